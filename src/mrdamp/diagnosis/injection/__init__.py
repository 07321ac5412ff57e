"""Fault injection: a known effect of the catalogue put exactly into measured records, and found again or not."""
