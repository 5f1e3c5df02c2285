"""A client of FollowPath and an operator on the graph of ROS 2: the independent peer of tests/ros2.

    goals.py DOMAIN

Standard input takes one order a line; each is answered by a line of JSON:
    figure_eight     sends the figure of eight as a goal, a thousand poses
    straight M       sends a straight path of M metres from the figure of eight's start
    result           waits for the end of the newest goal
    feedback         what has come for it
    cancel           takes it back
    press, release   the emergency stop
    diagnostics      the newest of the controller
The end of standard input ends the program.
"""

import json
import math
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), *[".."] * 5, "tests", "ros2"))

import wire
from peer import FollowPath, Peer, path_of
from programs import figure_eight, straight, wait_for

START_YAW_RAD = math.radians(90 - 50.906)
# A result comes when the path has been driven.
DRIVEN_S = 150.0


class Operator:
    def __init__(self, domain):
        peer = Peer(domain)
        self.diagnostics_of = peer.reader("/diagnostics", wire.DiagnosticArray)
        self.stop = peer.writer("/emergency_stop", wire.Bool, latched=True)
        self.action = FollowPath(peer).wait()
        wait_for(self.diagnostics_of.matched, "diagnostics")
        wait_for(self.stop.get_matched_subscriptions, "who listens to the emergency stop")
        # A goal waits for the first word of each who could have pressed it.
        self.release()
        self.goal = None

    def send(self, points):
        self.goal = self.action.send(path_of(points, "odom"))
        return {"accepted": self.goal.reply.accepted}

    def figure_eight(self):
        return self.send(figure_eight(1000))

    def straight(self, length_m):
        return self.send(straight(float(length_m), yaw_rad=START_YAW_RAD))

    def result(self):
        # Looked for at leisure: the kernel has one CPU, and a busy wait would take it from who drives.
        client = self.action.get_result
        number = client.send(goal_id=self.goal.id)
        answer = wait_for(lambda: client.reply(number), "the result", DRIVEN_S, 0.05)
        told = answer.result
        return {"status": answer.status, "code": told.error_code, "message": told.error_msg}

    def feedback(self):
        left_m = [message.distance_to_goal for message in self.goal.feedback()]
        return {"count": len(left_m), "first_m": left_m[0], "last_m": left_m[-1]}

    def cancel(self):
        return {"return_code": self.goal.cancel().return_code}

    def press(self):
        self.stop.write(wire.Bool(data=True))
        return {}

    def release(self):
        self.stop.write(wire.Bool(data=False))
        return {}

    def diagnostics(self):
        status = self.diagnostics_of.next("diagnostics").status[0]
        values = {value.key: value.value for value in status.values}
        return {"level": status.level, "message": status.message, **values}


operator = Operator(int(sys.argv[1]))
print("ready", flush=True)
for line in sys.stdin:
    name, *arguments = line.split()
    print(json.dumps(getattr(operator, name)(*arguments)), flush=True)
