import os
import random
import re
import signal

import pytest

from peer import REPOSITORY, Peer, Program


@pytest.fixture
def domain():
    """A domain of its own for each test, so that none hears another; up to 101 ports are free."""
    return random.randint(1, 101)


@pytest.fixture
def peer(domain):
    return Peer(domain)


@pytest.fixture
def start(domain, tmp_path):
    """Starts `sidehill` with arguments; whatever a test leaves running ends with it."""
    programs = []

    def start(*arguments, **environment):
        log = tmp_path / f"{arguments[0]}_{len(programs)}.log"
        program = Program(arguments, domain, log, **environment)
        programs.append(program)
        return program

    yield start
    for program in programs:
        if program.running():
            program.kill()
        print(f"--- {program.log.name}\n{program.output()[-4000:]}")


def adapted(name, replaced, tmp_path):
    """A configuration of the repository with some of its lines replaced: {pattern: text}."""
    folder = os.path.join(REPOSITORY, "config", "bridge")
    with open(os.path.join(folder, name)) as file:
        text = file.read()
    text = re.sub(r"\.\./", os.path.join(REPOSITORY, "config") + "/", text)
    for pattern, replacement in replaced.items():
        text, count = re.subn(pattern, lambda _: replacement, text, flags=re.MULTILINE)
        assert count == 1, f"{pattern} is {count} times in {name}"
    path = tmp_path / name
    path.write_text(text)
    return path


class Vehicle:
    """A virtual vehicle on ROS 2 and its truth."""

    def __init__(self, program, truth):
        self.program, self.truth_file = program, truth

    def truth(self):
        """Rows of the truth as dictionaries, numbers as numbers."""
        with open(self.truth_file) as file:
            names = file.readline().strip().split(",")
            rows = [line.strip().split(",") for line in file if line.endswith("\n")]
        number = lambda text: float(text) if re.match(r"^-?[0-9.]", text) else text
        return [dict(zip(names, map(number, row))) for row in rows]

    def now(self):
        return self.truth()[-1]

    def stands(self):
        row = self.now()
        return row["traction_m_s"] == 0.0 and row["steer_m_s"] == 0.0


@pytest.fixture
def vehicle(start, tmp_path):
    """Starts the vehicle of config/bridge/vehicle_ros2.yaml, with lines of it replaced."""

    def vehicle(replaced={}, faults=(), ros=()):
        if faults:
            rows = "".join(f"\n  - {fault}" for fault in faults)
            replaced = {**replaced, r"^  faults: \[\]$": f"  faults:{rows}"}
        config = adapted("vehicle_ros2.yaml", replaced, tmp_path)
        truth = tmp_path / "truth.csv"
        arguments = ["vehicle", config, "--truth", truth]
        if ros:
            arguments += ["--ros-args", *ros]
        return Vehicle(start(*arguments), truth)

    return vehicle
