"""Campaigns, against the program."""

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sidehill
from conftest import repository, untyped

WORDS = {"campaign", "controller", "completed", "ended_by"}


@pytest.fixture
def campaign() -> Any:
    return {
        "name": "short",
        "seed": 5,
        "runs": 8,
        "controllers": ["pure-pursuit", "icrik-mpc"],
        "scenario": str(repository("config/scenarios/slalom.yaml")),
        "conditions": "realistic",
        "draws": [
            {"key": "course", "one_of": [{"shape": "straight", "length_m": 2, "speed_m_s": 0.5}]},
            {"key": "terrain.slope_deg", "uniform": [0, 10]},
            {"key": "start.right_m", "uniform": [-0.2, 0.2]},
        ],
    }


def test_rows_are_those_of_the_program_bit_by_bit(run: Callable[..., str], tmp_path: Path) -> None:
    named = repository("config/campaigns/default.yaml")
    run("campaign", named, "--range", "2..4", "--out", tmp_path / "out.csv")
    with open(tmp_path / "out.csv") as file:
        rows = list(csv.DictReader(file))
    found = sidehill.campaign(named, runs=range(2, 4))
    assert list(found) == list(rows[0]) and len(rows) == 8
    for name, column in found.items():
        values = [row[name] for row in rows]
        if name == "completed":
            assert [str(value).lower() for value in column] == values
        elif name in WORDS:
            assert column == values
        elif name == "course":
            assert all(value["shape"] in text for value, text in zip(column, values, strict=True))
        else:
            np.testing.assert_array_equal(column, [float(value or "nan") for value in values], err_msg=name)
    assert found["index"].dtype == found["seed"].dtype == np.int64 and found["completed"].dtype == bool


def test_a_dict_and_any_split_give_the_same_rows(campaign: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = sidehill.campaign(campaign, threads=2)
    assert whole["index"].tolist() == [index for index in range(8) for _ in range(2)]
    assert whole["controller"][:2] == ["icrik-mpc", "pure-pursuit"]
    monkeypatch.setattr("sidehill._campaign.CHUNK_RUNS", 3)
    parts = [sidehill.campaign(campaign, runs=range(a, b), threads=1) for a, b in [(0, 5), (5, 8)]]
    for name, column in whole.items():
        joined = [value for part in parts for value in part[name]]
        # Pure pursuit has no bound ahead: a NaN equals a NaN.
        np.testing.assert_array_equal(list(column), joined, err_msg=name)
    assert sidehill.campaign(campaign, runs=2)["index"].tolist() == [0, 0, 1, 1]


def test_a_run_that_cannot_start_is_a_row_with_its_reason(campaign: Any) -> None:
    campaign["draws"][2] = {"key": "start.right_m", "uniform": [200, 300]}
    rows = sidehill.campaign(campaign, runs=1)
    assert not rows["completed"].any() and all("start.right_m" in reason for reason in rows["ended_by"])
    assert np.isnan(rows["cross_track_rms_m"]).all()


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"seed": None}, "seed"),
        ({"seed": math.nan}, "seed"),
        ({"rums": 3}, "rums"),
        ({"draws": [{"key": "terrain.slope_rad", "uniform": [0, 1]}]}, "slope_rad"),
        ({"draws": [{"key": "start.right_m", "uniform": [1, 0]}]}, "start.right_m"),
        ({"controllers": []}, "controllers"),
    ],
)
def test_what_is_wrong_with_a_campaign_is_named(campaign: Any, change: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.campaign(campaign | change)
    assert part in str(error.value)


def test_campaign_names_the_argument(campaign: Any, tmp_path: Path) -> None:
    for runs in (0, -1, range(3, 3), range(0, 10, 2), range(-1, 3), "3", 2.5, True, 2**33):
        with pytest.raises(ValueError, match="runs: "):
            sidehill.campaign(campaign, runs=untyped(runs))
    for threads in (0, "2", 1.5):
        with pytest.raises(ValueError, match="threads: "):
            sidehill.campaign(campaign, runs=1, threads=untyped(threads))
    with pytest.raises(ValueError, match="campaign: a path or a dict is needed"):
        sidehill.campaign(untyped(None))
    with pytest.raises(FileNotFoundError, match="none.yaml"):
        sidehill.campaign(tmp_path / "none.yaml")
    with pytest.raises(FileNotFoundError, match="none.yaml"):
        sidehill.campaign(campaign | {"scenario": "none.yaml"})
