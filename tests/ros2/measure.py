"""Measures the controller on ROS 2 and prints figures as JSON; nothing is asserted but that answers
come.

    python3 tests/ros2/measure.py [--seconds 60] [--clients 100] [--hz 100] [--fifo] [--stress]

With --fifo, which root may ask for, Sidehill and the peer get real-time priorities; with --stress each core has an
endless loop beside them.

- Round trip: the peer plays a vehicle and publishes odometry at 1 kHz, stamped as it is sent. From
  the stamp that a cycle used until the command of that cycle has arrived at the peer, less the cycle
  itself (from its beginning to its end, as the program records it). Of that, half a millisecond is the
  phase of the odometry, and what peers_alone says is the peer's own: the way there and back to another of
  its kind that answers at once.
- Goal acceptance: from when the client has put a goal of 1,000 or 5,000 poses on the wire, which takes
  Python its time, until the answer.
- First calls: of fresh participants, at once after both topics of the service have matched.
"""

import argparse
import csv
import json
import math
import multiprocessing
import os
import pathlib
import random
import subprocess
import tempfile
import threading
import time
import uuid

from cyclonedds.util import duration

import wire
from peer import Client, FollowPath, Goal, Peer, now, path_of
from programs import Program, adapted, straight, wait_for


class PlayedVehicle(threading.Thread):
    """A vehicle that does at once what it is told, on level ground."""

    def __init__(self, peer):
        super().__init__(daemon=True)
        self.odom = peer.writer("/odom", wire.Odometry)
        self.imu = peer.writer("/imu", wire.Imu)
        self.fixed = peer.writer("/tf_static", wire.TFMessage, latched=True)
        self.stopped = peer.writer("/emergency_stop", wire.Bool, latched=True)
        self.commands = peer.raw_reader("rt/cmd_vel", wire.Twist)
        self.arrivals, self.told = [], (0.0, 0.0)
        self.ended = False
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        """Waits for commands in a thread of its own, so that they are noted when they come."""
        while not self.ended:
            command = self.commands.take_one(timeout=duration(seconds=3600))
            self.arrivals.append(time.time())
            self.told = (command.linear.x, command.angular.z)

    def run(self):
        identity = wire.Transform(rotation=wire.Quaternion(w=1.0))
        header = wire.Header(stamp=now(), frame_id="map")
        self.fixed.write(
            wire.TFMessage(
                transforms=[wire.TransformStamped(header=header, child_frame_id="odom", transform=identity)]
            )
        )
        self.stopped.write(wire.Bool(data=False))
        x = y = yaw = 0.0
        message = wire.Odometry(child_frame_id="base_link")
        message.header.frame_id = "odom"
        imu = wire.Imu()
        imu.header.frame_id = "base_link"
        last, count = time.time(), 0
        while not self.ended:
            at = time.time()
            forward, turn = self.told
            dt, last = at - last, at
            yaw += turn * dt
            x += forward * math.cos(yaw) * dt
            y += forward * math.sin(yaw) * dt
            pose, twist = message.pose.pose, message.twist.twist
            pose.position.x, pose.position.y = x, y
            pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
            twist.linear.x, twist.angular.z = forward, turn
            message.header.stamp = now()
            self.odom.write(message)
            if count % 20 == 0:
                imu.header.stamp = now()
                imu.orientation = pose.orientation
                self.imu.write(imu)
            count += 1
            time.sleep(max(0.0, 0.001 - (time.time() - at)))


def start(*arguments):
    """Starts Sidehill with the priority of any program, whatever that of the peer is."""
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    program = Program(*arguments)
    os.sched_setscheduler(0, policy, priority)
    return program


def quantiles(values_s):
    ordered = sorted(1e3 * value for value in values_s)
    at = lambda q: round(ordered[min(len(ordered) - 1, int(q * len(ordered)))], 3)
    return {"count": len(ordered), "p50_ms": at(0.5), "p99_ms": at(0.99), "max_ms": round(ordered[-1], 3)}


def round_trip(peer, folder, config, domain, seconds, period_s):
    vehicle = PlayedVehicle(peer)
    vehicle.start()
    program = start(["run", config, "--out", folder / "run"], domain, folder / "run.log")
    action = FollowPath(peer).wait()
    goal = action.send(path_of(straight(0.5 * seconds + 5.0, yaw_rad=0.0, step_m=0.1)))
    assert goal.reply.accepted, program.output()
    time.sleep(seconds)
    goal.cancel()
    program.end()
    vehicle.ended = True
    vehicle.join()
    with open(folder / "run" / "cycles.csv") as file:
        cycles = list(csv.DictReader(file))
    inward, itself, outward, above = [], [], [], []
    arrivals = iter(vehicle.arrivals)
    arrival = next(arrivals)
    for row in cycles:
        if row["state"] != "driving":
            continue
        begin = float(row["unix_s"])
        duration = period_s - float(row["slack_s"]) - float(row["lateness_s"])
        while arrival is not None and arrival < begin:
            arrival = next(arrivals, None)
        if arrival is None:
            break
        if arrival > begin + period_s:
            continue
        inward.append(float(row["feedback_age_s"]))
        itself.append(duration)
        outward.append(arrival - begin - duration)
        above.append(inward[-1] + outward[-1])
    return {
        "cycles": len(cycles),
        "skipped": sum(int(row["skipped"]) for row in cycles[-1:]),
        "odometry_until_cycle": quantiles(inward),
        "cycle_itself": quantiles(itself),
        "cycle_end_until_command": quantiles(outward),
        "above_the_cycle": quantiles(above),
    }


def answer(domain, count):
    """Answers each 50th odometry by a command that has its stamp, as soon as it comes."""
    peer = Peer(domain)
    odometry = peer.raw_reader("rt/odom", wire.Odometry)
    commands = peer.writer("/cmd_vel", wire.Twist)
    for _ in range(count):
        for _ in range(50):
            message = odometry.take_one(timeout=duration(seconds=30))
        stamp = message.header.stamp
        commands.write(wire.Twist(linear=wire.Vector3(z=stamp.sec + 1e-9 * stamp.nanosec)))


def peers_alone(domain, count=400):
    """The way there and back between two peers, without Sidehill: what the measurement itself takes."""
    process = multiprocessing.get_context("spawn").Process(target=answer, args=(domain, count))
    process.start()
    peer = Peer(domain)
    vehicle = PlayedVehicle(peer)
    commands = peer.raw_reader("rt/cmd_vel", wire.Twist)
    vehicle.start()
    took = []
    while len(took) < count // 2:
        command = commands.take_one(timeout=duration(seconds=30))
        took.append(time.time() - command.linear.z)
    process.kill()
    vehicle.ended = True
    vehicle.join()
    return quantiles(took)


def acceptance(action, poses):
    points = straight(0.01 * poses, yaw_rad=0.0, step_m=0.01)
    goal = action.goal_type(path=path_of(points))
    wrote, took = [], []
    for _ in range(20):
        goal_id = wire.UUID(uuid=uuid.uuid4().bytes)
        began = time.perf_counter()
        number = action.send_goal.send(goal_id=goal_id, goal=goal)
        written = time.perf_counter()
        reply = wait_for(lambda: action.send_goal.reply(number), "the answer", step_s=0.0002)
        took.append(time.perf_counter() - written)
        wrote.append(written - began)
        assert reply.accepted
        Goal(action, goal_id, reply).cancel()
        time.sleep(0.1)
    return {"client_writes": quantiles(wrote), "answer_after_it": quantiles(took)}


def first_calls(domain, count):
    lost, took = 0, []
    for _ in range(count):
        client = Client(Peer(domain), "/controller_server/get_state", wire.GetState)
        wait_for(client.ready, "the service", step_s=0.001)
        number, began = client.send(), time.perf_counter()
        while client.reply(number) is None and time.perf_counter() < began + 3.0:
            time.sleep(0.001)
        if number in client.replies:
            took.append(time.perf_counter() - began)
        else:
            lost += 1
    return {"clients": count, "lost": lost, **quantiles(took)}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--clients", type=int, default=100)
    parser.add_argument("--hz", type=float, default=20.0, help="of the control loop")
    parser.add_argument("--fifo", action="store_true")
    parser.add_argument("--stress", action="store_true")
    arguments = parser.parse_args()
    figures = {}
    loops = []
    if arguments.stress:
        loops = [subprocess.Popen(["sh", "-c", "while :; do :; done"]) for _ in range(os.cpu_count())]
    if arguments.fifo:
        # Below those of Sidehill; the threads that come later inherit it.
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    try:
        measure(arguments, figures)
    finally:
        for loop in loops:
            loop.kill()
    print(json.dumps(figures, indent=2))


def configuration(arguments, folder):
    period_s = 1.0 / arguments.hz
    replaced = {
        r"^  period_s: 0\.05 # s, the same.*$": f"  period_s: {period_s}",
        r"^  period_s: 0\.05 # s, from.*$": f"  period_s: {period_s}",
        r"^  decision_time_s: 0\.03 .*$": f"  decision_time_s: {0.6 * period_s}",
    }
    if arguments.fifo:
        replaced[r"^cycle:$"] = "realtime: {fifo_priority: 80, lock_memory: true}\ncycle:"
    return adapted("run_ros2.yaml", replaced, folder)


def measure(arguments, figures):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        config = configuration(arguments, folder)
        domain = random.randint(1, 101)
        figures["peers_alone"] = peers_alone(domain)
        figures["round_trip"] = round_trip(
            Peer(domain), folder, config, domain, arguments.seconds, 1.0 / arguments.hz
        )
        domain = random.randint(1, 101)
        program = start(["run", config], domain, folder / "second.log")
        peer = Peer(domain)
        vehicle = PlayedVehicle(peer)
        vehicle.start()
        action = FollowPath(peer).wait()
        for poses in (1000, 5000):
            figures[f"goal_acceptance_{poses}_poses"] = acceptance(action, poses)
        figures["first_calls"] = first_calls(domain, arguments.clients)
        program.end()
        vehicle.ended = True


if __name__ == "__main__":
    main()
