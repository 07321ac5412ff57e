"""Training of controllers with stable-baselines3, and their export to files that NumPy alone can use.

from mrdamp.train.learn import train
from mrdamp.train.settings import Options

train(Options(environment="mrdamp/Frame-v0", algorithm="ppo", seed=1), "out/frame")
"""

from __future__ import annotations

import sys

from mrdamp.shown import CalledPackage

sys.modules[__name__].__class__ = CalledPackage  # `mrdamp.train(...)` is `mrdamp.api.train`
