"""A skid-steer rover in MuJoCo, as a vehicle for `sidehill.simulate`.

Four wheels without steering, 46 kg, on a plane that rises towards +Y_g. The model's axes are the paper's: x right, y
forward, z up, so nothing is converted. What makes skid-steer contact behave: elliptic friction cones and a raised
impratio (else standing wheels creep downhill), wheels with the reflected inertia of their motors, velocity servos that
are not stiff (their slip would read as the ground's), and a step well below the contacts' time constant.
"""

# MuJoCo's classes are compiled and have no stubs.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import math

import mujoco
import numpy as np
from body import Array, Body

WHEEL_RADIUS_M = 0.165
TRACK_HALF_M = 0.285
AXLES_M = (-0.256, 0.256)
MASS_KG = 46.0
SUBSTEP_S = 0.002
SIDE = len(AXLES_M)
WHEELS = 2 * SIDE
# Reflected inertia of a geared motor, in units of the mass that a wheel carries times its radius squared. MuJoCo's
# contacts resist slip in proportion to the inertia behind it: wheels much lighter to spin than the body to push would
# slip forward rather than sideways, and the rover would hardly turn.
REFLECTED_INERTIA = 4.0
SERVO_NM_S = 100.0


def model(slope_deg: float, friction: float = 0.8, mass_centre_m: float = 0.02) -> mujoco.MjModel:
    """Returns the rover on its slope; the centre of mass is so far ahead of the middle."""
    wheels = actuators = ""
    for side, right_m in (("left", -TRACK_HALF_M), ("right", TRACK_HALF_M)):
        for axle, forward_m in enumerate(AXLES_M):
            name = f"{side}_{axle}"
            wheels += f"""
      <body name="{name}" pos="{right_m} {forward_m} 0">
        <joint name="{name}" axis="-1 0 0" damping="1" armature="{REFLECTED_INERTIA * MASS_KG * WHEEL_RADIUS_M**2 / WHEELS}"/>
        <geom type="ellipsoid" size="0.06 {WHEEL_RADIUS_M} {WHEEL_RADIUS_M}" mass="2"
              friction="{friction} 0.005 0.0001" rgba="0.1 0.1 0.1 1"/>
        <geom type="box" size="0.062 0.02 {0.9 * WHEEL_RADIUS_M}" mass="0.1" contype="0" conaffinity="0"
              rgba="0.6 0.6 0.6 1"/>
      </body>"""
            actuators += f'<velocity joint="{name}" kv="{SERVO_NM_S}"/>'
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{SUBSTEP_S}" integrator="implicitfast" cone="elliptic" impratio="20"/>
  <visual><global offwidth="1280" offheight="720"/><headlight ambient="0.4 0.4 0.4"/></visual>
  <asset>
    <texture name="grid" type="2d" builtin="checker" rgb1="0.55 0.5 0.4" rgb2="0.5 0.45 0.35" width="300" height="300"/>
    <material name="ground" texture="grid" texrepeat="1 1" texuniform="true"/>
  </asset>
  <default><geom solref="0.01 1"/></default>
  <worldbody>
    <light pos="0 0 10" dir="0 0 -1" directional="true"/>
    <geom type="plane" size="40 40 0.1" euler="{slope_deg} 0 0" friction="{friction} 0.005 0.0001" material="ground"/>
    <body name="rover">
      <freejoint/>
      <geom type="box" size="0.2 0.45 0.1" pos="0 {mass_centre_m} 0.08" mass="{MASS_KG - WHEELS * 2.1}"
            contype="0" conaffinity="0" rgba="0.8 0.55 0.1 1"/>
      <geom type="box" size="0.15 0.06 0.04" pos="0 0.36 0.22" mass="0.1" contype="0" conaffinity="0" rgba="0.2 0.3 0.7 1"/>
{wheels}
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>""")


class MujocoRover(Body):
    """The plant: reset(pose, attitude), step(v_left_m_s, v_right_m_s, dt_s), and what it measures."""

    radius_m, side = WHEEL_RADIUS_M, SIDE

    def __init__(self, slope_deg: float, friction: float = 0.8) -> None:
        self.model = model(slope_deg, friction)
        self.data = mujoco.MjData(self.model)
        self.slope_rad = math.radians(slope_deg)

    def reset(self, pose: tuple[float, ...], attitude: tuple[float, ...]) -> None:
        mujoco.mj_resetData(self.model, self.data)
        x_m, y_m, _, yaw_rad = pose
        roll_rad, pitch_rad = attitude
        # R = Rz(yaw) Ry(roll) Rx(pitch), the middle rotation is roll: equation (12).
        quaternion = np.array([1.0, 0, 0, 0])
        for axis, angle in (((0, 0, 1), yaw_rad), ((0, 1, 0), roll_rad), ((1, 0, 0), pitch_rad)):
            turn, product = np.empty(4), np.empty(4)
            mujoco.mju_axisAngle2Quat(turn, np.array(axis, dtype=float), angle)
            mujoco.mju_mulQuat(product, quaternion, turn)
            quaternion = product
        self.data.qpos[:3] = self._hubs_above(x_m, y_m)
        self.data.qpos[3:7] = quaternion
        mujoco.mj_forward(self.model, self.data)
        # Until it rests on its wheels.
        self.step(0.0, 0.0, 0.5)

    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> None:
        self.data.ctrl[: self.side] = v_left_m_s / self.radius_m
        self.data.ctrl[self.side :] = v_right_m_s / self.radius_m
        mujoco.mj_step(self.model, self.data, nstep=round(dt_s / SUBSTEP_S))

    @property
    def _hubs_m(self) -> Array:
        return np.asarray(self.data.qpos[:3])

    @property
    def _wheel_rates_rad_s(self) -> Array:
        return np.asarray(self.data.qvel[6 : 6 + WHEELS])

    @property
    def _rotation(self) -> Array:
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, self.data.qpos[3:7])
        return rotation.reshape(3, 3)
