"""What tests share: the repository's files, and the program whose figures the wheel must have."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sidehill

REPOSITORY = Path(__file__).resolve().parents[3]


def untyped(value: object) -> Any:
    """Returns a value of a type that a checker would refuse."""
    return value


def repository(name: str) -> Path:
    return REPOSITORY / name


@pytest.fixture(scope="session")
def program() -> Path:
    """The program built from the same sources: SIDEHILL_PROGRAM, or cargo's newest build."""
    named = os.environ.get("SIDEHILL_PROGRAM")
    built = [Path(named)] if named else list((REPOSITORY / "target").glob("*/sidehill"))
    built = [path for path in built if path.is_file()]
    assert built, "no program: run `cargo build`, or set SIDEHILL_PROGRAM"
    return max(built, key=lambda path: path.stat().st_mtime)


@pytest.fixture
def run(program: Path, tmp_path: Path) -> Callable[..., str]:
    """Runs the program and returns what it prints."""

    def run(*arguments: object, stdin: str = "") -> str:
        command = [str(program), *map(str, arguments)]
        done = subprocess.run(command, input=stdin, capture_output=True, text=True, timeout=300, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return str(done.stdout)

    return run


@pytest.fixture(scope="session")
def j8() -> sidehill.Vehicle:
    return sidehill.Vehicle.load(repository("config/vehicles/j8.yaml"))


@pytest.fixture(scope="session")
def eight() -> sidehill.Scenario:
    return sidehill.Scenario.load(repository("config/scenarios/figure_eight.yaml"))


@pytest.fixture(scope="session")
def short(eight: sidehill.Scenario) -> sidehill.Scenario:
    """Seven seconds across a slope of 8 deg."""
    return eight.with_(
        name="short",
        terrain={"kind": "plane", "slope_deg": 8, "uphill_heading_deg": 60},
        course={"shape": "straight", "length_m": 2, "speed_m_s": 0.5},
        controllers=["icrik-mpc", "pure-pursuit"],
    )
