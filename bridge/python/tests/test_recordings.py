"""Replay and report of recordings, and paths of recorded drives, against the program."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sidehill
from conftest import repository, untyped

SCENARIO = repository("config/scenarios/slalom.yaml")


@pytest.fixture(scope="module")
def recording(program: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("recorded") / "drive.mcap"
    command = [program, "simulate", SCENARIO, "--controller", "icrik-mpc", "--record", file]
    subprocess.run([str(word) for word in command], check=True, capture_output=True, timeout=300)
    return file


def test_a_replay_is_that_of_the_program(recording: Path, run: Callable[..., str], tmp_path: Path) -> None:
    printed = json.loads(run("replay", recording, "--format", "json"))
    found = sidehill.replay(recording)
    assert found == printed and found["different"] == 0 < found["cycles"]
    changed = sidehill.replay(
        recording, controller="icrhk-mpc", settings={"weights.cross_per_m2": 20}, report=tmp_path / "changed.html"
    )
    assert changed["different"] > 0 and changed["controller"] == "icrhk-mpc"
    assert "<html" in (tmp_path / "changed.html").read_text()
    with pytest.raises(ValueError, match=r"changed\.html"):
        sidehill.replay(recording, report=tmp_path / "changed.html")
    again = sidehill.replay(recording, closed_loop=True, plant="contact")
    assert again["closed_loop"] and again["cross_track_rms_m"][1] != again["cross_track_rms_m"][0]


def test_a_report_is_that_of_the_program(recording: Path, run: Callable[..., str], tmp_path: Path) -> None:
    printed = json.loads(run("report", recording, "--format", "json"))
    page = tmp_path / "drive.html"
    assert sidehill.report(recording, page) == printed and printed["passed"] is None
    assert "<html" in page.read_text()
    assert sidehill.report(recording, limits={"max_cross_track_m": 1.0})["passed"] is True
    assert sidehill.report(recording, limits={"max_cross_track_m": 1e-6})["passed"] is False


def test_a_path_is_that_of_the_program(run: Callable[..., str], tmp_path: Path) -> None:
    run("simulate", SCENARIO, "--controller", "pure-pursuit", "--out", tmp_path / "driven")
    log = tmp_path / "driven" / "pure-pursuit.csv"
    run("route", log, "--out", tmp_path / "program.csv")
    found = sidehill.route(log, tmp_path / "path.csv")
    assert (tmp_path / "path.csv").read_bytes() == (tmp_path / "program.csv").read_bytes()
    rows = len((tmp_path / "path.csv").read_text().splitlines())
    assert rows == found["points"] + 1 < found["positions"] and found["deviation_m"] < 0.1 and found["notes"] == []


def test_what_is_wrong_is_named(recording: Path, tmp_path: Path) -> None:
    def fails(call: Callable[[], Any], *parts: str) -> None:
        with pytest.raises(ValueError) as error:
            call()
        assert all(part in str(error.value) for part in parts), error.value

    text = tmp_path / "text.mcap"
    text.write_text("no recording")
    fails(lambda: sidehill.replay(text), "text.mcap")
    fails(lambda: sidehill.report(text), "text.mcap")
    fails(lambda: sidehill.replay(untyped(3)), "recording: a path is needed, not 3")
    fails(lambda: sidehill.replay(recording, controller=untyped("best")), "best", "icrik-mpc")
    fails(lambda: sidehill.replay(recording, settings={"weights.cross": 1}), "weights.cross")
    fails(lambda: sidehill.report(recording, limits={"max_error_m": 1}), "max_error_m", "max_cross_track_m")
    fails(lambda: sidehill.report(recording, map=tmp_path / "map.mbtiles"), "map: ", "`out`")
    fails(lambda: sidehill.route(text, tmp_path / "path.txt"), "path.txt", ".gpx or .csv")
    for call in (sidehill.replay, sidehill.report):
        with pytest.raises(FileNotFoundError):
            call(tmp_path / "none.mcap")
    with pytest.raises(FileNotFoundError):
        sidehill.route(tmp_path / "none.csv", tmp_path / "path.csv")
