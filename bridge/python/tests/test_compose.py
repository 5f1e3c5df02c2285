"""Vehicles, scenarios, controllers and simulations as objects: composed, changed, compared, copied, pickled, shown."""

import copy
import json
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import untyped

MEASURES = (0.9, 0.7, 0.15, 120.0)


@pytest.fixture(scope="module")
def guessed() -> sidehill.Vehicle:
    return sidehill.Vehicle.from_geometry(*MEASURES, speed_m_s=1.2)


@pytest.fixture(scope="module")
def bend() -> np.ndarray:
    """Points along a quarter of a circle of 4 m, from the origin along Y_g to the left."""
    angle = np.linspace(0, math.pi / 2, 60)
    return np.column_stack([4 * np.cos(angle) - 4, 4 * np.sin(angle)])


def test_a_vehicle_of_five_numbers_is_that_of_init(guessed: Any, run: Callable[..., str], tmp_path: Path) -> None:
    length, width, radius, mass = MEASURES
    run("init", tmp_path / "rover", "--length", length, "--width", width, "--wheel-radius", radius, "--mass", mass,
        "--speed", 1.2)  # fmt: skip
    assert guessed == sidehill.Vehicle.load(tmp_path / "rover" / "vehicle.yaml")
    contact = sidehill.contact_from_geometry(*MEASURES)
    scenario = sidehill.Scenario.load(tmp_path / "rover" / "scenario.yaml")
    own = scenario.with_(contact={"vehicle": contact, "identified": guessed}, vehicle=guessed)
    figures = [sidehill.simulate(each, "contact-mpc", "contact").metrics["runs"][0] for each in (scenario, own)]
    assert figures[0]["cross_track_rms_m"] == figures[1]["cross_track_rms_m"]
    six = sidehill.Vehicle.from_geometry(*MEASURES, axles=3, name="six")
    assert six.name == "six" and len(untyped(six.contact)["axles"]) == 3


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({"length_m": 20.0}, "length_m: 20 is out of range"),
        ({"width_m": math.nan}, "width_m: NaN is not finite"),
        ({"wheel_radius_m": None}, "wheel_radius_m: None is not a number"),
        ({"mass_kg": -1}, "mass_kg: -1"),
        ({"speed_m_s": 99}, "speed_m_s: 99"),
        ({"axles": 1}, "axles: 1 is not a whole number from 2"),
        ({"axles": 2.5}, "axles: 2.5"),
        ({"name": "a b"}, 'name: "a b"'),
    ],
)
def test_a_measure_that_is_wrong_is_named(keywords: Any, part: Any) -> None:
    measures = dict(zip(("length_m", "width_m", "wheel_radius_m", "mass_kg"), MEASURES, strict=True))
    with pytest.raises(ValueError) as error:
        sidehill.Vehicle.from_geometry(**measures | keywords)
    assert part in str(error.value), error.value


def test_a_vehicle_is_made_and_changed_by_its_keys(j8: sidehill.Vehicle, guessed: Any) -> None:
    assert sidehill.Vehicle(**j8.to_dict()) == j8 == sidehill.Vehicle.j8()
    other = j8.with_(lambda_2_s_per_rad=2.5, name="other")
    assert (other.lambda_2_s_per_rad, other.name, other.x_icr_left_m) == (2.5, "other", j8.x_icr_left_m)
    assert j8.with_() == j8 != other
    nested = guessed.with_(contact={"friction": 0.5})
    assert nested == guessed.with_(**{"contact.friction": 0.5}) != guessed
    assert nested.contact["half_width_m"] == guessed.contact["half_width_m"]
    assert guessed.with_(contact=None).contact is None


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"lambda_3_s_per_rad": 1.0}, "lambda_3_s_per_rad"),
        ({"contact.half_widht_m": 1.0}, "half_widht_m"),
        ({"contact": {"half_widht_m": 1.0}}, "half_widht_m"),
        ({"lambda_1_s_per_rad": -1.0}, "lambda_1_s_per_rad: -1"),
        ({"y_icr_m": None}, "y_icr_m"),
    ],
)
def test_a_change_that_is_wrong_is_named(guessed: Any, change: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        guessed.with_(**change)
    assert part in str(error.value), error.value


def test_a_scenario_of_objects_and_arrays(guessed: Any, bend: Any) -> None:
    scenario = sidehill.Scenario(
        path=bend,
        vehicle=guessed,
        terrain={"kind": "plane", "slope_deg": 8, "uphill_heading_deg": 60},
        drive_train={"delay_s": 0.05},
        controllers=["icrik-mpc", "pure-pursuit"],
    )
    assert (scenario.name, scenario.seed, scenario.plant) == ("scenario", 1, "icrik")
    assert scenario.vehicle == guessed
    np.testing.assert_allclose(scenario.start_pose[:2], bend[0], atol=0.05)
    icrik, _ = sidehill.simulate(scenario).metrics["runs"]
    assert icrik["completed"] and icrik["cross_track_rms_m"] < 0.02
    # Points with heights are a ground.
    along = {"kind": "route", "smoothing_length_m": 1, "distance_max_m": 4}
    tilted = sidehill.Scenario(path=np.column_stack([bend, 0.1 * bend[:, 1]]), terrain=along)
    assert tilted.vehicle == sidehill.Vehicle.j8()
    assert tilted.start_attitude_rad[1] == pytest.approx(math.atan(0.1), abs=0.03)


def test_another_path_keeps_how_it_is_smoothed(bend: Any) -> None:
    smoothing = {"max_deviation_m": 0.02}
    scenario = sidehill.Scenario(path=bend, route={"smoothing": smoothing})
    moved = scenario.with_(path=bend + 1)
    assert moved.to_dict()["route"]["smoothing"] == smoothing and moved != scenario
    np.testing.assert_allclose(moved.start_pose[:2], (1, 1), atol=0.05)
    assert scenario.with_(path=bend) == scenario
    assert "smoothing" not in scenario.with_(path=bend, route={}).to_dict()["route"]


def test_a_scenario_of_objects_is_one_file_for_the_program(
    run: Callable[..., str], tmp_path: Path, guessed: Any, bend: Any
) -> None:
    x = np.linspace(-12, 12, 49)
    scenario = sidehill.Scenario(path=bend, vehicle=guessed, terrain=sidehill.Grid(x, x, lambda x, y: 0.1 * x + 0.05 * y))
    (tmp_path / "own.yaml").write_text(json.dumps(scenario.to_dict()))
    (printed,) = json.loads(run("simulate", tmp_path / "own.yaml", "--format", "json"))["runs"]
    (made,) = sidehill.simulate(scenario).metrics["runs"]
    for key in ("cross_track_rms_m", "heading_rms_rad", "steer_total_variation_m_s", "time_s"):
        assert made[key] == printed[key]


def test_a_grid_is_the_ground_of_its_heights(bend: Any) -> None:
    x, y = np.arange(-8, 8.5, 0.5), np.arange(-4, 9, 0.5)
    height = 0.2 * x[None, :] - 0.1 * y[:, None]
    by_array = sidehill.Scenario(path=bend, terrain=sidehill.Grid(x, y, height))
    by_function = sidehill.Scenario(path=bend, terrain=sidehill.Grid(x, y, lambda x, y: 0.2 * x - 0.1 * y))
    assert by_array == by_function
    start = by_array.start_pose
    assert start[2] == pytest.approx(0.2 * start[0] - 0.1 * start[1], abs=1e-9)
    # The nose along Y_g, which falls: nose down; the right side rises.
    roll, pitch = by_array.start_attitude_rad
    assert pitch == pytest.approx(-math.atan(0.1), abs=0.02) and roll < -0.15


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: sidehill.Scenario(), "course or route: one of them is needed"),
        (lambda: sidehill.Scenario(path=[[0, 0]] * 3, vehicle=3), "vehicle: a sidehill.Vehicle, a dict or"),
        (lambda: sidehill.Scenario(path=np.zeros(5)), "path: shape (5,)"),
        (lambda: sidehill.Scenario(path=np.zeros((5, 4))), "path: shape (5, 4)"),
        (lambda: sidehill.Scenario(path=[[0, 0], [1, math.nan]]), "path: nan is not finite"),
        (lambda: sidehill.Scenario(path=[["a", 0]]), "path: numbers are needed"),
        (lambda: sidehill.Scenario(path=[[0, 0], [0, 5]], drives={}), "drives"),
        (lambda: sidehill.Scenario(path=[[0, 0], [0, 5]], terrain={"kind": "plane", "slope_deg": 95}), "slope_deg: 95"),
        (lambda: sidehill.Scenario(path=[[0, 0], [0, 5]], vehicle={"name": "x"}), "x_icr_left_m"),
        (lambda: sidehill.Grid([0, 1], [0, 1], [[0, 0]]), "height_m: shape (1, 2) is not (2, 2)"),
        (lambda: sidehill.Grid([0, 1, 3], [0, 1], 0), "x_m, y_m: "),
        (lambda: sidehill.Grid([0, 1], [0, 1], [[0.0, math.inf], [0.0, 0.0]]), "height_m: inf is not finite"),
    ],
)
def test_what_is_wrong_with_a_scenario_is_named(make: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        make()
    assert part in str(error.value), error.value


def test_a_name_with_dots_changes_one_key(short: sidehill.Scenario) -> None:
    steeper = short.with_(**{"terrain.slope_deg": 12, "controller.weights.cross_per_m2": 7.0})
    assert steeper.to_dict()["terrain"] == short.to_dict()["terrain"] | {"slope_deg": 12}
    assert steeper.to_dict()["controller"]["weights"] == {"cross_per_m2": 7.0}
    with pytest.raises(ValueError, match="slope_dge"):
        short.with_(**{"terrain.slope_dge": 12})


def test_scenarios_are_compared_by_keys_and_files(short: sidehill.Scenario, guessed: Any, tmp_path: Path) -> None:
    assert short == short.with_() == short.with_(seed=2).with_(seed=1) != short.with_(seed=2)
    assert short != 3
    own = short.with_(vehicle=guessed)
    assert own == short.with_(vehicle=guessed) != short.with_(vehicle=guessed.with_(name="other"))
    # A file that changes afterwards changes no scenario.
    sidehill.Vehicle.j8().save(tmp_path / "vehicle.yaml")
    first = short.with_(vehicle=str(tmp_path / "vehicle.yaml"))
    guessed.save(tmp_path / "vehicle.yaml")
    second = short.with_(vehicle=str(tmp_path / "vehicle.yaml"))
    assert first.with_(vehicle=str(tmp_path / "vehicle.yaml")) == second
    assert first != second and first.vehicle == sidehill.Controller(first).vehicle == sidehill.Vehicle.j8()
    (tmp_path / "vehicle.yaml").unlink()
    for each in (first, second):
        for other in (pickle.loads(pickle.dumps(each)), copy.copy(each), copy.deepcopy(each)):
            assert other == each and other.vehicle == each.vehicle


def readings(simulation: Any) -> Any:
    return {
        "tread_speeds_m_s": simulation.tread_speeds_m_s,
        "attitude_rad": simulation.attitude_rad,
        "pose": (simulation.time_s, *simulation.pose),
    }


def cycle(simulation: Any, controller: Any) -> Any:
    """One cycle of a loop; returns everything it came to."""
    decision = controller.step(simulation.time_s, **readings(simulation))
    left = decision.drive_traction_m_s - decision.drive_steer_m_s
    right = decision.drive_traction_m_s + decision.drive_steer_m_s
    simulation.step(left, right, controller.period_s)
    plan = None if decision.plan is None else decision.plan.tolist()
    return simulation.pose, decision.status, decision.traction_m_s, decision.steer_m_s, plan, decision.iterations


# Bends at which inputs come to their limits.
SLALOM = {"shape": "slalom", "length_m": 8, "amplitude_m": 0.8, "wavelength_m": 4, "speed_m_s": 0.8}


@pytest.mark.parametrize("kind", ["icrik-mpc", "contact-mpc", "pure-pursuit"])
@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle"])
def test_a_copy_goes_on_bit_by_bit_as_the_original_would(short: sidehill.Scenario, kind: Any, way: Any) -> None:
    scenario = short.with_(course=SLALOM, plant="contact")
    make = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda one: pickle.loads(pickle.dumps(one))}[way]
    simulation, controller = sidehill.Simulation(scenario), sidehill.Controller(scenario, kind)
    for _ in range(45):
        cycle(simulation, controller)
    branches: Any = [(untyped(make)(simulation), untyped(make)(controller)) for _ in range(2)]
    assert branches[0] == branches[1] == (simulation, controller)
    # What happens in one branch is nothing to the others.
    stopped = branches.pop()
    stopped[1].request_stop()
    for _ in range(40):
        cycle(*stopped)
    assert stopped[0].pose != simulation.pose and stopped[1] != controller
    went = [cycle(simulation, controller) for _ in range(120)]
    goes = [cycle(*branches[0]) for _ in range(120)]
    assert went == goes
    assert branches[0] == (simulation, controller)
    assert kind == "pure-pursuit" or max(iterations for *_, iterations in went) > 0


def test_controllers_and_simulations_are_compared_by_what_they_were_told(
    short: sidehill.Scenario, j8: sidehill.Vehicle
) -> None:
    assert sidehill.Controller(short) == sidehill.Controller(short)
    assert sidehill.Controller(short) != sidehill.Controller(short, "icrhk-mpc")
    assert sidehill.Controller(short) != sidehill.Controller(short, vehicle=j8.with_(name="other"))
    assert sidehill.Controller(short) != sidehill.Controller(short.with_(seed=2))
    told, same, other = (sidehill.Controller(short) for _ in range(3))
    told.step(0.0, tread_speeds_m_s=(0, 0)), same.step(0.0, tread_speeds_m_s=(0, 0)), other.step(0.0)
    assert told == same != other
    one, two = sidehill.Simulation(short), sidehill.Simulation(short)
    assert one == two != sidehill.Simulation(short, "contact")
    one.step(0.1, 0.1, 0.05)
    assert one != two
    two.step(0.1, 0.1, 0.05)
    assert one == two and one != 3


def test_what_drives_on_and_on_is_copied_but_not_pickled(short: sidehill.Scenario) -> None:
    simulation = sidehill.Simulation(short)
    for _ in range(10_000):
        simulation.step(0.0, 0.0, 0.005)
    assert pickle.loads(pickle.dumps(simulation)) == simulation
    simulation.step(0.0, 0.0, 0.005)
    with pytest.raises(ValueError, match="10001; copy.copy copies it"):
        pickle.dumps(simulation)
    assert copy.copy(simulation) == simulation


def test_a_simulation_that_has_left_the_ground_is_pickled(bend: Any) -> None:
    x = np.linspace(-6, 6, 25)
    scenario = sidehill.Scenario(path=bend, terrain=sidehill.Grid(x, x, 0 * x[:, None] * x))
    simulation = sidehill.Simulation(scenario)
    with pytest.raises(ValueError, match="ground|grid|terrain"):
        for _ in range(1000):
            simulation.step(1.0, 1.0, 0.05)
    assert pickle.loads(pickle.dumps(simulation)) == simulation


def test_a_notebook_shows_a_table(short: sidehill.Scenario, j8: sidehill.Vehicle) -> None:
    for each, part in (
        (j8, "x_icr_left_m"),
        (short, "terrain.slope_deg"),
        (sidehill.Controller(short), "icrik-mpc"),
        (sidehill.Simulation(short), "cross_track_m"),
    ):
        html = each._repr_html_()
        assert html.startswith("<table>") and part in html
        assert type(each).__name__ in repr(each)
    assert "&lt;b&gt;" in short.with_(name="<b>")._repr_html_()
