"""The virtual vehicle alone, driven open loop by an independent peer."""

import math
import signal
import subprocess
import time

import pytest

import wire
from peer import Peer, rotate, seconds, yaw
from programs import REPOSITORY, SIDEHILL, repeating, wait_for

# Distance of the J8's tread ICRs, m: the width by which its drives read a twist.
TRACK_WIDTH_M = 1.073 + 0.980


def twist(forward_m_s, yaw_rate_rad_s):
    return wire.Twist(linear=wire.Vector3(x=forward_m_s), angular=wire.Vector3(z=yaw_rate_rad_s))


def commanded(writer, message):
    """Sends a command at 20 Hz while a block runs."""
    return repeating(lambda: writer.write(message))


def drive(writer, message, for_s):
    """Sends a command at 20 Hz for a time."""
    with commanded(writer, message):
        time.sleep(for_s)


def matched(writer):
    wait_for(lambda: writer.get_matched_subscriptions(), "the vehicle's subscription")
    time.sleep(0.3)
    return writer


def test_odometry_transforms_imu_and_joints_tell_the_same_story(vehicle, peer):
    offset = "  map_from_odom: {x_m: 3, y_m: -2, yaw_deg: 30}"
    # Longer than a loaded machine may hold up this process.
    patient = "drive: {command_timeout_s: 2.0}"
    rover = vehicle({r"^  map_from_odom: .*$": offset, r"^drive: .*$": patient})
    odom, tf = peer.reader("/odom", wire.Odometry), peer.reader("/tf", wire.TFMessage)
    imu, joints = peer.reader("/imu", wire.Imu), peer.reader("/joint_states", wire.JointState)
    fixed = peer.reader("/tf_static", wire.TFMessage, latched=True)
    command = matched(peer.writer("/cmd_vel", wire.Twist))
    for reader in (odom, tf, imu, joints, fixed):
        wait_for(reader.last, "a message of each topic")
    drive(command, twist(0.5, 0.2), 4.0)
    for reader in (odom, tf, imu, joints):
        reader.take()

    offset = fixed.last().transforms[0]
    assert (offset.header.frame_id, offset.child_frame_id) == ("map", "odom")
    assert len(odom.all) > 100
    transforms = {seconds(m.transforms[0].header.stamp): m.transforms[0] for m in tf.all}
    footprints = {seconds(m.transforms[1].header.stamp): m.transforms[1] for m in tf.all}
    orientations = {seconds(m.header.stamp): m.orientation for m in imu.all}
    velocities = {seconds(m.header.stamp): m for m in joints.all}
    newest_s = max([*orientations, seconds(odom.all[-1].header.stamp)])
    truth = {row["time_s"]: row for row in rover.truth(newest_s)}
    compared = 0
    for message in odom.all:
        assert message.header.frame_id == "odom" and message.child_frame_id == "base_link"
        at, pose = seconds(message.header.stamp), message.pose.pose
        if at not in transforms or at not in orientations or at not in velocities:
            continue
        compared += 1
        moved = transforms[at].transform
        assert moved.translation.x == pose.position.x and moved.translation.y == pose.position.y
        assert moved.rotation == pose.orientation
        level = footprints[at]
        assert level.header.frame_id == "base_link"
        # Turned back by the tilt of the vehicle, and not moved.
        at_base, back = level.transform.translation, level.transform.rotation
        assert (at_base.x, at_base.y, at_base.z) == (0.0, 0.0, 0.0)
        tilt = math.hypot(moved.rotation.x, moved.rotation.y)
        assert tilt > 0.01 and math.isclose(tilt, math.hypot(back.x, back.y), abs_tol=1e-9)
        # The compass of the AHRS is the map's, and odom is turned against it.
        turned = yaw(orientations[at]) - yaw(pose.orientation) - math.radians(30)
        assert abs(math.remainder(turned, 2 * math.pi)) < 0.01
        left, right = velocities[at].velocity
        speed = message.twist.twist
        assert math.isclose(speed.linear.x, (left + right) / 2, abs_tol=1e-9)
        assert math.isclose(speed.angular.z, (right - left) / TRACK_WIDTH_M, abs_tol=1e-9)
    assert compared > 50
    # Odometry moves as it says it does, by its own attitude: what is left is the slide and the
    # ICRs' place, at most |y omega| and a little.
    first, last = odom.all[-100], odom.all[-1]
    dt = seconds(last.header.stamp) - seconds(first.header.stamp)
    step = math.dist(
        (first.pose.pose.position.x, first.pose.pose.position.y, first.pose.pose.position.z),
        (last.pose.pose.position.x, last.pose.pose.position.y, last.pose.pose.position.z),
    )
    assert abs(step / dt - 0.5) < 0.05
    # Through map -> odom the newest pose is the truth.
    place = rotate(offset.transform.rotation, (last.pose.pose.position.x, last.pose.pose.position.y, 0))
    x, y = place[0] + offset.transform.translation.x, place[1] + offset.transform.translation.y
    nearest = min(truth.values(), key=lambda row: abs(row["unix_s"] - seconds(last.header.stamp)))
    assert math.dist((x, y), (nearest["x_m"], nearest["y_m"])) < 0.02
    heading = yaw(orientations[max(orientations)])
    row = min(truth.values(), key=lambda row: abs(row["unix_s"] - max(orientations)))
    # REP-103 counts from x, the paper from Y_g: 90 degrees apart, on the level to a hair.
    assert abs(math.remainder(heading - row["yaw_rad"] - math.pi / 2, 2 * math.pi)) < 0.01
    # Gravity is felt straight up in the world.
    felt = imu.last()
    up = rotate(felt.orientation, (felt.linear_acceleration.x, felt.linear_acceleration.y, felt.linear_acceleration.z))
    assert math.dist(up, (0, 0, 9.80665)) < 1e-6
    assert rover.program.end() == 0


@pytest.mark.parametrize("kind", ["twist_stamped", "tread_velocities", "motors"])
def test_other_commands_drive_as_a_twist_does(vehicle, peer, kind):
    rover = vehicle({r"^  command: twist$": f"  command: {kind}", r"radius_m: 1.0": "radius_m: 0.25"})
    if kind == "twist_stamped":
        writer = peer.writer("/cmd_vel", wire.TwistStamped)
        sends = [(writer, wire.TwistStamped(twist=twist(0.4, 0.2)))]
    elif kind == "tread_velocities":
        writer = peer.writer("/tread_velocities/commands", wire.Float64MultiArray)
        half = 0.1 * TRACK_WIDTH_M
        sends = [(writer, wire.Float64MultiArray(data=[(0.4 - half) / 0.25, (0.4 + half) / 0.25]))]
    else:
        traction = peer.writer("/traction/command", wire.Float64)
        steer = peer.writer("/steer/command", wire.Float64)
        sends = [(traction, wire.Float64(data=0.4)), (steer, wire.Float64(data=0.1 * TRACK_WIDTH_M))]
    joints = peer.reader("/joint_states", wire.JointState)
    for writer, _ in sends:
        matched(writer)

    def reached():
        # As the drives count, before c_l and c_r of the truth.
        left, right = (0.25 * velocity for velocity in joints.next("/joint_states").velocity)
        traction = math.isclose((left + right) / 2, 0.4, abs_tol=1e-6)
        return traction and math.isclose(right - left, 0.2 * TRACK_WIDTH_M, abs_tol=1e-6)

    with repeating(lambda: [writer.write(message) for writer, message in sends]):
        wait_for(reached, "the commanded speeds")
        wait_for(lambda: rover.now()["mode"] == "Enabled", "drives that are on")


def test_it_stops_when_commands_cease_or_are_no_numbers(vehicle, peer):
    rover = vehicle()
    command = matched(peer.writer("/cmd_vel", wire.Twist))
    stands_off = lambda: rover.stands() and rover.now()["mode"] == "Disabled"
    for _ in range(2):
        with commanded(command, twist(0.6, 0.0)):
            wait_for(lambda: rover.now()["traction_m_s"] > 0.5, "driving")
        wait_for(stands_off, "standing after silence")
    for speed in (math.nan, 1e308):
        with commanded(command, twist(0.6, 0.0)):
            wait_for(lambda: rover.now()["traction_m_s"] > 0.5, "driving")
        with commanded(command, twist(speed, 0.0)):
            wait_for(stands_off, f"standing while {speed} m/s are commanded")


def test_an_emergency_stop_is_told_and_holds_until_zero_is_commanded(vehicle, peer):
    rover = vehicle(faults=["{after_enabled_s: 1, for_s: 0.5, fault: emergency_stop}"])
    pressed = peer.reader("/emergency_stop", wire.Bool, latched=True)
    command = matched(peer.writer("/cmd_vel", wire.Twist))

    def told():
        pressed.take()
        return [message.data for message in pressed.all]

    with commanded(command, twist(0.5, 0.0)):
        wait_for(lambda: told() == [False, True, False], "a stop that is pressed and released")
        wait_for(rover.stands, "standing")
        time.sleep(0.5)
        assert rover.stands()
    drive(command, twist(0.0, 0.0), 0.5)
    with commanded(command, twist(0.5, 0.0)):
        wait_for(lambda: rover.now()["traction_m_s"] > 0.4, "driving again")


def test_a_clock_of_its_own_runs_faster_and_all_stamps_follow_it(vehicle, peer):
    vehicle({r"^  # clock_factor: 4$": "  clock_factor: 4"})
    clock, odom = peer.reader("/clock", wire.Clock), peer.reader("/odom", wire.Odometry)
    first, began = seconds(clock.next("/clock").clock), time.monotonic()
    assert first < 4 * 60
    time.sleep(3.0)
    last, took = seconds(clock.next("/clock").clock), time.monotonic() - began
    # Late on a loaded machine it catches up, so the ratio is near in the end.
    assert 3.0 < (last - first) / took < 5.0
    stamp_s = seconds(odom.next("/odom").header.stamp)
    assert last - 2.0 < stamp_s < seconds(clock.next("/clock").clock) + 2.0


def test_streams_can_fail_one_at_a_time(vehicle, peer):
    vehicle(
        faults=[
            "{after_enabled_s: 0.5, for_s: 100, fault: !stop [imu]}",
            "{after_enabled_s: 0.5, for_s: 100, fault: !wrong_frame transforms}",
            "{after_enabled_s: 0.5, for_s: 100, fault: !not_a_number odometry}",
        ]
    )
    imu, odom = peer.reader("/imu", wire.Imu), peer.reader("/odom", wire.Odometry)
    tf = peer.reader("/tf", wire.TFMessage)
    command = matched(peer.writer("/cmd_vel", wire.Twist))
    imu.next("/imu before the fault")
    drive(command, twist(0.3, 0.0), 1.5)
    assert imu.silent(0.5)
    assert math.isnan(odom.next("/odom").pose.pose.position.x)
    assert tf.next("/tf").transforms[0].header.frame_id == "nowhere"


def test_ros_args_name_node_and_topics_and_it_leaves_the_graph(vehicle, peer, domain):
    rover = vehicle(ros=["-r", "__ns:=/j8", "-r", "__node:=front", "-r", "odom:=/odometry/filtered"])
    names = peer.nodes()
    wait_for(lambda: "/j8/front" in names(), "the node on the graph")
    peer.reader("/odometry/filtered", wire.Odometry).next("remapped odometry")
    peer.reader("/j8/imu", wire.Imu).next("imu in the namespace")
    peer.reader("/tf", wire.TFMessage).next("/tf, which is no relative name")
    assert rover.program.end() == 0
    wait_for(lambda: "/j8/front" not in names(), "the node gone from the graph")


def test_a_vehicle_that_was_suspended_speaks_again(vehicle, peer):
    rover = vehicle()
    odom = peer.reader("/odom", wire.Odometry)
    odom.next("odometry")
    rover.program.signal(signal.SIGSTOP)
    time.sleep(1.0)
    rover.program.signal(signal.SIGCONT)
    fresh = lambda: any(time.time() - seconds(message.header.stamp) < 0.5 for message in odom.take())
    wait_for(fresh, "fresh odometry")
    command = matched(peer.writer("/cmd_vel", wire.Twist))
    with commanded(command, twist(0.5, 0.0)):
        wait_for(lambda: rover.now()["traction_m_s"] > 0.4, "driving")
    assert rover.program.end() == 0


@pytest.mark.parametrize(
    "arguments, environment, says",
    [
        (["--ros-args", "--no-such"], {}, "--no-such is not known"),
        (["--ros-args", "-r", "odom=/x"], {}, "odom=/x must be [NODE:]NAME:=VALUE"),
        (["--ros-args", "-r", "odom:=a//b"], {}, "/a//b"),
        ([], {"ROS_DOMAIN_ID": "300"}, "ROS_DOMAIN_ID=300 must be a number from 0 to 232"),
        ([], {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}, "RMW_IMPLEMENTATION=rmw_zenoh_cpp must be"),
    ],
)
def test_wrong_arguments_and_variables_are_named(start, arguments, environment, says):
    config = f"{REPOSITORY}/config/bridge/vehicle_ros2.yaml"
    program = start("vehicle", config, *arguments, **environment)
    assert program.process.wait(timeout=10) == 2
    assert says in program.output()


def test_loopback_only_is_heard_on_this_machine(vehicle, domain, start):
    config = f"{REPOSITORY}/config/bridge/vehicle_ros2.yaml"
    start("vehicle", config, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    Peer(domain).reader("/odom", wire.Odometry).next("odometry over loopback")


def test_check_knows_the_file():
    config = f"{REPOSITORY}/config/bridge/vehicle_ros2.yaml"
    said = subprocess.run([SIDEHILL, "check", config], capture_output=True, text=True, timeout=30)
    assert said.returncode == 0 and "valid" in said.stdout
