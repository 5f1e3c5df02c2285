"""Nodes of rclpy that drive a goal, for the tests in this folder."""

import math
import random

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import FollowPath
from programs import straight, wait_for
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor

SERVER = "/controller_server"
START_YAW_RAD = math.radians(90 - 50.906)


class Node:
    """A node of rclpy that is spun while something is waited for."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node(f"peer_{random.randrange(10**6)}", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def wait_for(self, condition, what, **limit):
        def spun():
            self.executor.spin_once(timeout_sec=0.01)
            return condition()

        # Without a pause, since each turn takes one message and there may be many.
        return wait_for(spun, what, step_s=0.0, **limit)

    def result(self, future, what, **limit):
        self.wait_for(future.done, what, **limit)
        return future.result()

    def call(self, kind, name, request):
        client = self.node.create_client(kind, f"{SERVER}/{name}")
        self.wait_for(client.service_is_ready, name)
        return self.result(client.call_async(request), name)

    def messages(self, kind, topic, qos=10):
        """A list that grows with what comes."""
        came = []
        self.node.create_subscription(kind, topic, came.append, qos)
        return came

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Driven:
    """A vehicle and its controller, with a client of the action."""

    def __init__(self, vehicle, controller, ros):
        self.vehicle, self.controller, self.ros = vehicle, controller, ros
        self.action = ActionClient(ros.node, FollowPath, "/follow_path")
        self.ros.wait_for(self.action.server_is_ready, "action server", timeout_s=60.0)
        self.feedback = []

    def send(self, points):
        goal = FollowPath.Goal(path=path_of(points, self.ros.node))
        came = lambda message: self.feedback.append(message.feedback)
        return self.ros.result(self.action.send_goal_async(goal, feedback_callback=came), "answer to a goal")

    def sent_off(self, points, **limit):
        """A goal that was accepted and is being driven."""
        goal = self.send(points)
        assert goal.accepted
        self.ros.wait_for(lambda: abs(self.vehicle.now()["traction_m_s"]) > 0.2, "driving", **limit)
        return goal

    def ended(self, goal, **limit):
        """Status and result of a goal."""
        answer = self.ros.result(goal.get_result_async(), "result", **limit)
        return answer.status, answer.result

    def emergency_stop_is(self, pressed):
        """Waits until the controller says whether the emergency stop is pressed."""
        messages = self.ros.messages(DiagnosticArray, "/diagnostics")

        def said():
            values = [value for message in messages[-1:] for value in message.status[0].values]
            return ("emergency_stop", str(pressed).lower()) in [(value.key, value.value) for value in values]

        self.ros.wait_for(said, "the state of the emergency stop")

    def stands(self):
        self.ros.wait_for(self.vehicle.stands, "standing")


def path_of(points, node):
    """A nav_msgs/Path in the map."""
    path = FollowPath.Goal().path
    path.header.frame_id = "map"
    path.header.stamp = node.get_clock().now().to_msg()
    for index, (x, y) in enumerate(points):
        ahead, behind = points[min(index + 1, len(points) - 1)], points[max(index - 1, 0)]
        half_rad = 0.5 * math.atan2(ahead[1] - behind[1], ahead[0] - behind[0])
        pose = PoseStamped(header=path.header)
        pose.pose.position.x, pose.pose.position.y = x, y
        pose.pose.orientation.z, pose.pose.orientation.w = math.sin(half_rad), math.cos(half_rad)
        path.poses.append(pose)
    return path


def ahead(length_m=15.0):
    return straight(length_m, yaw_rad=START_YAW_RAD)
