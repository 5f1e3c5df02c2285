"""Controller and virtual vehicle as two processes, over ROS 2 alone, with a goal of an independent
client."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import textwrap
import time

import pytest

import wire
from peer import FollowPath, Peer, now, path_of, seconds, stamp
from programs import REPOSITORY, Program, adapted, cross_track_m, figure_eight, repeating, straight, wait_for

# Codes of nav2_msgs/FollowPath.
NONE, UNKNOWN, INVALID_CONTROLLER, TF_ERROR, INVALID_PATH = 0, 100, 101, 102, 103
NO_VALID_CONTROL = 106

# The figure of eight's start: where the vehicle stands and where it looks, REP-103.
START_YAW_RAD = math.radians(90 - 50.906)


class Rig:
    """A vehicle, a controller and a client on a graph of their own."""

    def __init__(self, vehicle, controller, peer, definition):
        self.vehicle, self.controller, self.peer = vehicle, controller, peer
        self.commands = peer.reader("/cmd_vel", wire.Twist)
        self.action = FollowPath(peer, definition).wait()

    def ahead(self, length_m=15.0, frame="map"):
        """A straight path from where the vehicle stands first."""
        return path_of(straight(length_m, yaw_rad=START_YAW_RAD), frame)

    def drives(self):
        return abs(self.vehicle.now()["traction_m_s"]) > 0.2

    def sent_off(self, path=None, **names):
        """A goal that is accepted and being driven."""
        goal = self.action.send(path or self.ahead(), **names)
        assert goal.reply.accepted
        wait_for(self.drives, "driving")
        return goal

    def commands_zero(self):
        """Whether the newest command is zero."""
        message = self.commands.last()
        return message is not None and message.linear.x == 0.0 and message.angular.z == 0.0

    def stands(self):
        wait_for(self.vehicle.stands, "standing")
        wait_for(self.commands_zero, "commands of zero")


@pytest.fixture
def rig(vehicle, start, peer, tmp_path):
    def rig(faults=(), of_vehicle={}, of_controller={}, ros=(), definition="jazzy"):
        rover = vehicle(of_vehicle, faults)
        config = adapted("run_ros2.yaml", of_controller, tmp_path)
        arguments = ["run", config, "--out", tmp_path / "run"]
        if ros:
            arguments += ["--ros-args", *ros]
        return Rig(rover, start(*arguments), peer, definition)

    return rig


def test_it_drives_on_while_its_output_is_closed_100_times(vehicle, peer, domain, tmp_path):
    rover = vehicle()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    # Open for reading without waiting for a writer; then the writer does not wait either.
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    config = adapted("run_ros2.yaml", {}, tmp_path)
    run = Program(["run", config, "--log-level", "debug"], domain, pipe)
    os.close(reader)
    rig = Rig(rover, run, peer, "jazzy")
    try:
        goal = rig.sent_off(path_of(figure_eight(1000)))
        for _ in range(100):
            os.close(os.open(pipe, os.O_RDONLY))
            time.sleep(0.1)
        with open(pipe) as lines:
            said = next(json.loads(line) for line in lines if "lines_dropped" in line)
        assert said["state"] == "driving" and said["lines_dropped"] > 5, said
        assert goal.status() == FollowPath.EXECUTING
    finally:
        run.kill()


def test_figure_eight_with_a_goal_is_within_3_cm(rig):
    r = rig(of_vehicle={r"^  map_from_odom: .*$": "  map_from_odom: {x_m: 3, y_m: -2, yaw_deg: 30}"})
    points = figure_eight(1000)
    goal = r.action.send(path_of(points))
    assert goal.reply.accepted
    answer = goal.result(timeout_s=180)
    assert (answer.status, answer.result.error_code) == (FollowPath.SUCCEEDED, NONE)
    assert answer.result.error_msg == ""
    # States and results come on two topics: their order is the middleware's.
    wait_for(lambda: goal.status() == FollowPath.SUCCEEDED, "status of the goal that succeeded")
    r.stands()

    rows = r.vehicle.truth()
    moving = next(row["time_s"] for row in rows if abs(row["traction_m_s"]) > 1e-3)
    driven = [row for row in rows if row["time_s"] > moving]
    distances = cross_track_m(driven, points)
    after = [d for d, row in zip(distances, driven) if row["time_s"] > moving + 2.0]
    rms = math.sqrt(sum(d * d for d in after) / len(after))
    print(f"cross-track RMS {100 * rms:.2f} cm, largest {100 * max(after):.2f} cm")
    assert rms <= 0.03
    # It has been all the way: to both lobes' ends and back to the middle, where it began.
    assert max(row["y_m"] for row in driven) > 3.8 and min(row["y_m"] for row in driven) < -3.8
    assert math.dist((rows[-1]["x_m"], rows[-1]["y_m"]), points[-1]) < 0.25

    feedback = goal.feedback()
    left = [message.distance_to_goal for message in feedback]
    length = sum(math.dist(a, b) for a, b in zip(points, points[1:]))
    assert len(feedback) > 100
    assert abs(left[0] - length) < 1.0 and left[-1] < 1.0
    assert all(b < a + 0.05 for a, b in zip(left, left[1:]))
    assert max(message.speed for message in feedback) > 0.3


def reversed_at_its_end(path):
    """The same path with its last pose looking back."""
    last = path.poses[-1].pose
    half = math.atan2(last.orientation.z, last.orientation.w) + math.pi / 2
    last.orientation = wire.Quaternion(z=math.sin(half), w=math.cos(half))
    return path


def test_a_turn_at_the_goal_that_slides_off_it_is_not_begun(rig):
    r = rig(of_vehicle={r"figure_eight\.yaml": "figure_eight_15deg.yaml"})
    start = r.vehicle.now()["yaw_rad"]
    goal = r.sent_off(reversed_at_its_end(r.ahead(3.0)))
    answer = goal.result(timeout_s=60)
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, NO_VALID_CONTROL)
    assert "would slide" in answer.result.error_msg
    r.stands()
    assert abs(r.vehicle.now()["yaw_rad"] - start) < 0.3


def test_ground_too_steep_is_refused_with_place_and_figure(rig):
    # Standing on 15 degrees takes 0.89 of a friction of 0.3; the guard allows 0.8.
    guard = {r"vehicles/j8\.yaml": "vehicles/j8_wheels_identified.yaml", "^settings:$": "settings:\n  guard: {friction: 0.3}"}
    r = rig(of_vehicle={r"figure_eight\.yaml": "figure_eight_15deg.yaml"}, of_controller=guard)
    begin = r.vehicle.now()
    answer = r.action.send(r.ahead(3.0)).result(timeout_s=60)
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, INVALID_PATH)
    for part in ("too steep", "use of friction 0.8", "more than 0.78", "0.0 m along the path at ("):
        assert part in answer.result.error_msg, answer.result.error_msg
    r.stands()
    end = r.vehicle.now()
    assert math.dist((begin["x_m"], begin["y_m"]), (end["x_m"], end["y_m"])) < 0.1


def test_a_goal_checker_of_positions_asks_for_no_heading(rig):
    r = rig(ros=["-p", "general_goal_checker.plugin:=nav2_controller::PositionGoalChecker"])
    start = r.vehicle.now()["yaw_rad"]
    goal = r.sent_off(reversed_at_its_end(r.ahead(3.0)))
    answer = goal.result(timeout_s=60)
    assert (answer.status, answer.result.error_code) == (FollowPath.SUCCEEDED, NONE)
    assert abs(r.vehicle.now()["yaw_rad"] - start) < 0.3


def test_results_can_be_asked_for_again_and_before_the_end(rig):
    r = rig()
    goal = r.sent_off(r.ahead(3.0))
    early = r.action.get_result.send(goal_id=goal.id)
    answer = goal.result(timeout_s=60)
    assert (answer.status, answer.result.error_code) == (FollowPath.SUCCEEDED, NONE)
    assert wait_for(lambda: r.action.get_result.reply(early), "the early answer").status == FollowPath.SUCCEEDED
    again = goal.result()
    assert (again.status, again.result.error_code) == (FollowPath.SUCCEEDED, NONE)
    # A goal that nobody sent has no result: its status is unknown.
    nobody = r.action.get_result.call(goal_id=wire.UUID(uuid=bytes([7] * 16)))
    assert nobody.status == 0


def test_a_newer_goal_takes_over_without_a_stop(rig):
    r = rig()
    first = r.sent_off()
    time.sleep(1.0)
    since = r.vehicle.now()["time_s"]
    row = r.vehicle.now()
    ahead = straight(4.0, (row["x_m"], row["y_m"]), START_YAW_RAD)
    second = r.action.send(path_of(ahead))
    assert second.reply.accepted
    answer = first.result()
    assert answer.status == FollowPath.ABORTED
    assert second.result(timeout_s=60).status == FollowPath.SUCCEEDED
    r.stands()
    took_over = [row for row in r.vehicle.truth() if since < row["time_s"] < since + 2.0]
    assert min(abs(row["traction_m_s"]) for row in took_over) > 0.05


def test_cancelling_stops_and_says_which_goals(rig):
    r = rig()
    goal = r.sent_off()
    reply = goal.cancel()
    assert reply.return_code == 0
    assert [info.goal_id for info in reply.goals_canceling] == [goal.id]
    assert goal.result().status == FollowPath.CANCELED
    r.stands()
    # An ended goal and one that never was have codes of their own.
    assert goal.cancel().return_code == 3
    nobody = wire.GoalInfo(goal_id=wire.UUID(uuid=bytes([9] * 16)))
    assert r.action.cancel.call(goal_info=nobody).return_code == 2
    # Afterwards it drives again.
    r.sent_off()


@pytest.mark.parametrize(
    "path, names, code",
    [
        (path_of([]), {}, INVALID_PATH),
        (path_of([(0, 0), (math.nan, 1)]), {}, INVALID_PATH),
        (path_of(straight(5.0), frame="atlantis"), {}, TF_ERROR),
        (path_of(straight(5.0)), {"controller_id": "NoSuch"}, INVALID_CONTROLLER),
        (path_of(straight(5.0)), {"goal_checker_id": "NoSuch"}, INVALID_CONTROLLER),
        (path_of(straight(5.0)), {"progress_checker_id": "NoSuch"}, INVALID_CONTROLLER),
    ],
    ids=["empty", "nan", "unknown_frame", "controller", "goal_checker", "progress_checker"],
)
def test_what_cannot_be_followed_has_its_code_and_nothing_moves(rig, path, names, code):
    r = rig()
    goal = r.action.send(path, **names)
    assert goal.reply.accepted
    answer = goal.result()
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, code)
    assert answer.result.error_msg != ""
    assert all(row["traction_m_s"] == 0.0 for row in r.vehicle.truth())


@pytest.mark.parametrize("definition", ["humble", "iron"])
def test_the_definitions_of_older_distributions(rig, definition):
    r = rig(of_controller={"definition: jazzy": f"definition: {definition}"}, definition=definition)
    goal = r.sent_off(r.ahead(2.0))
    answer = goal.result(timeout_s=60)
    assert answer.status == FollowPath.SUCCEEDED
    failed = r.action.send(path_of([])).result()
    assert failed.status == FollowPath.ABORTED
    if definition == "iron":
        assert (answer.result.error_code, failed.result.error_code) == (NONE, INVALID_PATH)


@pytest.mark.parametrize(
    "fault, code",
    [
        ("!stop [odometry]", TF_ERROR),
        ("!stop [imu]", NO_VALID_CONTROL),
        ("!not_a_number odometry", TF_ERROR),
        ("!not_a_number imu", NO_VALID_CONTROL),
        ("!wrong_frame odometry", TF_ERROR),
        ("!wrong_frame imu", NO_VALID_CONTROL),
        ("freeze_stamps", TF_ERROR),
        ("!delay_s 2.0", TF_ERROR),
        ("!clock_jump_s 100.0", TF_ERROR),
        ("!clock_jump_s -100.0", TF_ERROR),
        ("emergency_stop", UNKNOWN),
    ],
)
def test_a_fault_ends_the_goal_with_its_code_and_the_vehicle_stands(rig, fault, code):
    r = rig(faults=["{after_enabled_s: 2.5, for_s: 1000, fault: " + fault + "}"])
    goal = r.sent_off()
    answer = goal.result(timeout_s=30)
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, code), answer.result.error_msg
    assert answer.result.error_msg != ""
    r.stands()
    # It stays so.
    time.sleep(1.0)
    assert r.vehicle.stands() and r.commands_zero()


def test_why_a_goal_is_refused_is_in_the_log(rig, tmp_path):
    r = rig()
    answer = r.action.send(path_of([(0.0, 0.0), (1.0, float("nan"))])).result()
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, INVALID_PATH)
    log = tmp_path / "run" / "events.jsonl"

    def refusals():
        events = [json.loads(line) for line in log.read_text().splitlines()]
        return [event["reason"] for event in events if event["event"] == "goal"]

    wait_for(lambda: any(answer.result.error_msg in reason for reason in refusals()), "the refusal in the log")


@pytest.mark.parametrize("different", [{"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, "humble"])
def test_a_goal_that_cannot_be_read_is_said(start, peer, different, tmp_path):
    definition, environment = ("humble", {}) if different == "humble" else ("jazzy", different)
    run = start("run", adapted("run_ros2.yaml", {}, tmp_path), "--format", "text", **environment)
    send_goal = FollowPath(peer, definition).send_goal
    wait_for(lambda: send_goal.writer.get_matched_subscriptions(), "the action server")
    time.sleep(0.3)
    goal = wire.FollowPathGoal[definition](path=path_of(straight(3.0)))
    send_goal.send(goal_id=wire.UUID(uuid=bytes(range(16))), goal=goal)
    wait_for(lambda: "a goal cannot be read: its client has another" in run.output(), "the reason on the screen")


def test_a_best_effort_emergency_stop_is_heard(rig, peer):
    r = rig()
    stop = peer.best_effort_writer("/emergency_stop", wire.Bool)
    with repeating(lambda: stop.write(wire.Bool(data=True)), 0.1):
        answer = r.action.send(r.ahead()).result(timeout_s=20)
        assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, UNKNOWN)
        assert "emergency stop is pressed" in answer.result.error_msg
    with repeating(lambda: stop.write(wire.Bool(data=False)), 0.1):
        time.sleep(0.5)
        goal = r.sent_off()
    with repeating(lambda: stop.write(wire.Bool(data=True)), 0.1):
        assert goal.result().status == FollowPath.ABORTED
        r.stands()


def test_an_emergency_stop_of_another_type_forbids_to_drive(rig, peer, domain):
    r = rig()
    goal = r.sent_off()
    other = Peer(domain).writer("/emergency_stop", wire.Float64)
    answer = goal.result()
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, UNKNOWN)
    said = "/emergency_stop: it is published as std_msgs/msg/Float64, must be std_msgs/msg/Bool"
    assert said in answer.result.error_msg
    r.stands()
    answer = r.action.send(r.ahead()).result()
    assert said in answer.result.error_msg
    r.stands()
    wait_for(lambda: "it is published as std_msgs/msg/Float64" in r.controller.output(), "the reason on the screen")
    del other


@pytest.mark.parametrize("kind", ["odometry", "pose_with_covariance_stamped"])
def test_poses_come_from_another_topic_than_the_speeds(rig, peer, kind):
    odom = peer.reader("/odom", wire.Odometry)
    wheels = peer.best_effort_writer("/wheels", wire.Odometry)
    message = {"odometry": wire.Odometry, "pose_with_covariance_stamped": wire.PoseWithCovarianceStamped}[kind]
    poses = peer.best_effort_writer("/gps", message)

    def relay():
        for sent in odom.take():
            child = {"child_frame_id": "base_link"}
            # Wheel odometry that believes to be elsewhere.
            header = wire.Header(stamp=sent.header.stamp, frame_id="wheels")
            elsewhere = wire.PoseWithCovariance(pose=wire.Pose(position=wire.Point(x=7.0)))
            wheels.write(wire.Odometry(header=header, pose=elsewhere, twist=sent.twist, **child))
            more = child if kind == "odometry" else {}
            poses.write(message(header=sent.header, pose=sent.pose, **more))

    with repeating(relay, 0.01):
        topics = f"    odometry: wheels\n    pose: {{topic: gps, type: {kind}}}"
        # The relay is a thread of Python beside others.
        patient = {r"^  feedback_timeout_s: .*$": "  feedback_timeout_s: 1.0"}
        r = rig(of_controller={r"^    odometry: odom # nav_msgs.*$": topics, **patient})
        answer = r.sent_off(path_of(figure_eight())).result(timeout_s=120)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg
    assert max(cross_track_m(r.vehicle.truth(), figure_eight())) < 0.1


def test_the_route_of_the_file_is_driven_when_the_operator_arms(vehicle, start, tmp_path):
    rover = vehicle()
    # To the left on a circle, of a radius that recorded routes of this vehicle may have.
    centre = (-2.5 * math.sin(START_YAW_RAD), 2.5 * math.cos(START_YAW_RAD))
    angles = [START_YAW_RAD + 0.03 * index for index in range(101)]
    points = [(centre[0] + 2.5 * math.sin(a), centre[1] - 2.5 * math.cos(a)) for a in angles]
    route = tmp_path / "route.csv"
    route.write_text("x_m,y_m\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in points))
    config = adapted("run_ros2.yaml", {r"^cycle:$": "route: {file: route.csv}\ncycle:"}, tmp_path)
    run = start("run", config, "--format", "text")
    wait_for(lambda: "listens to" in run.output(), "the start")
    time.sleep(2.0)
    assert rover.stands()
    run.signal(signal.SIGUSR1)
    driving = lambda: abs(rover.now()["traction_m_s"]) > 0.2
    wait_for(driving, "driving")
    time.sleep(4.0)
    # A stop on the way, from where it is driven on.
    run.signal(signal.SIGUSR2)
    wait_for(rover.stands, "standing")
    time.sleep(1.0)
    assert rover.stands()
    run.signal(signal.SIGUSR1)
    wait_for(driving, "driving on")
    wait_for(lambda: "the goal is reached" in run.output(), "the end of the route", 120)
    assert "the operator requested a stop" in run.output()
    assert max(cross_track_m(rover.truth(), points)) < 0.1
    assert run.end() == 0


def test_a_route_begins_by_itself_where_that_is_asked(vehicle, start, tmp_path):
    rover = vehicle()
    route = tmp_path / "route.csv"
    points = straight(3.0, yaw_rad=START_YAW_RAD)
    route.write_text("x_m,y_m\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in points))
    config = adapted("run_ros2.yaml", {r"^cycle:$": "route: {file: route.csv}\ncycle:"}, tmp_path)
    run = start("run", config, "--arm", "--format", "text")
    wait_for(lambda: "the goal is reached" in run.output(), "the end of the route", 30)
    wait_for(rover.stands, "standing")
    assert run.end() == 0


# Metres along a straight route, the speed of the stretch that begins there, m/s, and the action.
SLOW_M_S = 0.2
ROWS = [(0, "", ""), (1.5, "", "blade down"), (2.5, SLOW_M_S, "spray, slowly"), (4, 0.8, ""), (6, "", "blade up")]


def write_rows(path, rows=ROWS):
    """Rows as a file, from where the vehicle stands first."""
    sin, cos = math.sin(START_YAW_RAD), math.cos(START_YAW_RAD)
    lines = [f'{at * cos:.4f},{at * sin:.4f},{speed},"{action}"' for at, speed, action in rows]
    path.write_text("\n".join(["x_m,y_m,speed_m_s,action", *lines, ""]))


def along_m(row):
    """How far a vehicle is along the rows."""
    return row["x_m"] * math.cos(START_YAW_RAD) + row["y_m"] * math.sin(START_YAW_RAD)


def texts_of(actions):
    """A function that returns what has come, in order."""

    def said():
        actions.take()
        return [message.data for message in actions.all]

    return said


def assert_speeds_of_rows(rows):
    slow = [abs(row["traction_m_s"]) for row in rows if 2.5 < along_m(row) < 4.0]
    fast = [abs(row["traction_m_s"]) for row in rows if not 2.0 < along_m(row) < 4.5]
    print(f"fastest {max(slow):.3f} m/s on the slow stretch, {max(fast):.3f} m/s elsewhere")
    # The drives of this vehicle overshoot a little.
    assert max(slow) < 1.05 * SLOW_M_S < 0.4 < max(fast)


def test_a_route_has_its_speeds_and_each_action_once_over_a_stop(vehicle, start, peer, tmp_path):
    rover = vehicle()
    # One action is on the ramp of the stop.
    write_rows(tmp_path / "route.csv", sorted([*ROWS, (1.56, "", "mark")]))
    actions = peer.reader("/route_action", wire.String)
    config = adapted("run_ros2.yaml", {r"^cycle:$": "route: {file: route.csv}\ncycle:"}, tmp_path)
    run = start("run", config, "--out", tmp_path / "run", "--record", tmp_path / "drive.mcap", "--format", "text")
    wait_for(lambda: "listens to" in run.output(), "the start")
    wait_for(lambda: actions.reader.get_matched_publications(), "the controller's route_action")
    time.sleep(2.0)
    run.signal(signal.SIGUSR1)
    said = texts_of(actions)
    wait_for(lambda: "blade down" in said(), "the first action", 60)
    # It stops on the way, just beyond the action, and drives on.
    run.signal(signal.SIGUSR2)
    wait_for(rover.stands, "standing")
    assert 1.56 < along_m(rover.now()) < 2.2
    time.sleep(1.0)
    assert said() == ["blade down", "mark"]
    run.signal(signal.SIGUSR1)
    wait_for(lambda: "the goal is reached" in run.output(), "the end of the route", 60)
    wait_for(lambda: len(said()) == 4, "the last action")
    assert run.end() == 0
    assert said() == ["blade down", "mark", "spray, slowly", "blade up"]
    with open(tmp_path / "run" / "events.jsonl") as file:
        events = [json.loads(line) for line in file]
    assert [event["reason"] for event in events if event["event"] == "action"] == said()
    assert_speeds_of_rows(rover.truth())


def test_a_stored_route_has_its_speeds_and_actions_to_and_fro(vehicle, start, peer, tmp_path):
    rover = vehicle()
    write_rows(tmp_path / "lane.csv")
    actions = peer.reader("/route_action", wire.String)
    config = adapted("run_ros2.yaml", {}, tmp_path)
    run = start("run", config, "--out", tmp_path / "run")
    wait_for(lambda: re.search(r'"x_m":-?[0-9]', run.output()), "poses")
    driver = start("drive-route", config, "lane", "--passes", "2")
    said = texts_of(actions)
    wait_for(lambda: said() == ["blade down", "spray, slowly"], "the second action", 60)
    driver.signal(signal.SIGUSR2)
    wait_for(lambda: "paused" in driver.output(), "pause")
    wait_for(rover.stands, "standing")
    driver.signal(signal.SIGUSR1)
    assert driver.process.wait(120) == 0, driver.output() + run.output()
    there, back = ["blade down", "spray, slowly", "blade up"], ["blade up", "spray, slowly", "blade down"]
    wait_for(lambda: len(said()) == 6, "the last action")
    assert said() == there + back
    assert run.end() == 0
    with open(tmp_path / "run" / "events.jsonl") as file:
        events = [json.loads(line) for line in file]
    assert [event["reason"] for event in events if event["event"] == "action"] == said()
    assert_speeds_of_rows(rover.truth())


def test_drives_that_no_longer_obey_end_the_goal(rig):
    # On a straight line going on is what is commanded: the fault shows itself in the curve.
    r = rig(faults=["{after_enabled_s: 4, for_s: 6, fault: ignore_commands}"])
    goal = r.sent_off(path_of(figure_eight()))
    answer = goal.result(timeout_s=30)
    assert answer.status == FollowPath.ABORTED and answer.result.error_code != NONE
    wait_for(r.commands_zero, "commands of zero")
    wait_for(r.vehicle.stands, "standing when they obey again")


def test_a_localisation_that_falls_silent_ends_the_goal(rig, peer):
    r = rig(of_vehicle={r"^  frames: .*$": "  frames: {map: world, odom: odom, base: base_link}"})
    tf = peer.writer("/tf", wire.TFMessage)
    wait_for(lambda: len(tf.get_matched_subscriptions()) > 0, "the controller's /tf")

    def localise():
        header = wire.Header(stamp=now(), frame_id="map")
        rotation = wire.Quaternion(w=1.0)
        still = wire.TransformStamped(
            header=header, child_frame_id="odom", transform=wire.Transform(rotation=rotation)
        )
        tf.write(wire.TFMessage(transforms=[still]))

    with repeating(localise):
        goal = r.sent_off()
        time.sleep(2.0)
        assert goal.status() == FollowPath.EXECUTING
    answer = goal.result()
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, TF_ERROR)
    r.stands()


@pytest.mark.parametrize("ahead_s", [0.5, 3600.0])
def test_one_transform_stamped_ahead_does_not_move_the_path(rig, peer, ahead_s):
    r = rig(of_vehicle={r"^  frames: .*$": "  frames: {map: world, odom: odom, base: base_link}"})
    tf = peer.best_effort_writer("/tf", wire.TFMessage)
    wait_for(lambda: len(tf.get_matched_subscriptions()) > 0, "the controller's /tf")

    def localise(ahead_s=0.0, x=0.0):
        header = wire.Header(stamp=stamp(time.time() + ahead_s), frame_id="map")
        to_odom = wire.Transform(translation=wire.Vector3(x=x), rotation=wire.Quaternion(w=1.0))
        placed = wire.TransformStamped(header=header, child_frame_id="odom", transform=to_odom)
        tf.write(wire.TFMessage(transforms=[placed]))

    points = straight(4.0, yaw_rad=START_YAW_RAD)
    with repeating(localise):
        goal = r.sent_off(path_of(points))
        localise(ahead_s, 0.8)
        answer = goal.result(timeout_s=30)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg
    assert max(cross_track_m(r.vehicle.truth(), points)) < 0.15


@pytest.mark.parametrize("step_s", [-0.4, -0.15, 0.15, 0.4])
def test_a_clock_that_is_set_by_less_than_half_a_second_ends_nothing(rig, step_s):
    r = rig(faults=[f"{{after_enabled_s: 3, for_s: 3, fault: !clock_jump_s {step_s}}}"])
    answer = r.sent_off(r.ahead(4.5)).result(timeout_s=30)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg


@pytest.mark.parametrize("step_s", [-0.4, -0.15, 0.15, 0.4])
def test_a_step_of_this_computers_clock_ends_no_driving(set_clock, rig, step_s):
    r = rig()
    goal = r.sent_off(r.ahead(4.0))
    time.sleep(1.0)
    set_clock(step_s)
    answer = goal.result(timeout_s=30)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg


def test_a_jump_of_this_computers_clock_ends_the_goal(set_clock, rig, tmp_path):
    r = rig()
    goal = r.sent_off()
    set_clock(100.0)
    answer = goal.result(timeout_s=30)
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, TF_ERROR)
    r.stands()
    set_clock(0.0)
    wait_for(lambda: "set by -100.00 s" in (tmp_path / "run" / "events.jsonl").read_text(), "the step in the log")
    answer = r.action.send(r.ahead(4.0)).result(timeout_s=30)
    assert answer.status == FollowPath.SUCCEEDED, answer.result.error_msg


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM])
def test_a_client_that_leaves_ends_its_goal(rig, domain, ending, tmp_path):
    r = rig()
    script = textwrap.dedent(
        f"""
        import math, sys, time
        sys.path.insert(0, {str(sys.path[0])!r})
        from peer import FollowPath, Peer, path_of
        from programs import straight
        import signal
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
        action = FollowPath(Peer({domain})).wait()
        goal = action.send(path_of(straight(30.0, yaw_rad={START_YAW_RAD})))
        action.get_result.send(goal_id=goal.id)
        print("accepted" if goal.reply.accepted else "rejected", flush=True)
        time.sleep(600)
        """
    )
    client = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        assert client.stdout.readline().strip() == "accepted"
        wait_for(r.drives, "driving")
        client.send_signal(ending)
        client.wait(timeout=10)
        # One that is killed says nothing; its lease of 10 s must run out.
        wait_for(r.vehicle.stands, "standing", timeout_s=25.0)
    finally:
        client.kill()
    wait_for(r.commands_zero, "commands of zero")

    def aborted():
        message = r.action.status.last()
        return message and message.status_list and message.status_list[-1].status == FollowPath.ABORTED

    wait_for(aborted, "the status of the goal")


def test_a_killed_controller_leaves_a_vehicle_that_stops(rig):
    r = rig()
    r.sent_off()
    r.controller.kill()
    wait_for(r.vehicle.stands, "standing by the drives' own time-out")


def test_a_killed_vehicle_ends_the_goal_with_commands_of_zero(rig):
    r = rig()
    goal = r.sent_off()
    r.vehicle.program.kill()
    answer = goal.result(timeout_s=30)
    # Odometry and attitude are missed after 0.3 s each: which of them first depends on when the vehicle dies.
    assert answer.status == FollowPath.ABORTED
    assert answer.result.error_code in (TF_ERROR, NO_VALID_CONTROL), answer.result
    wait_for(r.commands_zero, "commands of zero")


def test_a_suspended_controller_ends_and_the_vehicle_stands(rig):
    r = rig()
    r.sent_off()
    r.controller.signal(signal.SIGSTOP)
    wait_for(r.vehicle.stands, "standing by the drives' own time-out")
    r.controller.signal(signal.SIGCONT)
    # What it speaks through does not survive that: it says so and lets itself be started again.
    assert r.controller.process.wait(timeout=10) != 0
    assert "suspended" in r.controller.output()
    time.sleep(0.5)
    assert r.vehicle.stands()


def test_ending_the_controller_sends_zero_and_leaves_the_graph(rig, peer):
    r = rig()
    names = peer.nodes()
    wait_for(lambda: "/controller_server" in names(), "the controller's node")
    r.sent_off()
    # `systemctl stop` and `timeout` send both.
    r.controller.signal(signal.SIGTERM)
    r.controller.signal(signal.SIGCONT)
    r.stands()
    assert r.controller.process.wait(timeout=10) == 0
    wait_for(lambda: "/controller_server" not in names(), "the node gone from the graph")


def test_a_latched_path_is_followed(rig, peer):
    r = rig()
    plan = peer.writer("/plan", wire.Path, latched=True)
    plan.write(r.ahead(3.0))
    wait_for(r.drives, "driving")
    wait_for(r.vehicle.stands, "the end of the path", 60.0)
    row = r.vehicle.now()
    end = straight(3.0, yaw_rad=START_YAW_RAD)[-1]
    assert math.dist((row["x_m"], row["y_m"]), end) < 0.25


def test_a_speed_limit_is_kept_and_lifted(rig, peer):
    r = rig()
    limit = peer.writer("/speed_limit", wire.SpeedLimit)
    wait_for(lambda: limit.get_matched_subscriptions(), "the controller's speed_limit")
    r.sent_off()
    time.sleep(1.5)
    limit.write(wire.SpeedLimit(percentage=False, speed_limit=0.2))
    wait_for(lambda: r.vehicle.now()["traction_m_s"] < 0.22, "slow driving")
    time.sleep(1.0)
    assert 0.1 < r.vehicle.now()["traction_m_s"] < 0.23
    limit.write(wire.SpeedLimit(percentage=True, speed_limit=0.0))
    wait_for(lambda: r.vehicle.now()["traction_m_s"] > 0.4, "full speed again")


def parameter(name, value):
    kinds = {bool: (1, "bool_value"), int: (2, "integer_value"), float: (3, "double_value"), str: (4, "string_value")}
    number, field = kinds[type(value)]
    return wire.Parameter(name=name, value=wire.ParameterValue(type=number, **{field: value}))


def test_parameters_are_listed_read_set_and_refused_with_reasons(rig, peer):
    rig(ros=["-p", "controller_frequency:=20.0"])
    names = peer.client("/controller_server/list_parameters", wire.ListParameters)
    known = set(names.call().result.names)
    wanted = {"controller_frequency", "odom_topic", "speed_limit_topic", "use_sim_time", "transform_tolerance"}
    assert wanted <= known, known
    get = peer.client("/controller_server/get_parameters", wire.GetParameters)
    value = get.call(names=["controller_frequency"]).values[0]
    assert (value.type, value.double_value) == (3, 20.0)
    set_ = peer.client("/controller_server/set_parameters", wire.SetParameters)
    good, bad, unknown, kind = set_.call(
        parameters=[
            parameter("transform_tolerance", 0.4),
            parameter("transform_tolerance", -1.0),
            parameter("no_such_parameter", 1.0),
            parameter("transform_tolerance", "soon"),
        ]
    ).results
    assert good.successful, good.reason
    for refused in (bad, unknown, kind):
        assert not refused.successful and refused.reason != ""
    assert get.call(names=["transform_tolerance"]).values[0].double_value == 0.4


def test_the_params_file_for_nav2_is_read(rig, peer):
    file = f"{REPOSITORY}/bridge/nav2/params.yaml"
    rig(ros=["--params-file", file, "-p", "FollowPath.desired_linear_vel:=0.35"])
    get = peer.client("/controller_server/get_parameters", wire.GetParameters)
    names = [
        "use_sim_time",
        "transform_tolerance",
        "general_goal_checker.xy_goal_tolerance",
        "progress_checker.movement_time_allowance",
        "FollowPath.desired_linear_vel",
    ]
    values = get.call(names=names).values
    assert (values[0].type, values[0].bool_value) == (1, False)
    # What stands on the command line is stronger than the file.
    assert [value.double_value for value in values[1:]] == [0.5, 0.25, 10.0, 0.35]


def test_a_wrong_parameter_ends_the_program_and_is_named(start, tmp_path):
    config = adapted("run_ros2.yaml", {}, tmp_path)
    program = start("run", config, "--ros-args", "-p", "transform_tolerance:=-1.0")
    assert program.process.wait(timeout=10) == 2
    assert "transform_tolerance" in program.output()


def test_a_lifecycle_manager_can_run_it(rig, peer):
    configure, cleanup, activate, deactivate = 1, 2, 3, 4
    r = rig(of_controller={r"^  autostart: true": "  autostart: false"})
    get = peer.client("/controller_server/get_state", wire.GetState)
    change = peer.client("/controller_server/change_state", wire.ChangeState)
    ask = lambda transition: change.call(transition=wire.Transition(id=transition)).success
    label = lambda: get.call().current_state.label
    assert label() == "unconfigured"
    assert not r.action.send(r.ahead()).reply.accepted
    assert not ask(activate)
    assert ask(configure) and label() == "inactive"
    assert ask(activate) and label() == "active"
    goal = r.sent_off()
    assert ask(deactivate) and label() == "inactive"
    assert goal.result().status == FollowPath.ABORTED
    r.stands()
    assert not r.action.send(r.ahead()).reply.accepted
    assert ask(cleanup) and label() == "unconfigured"


def test_diagnostics_and_plans_are_published(rig, peer):
    r = rig()
    diagnostics = peer.reader("/diagnostics", wire.DiagnosticArray)
    plan = peer.reader("/optimal_trajectory", wire.Path)
    reference = peer.reader("/transformed_global_plan", wire.Path)
    pose = peer.reader("/controller_server/pose", wire.PoseWithCovarianceStamped)
    r.sent_off()
    wait_for(diagnostics.last, "/diagnostics")
    keys = {value.key for status in diagnostics.last().status for value in status.values}
    assert len(keys) >= 6, keys
    predicted = plan.next("/optimal_trajectory")
    assert len(predicted.poses) > 10
    ahead = reference.next("/transformed_global_plan")
    assert len(ahead.poses) > 1
    estimate = pose.next("/controller_server/pose")
    at, at_s = estimate.pose.pose.position, seconds(estimate.header.stamp)
    row = min(r.vehicle.truth(at_s), key=lambda row: abs(row["unix_s"] - at_s))
    assert math.dist((at.x, at.y), (row["x_m"], row["y_m"])) < 0.05


def test_a_second_participant_sees_action_and_services(rig, domain):
    rig()
    other = Peer(domain)
    action = FollowPath(other).wait()
    assert action.send_goal.ready() and action.get_result.ready() and action.cancel.ready()
    names = other.nodes()
    wait_for(lambda: {"/controller_server", "/virtual_rover"} <= names(), "both nodes")
