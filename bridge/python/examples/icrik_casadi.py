"""ICRIK as a CasADi function, for an optimal control problem of one's own, and an MPC made with it.

    pip install casadi
    python bridge/python/examples/icrik_casadi.py

It is the model with which `icrik-mpc` predicts (`sidehill.linearise(vehicle, "icrik", ...)`), so that a solver that wants
expressions instead of arrays gets the same values and derivatives. The MPC, with IPOPT, is the whole nonlinear problem
with bounds on the inputs; a cycle takes about 6 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import sidehill

CONFIG = Path(__file__).resolve().parents[3] / "config"
Controller = Callable[[sidehill.Measured], tuple[float, float]]
SMOOTHING_M_S = 0.02
"""Speed within which the kinks at standstill are rounded off, m/s."""


def magnitude(value: Any) -> Any:
    """Returns |value|, with the derivative 1 at 0, where that of casadi.fabs is 0 and fits neither side."""
    return ca.if_else(value < 0, -value, value)


def body_velocity(vehicle: sidehill.Vehicle, roll: Any, pitch: Any, traction: Any, steer: Any, smoothing: float) -> Any:
    """Returns (v_x, v_y, omega_z) by equations (4) to (10), m/s and rad/s, smooth in the speeds.

    With s = steer / sqrt(steer^2 + smoothing^2), the ICRs of both directions of turning are blended by (1 +- s) / 2.
    """
    gain = ca.fmax(vehicle.speed_max_m_s - (ca.sqrt(traction**2 + smoothing**2) - smoothing), 0)
    excess = magnitude(pitch) - magnitude(roll)

    def icrs(sign: int) -> tuple[Any, Any, Any]:
        """Returns distance, middle and forward shift of the treads' ICRs for one direction, m."""
        shift = sign * vehicle.lambda_1_s_per_rad * gain
        further = ca.if_else(excess > 0, vehicle.lambda_2_s_per_rad * gain * excess, 0)
        # (9) where the left tread loses traction, (10) where the right one does; (1 - |roll/pitch|) pitch has no pole.
        left = vehicle.x_icr_left_m + shift * pitch - ca.if_else(sign * pitch < 0, further, 0)
        right = vehicle.x_icr_right_m + shift * pitch + ca.if_else(sign * pitch < 0, 0, further)
        forward = vehicle.y_icr_m + shift * roll
        half_width, half_length = vehicle.base_half_width_m, vehicle.base_half_length_m
        left = ca.if_else(left > -half_width, -half_width, left)
        right = ca.if_else(right < half_width, half_width, right)
        forward = ca.if_else(ca.fabs(forward) > half_length, ca.sign(forward) * half_length, forward)
        return right - left, (right + left) / 2, forward

    s = steer / ca.sqrt(steer**2 + smoothing**2)
    both = zip(icrs(1), icrs(-1), strict=True)
    distance, middle, forward = ((1 + s) / 2 * plus + (1 - s) / 2 * minus for plus, minus in both)
    omega = 2 * steer / distance
    return ca.vertcat(forward * omega, traction - middle * omega, omega)


def icrik(vehicle: sidehill.Vehicle, smoothing_m_s: float = SMOOTHING_M_S) -> ca.Function:
    """Returns the function (state, input, normal) -> rate of the state.

    state: (x_m, y_m, yaw_rad); rate in m/s and rad/s.
    input: effective (traction_m_s, steer_m_s), (V_r + V_l)/2 and (V_r - V_l)/2.
    normal: upward unit normal of the ground in the world; (0, 0, 1) is level. The attitude turns with the heading.

    Raises ValueError for a vehicle with terms beyond ICRIK.
    """
    if vehicle.to_dict().get("extension"):
        raise ValueError(f"vehicle: {vehicle.name} has an extension, which is not part of this model")
    state, told, normal = ca.SX.sym("state", 3), ca.SX.sym("input", 2), ca.SX.sym("normal", 3)
    yaw = state[2]
    # Upward normal along the body's horizontal axes.
    right = ca.cos(yaw) * normal[0] + ca.sin(yaw) * normal[1]
    forward = -ca.sin(yaw) * normal[0] + ca.cos(yaw) * normal[1]
    roll, pitch = ca.atan2(right, normal[2]), -ca.asin(forward)
    v_x, v_y, omega = ca.vertsplit(body_velocity(vehicle, roll, pitch, told[0], told[1], smoothing_m_s))
    # Equation (12).
    sideways = ca.cos(roll) * v_x + ca.sin(roll) * ca.sin(pitch) * v_y
    ahead = ca.cos(pitch) * v_y
    rate = ca.vertcat(
        ca.cos(yaw) * sideways - ca.sin(yaw) * ahead,
        ca.sin(yaw) * sideways + ca.cos(yaw) * ahead,
        omega * ca.cos(pitch) / ca.cos(roll),
    )
    return ca.Function("icrik", [state, told, normal], [rate], ["state", "input", "normal"], ["rate"])


def normal_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> list[float]:
    """Returns the upward normal, in the world, of the ground on which a vehicle stands so."""
    right, forward = math.sin(roll_rad) * math.cos(pitch_rad), -math.sin(pitch_rad)
    return [
        math.cos(yaw_rad) * right - math.sin(yaw_rad) * forward,
        math.sin(yaw_rad) * right + math.cos(yaw_rad) * forward,
        math.cos(roll_rad) * math.cos(pitch_rad),
    ]


class CasadiMpc:
    """A controller for `sidehill.simulate`: the nonlinear problem over the next stages, solved by IPOPT."""

    def __init__(self, vehicle: sidehill.Vehicle, stages: int = 25, step_s: float = 0.2) -> None:
        self.vehicle, self.stages, self.step_s = vehicle, stages, step_s
        rate = icrik(vehicle)
        self.problem = problem = ca.Opti()
        self.states, self.inputs = problem.variable(3, stages + 1), problem.variable(2, stages)
        self.start, self.normal, self.before = problem.parameter(3), problem.parameter(3), problem.parameter(2)
        self.reference = problem.parameter(3, stages + 1)
        problem.subject_to(self.states[:, 0] == self.start)
        cost: Any = 0
        before = self.before
        for k in range(stages):
            here, told = self.states[:, k], self.inputs[:, k]
            # The midpoint rule, as in Sidehill.
            middle = here + step_s / 2 * rate(here, told, self.normal)
            problem.subject_to(self.states[:, k + 1] == here + step_s * rate(middle, told, self.normal))
            error = self.states[:, k + 1] - self.reference[:, k + 1]
            cost += 10 * ca.sumsqr(error[:2]) + 0.05 * error[2] ** 2 + ca.sumsqr(told - before)
            before = told
        problem.subject_to(problem.bounded(-1, ca.vec(self.inputs), 1))
        problem.minimize(cost)
        problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "max_iter": 15, "tol": 1e-4})
        self.command = np.zeros(2)

    def __call__(self, measured: sidehill.Measured) -> tuple[float, float]:
        """Returns the speeds (left, right) told to the drives, m/s, for what is measured."""
        if measured.pose is None or measured.attitude_rad is None:
            return 0.0, 0.0
        x_m, y_m, _, yaw_rad = measured.pose
        reference = measured.reference(self.step_s * np.arange(self.stages + 1))[:, :3].T
        # Headings that go on from the vehicle's own.
        reference[2] = yaw_rad + np.unwrap(np.remainder(reference[2] - yaw_rad + np.pi, 2 * np.pi) - np.pi)
        problem = self.problem
        problem.set_value(self.start, [x_m, y_m, yaw_rad])
        problem.set_value(self.normal, normal_of(*measured.attitude_rad, yaw_rad))
        problem.set_value(self.before, self.command)
        problem.set_value(self.reference, reference)
        problem.set_initial(self.states, reference)
        problem.set_initial(self.inputs, np.tile(self.command[:, None], self.stages))
        found = problem.solve_limited()
        self.command = np.asarray(found.value(self.inputs))[:, 0]
        traction, steer = self.command
        return (traction - steer) / self.vehicle.correction_left, (traction + steer) / self.vehicle.correction_right


def beside_ours(own: Callable[[sidehill.Vehicle], Controller]) -> dict[str, float]:
    """Drives a slope of 12 deg with ours and the controller that `own` makes; returns their cross-track RMS, m."""
    scenario = sidehill.Scenario.load(CONFIG / "scenarios/figure_eight.yaml").with_(
        terrain={"kind": "plane", "slope_deg": 12, "uphill_heading_deg": 30},
        course={"shape": "figure_eight", "half_width_m": 1.6, "half_length_m": 2.6, "period_s": 40},
    )
    result = sidehill.simulate(scenario, controllers=["icrik-mpc", own(scenario.vehicle), "icrhk-mpc"])
    errors = {run["controller"]: float(run["cross_track_rms_m"]) for run in result.metrics["runs"]}
    for name, error in errors.items():
        print(f"{name:10}: cross-track RMS {100 * error:.2f} cm")
    return errors


def main() -> dict[str, float]:
    """Drives with the MPC in CasADi beside ours; returns their cross-track RMS, m."""
    return beside_ours(CasadiMpc)


if __name__ == "__main__":
    main()
