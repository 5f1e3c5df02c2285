"""The controller in a loop of one's own: readings in, speeds for the drives out.

    python bridge/python/examples/closed_loop.py

The vehicle here is five lines of the ICRIK model on a slope of 10 deg; put a simulator or a robot in their place.
"""

from __future__ import annotations

import math
from pathlib import Path

import sidehill

CONFIG = Path(__file__).resolve().parents[3] / "config"
SLOPE_RAD = math.radians(10)


def attitude(yaw_rad: float) -> tuple[float, float]:
    """Returns (roll, pitch) at a heading on a plane that rises towards +Y_g."""
    right, forward = -math.sin(yaw_rad) * math.sin(SLOPE_RAD), -math.cos(yaw_rad) * math.sin(SLOPE_RAD)
    return math.atan2(right, math.cos(SLOPE_RAD)), -math.asin(forward)


def main() -> float:
    scenario = sidehill.Scenario.load(CONFIG / "scenarios/figure_eight_10deg.yaml")
    controller = sidehill.Controller(scenario, kind="icrik-mpc")
    vehicle, dt_s = scenario.vehicle, scenario.period_s

    x_m, y_m, _, yaw_rad = scenario.start_pose
    left = right = time_s = largest_m = 0.0
    while True:
        decision = controller.step(
            time_s,
            tread_speeds_m_s=(left, right),
            attitude_rad=attitude(yaw_rad),
            pose=(time_s, x_m, y_m, y_m * math.tan(SLOPE_RAD), yaw_rad),
        )
        if decision.finished or decision.status == "stopping":
            break
        largest_m = max(largest_m, abs(decision.cross_track_m or 0.0))

        # The drives are told, and reach at once, what their encoders shall count.
        left = decision.drive_traction_m_s - decision.drive_steer_m_s
        right = decision.drive_traction_m_s + decision.drive_steer_m_s
        effective = vehicle.correction_left * left, vehicle.correction_right * right
        body = sidehill.icr(vehicle, *attitude(yaw_rad), *effective)
        turn_rad = dt_s * float(body["omega_z_rad_s"])
        # With the heading in the middle of the step.
        sin, cos = math.sin(yaw_rad + 0.5 * turn_rad), math.cos(yaw_rad + 0.5 * turn_rad)
        x_m += dt_s * float(cos * body["v_x_m_s"] - sin * body["v_y_m_s"])
        y_m += dt_s * float(sin * body["v_x_m_s"] + cos * body["v_y_m_s"])
        yaw_rad += turn_rad
        time_s += dt_s
    print(f"{decision.status} after {time_s:.1f} s, at most {100 * largest_m:.2f} cm from the path")
    return largest_m


if __name__ == "__main__":
    main()
