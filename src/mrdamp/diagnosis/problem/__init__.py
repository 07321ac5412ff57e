"""Simulators, records and residuals of a rig."""
