"""NARX networks from records: Bayesian regularisation, free-run refinement, choice of inputs, pruning.

The model is that of Chen, Ni and Or, "Characterization and modeling of a self-sensing MR damper under harmonic
loading" (Smart Structures and Systems, 2015), Eqs. (5), (9) and (11); the plugin runs its weights file.
"""

from mrdamp.narx.data import lagged, series
from mrdamp.narx.network import Network
from mrdamp.narx.train import FitNarx, train_narx

__all__ = ["FitNarx", "Network", "lagged", "series", "train_narx"]
