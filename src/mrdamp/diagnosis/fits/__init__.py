"""Fits of hypotheses, and the search over hypotheses."""
