"""Simulations: the program's figures, and other simulators as the vehicle."""

import copy
import csv
import json
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import repository, untyped

TIMES = {"solve_us", "cycle_us", "deadline_misses"}


def figures(run: dict[str, Any]) -> Any:
    return {key: value for key, value in run.items() if key not in TIMES}


KINDS = ["icrik-mpc", "icrhk-mpc", "contact-mpc", "diffdrive-mpc", "pure-pursuit"]


def same_as_the_program(
    run: Callable[..., str], tmp_path: Path, scenario: Any, controllers: Any, plant: Any, seed: Any
) -> None:
    """The wheel's figures and logs of a scenario's file are the program's, bit by bit."""
    named = [argument for kind in controllers for argument in ("--controller", kind)]
    arguments = ["--plant", plant, "--seed", seed, *named, "--format", "json", "--out", tmp_path / "out"]
    printed = json.loads(run("simulate", scenario, *arguments))
    result = sidehill.simulate(sidehill.Scenario.load(scenario), controllers=controllers, plant=plant, seed=seed)
    assert result.metrics.keys() == printed.keys() == {"runs"}
    assert [figures(each) for each in result.metrics["runs"]] == [figures(each) for each in printed["runs"]]
    assert [each["controller"] for each in printed["runs"]] == controllers
    assert result.metrics["runs"][0]["cross_track_rms_m"] > 0
    for each in result.runs:
        assert each.metrics in result.metrics["runs"]
        with open(tmp_path / "out" / f"{each.controller}.csv") as file:
            rows = list(csv.DictReader(file))
        log = each.log
        assert list(log) == list(rows[0])
        for name in set(log) - TIMES:
            values = [row[name] for row in rows]
            if name in ("status", "reason", "learned_unobserved"):
                assert log[name] == values
            else:
                assert log[name].dtype == np.float64
                expected = np.array([float(value) if value else math.nan for value in values])
                np.testing.assert_array_equal(log[name], expected)


@pytest.mark.parametrize(
    ("name", "plant", "controllers"),
    [
        ("figure_eight", "icrik", KINDS),
        ("figure_eight_15deg", "contact", ["contact-mpc", "icrik-mpc"]),
        ("slalom", "icrik", ["icrik-mpc", "pure-pursuit"]),
        ("j8_route", "contact", ["icrik-mpc"]),
    ],
)
def test_figures_and_logs_are_those_of_the_program_bit_by_bit(
    run: Callable[..., str], tmp_path: Path, name: Any, plant: Any, controllers: Any
) -> None:
    same_as_the_program(run, tmp_path, repository(f"config/scenarios/{name}.yaml"), controllers, plant, 3)


def test_a_campaigns_run_with_all_its_draws_is_that_of_the_program_bit_by_bit(
    run: Callable[..., str], tmp_path: Path
) -> None:
    run("campaign", repository("config/campaigns/default.yaml"), "--write-scenario", 17, "--out", tmp_path / "run.yaml")
    same_as_the_program(run, tmp_path, tmp_path / "run.yaml", KINDS, "contact", 8)


def test_conditions_with_sensors_and_noise_are_those_of_the_program(
    run: Callable[..., str], tmp_path: Path, short: sidehill.Scenario
) -> None:
    changed = short.with_(
        sensors={"pose": {"timing": {"rate_hz": 10, "delay_s": 0.1}, "errors": {"noise_std_m": 0.01}}},
        seed=11,
    )
    (tmp_path / "scenario.yaml").write_text(
        json.dumps(changed.to_dict() | {"vehicle": str(repository("config/vehicles/j8.yaml"))})
    )
    printed = json.loads(run("simulate", tmp_path / "scenario.yaml", "--format", "json"))
    assert [figures(each) for each in sidehill.simulate(changed).metrics["runs"]] == [
        figures(each) for each in printed["runs"]
    ]
    other = sidehill.simulate(changed, seed=12).metrics["runs"][0]
    assert other["cross_track_rms_m"] != printed["runs"][0]["cross_track_rms_m"] and other["seed"] == 12


def test_scenarios_from_dicts_name_what_is_wrong(short: sidehill.Scenario, tmp_path: Path) -> None:
    keys = short.to_dict() | {"vehicle": str(repository("config/vehicles/j8.yaml"))}
    again = sidehill.Scenario.from_dict(keys)
    assert again.name == "short" and again.controllers == ["icrik-mpc", "pure-pursuit"]
    assert figures(sidehill.simulate(again).metrics["runs"][0]) == figures(sidehill.simulate(short).metrics["runs"][0])
    for change, part in [
        ({"step_s": math.nan}, "step_s"),
        ({"step_s": None}, "step_s"),
        ({"step_s": 5}, "step_s"),
        ({"step_ms": 5}, "step_ms"),
        ({"terrain": {"kind": "plane", "slope_rad": 0.1, "uphill_heading_deg": 0}}, "slope"),
        ({"controller": {"motor_lag_ms": 1}}, "motor_lag_ms"),
        ({"controllers": ["mpc"]}, "mpc"),
        ({"seed": object()}, "object"),
    ]:
        with pytest.raises(ValueError) as error:
            sidehill.Scenario.from_dict(keys | untyped(change))
        assert part in str(error.value), error.value
        with pytest.raises(ValueError) as error:
            short.with_(**untyped(change))
        assert part in str(error.value), error.value
    with pytest.raises(FileNotFoundError, match="no.yaml"):
        short.with_(vehicle="no.yaml")
    with pytest.raises(FileNotFoundError, match="no.yaml"):
        sidehill.Scenario.load(tmp_path / "no.yaml")


def test_with_replaces_only_what_is_given_of_the_controller(eight: sidehill.Scenario) -> None:
    changed = eight.with_(controller={"estimator": {"gate": 50.0}}, seed=4)
    controller = changed.to_dict()["controller"]
    assert controller["estimator"]["gate"] == 50 and controller["estimator"]["pose_sigma_m"] == 0.0001
    assert (changed.seed, eight.seed) == (4, 1)
    assert changed.vehicle == eight.vehicle and changed.name == eight.name


def test_scenarios_and_vehicles_are_copied_and_pickled(eight: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    changed = eight.with_(seed=4)
    for again in (pickle.loads(pickle.dumps(changed)), copy.deepcopy(changed)):
        assert again.to_dict() == changed.to_dict() and again.vehicle == j8
    assert pickle.loads(pickle.dumps(j8)) == j8


class Rover:
    """The ICRIK model on a plane that rises towards +Y_g, as a simulator of one's own."""

    def __init__(self, vehicle: Any, slope_deg: Any = 5.3) -> None:
        self.vehicle, self.slope = vehicle, math.radians(slope_deg)
        self.calls: list[Any] = []

    def reset(self, pose: Any, attitude: Any) -> None:
        self.pose, self.attitude_rad, self.tread_speeds_m_s = pose, attitude, (0.0, 0.0)
        self.calls.append(("reset", pose, attitude))

    def step(self, v_left_m_s: Any, v_right_m_s: Any, dt_s: Any) -> None:
        x, y, z, yaw = self.pose
        left, right = self.vehicle.correction_left * v_left_m_s, self.vehicle.correction_right * v_right_m_s
        body = sidehill.icr(self.vehicle, self.attitude_rad[0], self.attitude_rad[1], left, right)
        sin, cos = math.sin(yaw), math.cos(yaw)
        x += dt_s * float(cos * body["v_x_m_s"] - sin * body["v_y_m_s"])
        y += dt_s * float(sin * body["v_x_m_s"] + cos * body["v_y_m_s"])
        yaw += dt_s * float(body["omega_z_rad_s"])
        self.pose = (x, y, y * math.tan(self.slope), yaw)
        # The normal (0, -sin, cos) of the plane, seen from the body.
        n = (-math.sin(yaw) * math.sin(self.slope), -math.cos(yaw) * math.sin(self.slope), math.cos(self.slope))
        self.attitude_rad = (math.atan2(n[0], n[2]), -math.asin(n[1]))
        self.tread_speeds_m_s = (v_left_m_s, v_right_m_s)
        self.calls.append(dt_s)


def test_a_simulation_step_by_step_is_that_of_simulate(eight: sidehill.Scenario) -> None:
    scenario = eight.with_(course={"shape": "circle", "radius_m": 1.5, "speed_m_s": 0.5, "turns": 1})
    for plant in ("icrik", "contact"):
        log = sidehill.simulate(scenario, controllers="icrik-mpc", plant=plant).runs[0].log
        simulation = sidehill.Simulation(scenario, plant)
        controller = sidehill.Controller(scenario, vehicle=simulation.vehicle)
        for row in range(len(log["time_s"])):
            x_m, y_m, _, yaw_rad = simulation.pose
            np.testing.assert_allclose([x_m, y_m, yaw_rad], [log[key][row] for key in ("x_m", "y_m", "yaw_rad")], atol=1e-9)
            np.testing.assert_allclose(simulation.errors[0], log["cross_track_m"][row], atol=1e-9)
            time_s = simulation.time_s
            decision = controller.step(
                time_s,
                tread_speeds_m_s=simulation.tread_speeds_m_s,
                attitude_rad=simulation.attitude_rad,
                pose=(time_s, *simulation.pose),
            )
            if decision.finished:
                break
            left = decision.drive_traction_m_s - decision.drive_steer_m_s
            right = decision.drive_traction_m_s + decision.drive_steer_m_s
            simulation.step(left, right, scenario.period_s)
        assert decision.finished and row == len(log["time_s"]) - 1
        assert simulation.reference(0.0)[:2] == pytest.approx(untyped(decision.reference_pose)[:2], abs=0.05)


def test_a_simulation_names_the_argument(short: sidehill.Scenario) -> None:
    simulation = sidehill.Simulation(short)
    for arguments, part in [
        ((None, 0.1, 0.05), "v_left_m_s: None"),
        ((0.1, math.nan, 0.05), "v_right_m_s: NaN"),
        ((0.1, 0.1, 0.0), "dt_s: 0 s is not a whole number of steps of 0.005 s"),
        ((0.1, 0.1, 0.0521), "dt_s: 0.0521"),
        ((0.1, 0.1, -0.05), "dt_s: -0.05"),
    ]:
        with pytest.raises(ValueError) as error:
            simulation.step(*untyped(arguments))
        assert part in str(error.value), error.value
    assert simulation.time_s == 0 and not simulation.finished
    for ahead_s in (None, -1, math.inf):
        with pytest.raises(ValueError, match="ahead_s: "):
            simulation.reference(untyped(ahead_s))
    for keywords in ({"plant": "mud"}, {"plant": object()}, {"seed": -1}):
        with pytest.raises(ValueError, match=f"{next(iter(keywords))}: "):
            sidehill.Simulation(short, **untyped(keywords))
    with pytest.raises(ValueError, match="scenario: "):
        sidehill.Simulation(untyped(None))


@pytest.mark.parametrize("plant", ["icrik", "contact"])
def test_another_plant_or_seed_is_that_of_a_scenario_made_so(eight: sidehill.Scenario, plant: Any) -> None:
    sensors = {"pose": {"timing": {"rate_hz": 10}, "errors": {"noise_std_m": 0.01}}}
    scenario = eight.with_(sensors=sensors, drive_train={"delay_s": 0.1})
    given = sidehill.Simulation(scenario, plant, 7)
    made = sidehill.Simulation(scenario.with_(plant=plant, seed=7))
    for number in range(200):
        for simulation in (given, made):
            simulation.step(0.3, 0.3 + 0.2 * math.sin(number / 20), 0.05)
        assert given.pose == made.pose and given.attitude_rad == made.attitude_rad and given.errors == made.errors
    np.testing.assert_array_equal(given.reference(np.arange(5)), made.reference(np.arange(5)))
    assert given.vehicle == made.vehicle and given.reference_end_s == made.reference_end_s


def test_an_object_is_the_vehicle(eight: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    rover = Rover(j8)
    scenario = eight.with_(course={"shape": "circle", "radius_m": 1.5, "speed_m_s": 0.5, "turns": 1}, step_s=0.025)
    result = sidehill.simulate(scenario, controllers=["icrik-mpc", "icrhk-mpc"], plant=rover)
    own, level = result.metrics["runs"]
    assert own["plant"] == "Rover" and own["completed"] and level["completed"]
    # The model that knows the slope is right here.
    assert own["cross_track_rms_m"] < 0.005 < level["cross_track_rms_m"]
    starts = [call for call in rover.calls if isinstance(call, tuple)]
    assert starts == [("reset", scenario.start_pose, scenario.start_attitude_rad)] * 2
    assert set(rover.calls[1:10]) == {0.025}
    np.testing.assert_array_equal(result.runs[1].log["x_m"][-1], rover.pose[0])


@pytest.mark.parametrize("form", ["tuple", "dict", "methods"])
def test_a_plant_may_return_what_it_measures(short: sidehill.Scenario, j8: sidehill.Vehicle, form: Any) -> None:
    class Other(Rover):
        def step(self, *arguments: Any) -> Any:
            super().step(*arguments)
            if form == "tuple":
                return self.pose, self.attitude_rad, np.array(self.tread_speeds_m_s)
            if form == "dict":
                return {"pose": self.pose, "attitude": self.attitude_rad, "tread_speeds": self.tread_speeds_m_s}
            return None

    plant = Other(j8, 8)
    if form == "methods":

        class Methods:
            def __init__(self) -> None:
                self.reset, self.step = plant.reset, plant.step

            def pose(self) -> Any:
                return plant.pose

            def attitude(self) -> Any:
                return plant.attitude_rad

            def tread_speeds(self) -> Any:
                return plant.tread_speeds_m_s

        plant_given: Any = Methods()
    else:
        plant_given = plant
    scenario = short.with_(terrain={"kind": "plane", "slope_deg": 8, "uphill_heading_deg": 0})
    metrics = sidehill.simulate(scenario, controllers="icrik-mpc", plant=plant_given).metrics["runs"][0]
    assert metrics["completed"] and metrics["cross_track_rms_m"] < 0.01


class Broken(Exception):
    pass


def test_a_failing_plant_raises_its_own_exception(short: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    class Failing(Rover):
        def step(self, *arguments: Any) -> None:
            super().step(*arguments)
            if len(self.calls) > 40:
                raise Broken("axle")

    with pytest.raises(Broken, match="axle") as error:
        sidehill.simulate(short, plant=untyped(Failing(j8)))
    assert error.traceback[-1].name == "step"

    class NoStart(Rover):
        def reset(self, pose: Any, attitude: Any) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sidehill.simulate(short, plant=NoStart(j8))


@pytest.mark.parametrize(
    ("given", "part"),
    [
        (((0, 0, 0), (0, 0), (0, 0)), "pose after step must be finite numbers (x_m, y_m, z_m, yaw_rad)"),
        (((0, 0, 0, math.nan), (0, 0), (0, 0)), "pose after step"),
        (((0, 0, 0, 0), None, (0, 0)), "attitude_rad after step"),
        (((0, 0, 0, 0), (0, 0), "fast"), "tread_speeds_m_s after step"),
        ({"pose": (0, 0, 0, 0)}, "attitude_rad is missing after step"),
        (3.0, "pose is missing after step"),
    ],
)
def test_what_a_plant_gives_wrongly_is_named(short: sidehill.Scenario, j8: sidehill.Vehicle, given: Any, part: Any) -> None:
    class Wrong(Rover):
        def step(self, *arguments: Any) -> Any:
            return given

    with pytest.raises(ValueError) as error:
        sidehill.simulate(short, plant=untyped(Wrong(j8)))
    assert part in str(error.value)


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({"plant": "mud"}, "plant: 'mud' is neither"),
        ({"plant": object()}, "has no method reset"),
        ({"controllers": "mpc"}, "controllers: 'mpc' is not a controller"),
        ({"controllers": ["icrik-mpc", None]}, "controllers: None is not a controller"),
        ({"controllers": 3}, "controllers: a list of names and callables is needed"),
        ({"seed": None, "scenario": "x"}, "scenario: a sidehill.Scenario is needed"),
        ({"seed": "1"}, "seed: '1'"),
    ],
)
def test_simulate_names_the_argument(short: sidehill.Scenario, keywords: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.simulate(**({"scenario": short} | keywords))
    assert part in str(error.value)
