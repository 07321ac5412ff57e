"""Simulator, records and residuals of a rig."""
