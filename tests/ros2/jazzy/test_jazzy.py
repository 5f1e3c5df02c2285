"""Controller and virtual vehicle with nodes of ROS 2 Jazzy itself, over Fast DDS: rclpy as it is published
in wheels, and Nav2's action made by rosidl from nav2_msgs/."""

import math
import subprocess
import sys
import time

import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav2_msgs.action import FollowPath
from nav2_msgs.msg import SpeedLimit, TrackingFeedback
from nav_msgs.msg import Odometry
from nodes import SERVER, START_YAW_RAD, Node, ahead
from programs import cross_track_m, figure_eight, straight, wait_for
from rcl_interfaces.msg import ParameterType
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from std_msgs.msg import Bool


def test_a_goal_is_driven_with_feedback_to_success(driven):
    d = driven()
    commands = d.ros.messages(Twist, "/cmd_vel")
    # The first lobe and back to where the lines cross.
    points = figure_eight(2000)[:1000]
    began = time.monotonic()
    goal = d.send(points)
    print(f"1,000 poses answered after {1000 * (time.monotonic() - began):.1f} ms")
    assert goal.accepted
    status, result = d.ended(goal, timeout_s=120)
    assert (status, result.error_code, result.error_msg) == (GoalStatus.STATUS_SUCCEEDED, 0, "")
    d.stands()
    rows = [row for row in d.vehicle.truth() if row["time_s"] > 0.0]
    moving = next(row["time_s"] for row in rows if abs(row["traction_m_s"]) > 1e-3)
    driven_rows = [row for row in rows if row["time_s"] > moving + 2.0]
    distances = cross_track_m(driven_rows, points)
    rms_m = math.sqrt(sum(d * d for d in distances) / len(distances))
    print(f"cross-track RMS {100 * rms_m:.2f} cm")
    assert rms_m <= 0.03
    left_m = [message.distance_to_goal for message in d.feedback]
    assert len(left_m) > 50 and left_m[0] > 9.0 and left_m[-1] < 1.0
    assert max(command.linear.x for command in commands) > 0.3
    assert commands[-1] == Twist()


def test_a_goal_is_driven_three_times_as_fast_as_time(driven, ros):
    ros.node.set_parameters([Parameter("use_sim_time", value=True)])
    # Time-outs run on the clock, too: as long as without it for a loaded machine.
    longer = {"feedback_timeout_s: 0.3": "feedback_timeout_s: 0.9\n  command_timeout_s: 0.45"}
    d = driven({"use_sim_time: false": "use_sim_time: true", **longer}, {r"^  # clock_factor: 4$": "  clock_factor: 3"})
    now_s = lambda: 1e-9 * ros.node.get_clock().now().nanoseconds
    points = ahead(8.0)
    goal = d.sent_off(points)
    began, began_s = time.monotonic(), now_s()
    status, result = d.ended(goal, timeout_s=60)
    took_s, took = now_s() - began_s, time.monotonic() - began
    assert (status, result.error_code, result.error_msg) == (GoalStatus.STATUS_SUCCEEDED, 0, "")
    median_m = sorted(cross_track_m(d.vehicle.truth(), points))[len(d.vehicle.rows) // 2]
    print(f"{took_s:.1f} s of /clock in {took:.1f} s, cross-track {100 * median_m:.2f} cm, the median")
    # A loaded machine may be slower than that.
    assert took_s > 1.5 * took
    assert median_m < 0.02


def test_cancel_and_a_newer_goal_end_a_goal_as_its_client_expects(driven):
    d = driven()
    first = d.sent_off(ahead())
    second = d.sent_off(ahead(12.0))
    status, result = d.ended(first)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 100)
    assert result.error_msg
    answer = d.ros.result(second.cancel_goal_async(), "answer to a cancel")
    assert [entry.goal_id for entry in answer.goals_canceling] == [second.goal_id]
    status, result = d.ended(second)
    assert (status, result.error_code) == (GoalStatus.STATUS_CANCELED, 0)
    d.stands()
    # A result is told again.
    assert d.ended(second)[0] == GoalStatus.STATUS_CANCELED


def test_an_emergency_stop_that_was_pressed_before_the_start_lets_nothing_drive(driven, ros):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    button = ros.node.create_publisher(Bool, "/emergency_stop", latched)
    button.publish(Bool(data=True))
    d = driven()
    # What a latched writer of Fast DDS said earlier takes some 3 s to be heard. A goal waits for it.
    for _ in range(2):
        status, result = d.ended(d.send(ahead()))
        assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 100)
        assert "the emergency stop is pressed" in result.error_msg
    assert all(row["traction_m_s"] == 0.0 and row["steer_m_s"] == 0.0 for row in d.vehicle.truth())
    button.publish(Bool(data=False))
    d.emergency_stop_is(False)
    time.sleep(1.0)
    assert d.vehicle.stands()
    d.sent_off(ahead())


# As `ros2 topic pub --once` does it.
PASSER_BY = """
import sys, time, rclpy
from std_msgs.msg import Bool
rclpy.init(domain_id=int(sys.argv[1]))
button = rclpy.create_node("passer_by").create_publisher(Bool, "/emergency_stop", 1)
while not button.get_subscription_count():
    time.sleep(0.01)
button.publish(Bool(data=True))
time.sleep(0.1)
"""


def test_an_emergency_stop_by_who_comes_for_it_and_leaves_is_not_lost(driven, ros, domain):
    d = driven()
    for _ in range(4):
        goal = d.sent_off(ahead())
        subprocess.run([sys.executable, "-c", PASSER_BY, str(domain)], check=True)
        status, result = d.ended(goal)
        assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 100)
        # Whichever comes first: the press, or the doubt about a publisher that has not been heard.
        assert result.error_msg.endswith(("the emergency stop is pressed", "has not sent anything yet"))
        print(result.error_msg)
        d.stands()
        # It is still pressed.
        wait_for(lambda: d.ended(d.send(ahead()))[1].error_msg == "the emergency stop is pressed", "a stop that holds")
        release = ros.node.create_publisher(Bool, "/emergency_stop", 1)
        ros.wait_for(release.get_subscription_count, "who listens to the emergency stop")
        release.publish(Bool(data=False))
        d.emergency_stop_is(False)
        ros.node.destroy_publisher(release)


def test_a_newcomer_who_may_press_the_emergency_stop_and_is_not_heard_ends_a_drive(driven, ros):
    d = driven()
    goal = d.sent_off(ahead())
    ros.node.create_publisher(Bool, "/emergency_stop", 1)
    status, result = d.ended(goal)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 100)
    assert "has not sent anything yet" in result.error_msg
    d.stands()
    # A goal waits 6 s for its word, but not for ever.
    d.sent_off(ahead(), timeout_s=20.0)


def test_a_path_that_cannot_be_driven_is_aborted_with_its_code(driven):
    d = driven()
    goal = d.send([])
    status, result = d.ended(goal)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 103)


def test_parameters_are_listed_described_set_and_refused(driven):
    d = driven()
    client = AsyncParameterClient(d.ros.node, SERVER)
    d.ros.wait_for(client.services_are_ready, "parameter services")
    names = d.ros.result(client.list_parameters(), "names").result.names
    assert {"failure_tolerance", "general_goal_checker.xy_goal_tolerance", "use_sim_time"} <= set(names)
    values = d.ros.result(client.get_parameters(["failure_tolerance"]), "values").values
    assert values[0].type == ParameterType.PARAMETER_DOUBLE and values[0].double_value == 1.0
    told = d.ros.result(client.describe_parameters(["failure_tolerance"]), "descriptions").descriptors
    assert told[0].type == ParameterType.PARAMETER_DOUBLE
    set_to = lambda value: d.ros.result(
        client.set_parameters([Parameter("failure_tolerance", value=value)]), "setting"
    ).results[0]
    assert set_to(2.5).successful
    refused = set_to(-1.0)
    assert not refused.successful and "failure_tolerance" in refused.reason
    values = d.ros.result(client.get_parameters(["failure_tolerance"]), "values").values
    assert values[0].double_value == 2.5


def test_a_lifecycle_manager_leads_it(driven):
    d = driven({r"^  autostart: true": "  autostart: false"})
    state = lambda: d.ros.call(GetState, "get_state", GetState.Request()).current_state.id

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return d.ros.call(ChangeState, "change_state", request).success

    assert state() == State.PRIMARY_STATE_UNCONFIGURED
    assert not d.send(ahead()).accepted
    assert change(Transition.TRANSITION_CONFIGURE) and state() == State.PRIMARY_STATE_INACTIVE
    assert not change(Transition.TRANSITION_CLEANUP + 100)
    assert change(Transition.TRANSITION_ACTIVATE) and state() == State.PRIMARY_STATE_ACTIVE
    goal = d.sent_off(ahead())
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert d.ended(goal)[0] == GoalStatus.STATUS_ABORTED
    d.stands()
    assert change(Transition.TRANSITION_CLEANUP) and state() == State.PRIMARY_STATE_UNCONFIGURED


def test_the_graph_shows_nodes_topics_services_and_the_action(driven):
    d = driven()
    node = d.ros.node
    # What a node has comes to be known one after the other.
    shown = lambda what, listed: d.ros.wait_for(lambda: set(what) <= set(listed()), str(what))
    shown(["controller_server", "virtual_rover"], node.get_node_names)

    def of_the_controller(list_of_node, expected):
        listed = lambda: [(name, *types) for name, types in list_of_node("controller_server", "/")]
        shown(expected, listed)

    of_the_controller(
        node.get_publisher_names_and_types_by_node,
        [
            ("/cmd_vel", "geometry_msgs/msg/Twist"),
            ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
            ("/optimal_trajectory", "nav_msgs/msg/Path"),
        ],
    )
    of_the_controller(
        node.get_subscriber_names_and_types_by_node,
        [("/odom", "nav_msgs/msg/Odometry"), ("/speed_limit", "nav2_msgs/msg/SpeedLimit")],
    )
    of_the_controller(
        node.get_service_names_and_types_by_node,
        [(f"{SERVER}/change_state", "lifecycle_msgs/srv/ChangeState")],
    )
    actions = lambda: [(name, *types) for name, types in get_action_names_and_types(node)]
    shown([("/follow_path", "nav2_msgs/action/FollowPath")], actions)


def test_topics_reach_nodes_of_ros_and_theirs_reach_the_controller(driven):
    d = driven()
    odometry = d.ros.messages(Odometry, "/odom", qos_profile_sensor_data)
    diagnostics = d.ros.messages(DiagnosticArray, "/diagnostics")
    limit = d.ros.node.create_publisher(SpeedLimit, "/speed_limit", 10)
    d.ros.wait_for(limit.get_subscription_count, "who listens to the speed limit")
    goal = d.sent_off(ahead())
    limit.publish(SpeedLimit(percentage=True, speed_limit=40.0))
    slow = lambda: 0.15 < d.vehicle.now()["traction_m_s"] < 0.22
    d.ros.wait_for(slow, "40 % of 0.5 m/s")
    d.ros.wait_for(lambda: diagnostics and odometry, "diagnostics and odometry")
    assert any("controller_server" in status.name for status in diagnostics[-1].status)
    assert odometry[-1].header.frame_id == "odom" and odometry[-1].child_frame_id == "base_link"
    d.ros.result(goal.cancel_goal_async(), "answer to a cancel")
    assert d.ended(goal)[0] == GoalStatus.STATUS_CANCELED


def test_tracking_feedback_is_signed_as_nav2s(driven, ros):
    d = driven({r"^  use_sim_time: false.*$": "  tracking_feedback: true\n  use_sim_time: false"})
    feedback = d.ros.messages(TrackingFeedback, "/tracking_feedback", 100)
    # The path leads off 0.1 rad to the left of where the vehicle looks, and begins 0.1 m to its right.
    beside = START_YAW_RAD - math.pi / 2
    begin = (0.1 * math.cos(beside), 0.1 * math.sin(beside))
    points = straight(6.0, begin, START_YAW_RAD + 0.1)
    goal = d.sent_off(points)
    d.ros.wait_for(lambda: feedback, "tracking feedback")
    first = feedback[0]
    assert first.header.frame_id == first.robot_pose.header.frame_id == "odom"
    # To the left of the path is positive; a heading to the right of the path's is positive too.
    assert 0.02 < first.position_tracking_error < 0.12, first
    assert 0.02 < first.heading_tracking_error < 0.12, first
    assert first.current_path_index < 10 and abs(first.remaining_path_length - 6.0) < 0.5
    status, result = d.ended(goal, timeout_s=60)
    assert status == GoalStatus.STATUS_SUCCEEDED, result
    indices = [message.current_path_index for message in feedback]
    assert indices == sorted(indices) and indices[-1] > 100
    last = feedback[-1]
    assert last.remaining_path_length < 0.5 and last.distance_to_goal < 0.5
    assert abs(last.position_tracking_error) < 0.03
    assert 0.4 < max(message.speed for message in feedback) < 0.7
    at_s = last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec
    row = min(d.vehicle.truth(at_s), key=lambda row: abs(row["unix_s"] - at_s))
    at = last.robot_pose.pose.position
    assert math.hypot(at.x - row["x_m"], at.y - row["y_m"]) < 0.05


@pytest.mark.parametrize("told", [False, True])
def test_a_node_that_slows_the_drives_down_is_no_fault_where_the_controller_hears_it(driven, told):
    """As Nav2's collision monitor, between the controller and the drives."""
    twist = "twist: {topic: cmd_vel_nav, stamped: false}"
    forwarded = "\n    forwarded: {topic: cmd_vel, stamped: false}" if told else ""
    d = driven({r"^    twist: \{.*$": f"    {twist}{forwarded}"})
    to_drives = d.ros.node.create_publisher(Twist, "/cmd_vel", 10)

    def slow_down(message):
        message.linear.x *= 0.4
        message.angular.z *= 0.4
        to_drives.publish(message)

    d.ros.node.create_subscription(Twist, "/cmd_vel_nav", slow_down, 10)
    d.ros.wait_for(to_drives.get_subscription_count, "the drives")
    status, result = d.ended(d.send(ahead(2.0)), timeout_s=60)
    if told:
        assert status == GoalStatus.STATUS_SUCCEEDED, result
    else:
        assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 100)
        assert "differs" in result.error_msg


def test_a_goal_ends_with_its_own_client_and_not_with_another_of_the_same_node(driven, ros):
    d = driven()
    other = ActionClient(ros.node, FollowPath, "/follow_path")
    ros.wait_for(other.server_is_ready, "action server")
    goal = d.sent_off(ahead())
    result = goal.get_result_async()
    other.destroy()
    began = time.monotonic()
    ros.wait_for(lambda: result.done() or time.monotonic() > began + 2.0, "two seconds of driving")
    assert not result.done() and d.vehicle.now()["traction_m_s"] > 0.2
    d.action.destroy()
    d.stands()


def test_first_calls_of_fresh_nodes_are_answered(driven, domain):
    driven()
    took_s = []
    for _ in range(10):
        fresh = Node(domain)
        client = fresh.node.create_client(GetState, f"{SERVER}/get_state")
        fresh.wait_for(client.service_is_ready, "service")
        began = time.monotonic()
        answer = fresh.result(client.call_async(GetState.Request()), "first call")
        took_s.append(time.monotonic() - began)
        assert answer.current_state.id == State.PRIMARY_STATE_ACTIVE
        fresh.close()
    print(f"first calls answered after {sorted(round(t, 3) for t in took_s)} s")
