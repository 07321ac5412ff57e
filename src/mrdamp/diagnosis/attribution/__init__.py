"""Where in the chain and in which regimes the gap lies."""
