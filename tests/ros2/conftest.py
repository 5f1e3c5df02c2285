import itertools
import os
import random
import struct
import subprocess

import pytest
from programs import Program, Vehicle, adapted


# Up to 101 the ports of a domain are below those that the system gives to others.
DOMAINS = itertools.cycle(random.sample(range(1, 102), 101))


@pytest.fixture
def domain():
    """A domain of its own for each test, so that none hears another that has not left yet."""
    return next(DOMAINS)


@pytest.fixture
def other_domain():
    """One more, for a test with two networks."""
    return next(DOMAINS)


@pytest.fixture
def peer(domain):
    # Tests with another peer run where this one is not installed.
    from peer import Peer

    return Peer(domain)


@pytest.fixture
def middleware():
    """The peer's, whose mapping of services the programs use."""
    return "rmw_cyclonedds_cpp"


@pytest.fixture
def start(domain, middleware, tmp_path):
    """Starts `sidehill` with arguments; whatever a test leaves running ends with it."""
    programs = []

    def start(*arguments, **environment):
        log = tmp_path / f"{arguments[0]}_{len(programs)}.log"
        environment = {"RMW_IMPLEMENTATION": middleware, **environment}
        program = Program(arguments, domain, log, **environment)
        programs.append(program)
        return program

    yield start
    for program in programs:
        if program.running():
            program.kill()
        print(f"--- {program.log.name}\n{program.output()[-4000:]}")
    for events in tmp_path.glob("*/events.jsonl"):
        print(f"--- {events.parent.name}/{events.name}\n{events.read_text()[-4000:]}")


@pytest.fixture
def set_clock(tmp_path, monkeypatch):
    """Sets the system's clock of all programs that are started from now on, by s in all."""
    library, shift = tmp_path / "shifted_clock.so", tmp_path / "shift"
    source = os.path.join(os.path.dirname(__file__), "shifted_clock.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    shift.write_bytes(struct.pack("=q", 0))
    monkeypatch.setenv("LD_PRELOAD", str(library))
    monkeypatch.setenv("SHIFTED_CLOCK", str(shift))

    def set_clock(by_s):
        with open(shift, "r+b") as file:
            file.write(struct.pack("=q", round(1e9 * by_s)))

    return set_clock


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
