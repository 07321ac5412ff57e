"""Dampers in MuJoCo Warp: many copies of a model at once, on a GPU or on Warp's CPU device.

    model, dampers = mrdamp.warp.put_model("frame.xml")
    data = dampers.make_data(nworld=4096)
    mujoco_warp.step(model, data)          # data.ctrl: the commanded currents, as ever

MuJoCo Warp takes no plugins. A damper becomes an actuator whose force is that of the same C++ chain, its force sensor a
user sensor. Needs the extra `warp` and, on a GPU, `cuda`.
"""

from mrdamp.warp.dampers import Dampers, put_model

__all__ = ["Dampers", "put_model"]
