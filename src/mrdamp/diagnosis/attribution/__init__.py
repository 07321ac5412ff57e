"""Attribution of the gap to parts of the chain and to regimes."""
