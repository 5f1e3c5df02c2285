"""The prediction models with their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from . import _sidehill
from ._arrays import broadcast, numbers
from ._sidehill import Vehicle

_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Linearisation:
    """A model about states x = (x_m, y_m, yaw_rad) and inputs u = (traction_m_s, steer_m_s): f(x, u) ~ A x + B u + c.

    f is the rate of x, or with a step the state after it. Arrays have the batch's shape before their own.
    """

    f: _Floats
    """Rate of the state in the world, m/s and rad/s, or the state after the step, m and rad: shape (..., 3)."""
    A: _Floats
    """df/dx, also through the attitude, which turns with the heading: shape (..., 3, 3)."""
    B: _Floats
    """df/du: shape (..., 3, 2)."""
    c: _Floats
    """f - A x - B u: shape (..., 3)."""
    body_velocity: _Floats
    """(v_x, v_y, omega_z) in the body frame, m/s and rad/s: shape (..., 3)."""
    body_velocity_by_attitude: _Floats
    """Its derivatives by (roll, pitch), per rad: shape (..., 3, 2)."""
    body_velocity_by_input: _Floats
    """Its derivatives by (traction, steer), per m/s: shape (..., 3, 2)."""


def linearise(
    vehicle: Vehicle,
    model: Literal["icrik", "icrhk", "contact"],
    state: npt.ArrayLike,
    input: npt.ArrayLike,
    attitude: npt.ArrayLike,
    step_s: float | None = None,
    smoothing_m_s: float | None = None,
) -> Linearisation:
    """Returns a prediction model of the MPCs about states and inputs, with analytic Jacobians.

    model: icrik, equations (4)-(10) and (12) of the paper with the terms of the vehicle's extension; icrhk, the same on
        level ground; contact, the steady balance of wheel friction, from what `vehicle.contact` knows or guesses.
    state: (x_m, y_m, yaw_rad) in the world: shape (..., 3).
    input: effective (traction_m_s, steer_m_s), (V_r + V_l)/2 and (V_r - V_l)/2: shape (..., 2).
    attitude: (roll, pitch) at that heading, rad, right side down and nose up positive: shape (..., 2); the ground is the
        plane on which the vehicle stands so.
    step_s: duration of a step by the midpoint rule, as the MPCs make it, s; without it rates are linearised.
    smoothing_m_s: speed within which the models' kinks at standstill are rounded off, m/s; that of the MPCs by default.

    The shapes before the last axis broadcast. Raises ValueError with the argument's name where it has another shape, is
    not finite or out of range (angles +-pi/2, tread speeds +-100 m/s).
    """
    named: dict[str, _Floats] = {}
    for name, value, parts in (
        ("state", state, ("x_m", "y_m", "yaw_rad")),
        ("input", input, ("traction_m_s", "steer_m_s")),
        ("attitude", attitude, ("roll_rad", "pitch_rad")),
    ):
        array = numbers(name, value)
        if array.ndim == 0 or array.shape[-1] != len(parts):
            raise ValueError(f"{name}: shape {array.shape} does not end in {len(parts)}: ({', '.join(parts)})")
        named |= {f"{name}: {part}": array[..., index] for index, part in enumerate(parts)}
    shape, (x, y, yaw, traction, steer, roll, pitch) = broadcast(named)
    found = _sidehill.linearise(vehicle, model, yaw, traction, steer, roll, pitch, step_s, smoothing_m_s)
    part = {name: column.reshape(*shape, 3) for name, column in found.items()}
    at, told = np.stack([x, y, yaw], -1).reshape(*shape, 3), np.stack([traction, steer], -1).reshape(*shape, 2)
    by_state = np.zeros((*shape, 3, 3))
    by_state[..., 2] = part["by_yaw"]
    f = part["change"]
    if step_s is not None:
        by_state += np.eye(3)
        f = at + f
    by_input = np.stack([part["by_traction"], part["by_steer"]], -1)
    return Linearisation(
        f=f,
        A=by_state,
        B=by_input,
        c=f - (by_state @ at[..., None] + by_input @ told[..., None])[..., 0],
        body_velocity=part["velocity"],
        body_velocity_by_attitude=np.stack([part["velocity_by_roll"], part["velocity_by_pitch"]], -1),
        body_velocity_by_input=np.stack([part["velocity_by_traction"], part["velocity_by_steer"]], -1),
    )
