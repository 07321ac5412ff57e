"""Evidence from the measured channels without a law: noise, smoothing, balances, comparison of channels."""
