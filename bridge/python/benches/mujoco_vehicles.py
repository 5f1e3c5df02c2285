"""Controllers on vehicles in MuJoCo, physics that none of them predicts with.

    python bridge/python/benches/mujoco_vehicles.py [--realistic SEEDS]

The wheels are on springs, and touch the ground in points. vehicles.py has the vehicles, and says what the table shows.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from vehicles import GRAVITY_M_S2, SAG_M, SPRINGS_HZ, Gyroscope, Measures, main

# vehicles.py has put the examples on the path.
from body import Array
from rover import MujocoRover

SUBSTEP_S = 0.002


def model(measures: Measures, slope_deg: float) -> mujoco.MjModel:
    """Returns the vehicle on a slope that rises towards +Y_g."""
    mass, radius, axles = measures.mass_kg, measures.wheel_radius_m, measures.axles_m
    wheels = actuators = couplings = ""
    wheel_kg = 0.02 * mass
    body_kg = mass - 2 * len(axles) * wheel_kg
    for side, right_m in (("left", -measures.half_width_m), ("right", measures.half_width_m)):
        for axle, (forward_m, share) in enumerate(zip(axles, measures.load_shares, strict=True)):
            load_n = 0.5 * share * mass * GRAVITY_M_S2
            stiffness = load_n / SAG_M
            damping = 1.4 * load_n / GRAVITY_M_S2 * 2 * math.pi * SPRINGS_HZ
            wheels += f"""
      <body name="{side}_{axle}" pos="{right_m} {forward_m} 0">
        <joint type="slide" axis="0 0 1" stiffness="{stiffness}" damping="{damping}" springref="{-SAG_M}"/>
        <joint name="{side}_{axle}" axis="-1 0 0" damping="{0.01 * mass * radius}"
               armature="{4 * mass * radius**2 / (2 * len(axles))}"/>
        <geom type="ellipsoid" size="{0.5 * measures.wheel_width_m} {radius} {radius}" mass="{wheel_kg}"
              friction="{measures.friction} 0.005 0.0001"/>
      </body>"""
            servo = 2000 * mass * radius**2 / len(axles)
            actuators += f'<velocity joint="{side}_{axle}" kv="{servo}"/>'
            if axle > 0:
                couplings += f"""
    <joint joint1="{side}_0" joint2="{side}_{axle}" solref="0.004 1" solimp="0.99 0.999 0.001"/>"""
    right_m, forward_m, height_m = measures.centre_of_mass_m
    length, width = 1.8 * max(axles), 1.8 * measures.half_width_m
    inertias = body_kg / 12 * np.array([length**2 + 0.09, width**2 + 0.09, length**2 + width**2])
    # The wheels' own mass is at their hubs.
    over = mass / body_kg
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{SUBSTEP_S}" integrator="implicitfast" cone="elliptic" impratio="20"/>
  <default><geom solref="0.01 1"/></default>
  <worldbody>
    <geom type="plane" size="40 40 0.1" euler="{slope_deg} 0 0" friction="{measures.friction} 0.005 0.0001"/>
    <body name="rover">
      <freejoint/>
      <inertial pos="{right_m * over} {forward_m * over} {(height_m - radius) * over}" mass="{body_kg}"
                diaginertia="{inertias[0]} {inertias[1]} {inertias[2]}"/>
{wheels}
    </body>
  </worldbody>
  <equality>{couplings}</equality>
  <actuator>{actuators}</actuator>
</mujoco>""")


class Vehicle(MujocoRover, Gyroscope):
    """One of the vehicles: the plant of `sidehill.simulate`."""

    def __init__(self, measures: Measures, slope_deg: float) -> None:
        self.model = model(measures, slope_deg)
        self.data = mujoco.MjData(self.model)
        self.slope_rad = math.radians(slope_deg)
        self.radius_m, self.side = measures.wheel_radius_m, len(measures.axles_m)
        names = [f"{side}_{axle}" for side in ("left", "right") for axle in range(self.side)]
        self._rates = [self.model.joint(name).dofadr[0] for name in names]

    @property
    def _wheel_rates_rad_s(self) -> Array:
        return np.asarray(self.data.qvel[self._rates])

    @property
    def yaw_rate_rad_s(self) -> float:
        return float(self.data.qvel[5])

    def reset(self, pose: tuple[float, ...], attitude: tuple[float, ...]) -> None:
        super().reset(pose, attitude)
        # Back to where it was put: it has rolled while it sank into its springs.
        x_m, y_m, _, _ = self.pose
        right_m, up_m = pose[0] - x_m, pose[1] - y_m
        self.data.qpos[:3] += [right_m, up_m, up_m * math.tan(self.slope_rad)]
        mujoco.mj_forward(self.model, self.data)


if __name__ == "__main__":
    main(__doc__ or "", Vehicle)
