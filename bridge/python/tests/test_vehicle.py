"""Vehicles, and their ICRs against the program and an independent implementation."""

import csv
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import repository, untyped

YAML = {
    "name": "j8",
    "x_icr_left_m": -0.980,
    "x_icr_right_m": 1.073,
    "y_icr_m": 0.206,
    "lambda_1_s_per_rad": 1.222,
    "lambda_2_s_per_rad": 4.965,
    "speed_max_m_s": 1.0,
    "base_half_width_m": 0.6,
    "base_half_length_m": 1.06,
    "correction_left": 1.004,
    "correction_right": 1.011,
}


def test_attributes_and_dict_are_the_keys_of_the_yaml(j8: sidehill.Vehicle) -> None:
    assert j8.to_dict() == YAML
    assert {key: getattr(j8, key) for key in YAML} == YAML
    assert j8.contact is None
    with pytest.raises(AttributeError):
        setattr(j8, "name", "other")


def test_load_save_and_dict_give_the_same_vehicle(j8: sidehill.Vehicle, tmp_path: Path, run: Callable[..., str]) -> None:
    odd = sidehill.Vehicle.from_dict(YAML | {"lambda_1_s_per_rad": 0.1 + 0.2, "name": 'a "name": yes'})
    odd.save(tmp_path / "odd.yaml")
    assert sidehill.Vehicle.load(tmp_path / "odd.yaml") == odd
    assert sidehill.Vehicle.load(str(tmp_path / "odd.yaml")).to_dict() == odd.to_dict()
    assert sidehill.Vehicle.from_dict(odd.to_dict()) == odd != j8
    assert pickle.loads(pickle.dumps(odd)) == odd
    assert "valid vehicle" in run("check", tmp_path / "odd.yaml")


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"y_icr_m": math.nan}, ["y_icr_m"]),
        ({"y_icr_m": None}, ["y_icr_m"]),
        ({"y_icr_m": "0.2 m"}, ["y_icr_m"]),
        ({"y_icr_m": [0.2]}, ["y_icr_m"]),
        ({"y_icr_m": 206.0}, ["y_icr_m", "206"]),
        ({"y_icr_mm": 206.0}, ["y_icr_mm"]),
        ({"correction_left": math.inf}, ["correction_left"]),
    ],
)
def test_a_wrong_key_or_value_is_named(change: Any, parts: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.Vehicle.from_dict(YAML | change)
    assert all(part in str(error.value) for part in parts), error.value


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="lambda_2_s_per_rad"):
        sidehill.Vehicle.from_dict({key: YAML[key] for key in YAML if key != "lambda_2_s_per_rad"})
    with pytest.raises(FileNotFoundError, match="none.yaml"):
        sidehill.Vehicle.load(tmp_path / "none.yaml")
    for wrong in (None, 3, "text", [1]):
        with pytest.raises(ValueError, match="keys: a dict is needed"):
            sidehill.Vehicle.from_dict(untyped(wrong))
    with pytest.raises(ValueError, match="path: None is not a path"):
        sidehill.Vehicle.load(untyped(None))


def test_icrs_are_those_of_an_independent_implementation() -> None:
    with open(repository("plant/tests/data/icrik_vectors.csv")) as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert len(rows) > 400
    for name in {row["vehicle"] for row in rows}:
        vehicle = sidehill.Vehicle.load(repository(f"config/vehicles/{name}.yaml"))
        own = [row for row in rows if row["vehicle"] == name]
        columns = {key: np.array([float(row[key]) for row in own]) for key in own[0] if key != "vehicle"}
        found = sidehill.icr(vehicle, *(columns[key] for key in ("roll_rad", "pitch_rad", "v_left_m_s", "v_right_m_s")))
        for key in ("x_icr_left_m", "x_icr_right_m", "y_icr_m", "v_x_m_s", "v_y_m_s", "omega_z_rad_s"):
            np.testing.assert_allclose(found[key], columns[key], rtol=0, atol=1e-9)


def test_icrs_are_those_of_the_program_bit_by_bit(j8: sidehill.Vehicle, run: Callable[..., str]) -> None:
    random = np.random.default_rng(5)
    inputs = random.uniform([-0.3, -0.3, -1, -1], [0.3, 0.3, 1, 1], (200, 4))
    text = "roll_rad,pitch_rad,v_left_m_s,v_right_m_s\n"
    text += "".join(",".join(map(repr, map(float, row))) + "\n" for row in inputs)
    rows = list(csv.DictReader(run("icr", "--vehicle", repository("config/vehicles/j8.yaml"), stdin=text).splitlines()))
    found = sidehill.icr(j8, *inputs.T)
    for key in ("x_icr_left_m", "x_icr_right_m", "y_icr_m", "v_x_m_s", "v_y_m_s", "omega_z_rad_s"):
        assert found[key].tolist() == [float(row[key]) for row in rows]


def test_icr_broadcasts_and_has_the_model_for_level_ground(j8: sidehill.Vehicle) -> None:
    found = sidehill.icr(j8, 0.1, np.zeros((3, 1)), [-0.3, 0.3], 0.3)
    assert {column.shape for column in found.values()} == {(3, 2)}
    assert (found["icrhk_x_icr_left_m"] == j8.x_icr_left_m).all()
    # Level ground, pivot: equation (4) by hand.
    level = sidehill.icr(j8, 0.0, 0.0, -0.3, 0.3)
    width = j8.x_icr_right_m - j8.x_icr_left_m
    assert level["omega_z_rad_s"].shape == ()
    assert math.isclose(level["omega_z_rad_s"], 0.6 / width)
    for key in ("x_icr_left_m", "v_x_m_s", "v_y_m_s", "omega_z_rad_s"):
        assert level[key] == level["icrhk_" + key]
    assert sidehill.icr(j8, [], [], [], [])["v_x_m_s"].shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ((0, 0, [1, 2], [1, 2, 3]), "v_right_m_s: shape"),
        ((math.nan, 0, 0, 0), "roll_rad: nan is not finite"),
        ((0, None, 0, 0), "pitch_rad: numbers are needed, not None"),
        ((0, 0, "fast", 0), "v_left_m_s: numbers are needed"),
        ((0, 5.3, 0, 0), "pitch_rad"),
        ((0, 0, [0, 500], 0), "index 1"),
        ((0, 0, [[0], [1, 2]], 0), "v_left_m_s"),
    ],
)
def test_icr_names_the_argument(j8: sidehill.Vehicle, arguments: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.icr(j8, *arguments)
    assert part in str(error.value)
    with pytest.raises(ValueError, match="vehicle: a sidehill.Vehicle is needed"):
        sidehill.icr(untyped("j8"), 0, 0, 0, 0)
