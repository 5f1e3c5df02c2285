"""Faults drawn from a seed, in real time: each draw is a vehicle and a controller of its own over ROS 2, all at once.

FAULT_SEED names another seed than 1, FAULT_DRAWS another number than 8. A draw that fails is named with both, and is drawn
again by them; its instants within a cycle are the machine's.
"""

import contextlib
import dataclasses
import json
import os
import random
import threading
import time

import pytest
from peer import FollowPath, Peer, path_of
from programs import Program, Vehicle, adapted, cross_track_m, figure_eight, wait_for

SEED = int(os.environ.get("FAULT_SEED", 1))
DRAWS = int(os.environ.get("FAULT_DRAWS", 8))
# Vehicles at once: two programs each, beside the tests' own.
AT_ONCE = 4

FAULTS = [
    "!stop [odometry]",
    "!stop [imu]",
    "!stop [transforms]",
    "!stop [odometry, imu, transforms]",
    "!not_a_number odometry",
    "!not_a_number imu",
    "!wrong_frame odometry",
    "!wrong_frame transforms",
    "freeze_stamps",
    "!delay_s 0.1",
    "!delay_s 2.0",
    "!clock_jump_s 0.3",
    "!clock_jump_s -30.0",
    "emergency_stop",
    "ignore_commands",
]
# From the end of a goal to standstill: the longest ramp, and what a shared machine adds.
STANDSTILL_S = 2.0
# How far from the path the vehicle may ever be: half the distance at which the controller gives up.
ASIDE_M = 0.5

# The binding of CycloneDDS makes topics in one thread at a time.
MAKES_TOPICS = threading.Lock()


@dataclasses.dataclass
class Draw:
    """What goes wrong in a drive."""

    number: int
    windows: list

    @staticmethod
    def of(number):
        rng = random.Random(f"{SEED}-{number}")

        def window():
            # A twentieth of a second to five; as many short ones as long ones.
            for_s = 0.05 * 100 ** rng.random()
            return round(rng.uniform(1.5, 6.0), 3), round(for_s, 3), rng.choice(FAULTS)

        return Draw(number, [window() for _ in range(2 if rng.random() < 0.25 else 1)])

    def rows(self):
        return "".join(
            f"\n  - {{after_enabled_s: {at_s}, for_s: {for_s}, fault: {fault}}}" for at_s, for_s, fault in self.windows
        )

    def over_s(self):
        """When all is well again, s after the drives are on."""
        return max(at_s + for_s for at_s, for_s, _ in self.windows)


def drive(draw, domain, folder):
    """Drives a figure of eight through the faults; fails if the vehicle does not do what it must."""
    folder.mkdir()
    points = figure_eight(1000)
    with contextlib.ExitStack() as ending:

        def start(*arguments):
            program = Program(arguments, domain, folder / f"{arguments[0]}.log")
            ending.callback(program.kill)
            return program

        vehicle = adapted("vehicle_ros2.yaml", {r"^  faults: \[\]$": f"  faults:{draw.rows()}"}, folder)
        rover = Vehicle(start("vehicle", vehicle, "--truth", folder / "truth.csv"), folder / "truth.csv")
        run = start("run", adapted("run_ros2.yaml", {}, folder), "--out", folder / "run")
        with MAKES_TOPICS:
            action = FollowPath(Peer(domain))
        action.wait()
        goal = action.send(path_of(points))
        assert goal.reply.accepted
        wait_for(lambda: abs(rover.now()["traction_m_s"]) > 0.2, "driving")

        until = time.monotonic() + draw.over_s() + 4.0
        ended = lambda: goal.status() in (FollowPath.SUCCEEDED, FollowPath.CANCELED, FollowPath.ABORTED)
        while time.monotonic() < until and not ended():
            time.sleep(0.05)
        if ended():
            answer = goal.result()
            assert answer.status == FollowPath.ABORTED and answer.result.error_msg != "", answer
            wait_for(rover.stands, "standstill", timeout_s=STANDSTILL_S)
            stopped = rover.truth()[-1]
            # What comes back arms nothing.
            time.sleep(max(until - time.monotonic(), 1.0))
            rows = rover.truth()
            after = [row for row in rows if row["unix_s"] > stopped["unix_s"] + 0.1]
            assert after and all(row["traction_m_s"] == 0 == row["steer_m_s"] for row in after), "it moves again"
            events = [json.loads(line) for line in (folder / "run" / "events.jsonl").read_text().splitlines()]
            stops = [event for event in events if event.get("to") in ("stopping", "latched", "estopped", "halting")]
            assert stops and all(event["reason"] for event in stops), events
            outcome = answer.result.error_msg
        else:
            rows = rover.truth()
            assert rows[-1]["traction_m_s"] > 0.1, "it neither drives nor has ended its goal"
            outcome = "drove on"
        assert run.running() and rover.program.running()
        moving = [row for row in rows if row["time_s"] > 0]
        aside_m = max(cross_track_m(moving, points))
        assert aside_m < ASIDE_M, f"{aside_m:.2f} m aside"
        return outcome, aside_m


def test_drawn_faults_end_in_a_stop_with_its_reason_or_the_drive_goes_on(tmp_path, capsys):
    draws = [Draw.of(number) for number in range(DRAWS)]
    # Domains of other tests end before this one begins.
    domains = random.sample(range(1, 102), AT_ONCE)
    outcomes, failures = {}, []
    waiting = iter(draws)
    lock = threading.Lock()

    def work(domain):
        while True:
            with lock:
                draw = next(waiting, None)
            if draw is None:
                return
            try:
                outcomes[draw.number] = drive(draw, domain, tmp_path / str(draw.number))
            except BaseException as error:  # noqa: BLE001: what fails in a thread fails the test.
                failures.append(f"seed {SEED}, draw {draw.number}, {draw.windows}: {error}")

    threads = [threading.Thread(target=work, args=[domain]) for domain in domains]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with capsys.disabled():
        for draw in draws:
            if draw.number in outcomes:
                outcome, aside_m = outcomes[draw.number]
                print(f"\nseed {SEED}, draw {draw.number}, {draw.windows}: {outcome}; {100 * aside_m:.1f} cm aside", end="")
    if failures:
        pytest.fail("\n".join(failures))
