"""Slope-corrected odometry: a node of its own, and that of the controller."""

import math
import os

from nav_msgs.msg import Odometry
from nodes import ahead
from programs import REPOSITORY, figure_eight

SCENARIO = os.path.join(REPOSITORY, "config", "scenarios", "figure_eight_10deg.yaml")


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def heading(orientation):
    """Yaw of a quaternion in ROS axes, of a vehicle that may be tilted."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def wheels(messages):
    """Poses that a differential drive counts from the twist of wheel odometry."""
    poses, x, y, yaw, before = [], 0.0, 0.0, 0.0, None
    for message in messages:
        at, twist = seconds(message.header.stamp), message.twist.twist
        if before is not None:
            step = at - before
            yaw += 0.5 * step * twist.angular.z
            x += step * twist.linear.x * math.cos(yaw)
            y += step * twist.linear.x * math.sin(yaw)
            yaw += 0.5 * step * twist.angular.z
        before = at
        poses.append((at, x, y))
    return poses


def drift_m(poses, rows):
    """Root mean square distance of poses from the truth, both from where they begin and along its heading."""
    begin = min(rows, key=lambda row: abs(row["unix_s"] - poses[0][0]))
    turn = begin["yaw_rad"] + math.pi / 2
    cos, sin = math.cos(turn), math.sin(turn)
    squares, index = [], 0
    for at, x, y in poses:
        while index + 1 < len(rows) and rows[index + 1]["unix_s"] <= at:
            index += 1
        row = rows[index]
        true_x, true_y = row["x_m"] - begin["x_m"], row["y_m"] - begin["y_m"]
        squares.append((cos * x - sin * y - true_x) ** 2 + (sin * x + cos * y - true_y) ** 2)
    return math.sqrt(sum(squares) / len(squares)), math.sqrt(squares[-1])


def test_the_odometry_node_drifts_a_tenth_of_what_wheels_do(driven, start, ros):
    rover = {r"^scenario: .*$": f"scenario: {SCENARIO}", r"^# plant: .*$": "plant: contact"}
    d = driven(of_vehicle=rover)
    start("odometry", "--live", os.path.join(REPOSITORY, "config", "bridge", "odometry_ros2.yaml"))
    corrected = ros.messages(Odometry, "/slope_odometry/odometry", 100)
    wheel = ros.messages(Odometry, "/odom", 100)
    ros.wait_for(lambda: corrected and wheel, "odometry")
    status, result = d.ended(d.send(figure_eight(1000)), timeout_s=120)
    assert result.error_code == 0, (status, result)
    first = seconds(corrected[0].header.stamp)
    rows = [row for row in d.vehicle.truth() if row["unix_s"] >= first - 0.1]
    counted = wheels([message for message in wheel if seconds(message.header.stamp) >= first])
    poses = [
        (seconds(m.header.stamp), m.pose.pose.position.x, m.pose.pose.position.y) for m in corrected
    ]
    slope, flat = drift_m(poses, rows), drift_m(counted, rows)
    print(f"drift RMS and at the end: slope model {slope[0]:.2f} and {slope[1]:.2f} m, wheels {flat[0]:.2f} and {flat[1]:.2f} m")
    assert slope[1] <= 0.1 * flat[1] and slope[0] <= 0.1 * flat[0]
    last = corrected[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    assert 0.0 < last.pose.covariance[0] < 10.0 and last.pose.covariance[14] == 1e6


def test_the_controller_publishes_its_estimate_as_odometry(driven, ros):
    d = driven()
    estimates = ros.messages(Odometry, "/controller_server/odometry", 10)
    d.sent_off(ahead())
    moves = lambda: estimates and estimates[-1].twist.twist.linear.x > 0.2
    ros.wait_for(moves, "odometry of the controller that moves")
    estimate = estimates[-1]
    at_s = seconds(estimate.header.stamp)
    row = min(d.vehicle.truth(at_s), key=lambda row: abs(row["unix_s"] - at_s))
    at = estimate.pose.pose.position
    assert math.hypot(at.x - row["x_m"], at.y - row["y_m"]) < 0.05
    assert 0.2 < estimate.twist.twist.linear.x < 0.6
    turn = heading(estimate.pose.pose.orientation) - row["yaw_rad"] - math.pi / 2
    assert abs(math.remainder(turn, 2 * math.pi)) < 0.05
