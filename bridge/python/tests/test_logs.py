"""Identification and odometry, against the program."""

import json
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
import sidehill
from conftest import repository, untyped

LOGS = repository("plant/tests/data/trento_ramps")
LEVEL = sorted(LOGS.glob("flat_left_*.csv"))
SLOPE = [LOGS / "ramp_0.150_left_18.0.csv"]
COLUMNS = LOGS / "columns.yaml"
REPLAY = repository("plant/tests/data/dead_reckoning_exp1.csv")


@pytest.fixture(scope="module")
def tracked() -> Any:
    return sidehill.Vehicle.load(LOGS / "vehicle.yaml")


@pytest.fixture
def drive(j8: sidehill.Vehicle) -> Any:
    """A log made by the ICRIK model on a plane of 4 deg that rises towards +Y_g, turning all the time."""
    rows, (x, y, yaw) = [], (0.0, 0.0, 0.0)
    slope = math.radians(4)
    for step in range(1200):
        time_s = 0.05 * step
        left, right = 0.3 * math.sin(0.3 * time_s), 0.35 * math.sin(0.23 * time_s + 1)
        n = (-math.sin(yaw) * math.sin(slope), -math.cos(yaw) * math.sin(slope), math.cos(slope))
        roll, pitch = math.atan2(n[0], n[2]), -math.asin(n[1])
        rows.append((time_s, left, right, roll, pitch, x, y, y * math.tan(slope), yaw))
        body = sidehill.icr(j8, roll, pitch, j8.correction_left * left, j8.correction_right * right)
        x += 0.05 * float(math.cos(yaw) * body["v_x_m_s"] - math.sin(yaw) * body["v_y_m_s"])
        y += 0.05 * float(math.sin(yaw) * body["v_x_m_s"] + math.cos(yaw) * body["v_y_m_s"])
        yaw += 0.05 * float(body["omega_z_rad_s"])
    names = ("time_s", "v_left_m_s", "v_right_m_s", "roll_rad", "pitch_rad", "x_m", "y_m", "z_m", "yaw_rad")
    return dict(zip(names, map(list, zip(*rows))))


def test_identification_is_that_of_the_program_bit_by_bit(tracked: Any, tmp_path: Path, run: Callable[..., str]) -> None:
    out = tmp_path / "identified.yaml"
    printed = json.loads(run(
        "identify", "--level", *LEVEL, "--slope", *SLOPE, "--segment-s", 4, "--columns", COLUMNS,
        "--vehicle", LOGS / "vehicle.yaml", "--out", out, "--format", "json",
    ))  # fmt: skip
    found = sidehill.identify(level=LEVEL, slope=[*map(str, SLOPE)], vehicle=tracked, segment_s=4, columns=COLUMNS)
    assert found.vehicle == sidehill.Vehicle.load(out) != tracked
    assert (
        list(untyped(found.slope)["undetermined"]) == ["lambda_2_s_per_rad"] and untyped(found.level)["undetermined"] == {}
    )
    assert (found.level, found.slope, found.verdict) == (printed["level"], printed["slope"], printed["verdict"])
    assert found.verdict["max_slope_deg"] < 20 and found.verdict["reasons"]
    assert found.text.startswith("level: ") and "\nslope: " in found.text
    verdict = found.text[found.text.index("verdict: ") :].splitlines()
    assert verdict[1:] == [f"  - {reason}" for reason in found.verdict["reasons"]]
    assert found.contact_report is None
    other = pickle.loads(pickle.dumps(found))
    assert other == found and (other.slope, other.verdict) == (found.slope, found.verdict)
    assert isinstance(found, sidehill.Vehicle) and found.x_icr_left_m == found.vehicle.x_icr_left_m
    assert untyped(found.level)["estimates"]["x_icr_left_m"]["value"] == found.x_icr_left_m
    assert untyped(found.level)["held_out"]["fitted"]["yaw_rad"] < untyped(found.level)["held_out"]["baseline"]["yaw_rad"]
    assert "lambda_1_s_per_rad" in untyped(found.slope)["estimates"] and untyped(found.slope)["segments"] > 0


def test_the_vehicle_on_wheels_is_identified_where_it_is_asked_for(j8: sidehill.Vehicle, drive: Any) -> None:
    found = sidehill.identify(slope=[drive], vehicle=j8, segment_s=2, contact=True)
    assert (
        "friction" in untyped(found.contact_report)["estimates"]
        and untyped(found.contact)["half_width_m"] == j8.base_half_width_m
    )
    assert "contact vehicle: " in found.text


def test_gains_of_a_slope_are_found_again_from_dicts_and_frames(j8: sidehill.Vehicle, drive: Any) -> None:
    flat = sidehill.Vehicle.from_dict(j8.to_dict() | {"lambda_1_s_per_rad": 0.0, "lambda_2_s_per_rad": 0.0})
    found = sidehill.identify(slope=[drive], vehicle=flat, smoothing_s=0)
    assert found.level is None
    assert found.lambda_1_s_per_rad == pytest.approx(j8.lambda_1_s_per_rad, rel=0.05)
    assert found.lambda_2_s_per_rad == pytest.approx(j8.lambda_2_s_per_rad, rel=0.1)
    again = sidehill.identify(slope=[pandas.DataFrame(drive)], vehicle=flat, smoothing_s=0)
    arrays = {name: np.array(values) for name, values in drive.items()}
    assert again.vehicle == found.vehicle == sidehill.identify(slope=(arrays,), vehicle=flat, smoothing_s=0).vehicle


def test_odometry_is_that_of_the_program_bit_by_bit(
    j8: sidehill.Vehicle, run: Callable[..., str], drive: Any, tmp_path: Path
) -> None:
    pandas.DataFrame(drive).to_csv(tmp_path / "drive.csv", index=False)
    log = tmp_path / "drive.csv"
    printed = json.loads(run("odometry", log, "--vehicle", repository("config/vehicles/j8.yaml"), "--format", "json"))
    assert sidehill.odometry(log, j8) == sidehill.odometry(drive, j8) == printed
    assert printed["icrik"]["j_over_n"] < printed["icrhk"]["j_over_n"]


def test_rows_without_a_pose_count_less(j8: sidehill.Vehicle, drive: Any) -> None:
    frame = pandas.DataFrame(drive)
    frame.loc[frame.index % 4 != 0, ["x_m", "y_m", "z_m", "yaw_rad"]] = np.nan
    assert sidehill.odometry(frame, j8)["samples"] < sidehill.odometry(drive, j8)["samples"] / 3


def test_what_is_wrong_with_a_log_is_named(j8: sidehill.Vehicle, drive: Any, tmp_path: Path) -> None:
    def fails(log: Any, *parts: Any) -> None:
        for call in (lambda: sidehill.odometry(log, j8), lambda: sidehill.identify(slope=[log], vehicle=j8)):
            with pytest.raises(ValueError) as error:
                call()
            assert all(part in str(error.value) for part in parts), error.value

    changed = dict(drive, v_left_m_s=[*drive["v_left_m_s"][:-1], math.nan])
    fails(changed, "1200", "v_left")
    fails(dict(drive, roll_rad=[None, *drive["roll_rad"][1:]]), "row", "roll_rad")
    fails(dict(drive, pitch_rad=[5.3, *drive["pitch_rad"][1:]]), "row 1", "pitch_rad")
    fails(dict(drive, v_left_m_s=drive["v_left_m_s"][:-3]), "v_left_m_s has 1197 values, time_s has 1200")
    fails(dict(drive, v_left_m_s=[[1], [2]]), "v_left_m_s has shape (2, 1)")
    fails({("v_left_kmh" if name == "v_left_m_s" else name): drive[name] for name in drive}, "v_left_m_s")
    fails(None, "a path, a dict of columns or a DataFrame is needed, not NoneType")
    with pytest.raises(ValueError, match=r"slope\[1\]"):
        sidehill.identify(slope=[drive, changed], vehicle=j8)
    with pytest.raises(FileNotFoundError):
        sidehill.odometry(tmp_path / "none.csv", j8)


@pytest.mark.parametrize(
    ("keywords", "part"),
    [
        ({}, "level, slope: at least one log is needed"),
        ({"slope": REPLAY}, "slope: a list of logs is needed"),
        ({"slope": None}, "slope: a list of logs is needed"),
        ({"slope": [REPLAY], "segment_s": None}, "segment_s: None is not a number"),
        ({"slope": [REPLAY], "segment_s": math.nan}, "segment_s: NaN is not finite"),
        ({"slope": [REPLAY], "segment_s": -1}, "segment"),
        ({"slope": [REPLAY], "smoothing_s": 11}, "smoothing_s"),
        ({"slope": [REPLAY], "vehicle": {}}, "vehicle: a sidehill.Vehicle is needed"),
    ],
)
def test_identify_names_the_argument(j8: sidehill.Vehicle, keywords: Any, part: Any) -> None:
    with pytest.raises(ValueError) as error:
        sidehill.identify(**({"vehicle": j8} | keywords))
    assert part in str(error.value)
