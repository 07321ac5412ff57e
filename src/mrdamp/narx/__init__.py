"""NARX networks from records: Bayesian regularisation, free-run refinement, choice of inputs, pruning.

The model is that of Chen, Ni and Or, "Characterization and modeling of a self-sensing MR damper under harmonic
loading" (Smart Structures and Systems, 2015), Eqs. (5), (9) and (11); the plugin runs its weights file.
"""

from mrdamp.narx.bayes import Posterior, minimise
from mrdamp.narx.data import PROTOCOL, Series, lagged, protocol, series
from mrdamp.narx.error_bars import ErrorBars, error_bars
from mrdamp.narx.evaluation import Evaluation, evaluate
from mrdamp.narx.network import Network
from mrdamp.narx.prune import Pruned, draw_pruning, prune
from mrdamp.narx.select import Candidate, Choice, draw_choice, select
from mrdamp.narx.train import FitNarx, train_narx

__all__ = [
    "PROTOCOL",
    "Candidate",
    "Choice",
    "ErrorBars",
    "Evaluation",
    "FitNarx",
    "Network",
    "Posterior",
    "Pruned",
    "Series",
    "draw_choice",
    "draw_pruning",
    "error_bars",
    "evaluate",
    "lagged",
    "minimise",
    "protocol",
    "prune",
    "select",
    "series",
    "train_narx",
]
