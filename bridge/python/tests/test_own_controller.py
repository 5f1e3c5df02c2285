"""Controllers of one's own beside ours, figures of any log, references over a horizon."""

import json
import math
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
import sidehill
from conftest import untyped

FIGURES = (
    "cross_track_rms_m", "cross_track_p95_m", "cross_track_max_m", "along_track_rms_m", "heading_rms_rad", "goal_error_m",
    "mean_speed_m_s", "time_s", "steer_total_variation_m_s", "constraint_violations",
)  # fmt: skip


class Pursuit:
    """Steers at where the reference is in one second."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def __call__(self, measured: Any) -> Any:
        self.asked.append(measured)
        if measured.pose is None:
            return 0.0, 0.0
        x, y, _, yaw = measured.pose
        ahead = measured.reference(1.0)
        heading = math.atan2(-(ahead[0] - x), ahead[1] - y)
        error = math.remainder(heading - yaw, 2 * math.pi)
        vehicle = measured.vehicle
        steer = 0.5 * (vehicle.x_icr_right_m - vehicle.x_icr_left_m) * 0.8 * error
        # The reference waits for a vehicle that does not go.
        traction = max(0.1, measured.reference(0.5)[3])
        return (traction - steer) / vehicle.correction_left, np.float64(traction + steer) / vehicle.correction_right


def test_a_callable_drives_beside_ours(short: sidehill.Scenario) -> None:
    own = Pursuit()
    result = sidehill.simulate(short, controllers=["icrik-mpc", own])
    ours, theirs = result.metrics["runs"]
    assert (ours["controller"], theirs["controller"]) == ("icrik-mpc", "Pursuit")
    assert ours["completed"] and theirs["completed"] and ours.keys() == theirs.keys()
    assert ours["cross_track_rms_m"] < theirs["cross_track_rms_m"] < 0.2
    assert set(result.runs[1].log) >= {"x_m", "command_steer_m_s", "cross_track_m"}
    # It is asked once a control period, with what the sensors gave.
    times = [measured.time_s for measured in own.asked]
    np.testing.assert_allclose(np.diff(times), short.period_s)
    assert own.asked[0].period_s == short.period_s and own.asked[0].vehicle == short.vehicle
    assert own.asked[0].pose == short.start_pose and own.asked[0].attitude_rad == short.start_attitude_rad
    assert own.asked[0].pose_time_s == 0 and own.asked[0].yaw_rate_rad_s is None
    measured = own.asked[60]
    assert len(measured.tread_speeds_m_s) == 2 and abs(measured.cross_track_m) < 0.3 and measured.arc_length_m > 0.5
    # The command is what the log has.
    log = result.runs[1].log
    told = Pursuit()(measured)
    effective = (short.vehicle.correction_left * told[0] + short.vehicle.correction_right * told[1]) / 2
    assert log["command_traction_m_s"][60] == pytest.approx(effective, abs=1e-12)


def test_a_function_keeps_its_name_and_sees_late_and_rare_readings(short: sidehill.Scenario) -> None:
    seen = []

    def standing(measured: Any) -> Any:
        seen.append(measured)
        return 0, 0

    late = short.with_(
        sensors={"pose": {"timing": {"rate_hz": 4, "delay_s": 0.2}}},
        course={"shape": "straight", "length_m": 1, "speed_m_s": 1},
    )
    (run,) = sidehill.simulate(late, standing).metrics["runs"]
    assert run["controller"] == "standing" and not run["completed"] and run["ended_by"].startswith("not at the end")
    assert seen[0].pose is None and seen[0].cross_track_m is None and seen[0].pose_time_s is None
    ages = [measured.time_s - measured.pose_time_s for measured in seen if measured.pose is not None]
    assert 0.19 < min(ages) and max(ages) < 0.46


def test_a_callable_drives_an_object_too(short: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    from test_simulate import Rover

    rover = Rover(j8, 8)
    scenario = short.with_(terrain={"kind": "plane", "slope_deg": 8, "uphill_heading_deg": 0})
    (run,) = sidehill.simulate(scenario, [Pursuit()], plant=rover).metrics["runs"]
    assert run["completed"] and run["plant"] == "Rover" and run["controller"] == "Pursuit"


@pytest.mark.parametrize(
    ("given", "part"),
    [
        (None, "controllers: (v_left_m_s, v_right_m_s) is needed, not None"),
        ((0.1,), "controllers: (v_left_m_s, v_right_m_s) is needed"),
        ((0.1, math.nan), "controllers: v_right_m_s is nan"),
        (("a", 0), "controllers: v_left_m_s is 'a'"),
    ],
)
def test_what_a_callable_gives_wrongly_is_named(short: sidehill.Scenario, given: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.simulate(short, lambda measured: given)
    assert part in str(error.value), error.value


def test_what_a_callable_raises_comes_through(short: sidehill.Scenario) -> None:
    def broken(measured: Any) -> Any:
        if measured.time_s > 1:
            raise KeyError("gain")
        return 0.2, 0.2

    with pytest.raises(KeyError, match="gain") as error:
        sidehill.simulate(short, ["pure-pursuit", broken])
    assert error.traceback[-1].name == "broken"


def test_a_horizon_of_references_is_one_call(short: sidehill.Scenario) -> None:
    simulation = sidehill.Simulation(short)
    ahead = np.linspace(0, 3, 31)
    horizon = simulation.reference(ahead)
    assert horizon.shape == (31, 4) and horizon.dtype == np.float64
    assert horizon.tolist() == [list(simulation.reference(each)) for each in ahead]
    assert simulation.reference([0.0, 1.0]).tolist() == horizon[[0, 10]].tolist()
    assert simulation.reference([]).shape == (0, 4)
    for wrong in ([0.0, -1.0], [[0.0]], [math.nan], "1", None):
        with pytest.raises(ValueError, match="ahead_s: "):
            simulation.reference(untyped(wrong))


def test_threads_that_share_a_simulation_wait_for_each_other(short: sidehill.Scenario) -> None:
    simulation = sidehill.Simulation(short)
    ahead = [0.1] * 200

    def work() -> None:
        for _ in range(300):
            simulation.reference(ahead)
            simulation.step(0.1, 0.1, 0.005)
            assert simulation.time_s > 0 and simulation == simulation

    threads = [threading.Thread(target=work, daemon=True) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()
    assert simulation.time_s == pytest.approx(6)


def close(found: Any, expected: Any) -> None:
    for key in FIGURES:
        assert found[key] == pytest.approx(expected[key], rel=1e-3, abs=1e-4), key


@pytest.mark.parametrize("kind", ["icrik-mpc", "pure-pursuit"])
def test_figures_of_a_log_are_those_of_the_run(eight: sidehill.Scenario, kind: Any) -> None:
    # A row a step: the log has all that the figures are made of.
    scenario = eight.with_(step_s=0.05, controllers=[kind])
    (run,) = sidehill.simulate(scenario).runs
    found = sidehill.metrics(run.log, scenario)
    close(found, run.metrics)
    assert found["completed"] is run.metrics["completed"] is True


def test_any_log_has_figures(short: sidehill.Scenario, tmp_path: Path) -> None:
    scenario = short.with_(step_s=0.05, controllers=["icrik-mpc"])
    (run,) = sidehill.simulate(scenario).runs
    known = {name: run.log[name] for name in ("time_s", "x_m", "y_m", "yaw_rad")}
    pandas.DataFrame(run.log).to_csv(tmp_path / "run.csv", index=False)
    whole = sidehill.metrics(tmp_path / "run.csv", scenario)
    bare = sidehill.metrics(pandas.DataFrame(known), scenario)
    assert whole.keys() - bare.keys() == {"steer_total_variation_m_s", "constraint_violations"}
    assert all(bare[key] == pytest.approx(whole[key], abs=1e-3) for key in bare)
    # A path as an array: this one is straight, from where the vehicle starts.
    x, y, _, yaw = scenario.start_pose
    path = np.array([x, y]) + np.linspace(0, 2, 21)[:, None] * np.array([-math.sin(yaw), math.cos(yaw)])
    by_array = sidehill.metrics(known, path, scenario.vehicle)
    assert by_array["cross_track_rms_m"] == pytest.approx(whole["cross_track_rms_m"], abs=2e-3)
    # Beside the path it is beside it.
    moved = known | {"x_m": known["x_m"] + 0.1 * math.cos(yaw), "y_m": known["y_m"] + 0.1 * math.sin(yaw)}
    assert sidehill.metrics(moved, scenario)["cross_track_rms_m"] == pytest.approx(0.1, abs=0.01)
    holes = known | {"x_m": np.where(np.arange(len(known["x_m"])) % 7 == 3, math.nan, known["x_m"])}
    assert sidehill.metrics(holes, scenario)["cross_track_rms_m"] == pytest.approx(whole["cross_track_rms_m"], abs=1e-3)
    json.dumps(whole)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"x_m": None}, "log: the column x_m is missing"),
        ({"y_m": [0.0]}, "log: y_m has 1 values, time_s has 3"),
        ({"yaw_rad": ["a", "b", "c"]}, "log: yaw_rad: numbers are needed"),
        ({"time_s": [0.0, 0.2, 0.1]}, "log: time_s does not increase"),
        ({"time_s": [0.0, math.nan, 0.1]}, "log: time_s: nan is not finite"),
        ({"x_m": [math.nan] * 3}, "log: no row has a pose"),
        ({"command_traction_m_s": [0.0] * 3}, "log: the column command_steer_m_s is missing"),
    ],
)
def test_what_is_wrong_with_a_log_is_named(short: sidehill.Scenario, change: Any, part: Any) -> None:
    log = {"time_s": [0.0, 0.1, 0.2], "x_m": [0.0] * 3, "y_m": [0.0] * 3, "yaw_rad": [0.0] * 3} | change
    log = {name: values for name, values in log.items() if values is not None}
    with pytest.raises(ValueError) as error:
        sidehill.metrics(log, short)
    assert part in str(error.value), error.value
    with pytest.raises(ValueError, match="log: a path, a dict of columns or a DataFrame is needed, not int"):
        sidehill.metrics(untyped(3), short)
