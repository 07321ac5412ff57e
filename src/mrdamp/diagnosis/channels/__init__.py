"""What the measured channels say before any law: noise, smoothing, interfaces of the chain."""
