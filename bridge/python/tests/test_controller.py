"""The controller, step by step."""

import math
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import untyped


def drive(scenario: Any, controller: Any, seconds: Any = math.inf, dt_s: Any = None) -> Any:
    """Drives the controller on an ICRIK model of its own on a plane, and returns all decisions."""
    vehicle = controller.vehicle
    dt_s = dt_s or controller.period_s
    x, y, z, yaw = scenario.start_pose
    plane = scenario.to_dict()["terrain"]
    slope, uphill = math.radians(plane["slope_deg"]), math.radians(plane["uphill_heading_deg"])
    # The upward normal leans away from where the ground rises to.
    normal = np.array([math.sin(uphill) * math.sin(slope), -math.cos(uphill) * math.sin(slope), math.cos(slope)])
    left = right = time_s = 0.0
    decisions = []
    while time_s < seconds:
        cos, sin = math.cos(yaw), math.sin(yaw)
        n = np.array([cos * normal[0] + sin * normal[1], -sin * normal[0] + cos * normal[1], normal[2]])
        attitude = (math.atan2(n[0], n[2]), -math.asin(n[1]))
        decision = controller.step(
            time_s, tread_speeds_m_s=(left, right), attitude_rad=attitude, pose=(time_s, x, y, z, yaw)
        )
        decisions.append(decision)
        if decision.finished:
            break
        left = decision.drive_traction_m_s - decision.drive_steer_m_s
        right = decision.drive_traction_m_s + decision.drive_steer_m_s
        body = sidehill.icr(vehicle, *attitude, vehicle.correction_left * left, vehicle.correction_right * right)
        x += dt_s * float(cos * body["v_x_m_s"] - sin * body["v_y_m_s"])
        y += dt_s * float(sin * body["v_x_m_s"] + cos * body["v_y_m_s"])
        yaw += dt_s * float(body["omega_z_rad_s"])
        time_s = len(decisions) * dt_s
    return decisions


def test_a_loop_of_ones_own_follows_the_path(short: sidehill.Scenario) -> None:
    controller = sidehill.Controller(short, "icrik-mpc", seed=1)
    decisions = drive(short, controller, seconds=60)
    assert decisions[-1].finished and decisions[-1].status == "finished"
    assert max(abs(decision.cross_track_m) for decision in decisions) < 0.02
    assert decisions[-1].arc_length_m == pytest.approx(2, abs=0.05)


def test_a_decision_has_what_it_is_named_for(short: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    controller = sidehill.Controller(short)
    assert (controller.kind, controller.period_s, controller.vehicle) == ("icrik-mpc", 0.05, j8)
    first = controller.step(0.0)
    assert (first.status, first.reason, first.estimate, first.cross_track_m) == ("waiting", None, None, None)
    decision = drive(short, sidehill.Controller(short), seconds=1)[-1]
    assert decision.status == "tracking" and decision.reason is None and not decision.finished
    assert decision.plan.shape == (41, 3) and decision.plan.dtype == np.float64
    estimate = decision.estimate
    np.testing.assert_allclose(decision.plan[0], [estimate.x_m, estimate.y_m, estimate.yaw_rad], atol=0.05)
    assert estimate.covariance.shape == (3, 3) and (np.diag(estimate.covariance) > 0).all()
    assert estimate.time_s == decision.time_s and len(decision.reference_pose) == 3
    assert decision.solve_us > 0 and decision.cycle_us >= decision.solve_us and decision.iterations >= 0
    # What the drives are told is (11) solved for it.
    left = j8.correction_left * (decision.drive_traction_m_s - decision.drive_steer_m_s)
    right = j8.correction_right * (decision.drive_traction_m_s + decision.drive_steer_m_s)
    assert (right + left) / 2 == pytest.approx(decision.traction_m_s, abs=1e-15)
    assert (right - left) / 2 == pytest.approx(decision.steer_m_s, abs=1e-15)
    assert drive(short, sidehill.Controller(short, "pure-pursuit"), seconds=1)[-1].plan is None


def test_a_silent_pose_ends_in_a_stop_with_its_reason(short: sidehill.Scenario) -> None:
    controller = sidehill.Controller(short)
    last = drive(short, controller, seconds=1.5)[-1]
    # It drives on for up to 12 s; treads that say that it hardly moves keep it from the end of its path.
    for cycle in range(260):
        last = controller.step(1.5 + 0.05 * cycle, tread_speeds_m_s=(0.01, 0.01), attitude_rad=(0.0, 0.0))
    assert last.status == "stopping" and last.reason
    assert last.traction_m_s == last.steer_m_s == 0
    controller.rearm()
    assert controller.step(19.0).status == "waiting"
    controller.request_stop()
    assert controller.step(19.05).status == "stopping"


def test_a_yaw_rate_turns_the_heading_between_poses(short: sidehill.Scenario) -> None:
    estimated = {}
    for yaw_rate_rad_s in (None, -0.2, 0.2):
        controller = sidehill.Controller(short)
        drive(short, controller, seconds=0.5)
        for cycle in range(5):
            decision = controller.step(
                0.5 + 0.05 * cycle, tread_speeds_m_s=(0.3, 0.3), attitude_rad=(0.0, 0.0), yaw_rate_rad_s=yaw_rate_rad_s
            )
        estimated[yaw_rate_rad_s] = untyped(decision.estimate).yaw_rad
    # For 0.2 s or more the one vehicle turned by 0.2 rad/s to the left and the other to the right.
    assert estimated[0.2] - estimated[-0.2] > 0.04
    assert estimated[-0.2] < estimated[None] < estimated[0.2]


def test_another_vehicle_and_seed_are_taken(short: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    other = sidehill.Vehicle.from_dict(j8.to_dict() | {"name": "other", "correction_left": 1.1})
    controller = sidehill.Controller(short, kind="icrhk-mpc", vehicle=other, seed=2**63)
    assert (controller.vehicle, controller.kind) == (other, "icrhk-mpc")


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({"kind": "mpc"}, "kind: 'mpc' is not a controller, they are icrik-mpc"),
        ({"kind": 3}, "kind: 3"),
        ({"vehicle": "j8.yaml"}, "vehicle: a sidehill.Vehicle is needed"),
        ({"seed": -1}, "seed: -1"),
        ({"seed": 1.5}, "seed: 1.5"),
    ],
)
def test_a_controller_names_the_argument(short: sidehill.Scenario, keywords: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.Controller(short, **keywords)
    assert part in str(error.value)
    with pytest.raises(ValueError, match="scenario: a sidehill.Scenario is needed"):
        sidehill.Controller(untyped("scenario.yaml"), **keywords)


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({"time_s": None}, "time_s: None is not a number"),
        ({"time_s": math.nan}, "time_s: NaN is not finite"),
        ({"time_s": "0"}, "time_s: '0' is not a number"),
        ({"tread_speeds_m_s": 0.3}, "tread_speeds_m_s: (left, right) is needed"),
        ({"tread_speeds_m_s": (0.3,)}, "tread_speeds_m_s: (left, right) is needed"),
        ({"tread_speeds_m_s": (0.3, None)}, "tread_speeds_m_s: right is None"),
        ({"tread_speeds_m_s": np.zeros((2, 2))}, "tread_speeds_m_s: left is"),
        ({"tread_speeds_m_s": {"left": 0.3, "right": 0.3}}, "tread_speeds_m_s"),
        ({"attitude_rad": (0.1, math.inf)}, "attitude_rad: pitch is inf"),
        ({"attitude_rad": (5.3, 0.0)}, "attitude_rad: roll"),
        ({"pose": (0, 0, 0, 0)}, "pose: (time_s, x_m, y_m, z_m, yaw_rad) is needed"),
        ({"pose": (0, 0, math.nan, 0, 0)}, "pose: y_m is nan"),
        ({"yaw_rate_rad_s": math.nan}, "yaw_rate_rad_s: NaN is not finite"),
        ({"yaw_rate_rad_s": (0.1,)}, "yaw_rate_rad_s: (0.1,) is not a number"),
        ({"attitude_deg": (1, 2)}, "attitude_deg: unknown"),
    ],
)
def test_step_names_the_argument_and_changes_nothing(short: sidehill.Scenario, keywords: Any, part: Any) -> None:
    controller, other = sidehill.Controller(short), sidehill.Controller(short)
    drive(short, controller, seconds=0.5), drive(short, other, seconds=0.5)
    with pytest.raises(ValueError) as error:
        controller.step(**({"time_s": 0.5} | keywords))
    assert part in str(error.value), error.value
    after, reference = (each.step(0.5, tread_speeds_m_s=np.array([0.1, 0.2])) for each in (controller, other))
    assert (after.traction_m_s, after.steer_m_s) == (reference.traction_m_s, reference.steer_m_s)


def test_threads_take_turns(short: sidehill.Scenario) -> None:
    controller = sidehill.Controller(short)
    steps = [threading.Thread(target=lambda: [controller.step(0.0) for _ in range(200)]) for _ in range(4)]
    for step in steps:
        step.start()
    for step in steps:
        step.join(timeout=60)
        assert not step.is_alive()
    controller.rearm()
    assert controller.step(0.1).status == "waiting"


def resident_kib() -> int:
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in status if line.startswith("VmRSS")).split()[1])


def test_memory_does_not_grow(short: sidehill.Scenario) -> None:
    """SIDEHILL_STEPS sets the number of steps. The rover drives in circles on a level floor, without end."""
    steps = int(os.environ.get("SIDEHILL_STEPS", "50000"))
    circles = short.with_(
        terrain={"kind": "plane", "slope_deg": 0, "uphill_heading_deg": 0},
        # 1257 steps each.
        course={"shape": "circle", "radius_m": 5, "speed_m_s": 0.5, "turns": steps // 1200 + 1},
    )
    controller = sidehill.Controller(circles)
    vehicle, dt_s = circles.vehicle, circles.period_s
    span = vehicle.x_icr_right_m - vehicle.x_icr_left_m
    middle = (vehicle.x_icr_right_m + vehicle.x_icr_left_m) / 2
    x, y, z, yaw = circles.start_pose
    left = right = 0.0
    resident = []
    for step in range(steps):
        time_s = step * dt_s
        decision = controller.step(
            time_s, tread_speeds_m_s=(left, right), attitude_rad=(0.0, 0.0), pose=(time_s, x, y, z, yaw)
        )
        assert decision.status in ("waiting", "tracking"), decision.reason
        assert decision.plan is not None and untyped(decision.estimate).covariance is not None
        if step % 100 == 0:
            with pytest.raises(ValueError):
                controller.step(time_s, pose=(math.nan,) * 5)
        left = decision.drive_traction_m_s - decision.drive_steer_m_s
        right = decision.drive_traction_m_s + decision.drive_steer_m_s
        # ICRHK, equation (4) on level ground.
        effective = vehicle.correction_left * left, vehicle.correction_right * right
        omega = (effective[1] - effective[0]) / span
        v_x = vehicle.y_icr_m * omega
        v_y = (effective[1] + effective[0]) / 2 - middle * omega
        sin, cos = math.sin(yaw + omega * dt_s / 2), math.cos(yaw + omega * dt_s / 2)
        x, y, yaw = x + dt_s * (cos * v_x - sin * v_y), y + dt_s * (sin * v_x + cos * v_y), yaw + dt_s * omega
        if step % (steps // 10) == 0:
            resident.append(resident_kib())
    resident.append(resident_kib())
    print("resident, KiB:", *resident)
    # From a fifth of the steps on: less than 26 bytes a step in 50,000, one in a million.
    assert resident[-1] - resident[2] < 1024, resident


def test_controllers_and_simulations_are_freed(short: sidehill.Scenario) -> None:
    resident = []
    for _ in range(4):
        for _ in range(200):
            controller, simulation = sidehill.Controller(short), sidehill.Simulation(short)
            controller.step(0.0)
            simulation.step(0.1, 0.1, 0.05)
        resident.append(resident_kib())
    # A controller alone holds more than 100 KiB.
    assert resident[-1] - resident[1] < 4096, resident
