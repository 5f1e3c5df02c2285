"""Search of settings."""

import math
from typing import Any

import pytest
import sidehill
from conftest import repository


@pytest.fixture
def bad() -> Any:
    """A campaign whose controller hardly heeds its path: easily bettered."""
    return {
        "name": "bad",
        "seed": 3,
        "runs": 100,
        "controllers": ["icrik-mpc"],
        "scenario": str(repository("config/scenarios/slalom.yaml")),
        "conditions": "realistic",
        "with": {
            "course": {"shape": "slalom", "length_m": 3, "amplitude_m": 0.3, "wavelength_m": 3, "speed_m_s": 0.5},
            "controller": {"weights": {"cross_per_m2": 1.0}},
        },
        "draws": [{"key": "start.right_m", "uniform": [-0.3, 0.3]}],
    }


BUDGET: dict[str, Any] = {"training": 6, "held_out": 12, "tries": 8, "keys": ["weights.cross_per_m2"]}


def test_bad_weights_become_better_and_the_same_again(bad: Any) -> None:
    found = sidehill.tune(bad, **BUDGET)
    assert found["improved"] and found["controller"] == "icrik-mpc" and found["name"] == "bad"
    (setting,) = found["settings"]
    assert setting["key"] == "weights.cross_per_m2" and setting["before"] == 1 and 1.2 < setting["after"] <= 8
    held_out, training = found["held_out"], found["training"]
    assert training["runs"] == {"start": 0, "end": 6} and held_out["runs"] == {"start": 6, "end": 18}
    assert held_out["cost"] < 0 and held_out["after"]["median_m"] < held_out["before"]["median_m"]
    assert found["tried"][0] == 0 and min(found["tried"]) < 0 and 2 <= len(found["tried"]) <= 8
    # The figures are those of a campaign with these settings.
    weights = {"cross_per_m2": setting["after"]}
    bad["with"]["controller"] = {"weights": weights}
    rows = sidehill.campaign(bad, runs=range(6, 18))
    assert sorted(rows["cross_track_rms_m"])[5] == held_out["after"]["median_m"]
    bad["with"]["controller"] = {"weights": {"cross_per_m2": 1.0}}
    assert sidehill.tune(bad, threads=1, **BUDGET) == found


def test_settings_that_cannot_be_bettered_stay(bad: Any) -> None:
    # No pose is ever late, so when the vehicle would stop for one changes nothing.
    found = sidehill.tune(bad, **{**BUDGET, "keys": ["supervisor.pose_timeout_s"]})
    assert not found["improved"] and found["held_out"]["cost"] == 0


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({"controller": "mpc"}, "controller: 'mpc'"),
        ({"keys": []}, "keys: [] is empty"),
        ({"keys": "weights.cross_per_m2"}, "keys: a list of names"),
        ({"keys": ["weights.cross"]}, "weights.cross: there is no such setting"),
        ({"keys": ["weights"]}, "weights: "),
        ({"keys": ["stages"]}, "stages: 40 is a whole number"),
        ({"keys": ["weights.cross_per_m2"] * 2}, "weights.cross_per_m2: given twice"),
        ({"factor": 1}, "factor: 1 is out of range"),
        ({"factor": math.nan}, "factor: nan"),
        ({"calmness": None}, "calmness: None"),
        ({"calmness": -1.0}, "calmness: -1"),
        ({"training": 0}, "training: 0"),
        ({"training": 1}, "training: 1 is out of range"),
        ({"held_out": 2.5}, "held_out: 2.5"),
        ({"tries": True}, "tries: True"),
        ({"minutes": math.inf}, "minutes: inf"),
        ({"threads": 0}, "threads: 0"),
        ({"campaign": None}, "campaign: a path or a dict is needed"),
        ({"campaign": {"name": "x", "draws": []}}, "campaign"),
    ],
)
def test_what_is_wrong_is_named(bad: Any, keywords: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.tune(**({"campaign": bad} | keywords))
    assert part in str(error.value), error.value
    with pytest.raises(FileNotFoundError, match="none.yaml"):
        sidehill.tune("none.yaml")


def test_runs_that_are_equal_prove_nothing(short: sidehill.Scenario) -> None:
    with pytest.raises(ValueError, match="short: its 6 training runs are equal"):
        sidehill.tune(short, **BUDGET)
