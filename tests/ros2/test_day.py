"""The first day with a robot, by the commands of the guide's page on RTK: recorded by joystick, driven in lanes."""

import csv
import json
import math
import os
import re
import signal
import statistics
import subprocess
import threading
import time

import wire
from peer import FollowPath, Peer, path_of
from programs import SIDEHILL, Vehicle, adapted, cross_track_m, repeating, straight, wait_for
from test_guide import blocks

PAGE = "rtk.md"
# The distance from lane to lane of the page, m.
LANE_M = 0.8


def run_commands(page, needs=""):
    """Runs a page's commands of a kind; by default those that need nothing."""
    path = f"{os.path.dirname(SIDEHILL)}:{os.environ['PATH']}"
    said = ""
    for block in blocks(page, needs):
        script, environment = "\n".join(block), {**os.environ, "PATH": path}
        said += subprocess.run(["sh", "-euc", script], check=True, env=environment, stdout=-1, text=True).stdout
    return said


def words(needs):
    """The arguments of the only commands of a kind on the page."""
    [lines] = blocks(PAGE, needs)
    return [line.removesuffix("&").split()[1:] for line in lines]


def twist(forward_m_s=0.0, yaw_rate_rad_s=0.0):
    return wire.Twist(linear=wire.Vector3(x=forward_m_s), angular=wire.Vector3(z=yaw_rate_rad_s))


def joystick(writers, seconds, forward_m_s, yaw_rate_rad_s=0.0):
    asked = twist(forward_m_s, yaw_rate_rad_s)
    with repeating(lambda: [writer.write(asked) for writer in writers]):
        time.sleep(seconds)


def moved_left(points, left_m):
    """A line moved to the left of its direction, point by point."""
    moved = []
    for index, (x, y) in enumerate(points):
        (ax, ay), (bx, by) = points[max(index - 1, 0)], points[min(index + 1, len(points) - 1)]
        length = math.dist((ax, ay), (bx, by))
        moved.append((x - left_m * (by - ay) / length, y + left_m * (bx - ax) / length))
    return moved


def test_the_first_day_with_a_robot(start, peer, other_domain, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_commands("first_run.md")
    run_commands(PAGE)
    # Between the receiver and Sidehill, where fixes can get lost.
    received, sent = peer.reader("/receiver", wire.NavSatFix), peer.best_effort_writer("/fix", wire.NavSatFix)
    lost = threading.Event()

    def relay():
        for fix in received.take():
            if not lost.is_set():
                sent.write(fix)

    with repeating(relay, 0.005):
        log_and_identify(start, peer, other_domain, tmp_path)
        drive_lanes(start, peer, tmp_path, lost)


def with_poses(run):
    wait_for(lambda: re.search(r'"x_m":-?[0-9]', run.output()), "poses")


def log_and_identify(start, peer, level_domain, tmp_path):
    """Records a route and logs by joystick, on the slope and on level ground at once, and identifies the vehicle."""
    truth = tmp_path / "truth.csv"
    [vehicle_words, run_words] = words("ros2")
    vehicle = Vehicle(start(*vehicle_words, "--truth", truth, "--ros-args", "-r", "fix:=/receiver"), truth)
    programs = [vehicle.program, start(*run_words)]
    programs += [start(*words, ROS_DOMAIN_ID=str(level_domain)) for words in words("level")]
    commands = [peer.writer("/cmd_vel", wire.Twist) for peer in (peer, Peer(level_domain))]
    for writer, run in zip(commands, programs[1::2]):
        wait_for(writer.get_matched_subscriptions, "base")
        with_poses(run)

    # Recorded by joystick: standing, 5 m in a wide bend, standing.
    recorder = start(*words("record")[0])
    joystick(commands, 3, 0.0)
    wait_for(lambda: "recording" in recorder.output(), "recorder")
    joystick(commands, 12.5, 0.4, 0.04)
    joystick(commands, 1.5, 0.0)
    assert recorder.end() == 0, recorder.output()
    lane = lane_points()
    driven = [(row["x_m"], row["y_m"]) for row in vehicle.truth() if row["traction_m_s"] > 0.0]
    length_m = sum(math.dist(a, b) for a, b in zip(lane, lane[1:]))
    assert 4.5 < length_m < 5.5, recorder.output()
    # Where the vehicle was, not where its antenna was: that is 0.23 m aside here.
    assert statistics.median(cross_track_m([{"x_m": x, "y_m": y} for x, y in driven[50:-50:10]], lane)) < 0.02
    run_commands(PAGE, "look")

    for asked in [(0.3, 0.6), (0.3, -0.6), (-0.3, 0.6), (-0.3, -0.6), (0.0, 0.7), (0.6, 0.3)]:
        joystick(commands, 12, *asked)
    joystick(commands, 1, 0.0)
    for program in programs:
        assert program.end() == 0, program.output()
    said = run_commands(PAGE, "identify")
    print(said)
    # Good enough for the hill of 15 deg.
    assert int(re.search(r"verdict: good enough to drive at up to (\d+) deg", said)[1]) >= 15, said


def lane_points():
    with open("husky/lane.csv") as file:
        return [(float(row["x_m"]), float(row["y_m"])) for row in csv.DictReader(file)]


def drive_lanes(start, peer, tmp_path, lost):
    truth = tmp_path / "truth_of_lanes.csv"
    vehicle_words, run_words, drive_words = words("drive")
    vehicle = Vehicle(start(*vehicle_words, "--truth", truth, "--ros-args", "-r", "fix:=/receiver"), truth)
    run = start(*run_words)
    stop = peer.writer("/emergency_stop", wire.Bool, latched=True)
    with_poses(run)
    run_in_place = lambda arguments: subprocess.run([SIDEHILL, *arguments], check=True, capture_output=True, text=True)
    # On the first lane the operator pauses, on the second fixes are lost, on the third somebody presses the stop.
    since = vehicle.now()["time_s"]
    driver = start(*drive_words)
    says = lambda text, timeout_s=60: wait_for(lambda: text in driver.output(), f"{text} in {driver.output()}", timeout_s)
    says("lane 1 of 3")
    wait_for(lambda: vehicle.now()["traction_m_s"] > 0.3, "lane 1")
    time.sleep(1.0)
    driver.signal(signal.SIGUSR2)
    says("paused")
    wait_for(vehicle.stands, "pause")
    driver.signal(signal.SIGUSR1)
    says("lane 1 of 3: goes on")


    def under_way():
        """Whether the vehicle has driven on straight for a second, as on a lane and not on the way there."""
        now = vehicle.truth(time.time())[-1]["time_s"]
        rows = [row for row in vehicle.truth() if row["time_s"] > now - 1.0]
        return all(row["traction_m_s"] > 0.4 and abs(row["steer_m_s"]) < 0.1 for row in rows)

    says("lane 2 of 3")
    wait_for(under_way, "lane 2", 30, 0.1)
    lost.set()
    lost_since = time.time()
    time.sleep(8)
    lost.clear()
    # Where its position was too uncertain before that, it stands and waits for the operator.
    time.sleep(1)
    if driver.output().count("paused") > 1:
        assert "the position across the path is uncertain" in driver.output()
        driver.signal(signal.SIGUSR1)
    says("lane 3 of 3")
    wait_for(under_way, "lane 3", 30, 0.1)
    stop.write(wire.Bool(data=True))
    says("the emergency stop is pressed")
    wait_for(vehicle.stands, "stop", 5)
    stop.write(wire.Bool(data=False))
    time.sleep(0.5)
    driver.signal(signal.SIGUSR1)
    assert driver.process.wait(60) == 0, driver.output() + run.output()
    print(driver.output())

    rows = [row for row in vehicle.truth() if row["time_s"] > since]
    # It has driven on without fixes for a while.
    blind = [row for row in rows if 0.0 < row["unix_s"] - lost_since < 4.0]
    assert all(row["traction_m_s"] > 0.1 for row in blind), driver.output()
    assert run.end() == 0, run.output()
    lanes = [moved_left(lane_points(), LANE_M * index) for index in range(3)]
    distances = []
    for row in rows:
        if abs(row["traction_m_s"]) < 0.1:
            continue
        place = [(row["x_m"], row["y_m"])]
        ahead = (-math.sin(row["yaw_rad"]), math.cos(row["yaw_rad"]))
        for points in lanes:
            near = min(range(len(points) - 1), key=lambda i: math.dist(place[0], points[i]))
            along = (points[near + 1][0] - points[near][0], points[near + 1][1] - points[near][1])
            turned = abs(ahead[0] * along[0] + ahead[1] * along[1]) / math.hypot(*along)
            [distance] = cross_track_m([{"x_m": place[0][0], "y_m": place[0][1]}], points[max(near - 1, 0) :])
            # On a lane and along it, not on the way to the next.
            if distance < 0.3 and turned > 0.9 and 0 < near < len(points) - 2:
                distances.append(distance)
    assert len(distances) > 1000
    print(f"cross-track: median {statistics.median(distances):.4f} m, largest {max(distances):.3f} m")
    assert statistics.median(distances) < 0.02

    replayed = subprocess.run([SIDEHILL, *words("after")[0], "--format", "json"], capture_output=True, text=True)
    assert json.loads(replayed.stdout)["different"] == 0, replayed.stdout + replayed.stderr

    # The report tells what the fixes were worth, and that they were lost for 8 s.
    recording = next(word for word in words("after")[0] if word.endswith(".mcap"))
    facts = json.loads(run_in_place(["report", recording, "--format", "json"]).stdout)
    fixes = next(sensor for sensor in facts["sensors"] if sensor["name"] == "fixes used")
    assert 7.5 < fixes["gap_max_s"] < 9.5 and 0.0 <= fixes["age_p50_s"] < 0.3, fixes
    assert facts["fixes"]["rtk_share"] == 1.0 and facts["fixes"]["sigma_max_m"] < 0.1, facts["fixes"]


def test_a_stretch_of_a_route_is_driven_again(start, vehicle, tmp_path):
    rover = vehicle()
    begins = rover.now()
    heading = begins["yaw_rad"] + math.pi / 2
    come_m = lambda: math.dist((rover.now()["x_m"], rover.now()["y_m"]), (begins["x_m"], begins["y_m"]))
    # It stops within 1 s and 0.25 m or more, so that the point is on the ramp whenever the signal arrives.
    config = adapted("run_ros2.yaml", {"^  feedback_timeout_s: .*$": "  feedback_timeout_s: 0.3\n  deceleration_m_s2: 0.25"}, tmp_path)
    run = start("run", config)
    points = straight(6.0, (begins["x_m"], begins["y_m"]), heading, step_m=1.0)
    points.insert(5, straight(4.3, points[0], heading, step_m=4.3)[1])
    actions = {2: "probe", 5: "ramp"}
    rows = [f"{x},{y},{actions.get(index, '')}" for index, (x, y) in enumerate(points)]
    (tmp_path / "lane.csv").write_text("\n".join(["x_m,y_m,action", *rows]))
    drive = ["drive-route", config, "lane"]

    driver = start(*drive)
    wait_for(lambda: come_m() > 4.0, "4 m", 60)
    driver.signal(signal.SIGUSR2)
    wait_for(lambda: "paused at 4." in driver.output(), "pause")
    assert driver.end() == 1
    ended = re.search(r"ended at (4\.\d) m, (\d\.\d) m before the end of lane 1 of 1; with --from-m \1", driver.output())
    assert abs(float(ended[1]) + float(ended[2]) - 6.0) < 0.11
    assert re.findall(r"action: (\w+)|(paused)", driver.output()) == [("probe", ""), ("ramp", ""), ("", "paused")]
    wait_for(rover.stands, "standing")

    wrong = start(*drive, "--from-m", "7")
    assert wrong.process.wait(20) == 2
    assert "--from-m: 7 is out of range, must be from 0 to 6 m" in wrong.output(), wrong.output()

    again = start(*drive, "--from-m", "1.5")
    wait_for(lambda: "lane 1 of 1: 4.5 m" in again.output(), "the lane", 60)
    assert "way to 1.5 m: " in again.output() and come_m() < 1.9
    assert again.process.wait(60) == 0, again.output() + run.output()
    assert again.output().count("action: probe") == again.output().count("action: ramp") == 1 and come_m() > 5.7


def test_a_joystick_takes_over_and_the_goal_ends(start, peer, tmp_path, vehicle):
    """With a node that does what twist_mux does: the newest of the highest priority reaches the base."""
    rover = vehicle()
    commands = {r"^    twist: .*$": "    twist: {topic: cmd_vel_nav}\n    forwarded: {topic: cmd_vel}"}
    run = start("run", adapted("run_ros2.yaml", commands, tmp_path))
    base = peer.writer("/cmd_vel", wire.Twist)
    planned = peer.reader("/cmd_vel_nav", wire.Twist)
    held = threading.Event()

    def mux():
        for message in planned.take()[-1:]:
            if not held.is_set():
                base.write(message)
        if held.is_set():
            base.write(twist(0.2, -0.5))

    with repeating(mux, 0.02):
        client = FollowPath(peer).wait()
        row = rover.now()
        heading = row["yaw_rad"] + math.pi / 2
        points = straight(8.0, (row["x_m"], row["y_m"]), heading)
        goal = client.send(path_of(points, "odom"))
        assert goal.reply.accepted
        wait_for(lambda: rover.now()["traction_m_s"] > 0.3, "drive")
        held.set()
        result = goal.result(20)
        assert result.status == FollowPath.ABORTED, run.output()
        assert "differs" in result.result.error_msg, result.result.error_msg
        # Sidehill is silent, the joystick drives.
        wait_for(lambda: planned.silent(0.5), "silence")
        assert abs(rover.now()["traction_m_s"] - 0.2) < 0.02
        held.clear()
        wait_for(rover.stands, "let go")
        # What is left of the path is driven from where the joystick has left the vehicle.
        goal = client.send(path_of(points, "odom"))
        assert goal.result(60).status == FollowPath.SUCCEEDED, run.output()
