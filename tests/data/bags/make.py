#!/usr/bin/env python3
"""Writes bags from a CSV log with the PyPI package `rosbags`: `make.py LOG.csv FOLDER`.

FOLDER gets the log in each storage and compression: `mcap/` (chunks by zstd), `plain/` (MCAP without), `sqlite3/`,
`by_message/` and `by_file/` (SQLite by zstd). The columns are those of a log in the frame of the paper. `topics.yaml`
beside this file is the map that reads them.
"""

import csv
import math
import pathlib
import shutil
import sys

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

WHEEL_RADIUS_M = 0.165
# Stamps of a recording are seconds since 1970.
START_NS = 1_690_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types


def rotation(roll, pitch, yaw):
    """Returns world_from_base_link as x, y, z, w: Rz(yaw) Ry(roll) Rx(pitch) of a body with X right and Y forward,
    times the turn by 90 degrees about z that makes x forward and y left of it."""

    def about(axis, angle):
        return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * np.eye(3)[axis])])

    def times(p, q):
        (a, *u), (b, *v) = p, q
        u, v = np.array(u), np.array(v)
        return np.array([a * b - u @ v, *(a * v + b * u + np.cross(u, v))])

    q = times(times(about(2, yaw), about(1, roll)), about(0, pitch))
    w, x, y, z = times(q, about(2, math.pi / 2))
    return T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def header(ns, frame):
    """Returns a header."""
    stamp = T["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    return T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def vector(x=0.0, y=0.0, z=0.0):
    """Returns a vector."""
    return T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def messages(rows):
    """Yields topic, type, receive time and message of each sample."""
    nine = np.zeros(9)
    for row in rows:
        ns = START_NS + round(float(row["time_s"]) * 1e9)
        value = lambda name: float(row[name])
        left, right = value("v_left_m_s") / WHEEL_RADIUS_M, value("v_right_m_s") / WHEEL_RADIUS_M
        yield "/joint_states", ns, T["sensor_msgs/msg/JointState"](
            header=header(ns, ""),
            name=["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"],
            position=np.zeros(4),
            velocity=np.array([left, right, left, right]),
            effort=np.zeros(0),
        )
        orientation = rotation(value("roll_rad"), value("pitch_rad"), float(row["yaw_rad"] or 0.0))
        yield "/imu/data", ns, T["sensor_msgs/msg/Imu"](
            header=header(ns, "base_link"),
            orientation=orientation,
            orientation_covariance=nine,
            angular_velocity=vector(),
            angular_velocity_covariance=nine,
            linear_acceleration=vector(),
            linear_acceleration_covariance=nine,
        )
        if row["x_m"]:
            point = T["geometry_msgs/msg/Point"](x=value("x_m"), y=value("y_m"), z=value("z_m"))
            pose = T["geometry_msgs/msg/Pose"](position=point, orientation=orientation)
            covariance = np.zeros(36)
            yield "/lidar/odometry", ns, T["nav_msgs/msg/Odometry"](
                header=header(ns, "map"),
                child_frame_id="base_link",
                pose=T["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
                twist=T["geometry_msgs/msg/TwistWithCovariance"](
                    twist=T["geometry_msgs/msg/Twist"](linear=vector(), angular=vector()), covariance=covariance
                ),
            )


def write(folder, storage, rows, compression=None, version=9):
    """Writes a bag, with the metadata of kilted (9) or humble (8 is the oldest that the package writes)."""
    shutil.rmtree(folder, ignore_errors=True)
    writer = Writer(folder, version=version, storage_plugin=storage)
    if compression:
        writer.set_compression(*compression)
    with writer:
        connections = {}
        for topic, ns, message in messages(rows):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORE)
            data = STORE.serialize_cdr(message, message.__msgtype__)
            # The recorder gets messages a little later than they are stamped.
            writer.write(connections[topic], ns + 2_000_000, data)
        # A topic that nothing here reads, and one that stays empty.
        text = writer.add_connection("/rosout_text", "std_msgs/msg/String", typestore=STORE)
        writer.write(text, START_NS, STORE.serialize_cdr(T["std_msgs/msg/String"](data="hello"), "std_msgs/msg/String"))
        writer.add_connection("/gps/fix", "sensor_msgs/msg/NavSatFix", typestore=STORE)


def main(log, folder):
    """Writes all bags."""
    with open(log, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    by_chunk = (CompressionMode.STORAGE, CompressionFormat.ZSTD)
    write(folder / "mcap", StoragePlugin.MCAP, rows, by_chunk)
    write(folder / "sqlite3", StoragePlugin.SQLITE3, rows, version=8)
    write(folder / "by_message", StoragePlugin.SQLITE3, rows, (CompressionMode.MESSAGE, CompressionFormat.ZSTD), version=8)
    write(folder / "by_file", StoragePlugin.SQLITE3, rows, (CompressionMode.FILE, CompressionFormat.ZSTD), version=8)
    write(folder / "plain", StoragePlugin.MCAP, rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
