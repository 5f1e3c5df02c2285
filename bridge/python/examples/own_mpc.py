"""A controller of one's own beside Sidehill's, over slopes and slide gains: a linear MPC in numpy.

    python bridge/python/examples/own_mpc.py --out out

The MPC linearises ICRIK about the reference of the next two seconds and solves for the inputs without limits. Nothing is
read from files: the vehicle comes from its measures, the path is an array.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import sidehill

STAGES = 20
STEP_S = 0.1
# Weights of errors, (x, y) per m^2 and yaw per rad^2, and of changes of the inputs, per (m/s)^2.
ERRORS = np.diag([10.0, 10.0, 2.0])
CHANGES = 1.0

SLOPES_DEG = (0.0, 6.0, 12.0)
LAMBDA_2_S_PER_RAD = (0.0, 2.0)


def turned(attitude_rad: tuple[float, float], by_rad: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns (roll, pitch) of a vehicle that turns on its plane, one row an angle."""
    roll, pitch = attitude_rad
    # The upward normal along the horizontal axes to the right and forward.
    right, forward, up = math.sin(roll) * math.cos(pitch), -math.sin(pitch), math.cos(roll) * math.cos(pitch)
    cos, sin = np.cos(by_rad), np.sin(by_rad)
    return np.stack([np.arctan2(cos * right + sin * forward, up), -np.arcsin(cos * forward - sin * right)], axis=-1)


class OwnMpc:
    """Gives the speeds told to the drives for what is measured."""

    def __init__(self) -> None:
        self.input = np.zeros(2)

    def __call__(self, measured: sidehill.Measured) -> tuple[float, float]:
        vehicle = measured.vehicle
        if measured.pose is None or measured.attitude_rad is None:
            return 0.0, 0.0
        x_m, y_m, _, yaw_rad = measured.pose
        reference = measured.reference(STEP_S * np.arange(STAGES + 1))
        states = reference[:, :3]
        # Headings that go on from the vehicle's own.
        states[:, 2] = yaw_rad + np.unwrap(np.remainder(states[:, 2] - yaw_rad + np.pi, 2 * np.pi) - np.pi)
        half_track_m = (vehicle.x_icr_right_m - vehicle.x_icr_left_m) / 2
        inputs = np.stack([reference[:-1, 3], half_track_m * np.diff(states[:, 2]) / STEP_S], axis=-1)
        attitudes = turned(measured.attitude_rad, states[:-1, 2] - yaw_rad)
        model = sidehill.linearise(vehicle, "icrik", states[:-1], inputs, attitudes, STEP_S)

        # Errors of all stages' ends: free + by_inputs du, from x+ = A x + B du + (f - x+ of the reference).
        error = np.array([x_m, y_m, yaw_rad]) - states[0]
        by_inputs, free = np.zeros((STAGES, 3, 2 * STAGES)), np.zeros((STAGES, 3))
        sensitivity = np.zeros((3, 2 * STAGES))
        for k in range(STAGES):
            error = model.A[k] @ error + model.f[k] - states[k + 1]
            sensitivity = model.A[k] @ sensitivity
            sensitivity[:, 2 * k : 2 * k + 2] += model.B[k]
            free[k], by_inputs[k] = error, sensitivity

        # Changes of the inputs from stage to stage: D (u + du) - u before the first.
        difference = np.eye(2 * STAGES) - np.eye(2 * STAGES, k=-2)
        change = difference @ inputs.ravel() - np.concatenate([self.input, np.zeros(2 * STAGES - 2)])
        hessian = np.einsum("kia,ij,kjb->ab", by_inputs, ERRORS, by_inputs) + CHANGES * difference.T @ difference
        slope = np.einsum("kia,ij,kj->a", by_inputs, ERRORS, free) + CHANGES * difference.T @ change
        self.input = inputs[0] - np.linalg.solve(hessian, slope)[:2]

        traction, steer = np.clip(self.input, -1, 1)
        return (traction - steer) / vehicle.correction_left, (traction + steer) / vehicle.correction_right


def path() -> npt.NDArray[np.float64]:
    """Returns points of two bends, m."""
    along = np.linspace(0, 8, 81)
    return np.stack([0.8 * np.sin(2 * np.pi * along / 8) ** 2 * np.sign(4 - along), along], axis=-1)


def main(out: Path) -> list[dict[str, Any]]:
    """Sweeps slope and slide gain, prints a row of figures each, and writes a plot of the last runs."""
    vehicle = sidehill.Vehicle.from_geometry(length_m=0.9, width_m=0.7, wheel_radius_m=0.15, mass_kg=120, speed_m_s=1.2)
    scenario = sidehill.Scenario(path=path(), vehicle=vehicle, name="two bends")
    rows: list[dict[str, Any]] = []
    for slope_deg in SLOPES_DEG:
        for lambda_2_s_per_rad in LAMBDA_2_S_PER_RAD:
            result = sidehill.simulate(
                scenario.with_(
                    vehicle=vehicle.with_(lambda_2_s_per_rad=lambda_2_s_per_rad),
                    terrain={"kind": "plane", "slope_deg": slope_deg, "uphill_heading_deg": 30},
                ),
                controllers=["icrik-mpc", OwnMpc(), "pure-pursuit"],
            )
            for run in result.metrics["runs"]:
                rows.append({"slope_deg": slope_deg, "lambda_2_s_per_rad": lambda_2_s_per_rad} | run)
                print(
                    f"{slope_deg:4.0f} deg, lambda_2 {lambda_2_s_per_rad:.0f} s/rad, {run['controller']:12}: cross-track "
                    f"RMS {100 * run['cross_track_rms_m']:5.2f} cm, largest {100 * run['cross_track_max_m']:5.2f} cm"
                )
    out.mkdir(parents=True, exist_ok=True)
    result.plot().savefig(out / "own_mpc.png")
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    main(parser.parse_args().out)
