"""Drives one controller, Sidehill or a controller server of Nav2, over a course on the virtual rover, and prints
its figures as JSON. Nothing is asserted.

    python3 tests/ros2/compare/compare.py --slope-deg 10                                  # Sidehill
    python3 tests/ros2/compare/compare.py --course piece --speed 0.8                      # 44 m of a recorded route
    python3 tests/ros2/compare/compare.py --slope-deg 10 --params rpp.yaml --server PATH  # a peer

PATH is Nav2's `controller_server`, which is not part of this repository: `nav2_controller/lib/.../controller_server`
of a ROS 2 Jazzy installation. The script itself needs rclpy and the action FollowPath; the environment that
`.ci/ros2` makes has them:

    AMENT_PREFIX_PATH=$PWD/target/jazzy target/jazzy/bin/python3 tests/ros2/compare/compare.py ...

Both controllers get the same goal at 20 Hz and obey nothing else; sensors are perfect, time is real. A peer takes
the level frame `base_footprint` for the vehicle's, moved ahead by --point-m, since Nav2's controllers take level
paths into that frame in 3D. 0.206 m is the place of the J8's tread ICRs; benches/notes/2026-11-25-nav2.md says which points were best.
The figure of eight is sent without its last 0.5 m, since Nav2's goal checker ends a closed path at once. Figures are
those of `base_link`, and with --point-m also of that point, by the truth, after the first 2 s and without the last
0.8 m. Run it where nothing else runs: a peer that gets no CPU tracks worse. Runs side by side need a network each
(`unshare -n`), since their domains are random.
"""

import argparse
import csv
import itertools
import json
import math
import os
import pathlib
import random
import re
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "jazzy")]

from geometry_msgs.msg import TransformStamped, Twist
from nodes import Driven, Node
from programs import REPOSITORY, SIDEHILL, Vehicle, adapted, cross_track_m, figure_eight
from rclpy.qos import DurabilityPolicy, QoSProfile

END_M, START_S = 0.8, 2.0
# A goal that lies within the tolerance of the start counts as reached at once with Nav2's goal checker.
OPEN_M = 0.5
# The stretch of the recorded route with the most bends on a slope, m along it.
PIECE_M = (156.0, 200.0)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--course", choices=["eight", "piece"], default="eight")
    parser.add_argument("--slope-deg", type=float, default=10.0, help="of the figure of eight")
    parser.add_argument("--plant", choices=["icrik", "contact"], default="contact")
    parser.add_argument("--speed", type=float, default=0.6, help="m/s")
    parser.add_argument("--laps", type=int, default=1, help="of the figure of eight")
    parser.add_argument("--controller", default="icrik-mpc", help="Sidehill's, without --params")
    parser.add_argument("--params", help="parameters of a peer, beside this file or a path")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="one of the peer's parameters")
    parser.add_argument("--server", help="program of the peer")
    parser.add_argument("--point-m", type=float, default=0.0, help="steered point ahead of base_link")
    return parser.parse_args()


def course(args, folder):
    """The scenario of the course, and its points."""
    if args.course == "piece":
        return piece(folder)
    return eight(args, folder), figure_eight(1000)


def piece(folder):
    """A stretch of the recorded route, on the elevation recorded with it."""
    route = pathlib.Path(REPOSITORY, "config/routes/path_1_june_26.gpx").read_text()
    found = re.compile(r"<trkpt lat=\"(\S+?)\" lon=\"(\S+?)\">.*?</trkpt>", re.DOTALL)
    kept, along_m, before = [], 0.0, None
    for point in found.finditer(route):
        latitude, longitude = (math.radians(float(value)) for value in point.groups())
        if before is not None:
            north, east = latitude - before[0], (longitude - before[1]) * math.cos(latitude)
            along_m += 6_371_000 * math.hypot(north, east)
        before = latitude, longitude
        if PIECE_M[0] <= along_m <= PIECE_M[1]:
            kept.append(point.group())
    first, last = list(found.finditer(route))[:: len(found.findall(route)) - 1]
    (folder / "piece.gpx").write_text(route[: first.start()] + "\n".join(kept) + route[last.end() :])
    text = pathlib.Path(REPOSITORY, "config/scenarios/j8_route.yaml").read_text()
    text = text.replace("../vehicles", f"{REPOSITORY}/config/vehicles")
    path = folder / "scenario.yaml"
    path.write_text(re.sub(r"file: \S+", f"file: {folder}/piece.gpx", text))
    # The points of the path of bounded curvature that `simulate` makes of it.
    drive = [SIDEHILL, "simulate", path, "--controller", "icrik-mpc", "--out", folder / "reference"]
    subprocess.run([str(part) for part in drive], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    points = []
    with open(folder / "reference" / "icrik-mpc.csv") as file:
        for row in csv.DictReader(file):
            point = float(row["reference_x_m"]), float(row["reference_y_m"])
            if not points or math.dist(point, points[-1]) > 0.03:
                points.append(point)
    return path, points


def eight(args, folder):
    """The figure of eight on a plane of the slope."""
    text = pathlib.Path(REPOSITORY, "config/scenarios/figure_eight_10deg.yaml").read_text()
    text = text.replace("../", f"{REPOSITORY}/config/").replace("slope_deg: 10", f"slope_deg: {args.slope_deg}")
    path = folder / "scenario.yaml"
    path.write_text(text)
    return path


def opened(points):
    """A closed path without its end."""
    return points[: max(i for i, point in enumerate(points) if math.dist(point, points[0]) > OPEN_M) + 1]


def sidehill_config(args, folder):
    replaced = {
        r"\bspeed_m_s: 0\.5\b": f"speed_m_s: {args.speed}",
        r"^controller: icrik-mpc.*$": f"controller: {args.controller}",
        r'^    path: plan.*$': '    path: ""',
    }
    if args.plant == "contact":
        identified = "j8_wheels" if args.controller == "contact-mpc" else "j8_contact"
        vehicle = f"{REPOSITORY}/config/vehicles/{identified}_identified.yaml"
        replaced[r"^vehicle: .*$"] = f"vehicle: {vehicle}"
    return adapted("run_ros2.yaml", replaced, folder)


def peer_params(args, folder):
    """The peer's parameters with the speed of this run and the frame of the vehicle."""
    path = pathlib.Path(args.params)
    text = (path if path.exists() else HERE / path).read_text()
    # What RPP, Graceful, MPPI and DWB call the speed.
    speed = r"\b(desired_linear_vel|v_linear_max|vx_max|max_vel_x|max_speed_xy): [0-9.]+"
    text = re.sub(speed, rf"\1: {args.speed}", text)
    text = re.sub(r"robot_base_frame: \S+", "robot_base_frame: steered_point", text)
    for changed in args.set:
        name, value = changed.split("=")
        text, count = re.subn(rf"\b{name}: .*", f"{name}: {value}", text)
        if count != 1:
            sys.exit(f"--set {changed}: {args.params} has {count} parameters {name}, not one")
    made = folder / "params.yaml"
    made.write_text(text)
    return made


def steered_point(node, args):
    """Publishes the level frame that a peer steers."""
    # Where Nav2 is, tf2 is too; Sidehill alone needs neither.
    from tf2_msgs.msg import TFMessage

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = node.node.create_publisher(TFMessage, "/tf_static", latched)
    ahead = TransformStamped()
    ahead.header.frame_id, ahead.child_frame_id = "base_footprint", "steered_point"
    ahead.transform.translation.x, ahead.transform.rotation.w = args.point_m, 1.0
    # The node keeps its publisher, and latches what it has sent.
    publisher.publish(TFMessage(transforms=[ahead]))


def used(pid):
    """CPU time of a process, s, and its memory, MB."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    ticks = int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK"), int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def moved(rows, ahead_m):
    """The rows of a point ahead of base_link; yaw is that of the body's forward axis from Y_g."""
    at = lambda row: {
        **row,
        "x_m": row["x_m"] - ahead_m * math.sin(row["yaw_rad"]),
        "y_m": row["y_m"] + ahead_m * math.cos(row["yaw_rad"]),
    }
    return [at(row) for row in rows]


def figures(rows, points):
    distances = sorted(abs(d) for d in cross_track_m(rows, points))
    rms = math.sqrt(sum(d * d for d in distances) / len(distances))
    of = {"rms": rms, "p95": distances[int(0.95 * len(distances))], "max": distances[-1]}
    return {f"{name}_cm": round(100 * value, 2) for name, value in of.items()}


def along(rows):
    """The way driven up to each row, m."""
    steps = (math.hypot(b["x_m"] - a["x_m"], b["y_m"] - a["y_m"]) for a, b in zip(rows, rows[1:]))
    return list(itertools.accumulate(steps, initial=0.0))


def before_end(rows, points):
    """The rows until the end of the path is near for the first time: what a controller that misses its goal does there
    does not count. A course may begin near its end, so most of it has to be driven."""
    most_m = 0.8 * sum(math.dist(a, b) for a, b in zip(points, points[1:]))
    near = lambda row: math.dist((row["x_m"], row["y_m"]), points[-1]) <= END_M
    ends = (i for i, (row, way_m) in enumerate(zip(rows, along(rows))) if way_m > most_m and near(row))
    return rows[: next(ends, len(rows))]


def total_variation(values):
    return sum(abs(b - a) for a, b in zip(values, values[1:]))


def main():
    args = arguments()
    folder = pathlib.Path(tempfile.mkdtemp(prefix="compare_"))
    domain = random.randint(1, 101)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    path, points = course(args, folder)
    goal_points = opened(points * args.laps) if args.course == "eight" else points
    truth = folder / "truth.csv"
    rover = adapted("vehicle_ros2.yaml", {
        r"^scenario: .*$": f"scenario: {path}",
        r"^# plant: .*$": f"plant: {args.plant}",
    }, folder)
    start = lambda *command: subprocess.Popen([str(part) for part in command], env=environment,
                                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    programs = [start(SIDEHILL, "vehicle", rover, "--truth", truth)]
    ros = Node(domain)
    try:
        if args.params:
            steered_point(ros, args)
            controller = start(args.server, "--ros-args", "--params-file", peer_params(args, folder))
        else:
            controller = start(SIDEHILL, "run", sidehill_config(args, folder))
        programs.append(controller)
        commands = ros.messages(Twist, "/cmd_vel", 100)
        driven = Driven(Vehicle(programs[0], truth), controller, ros)
        time.sleep(3.0)
        cpu_s, began = used(controller.pid)[0], time.monotonic()
        status, result = driven.ended(driven.send(goal_points), timeout_s=600)
        took_s = time.monotonic() - began
        cpu_s, memory_mb = used(controller.pid)[0] - cpu_s, used(controller.pid)[1]
        rows = [row for row in driven.vehicle.truth() if row["time_s"] > 0.0]
    finally:
        for program in reversed(programs):
            program.terminate()
            program.wait(timeout=10)
        ros.close()
    moving = next(row["time_s"] for row in rows if abs(row["traction_m_s"]) > 1e-3)
    rows = [row for row in rows if row["time_s"] > moving + START_S]
    rows = before_end(rows, goal_points)
    way_m = along(rows)[-1]
    print(json.dumps({
        "controller": pathlib.Path(args.params).stem if args.params else args.controller,
        "plant": args.plant, "course": args.course, "slope_deg": args.slope_deg if args.course == "eight" else None,
        "speed_m_s": args.speed,
        "status": status, "error_code": result.error_code,
        "base_link": figures(rows, points),
        "point": figures(moved(rows, args.point_m), points) if args.point_m else None,
        "steer_tv_m_s": round(total_variation([row["steer_m_s"] for row in rows]), 2),
        "traction_tv_m_s": round(total_variation([row["traction_m_s"] for row in rows]), 2),
        "mean_speed_m_s": round(way_m / (rows[-1]["time_s"] - rows[0]["time_s"]), 3),
        "cpu_percent": round(100 * cpu_s / took_s, 1), "memory_mb": round(memory_mb, 1),
        "commands": len(commands),
    }))


if __name__ == "__main__":
    main()
