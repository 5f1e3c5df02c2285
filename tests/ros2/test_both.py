"""Drives told through one port while paths come over ROS 2; frames that move; headings at the goal."""

import json
import math
import os
import subprocess

import pytest
import wire
from peer import FollowPath, now, path_of
from programs import REPOSITORY, SIDEHILL, adapted, repeating, straight, wait_for

START_YAW_RAD = math.radians(90 - 50.906)


@pytest.fixture
def simulated(start, peer, tmp_path):
    """A controller whose vehicle is within its program, and a client of its action."""
    rover = os.path.join(REPOSITORY, "config", "bridge", "vehicle_vcan0.yaml")
    replaced = {r"^port: ros2.*$": f"port: simulated\nsimulated: {rover}"}
    start("run", adapted("run_ros2.yaml", replaced, tmp_path))
    return FollowPath(peer).wait()


def ahead(length_m, frame, turned_rad=0.0):
    return path_of(straight(length_m, yaw_rad=START_YAW_RAD + turned_rad), frame)


def test_a_drive_over_ros_is_recorded_and_replayed_bit_by_bit(start, vehicle, peer, tmp_path):
    vehicle()
    recording = tmp_path / "drive.mcap"
    config = os.path.join(REPOSITORY, "config", "bridge", "run_ros2.yaml")
    run = start("run", config, "--record", recording)
    client = FollowPath(peer).wait()
    length_m = float(os.environ.get("SIDEHILL_DRIVE_M", "2"))
    goal = client.send(ahead(length_m, "odom"))
    assert goal.reply.accepted
    assert goal.result(60 + 4 * length_m).status == FollowPath.SUCCEEDED
    assert values(peer.reader("/diagnostics", wire.DiagnosticArray))["recording"] == "on"
    assert run.end() == 0, run.output()
    output = subprocess.run(
        [SIDEHILL, "replay", recording, "--format", "json"], capture_output=True, text=True
    )
    figures = json.loads(output.stdout)
    print(figures)
    assert figures["different"] == 0 and figures["lost"] == 0, figures
    assert figures["cycles"] > 100 and output.returncode == 0


def values(diagnostics):
    """The newest diagnostics by name."""
    message = diagnostics.next("diagnostics")
    return {value.key: value.value for value in message.status[0].values}


def test_paths_over_ros_are_driven_through_another_port(simulated, peer):
    pose = peer.reader("/controller_server/pose", wire.PoseWithCovarianceStamped)
    goal = simulated.send(ahead(2.0, "odom"))
    assert goal.reply.accepted
    assert goal.result(60).status == FollowPath.SUCCEEDED
    place = pose.next("pose").pose.pose.position
    assert math.dist((place.x, place.y), straight(2.0, yaw_rad=START_YAW_RAD)[-1]) < 0.25


def test_a_path_moves_with_its_frame_and_is_given_up_where_that_is_lost(simulated, peer):
    tf = peer.writer("/tf", wire.TFMessage)
    diagnostics = peer.reader("/diagnostics", wire.DiagnosticArray)
    wait_for(tf.get_matched_subscriptions, "transforms")
    odom_x_m = 0.0

    def say():
        """Where odom is in the map."""
        transform = wire.Transform(
            translation=wire.Vector3(x=odom_x_m, y=0.0, z=0.0),
            rotation=wire.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        )
        header = wire.Header(stamp=now(), frame_id="map")
        stamped = wire.TransformStamped(header=header, child_frame_id="odom", transform=transform)
        tf.write(wire.TFMessage(transforms=[stamped]))

    def off_path_m():
        return abs(float(values(diagnostics)["cross_track_m"]))

    with repeating(say, 0.1):
        goal = simulated.send(ahead(20.0, "map"))
        wait_for(lambda: float(values(diagnostics)["distance_to_goal_m"]) < 19.0, "driving")
        assert off_path_m() < 0.05
        # The path is elsewhere for the vehicle now, 0.19 m across; it swings out and drives there.
        odom_x_m = 0.3
        wait_for(lambda: 0.05 < off_path_m() < 0.3, "a path that has moved")
        wait_for(lambda: off_path_m() < 0.05, "the vehicle on the path again")
    answer = goal.result(30)
    assert (answer.status, answer.result.error_code) == (FollowPath.ABORTED, 102)
    assert "odom" in answer.result.error_msg


def test_the_vehicle_turns_to_the_goals_heading(simulated, peer):
    pose = peer.reader("/controller_server/pose", wire.PoseWithCovarianceStamped)
    path = ahead(2.0, "odom")
    yaw_rad = START_YAW_RAD + 1.5
    last = path.poses[-1].pose.orientation
    last.z, last.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    assert simulated.send(path).result(60).status == FollowPath.SUCCEEDED
    q = pose.next("pose").pose.pose.orientation
    reached_rad = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    assert abs(reached_rad - yaw_rad) < 0.1


def test_a_path_that_leads_off_behind_the_vehicle_is_driven(simulated, peer):
    pose = peer.reader("/controller_server/pose", wire.PoseWithCovarianceStamped)
    answer = simulated.send(ahead(2.0, "odom", turned_rad=3.0)).result(60)
    assert (answer.status, answer.result.error_msg) == (FollowPath.SUCCEEDED, "")
    place = pose.next("pose").pose.pose.position
    assert math.dist((place.x, place.y), straight(2.0, yaw_rad=START_YAW_RAD + 3.0)[-1]) < 0.25
