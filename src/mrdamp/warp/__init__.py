"""Dampers in MuJoCo Warp: many copies of a model at once, on a GPU or on Warp's CPU device.

    model, dampers = mrdamp.warp.put_model("frame.xml")
    data = dampers.make_data(nworld=4096)
    mujoco_warp.step(model, data)          # data.ctrl: the commanded currents, as ever

MuJoCo Warp takes no plugins. A damper becomes an actuator whose force is that of the same C++ chain, its force sensor a
user sensor. Needs the extra `warp` and, on a GPU, `cuda`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mrdamp.errors import InputError

if TYPE_CHECKING:
    from mrdamp.warp.dampers import Dampers, put_model

__all__ = ["Dampers", "put_model"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    try:
        from mrdamp.warp import dampers
    except ModuleNotFoundError as error:
        if error.name not in ("warp", "mujoco_warp"):
            raise
        raise InputError("dampers in MuJoCo Warp need the extra `warp`: pip install 'mrdamp[warp]'") from None
    return getattr(dampers, name)
