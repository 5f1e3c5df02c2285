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


class Tilting:
    """A vehicle that slips outward in turns, on the plane that it is reset to."""

    icrs_m = (-0.9, 0.8, 0.1)
    outward_slip_s = 0.3
    pitch_max_rad = 0.2

    def reset(self, pose: tuple[float, float, float, float], attitude: tuple[float, float]) -> Any:
        self.x_m, self.y_m, _, self.yaw_rad = pose
        self.slope_rad = min(attitude[1], self.pitch_max_rad)
        return self.measured(0.0, 0.0)

    def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> Any:
        left_m, right_m, forward_m = self.icrs_m
        rate = (v_right_m_s - v_left_m_s) / (right_m - left_m)
        forward_m_s = v_left_m_s - rate * left_m
        right_m_s = rate * (forward_m + self.outward_slip_s * forward_m_s)
        yaw = self.yaw_rad + 0.5 * dt_s * rate
        self.x_m += dt_s * (math.cos(yaw) * right_m_s - math.sin(yaw) * forward_m_s)
        self.y_m += dt_s * (math.sin(yaw) * right_m_s + math.cos(yaw) * forward_m_s)
        self.yaw_rad += dt_s * rate
        return self.measured(v_left_m_s, v_right_m_s)

    def measured(self, v_left_m_s: float, v_right_m_s: float) -> Any:
        slope, yaw = self.slope_rad, self.yaw_rad
        roll = math.atan2(-math.sin(yaw) * math.sin(slope), math.cos(slope))
        pose = (self.x_m, self.y_m, self.y_m * math.tan(slope), yaw)
        return pose, (roll, math.asin(math.cos(yaw) * math.sin(slope))), (v_left_m_s, v_right_m_s)


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
    assert found.extension_report == printed["extension"] and "creep_per_rad" in untyped(found.extension_report)["terms"]
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
    assert sidehill.odometry(log, j8) == sidehill.odometry(drive, j8) == printed | {"notes": []}
    assert printed["icrik"]["j_over_n"] < printed["icrhk"]["j_over_n"]


def test_bags_are_read_as_by_the_program(tmp_path: Path, run: Callable[..., str]) -> None:
    bags, vehicle = repository("tests/data/bags"), repository("plant/tests/data/drive/warthog_2023/vehicle.yaml")
    topics, out = bags / "topics.yaml", tmp_path / "found.yaml"
    warthog = sidehill.Vehicle.load(vehicle)
    folder = bags / "warthog_2023" / "mcap"
    file = folder / "mcap.mcap"
    printed = json.loads(run(
        "identify", "--level", folder, "--slope", file, "--segment-s", 1.5, "--topics", topics, "--vehicle", vehicle,
        "--out", out, "--format", "json",
    ))  # fmt: skip
    found = sidehill.identify(level=[folder], slope=[file], vehicle=warthog, segment_s=1.5, topics=topics)
    assert found.vehicle == sidehill.Vehicle.load(out) != warthog
    reports = {"level": found.level, "slope": found.slope, "extension": found.extension_report, "verdict": found.verdict}
    assert reports == {name: printed[name] for name in reports}
    assert any(note.startswith(f"{file}: note: /joint_states: ") for note in found.notes)
    database = bags / "warthog_2023" / "by_file"
    odometry = sidehill.odometry(database, warthog, topics=str(topics))
    assert "/joint_states" in odometry.pop("notes")[0]
    arguments = ("odometry", database, "--vehicle", vehicle, "--topics", topics, "--format", "json")
    assert odometry == json.loads(run(*arguments))
    with pytest.raises(ValueError, match=r"level\[0\]: .*decompress"):
        sidehill.identify(level=[folder], vehicle=warthog, topics=topics, max_bytes=1000)
    with pytest.raises(ValueError, match=r"topics\.yaml.*tread_speeds"):
        (tmp_path / "topics.yaml").write_text("tread_speeds: {kind: none}")
        sidehill.odometry(folder, warthog, topics=tmp_path / "topics.yaml")


def test_drives_are_those_of_the_program_and_a_controller_takes_them(
    j8: sidehill.Vehicle, tmp_path: Path, run: Callable[..., str]
) -> None:
    scenario, vehicle = repository("config/scenarios/slalom.yaml"), repository("config/vehicles/j8.yaml")
    out, recording = tmp_path / "drives.yaml", tmp_path / "run.mcap"
    weak = repository("config/conditions/realistic.yaml")
    run("simulate", scenario, "--controller", "pure-pursuit", "--conditions", weak, "--out", tmp_path, "--record", recording)
    log = tmp_path / "pure-pursuit.csv"
    for logs in ([recording], [log, recording]):
        arguments = ("identify", "--drives", *logs, "--vehicle", vehicle, "--out", out, "--force")
        printed, text = json.loads(run(*arguments, "--format", "json")), run(*arguments)
        found = sidehill.identify_drives(logs, j8)
        assert printed.pop("written") == str(out) and text.startswith(found.pop("text"))
        assert found.pop("notes") == [] and found == printed
    low, high = found["drives"]["traction"]["delay_s"]["interval_95"]
    assert low < 0.1 < high or high - low < 0.01
    frame = pandas.read_csv(log)
    assert sidehill.identify_drives([frame], j8)["drives"] == sidehill.identify_drives([log], j8)["drives"]
    # The file of the program and the dict are the same settings of a controller.
    driven = json.loads(
        run("simulate", scenario, "--controller", "icrik-mpc", "--conditions", out, "--format", "json")
    )["runs"][0]
    taken = sidehill.Scenario.load(scenario).with_(controller=found["controller"])
    metrics = sidehill.simulate(taken, "icrik-mpc").metrics["runs"][0]
    assert metrics["cross_track_rms_m"] == driven["cross_track_rms_m"]
    plain = sidehill.simulate(sidehill.Scenario.load(scenario), "icrik-mpc").metrics["runs"][0]
    assert plain["cross_track_rms_m"] != metrics["cross_track_rms_m"]
    assert sidehill.Controller(taken).step(0.0).status == "waiting"
    # A recording is a log of either kind.
    odometry = sidehill.odometry(recording, j8)
    assert "a recording of sidehill" in odometry.pop("notes")[0]
    assert odometry == json.loads(run("odometry", recording, "--vehicle", vehicle, "--format", "json"))
    with pytest.raises(ValueError, match=r"logs\[0\]: no column command_left_m_s"):
        sidehill.identify_drives([frame[["time_s", "v_left_m_s", "v_right_m_s"]]], j8)
    with pytest.raises(ValueError, match="logs: a list of logs is needed"):
        sidehill.identify_drives(untyped(log), j8)


def test_a_plant_is_driven_through_the_procedure_and_found_again(j8: sidehill.Vehicle) -> None:
    found = sidehill.identify(plant=Tilting(), vehicle=j8)
    estimates = untyped(found.level)["estimates"]
    left_m, right_m, _ = Tilting.icrs_m
    for name, value in {"x_icr_left_m": left_m, "x_icr_right_m": right_m, "correction_left": 1.0}.items():
        assert estimates[name]["value"] == pytest.approx(value, rel=0.03), name
    terms = untyped(found.extension_report)["terms"]
    slip = terms["outward_slip_s"]
    assert slip["verdict"] == "supported" and slip["value"] == pytest.approx(Tilting.outward_slip_s, rel=0.1)
    assert slip["value"] == found.to_dict()["extension"]["outward_slip_s"]
    assert terms["turn_loss_s_per_rad"]["verdict"] != "supported"
    assert found.verdict["max_slope_deg"] > 0


def test_a_plant_that_fails_or_has_other_ground_is_named(j8: sidehill.Vehicle) -> None:
    class Level(Tilting):
        pitch_max_rad = 0.0

    class Broken(Tilting):
        def step(self, v_left_m_s: float, v_right_m_s: float, dt_s: float) -> Any:
            raise KeyError("wheel")

    with pytest.raises(ValueError, match=r"plant: it was put on ground of 4\.0 deg and tells of 0\.4 deg"):
        sidehill.identify(plant=Level(), vehicle=j8)
    with pytest.raises(KeyError, match="wheel"):
        sidehill.identify(plant=Broken(), vehicle=j8)


def test_logs_that_are_exchanged_are_named(j8: sidehill.Vehicle, drive: Any) -> None:
    level = dict(drive, roll_rad=[0.0] * 1200, pitch_rad=[0.0] * 1200)
    with pytest.raises(ValueError, match=r"level\[0\] is from ground of 4\.0 deg.* exchanged"):
        sidehill.identify(level=[drive], slope=[level], vehicle=j8)
    with pytest.raises(ValueError, match=r"slope\[0\]: the log has no poses"):
        sidehill.identify(slope=[{name: drive[name] for name in list(drive)[:5]}], vehicle=j8)


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
        ({}, "level, slope, plant: logs or a plant"),
        ({"slope": [REPLAY], "plant": Tilting()}, "level, slope, plant: logs or a plant"),
        ({"plant": 3}, "plant: 3 has no method reset"),
        ({"slope": [REPLAY], "max_bytes": -1}, "max_bytes: -1 is not a whole number"),
        ({"slope": [REPLAY], "max_bytes": 1000}, "--max-bytes"),
        ({"slope": [REPLAY], "topics": 3}, "topics: 3 is not a path"),
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
