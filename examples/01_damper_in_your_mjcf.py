"""A damper in an MJCF of your own: a mass on a spring, released, with the damper off and on.

python examples/01_damper_in_your_mjcf.py
"""

import mujoco
import numpy as np

import mrdamp  # noqa: F401  (registers the plugins)

MJCF = """
<mujoco>
  <extension>
    <plugin plugin="mrdamp.damper">
      <instance name="mr">
        <config key="law" value="bingham"/>
        <config key="c0a" value="60"/> <config key="c0b" value="50"/>
        <config key="fya" value="2"/> <config key="fyb" value="150"/>
        <config key="v_ref" value="0.01"/>
        <config key="driver_lag_tau" value="0.008"/>
      </instance>
    </plugin>
  </extension>
  <worldbody>
    <body>
      <joint name="slide" type="slide" axis="1 0 0" stiffness="20000"/>
      <geom size=".1" mass="50"/>
    </body>
  </worldbody>
  <actuator> <plugin joint="slide" plugin="mrdamp.damper" instance="mr"/> </actuator>
</mujoco>
"""


def main(seconds: float = 2.0) -> dict[float, float]:
    """Motion left at the end (mm) by current (A)."""
    model = mujoco.MjModel.from_xml_string(MJCF)
    left = {}
    for current in (0.0, 1.0):
        data = mujoco.MjData(model)
        data.qpos[0], data.ctrl[0] = 0.05, current
        path = []
        while data.time < seconds:
            mujoco.mj_step(model, data)
            path.append(float(data.qpos[0]))
        left[current] = 1e3 * float(np.ptp(path[-len(path) // 4 :]))
        print(f"{current:g} A: {left[current]:6.2f} mm of motion in the last quarter of {seconds:g} s")
    return left


if __name__ == "__main__":
    main()
