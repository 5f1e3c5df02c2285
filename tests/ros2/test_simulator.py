"""`use_sim_time` beside a simulator that is paused, reset, or faster than time, and a vehicle that digs in."""

import itertools
import json
import math
import re
import signal
import socket
import statistics
import threading
import time

import pytest

import wire
from peer import FollowPath, path_of, stamp
from programs import adapted, cross_track_m, straight, wait_for

TF_ERROR = 102
# Of simulated time, s.
STEP_S = 0.01
# Of poses, m.
NOISE_M = 0.001
# Time-outs run on the clock, too: as long as without it for a loaded machine that is to be three times as fast as time.
LONGER = {"feedback_timeout_s: 0.3": "feedback_timeout_s: 0.9\n  command_timeout_s: 0.45"}


class Simulator:
    """A rover on level ground that obeys `cmd_vel` at once, with the clock."""

    def __init__(self, peer, factor):
        self.factor, self.paused, self.ended = factor, threading.Event(), threading.Event()
        self.clock, self.odometry = peer.writer("/clock", wire.Clock), peer.writer("/odom", wire.Odometry)
        self.commands = peer.reader("/cmd_vel", wire.Twist)
        self.reset()
        # Where wheels that turn forward dig in, and since when they have, s.
        self.digs, self.digs_since_s = lambda x, y: False, None
        # The pose that is published whatever the vehicle does.
        self.frozen = None
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def reset(self):
        self.time_s, self.x, self.y, self.yaw, self.command, self.places = 0.0, 0.0, 0.0, 0.0, wire.Twist(), []

    def run(self):
        due = time.monotonic()
        while not self.ended.is_set():
            due = max(due + STEP_S / self.factor, time.monotonic() - 0.05)
            time.sleep(max(due - time.monotonic(), 0.0))
            if self.paused.is_set():
                continue
            self.step()

    def step(self):
        self.command = (self.commands.take() or [self.command])[-1]
        forward_m, turned = self.command.linear.x * STEP_S, self.command.angular.z * STEP_S
        if forward_m > 0.0 and self.digs(self.x, self.y):
            forward_m = turned = 0.0
            self.digs_since_s = self.digs_since_s or self.time_s
        self.x += forward_m * math.cos(self.yaw + 0.5 * turned)
        self.y += forward_m * math.sin(self.yaw + 0.5 * turned)
        self.yaw += turned
        self.time_s += STEP_S
        self.clock.write(wire.Clock(clock=stamp(self.time_s)))
        if round(self.time_s / STEP_S) % 2 == 0:
            self.places.append({"x_m": self.x, "y_m": self.y})
            noise_m = NOISE_M * (len(self.places) % 3 - 1)
            x, y, yaw = self.frozen or (self.x + noise_m, self.y - noise_m, self.yaw)
            half = 0.5 * yaw
            place = wire.Pose(
                position=wire.Point(x=x, y=y),
                orientation=wire.Quaternion(z=math.sin(half), w=math.cos(half)),
            )
            self.odometry.write(
                wire.Odometry(
                    header=wire.Header(stamp=stamp(self.time_s), frame_id="odom"),
                    child_frame_id="base_link",
                    pose=wire.PoseWithCovariance(pose=place),
                    twist=wire.TwistWithCovariance(twist=self.command),
                )
            )

    def drives(self):
        return self.command.linear.x > 0.4

    def end(self):
        self.ended.set()
        self.thread.join()


@pytest.fixture
def simulated(peer, start, tmp_path):
    """Starts a simulator and the controller on its clock; returns both with a client of the action."""
    simulators = []

    def simulated(*arguments, factor=1.0, changes={}, **environment):
        simulators.append(Simulator(peer, factor))
        changes = {"attitude: imu": "attitude: odometry", "use_sim_time: false": "use_sim_time: true", **changes}
        file = adapted("run_ros2.yaml", changes, tmp_path)
        run = start("run", file, "--out", tmp_path / "run", *arguments, **environment)
        return simulators[0], run, FollowPath(peer).wait()

    yield simulated
    for simulator in simulators:
        simulator.end()


def ahead(length_m):
    return path_of(straight(length_m, yaw_rad=0.0), "odom")


def test_a_simulator_that_is_paused_goes_on_with_the_goal(simulated, tmp_path):
    systemd = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    systemd.bind(str(tmp_path / "notify"))
    signs = []

    def listen():
        while True:
            if b"WATCHDOG=1" in systemd.recv(4096):
                signs.append(time.monotonic())

    threading.Thread(target=listen, daemon=True).start()
    simulator, run, action = simulated(NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="600000")
    goal = action.send(ahead(5.0))
    wait_for(simulator.drives, "driving")
    simulator.paused.set()
    time.sleep(0.2)
    simulator.commands.take()
    # Longer than any time-out of readings, and than the limit of a jump.
    paused = time.monotonic()
    time.sleep(4.0)
    # The program is alive, as systemd hears.
    alive = [paused, *(sign for sign in signs if sign > paused), time.monotonic()]
    assert max(later - sign for sign, later in itertools.pairwise(alive)) < 1.0, alive
    # What has stopped the time may also be that its source is lost.
    told = [(twist.linear.x, twist.angular.z) for twist in simulator.commands.take()]
    assert told and not any(any(speeds) for speeds in told), told
    assert goal.status() == FollowPath.EXECUTING
    place = simulator.x
    simulator.paused.clear()
    answer = goal.result(60)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg + run.output()
    assert place < 4.0 and abs(simulator.x - 5.0) < 0.25


def test_a_simulator_is_driven_three_times_as_fast_as_time(simulated):
    simulator, run, action = simulated(factor=3.0, changes=LONGER)
    bend = [(2.0 * math.sin(a), 2.0 - 2.0 * math.cos(a)) for a in (0.01 * i for i in range(629))]
    began, began_s = time.monotonic(), simulator.time_s
    answer = action.send(path_of(bend, "odom")).result(60)
    took_s = simulator.time_s - began_s
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg + run.output()
    print(f"{took_s:.1f} s of the simulator in {time.monotonic() - began:.1f} s")
    # A loaded machine may be slower than that.
    assert took_s > 1.5 * (time.monotonic() - began)
    median_m = statistics.median(cross_track_m(simulator.places, bend))
    print(f"cross-track {median_m:.3f} m, the median")
    assert median_m < 0.02


def test_a_simulator_that_is_reset_ends_the_goal_and_drives_the_next(simulated):
    simulator, run, action = simulated()
    # The clock and the vehicle are back at the beginning while it drives.
    goal = action.send(ahead(20.0))
    wait_for(lambda: simulator.x > 2.0, "driving")
    simulator.reset()
    answer = goal.result(20)
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, TF_ERROR)
    assert answer.result.error_msg == "the clock has jumped"
    wait_for(lambda: simulator.command == wire.Twist(), "standing")
    answer = action.send(ahead(simulator.x + 3.0)).result(60)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg + run.output()


# A vehicle that is driven back goes in reverse.
IN_REVERSE = {"use_orientations: false": "use_orientations: true"}


def test_a_vehicle_that_digs_in_stops_and_is_driven_back(simulated, start, tmp_path):
    simulator, run, _ = simulated(factor=3.0, changes={**LONGER, **IN_REVERSE})
    (tmp_path / "lane.csv").write_text("x_m,y_m\n0,0\n3,0\n6,0\n")
    simulator.digs = lambda x, y: x > 3.0
    driver = start("drive-route", tmp_path / "run_ros2.yaml", "lane", "--retreat-m", "1")
    wait_for(lambda: simulator.digs_since_s, "wheels that dig", 30)
    wait_for(lambda: simulator.command.linear.x <= 0.0, "a stop")
    assert simulator.time_s - simulator.digs_since_s < 2.0
    wait_for(lambda: "paused" in driver.output(), "the retreat", 20)
    assert "the treads turn and the vehicle stays where it is" in driver.output()
    back_m = float(re.search(r"driven back (\d\.\d) m; Enter", driver.output())[1])
    assert abs(back_m - 1.0) < 0.2 and abs(float(re.search(r"paused at (\d\.\d) m", driver.output())[1]) - 2.0) < 0.2
    # In reverse, along the lane.
    assert abs(simulator.x - 2.0) < 0.3 and abs(simulator.y) < 0.1 and abs(simulator.yaw) < 0.2
    place = simulator.x
    time.sleep(1.0)
    assert simulator.x == place
    # The operator has seen to it.
    simulator.digs = lambda x, y: False
    driver.signal(signal.SIGUSR1)
    assert driver.process.wait(30) == 0, driver.output() + run.output()
    assert abs(simulator.x - 6.0) < 0.25


def test_a_vehicle_goes_round_a_place_where_it_has_dug_in_once(simulated, start, tmp_path):
    recording, report = tmp_path / "drive.mcap", tmp_path / "report.html"
    recorded = ["--record", recording, "--report", report]
    faster = {"speed: {speed_m_s: 0.5": "speed: {speed_m_s: 1.0"}
    simulator, run, _ = simulated(*recorded, factor=3.0, changes={**LONGER, **IN_REVERSE, **faster})
    (tmp_path / "lane.csv").write_text("x_m,y_m\n0,0\n3,0\n10,0\n")
    dug = []

    def digs(x, y):
        soft = abs(x - 5.0) < 0.3 and abs(y) < half_width_m
        dug.extend([(x, y)] if soft else [])
        return soft

    half_width_m, simulator.digs = 0.3, digs
    lane = ["drive-route", tmp_path / "run_ros2.yaml", "lane", "--passes", "2", "--retreat-m", "4"]
    near = start(*lane, "--go-round-m", "3")
    assert near.process.wait(10) == 2 and re.search(r"--retreat-m \d\.\d would do", near.output()), near.output()
    driver = start(*lane, "--go-round-m", "0.8")
    wait_for(lambda: "goes round" in driver.output(), "the retreat", 30)
    first = len(dug)
    wait_for(lambda: "pass 2 of 2" in driver.output(), "the end of the lane", 30)
    # To the left of travel, and the next time round it from the start.
    aside = [at["y_m"] for at in simulator.places if abs(at["x_m"] - 5.0) < 0.3]
    assert max(aside) > 0.7 and len(dug) == first, driver.output() + run.output()
    # It digs in there all the same: the drive ends.
    half_width_m = 2.0
    assert driver.process.wait(30) == 1, driver.output() + run.output()
    [told] = re.findall(r"ended at .*", driver.output())
    assert "it was stuck there before; with --from-m" in told
    x, y = map(float, re.search(r" --stuck-at (\S+),(\S+) it goes on", told).groups())
    assert abs(x - 4.7) < 0.2 and abs(y) < 0.1
    assert driver.output().count("drives back") == 1
    # The report marks both.
    run.signal(signal.SIGINT)
    assert run.process.wait(20) == 0, run.output()
    drive = json.loads(re.search(r'<script id="drive"[^>]*>(.*?)</script>', report.read_text(), re.DOTALL)[1])
    first_x, first_y, last_x, last_y = drive["parts"]["dug_in"]
    assert abs(first_x - 4.7) < 0.2 and abs(first_y) < 0.1
    assert abs(last_x - 5.3) < 0.2 and abs(last_y) < 1.0
    assert [text for _, _, name, text in drive["events"] if name == "dug_in"][0] == f"x {first_x:.2f} m, y {first_y:.2f} m"


def test_a_vehicle_whose_poses_are_frozen_is_not_driven_back(simulated, start, tmp_path):
    simulator, run, _ = simulated(changes=IN_REVERSE)
    (tmp_path / "lane.csv").write_text("x_m,y_m\n0,0\n3,0\n6,0\n")
    driver = start("drive-route", tmp_path / "run_ros2.yaml", "lane", "--retreat-m", "1")
    wait_for(lambda: simulator.x > 1.0, "driving", 20)
    simulator.frozen = (simulator.x, simulator.y, simulator.yaw)
    wait_for(lambda: "paused" in driver.output(), "a stop", 10)
    # It may have come farther than the poses say.
    assert "the pose stays the same to the bit" in driver.output() and "drives back" not in driver.output()
    place = simulator.x
    time.sleep(1.0)
    assert simulator.x == place
