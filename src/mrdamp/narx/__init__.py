"""NARX networks from records: Bayesian regularisation, free-run refinement, choice of inputs, pruning.

The model is that of Chen, Ni and Or, "Characterization and modeling of a self-sensing MR damper under harmonic
loading" (Smart Structures and Systems, 2015), Eqs. (5), (9) and (11); the plugin runs its weights file.
"""

from mrdamp.narx.bayes import Posterior, minimise
from mrdamp.narx.data import PROTOCOL, Series, lagged, protocol, series
from mrdamp.narx.doubt import Doubt, doubt
from mrdamp.narx.judge import Judged, judge
from mrdamp.narx.network import Network
from mrdamp.narx.prune import Pruned, draw_course, prune
from mrdamp.narx.select import Candidate, Choice, draw_choice, select
from mrdamp.narx.train import FitNarx, train_narx

__all__ = [
    "PROTOCOL",
    "Candidate",
    "Choice",
    "Doubt",
    "FitNarx",
    "Judged",
    "Network",
    "Posterior",
    "Pruned",
    "Series",
    "doubt",
    "draw_choice",
    "draw_course",
    "judge",
    "lagged",
    "minimise",
    "protocol",
    "prune",
    "select",
    "series",
    "train_narx",
]
