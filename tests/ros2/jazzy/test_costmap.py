"""Obstacles: costmaps published by nodes of ROS 2 Jazzy, and where the vehicle stops for them."""

import array
import json
import math
import os
import re
import signal
import time

import pytest
from action_msgs.msg import GoalStatus
from nav2_msgs.msg import Costmap, CostmapUpdate
from nav_msgs.msg import OccupancyGrid
from nodes import START_YAW_RAD, ahead
from programs import REPOSITORY
from rclpy.qos import DurabilityPolicy, QoSProfile

# Base rectangle of the J8, m: half its width and half its length.
HALF_WIDTH_M, HALF_LENGTH_M = 0.6, 1.06
CELLS, RESOLUTION_M = 240, 0.1
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def on_path(along_m, aside_m=0.0):
    """A place by its distance along the straight path, and to the left of it."""
    cos, sin = math.cos(START_YAW_RAD), math.sin(START_YAW_RAD)
    return along_m * cos - aside_m * sin, along_m * sin + aside_m * cos


class Costmaps:
    """Publishes a costmap five times a second, with the discs (x, y, radius) that `obstacles` returns."""

    def __init__(self, ros):
        self.ros, self.obstacles, self.silent = ros, list, False
        self.publisher = ros.node.create_publisher(OccupancyGrid, "/local_costmap/costmap", LATCHED)
        self.timer = ros.node.create_timer(0.2, self.publish)

    def publish(self):
        if self.silent:
            return
        grid = OccupancyGrid()
        grid.header.frame_id = "odom"
        grid.header.stamp = self.ros.node.get_clock().now().to_msg()
        grid.info.resolution, grid.info.width, grid.info.height = RESOLUTION_M, CELLS, CELLS
        corner = -0.5 * CELLS * RESOLUTION_M
        grid.info.origin.position.x = grid.info.origin.position.y = corner
        grid.data = costs(self.obstacles(), 100, "b")
        self.publisher.publish(grid)


def costs(discs, lethal, kind):
    """Cells of a map around the origin, row by row."""
    cells = array.array(kind, bytes(CELLS * CELLS))
    centre = lambda index: (index + 0.5 - 0.5 * CELLS) * RESOLUTION_M
    for x, y, radius in discs:
        near = range(int(-radius / RESOLUTION_M) - 1, int(radius / RESOLUTION_M) + 2)
        column, row = (int(at / RESOLUTION_M + 0.5 * CELLS) for at in (x, y))
        for i, j in ((row + dy, column + dx) for dy in near for dx in near):
            if math.hypot(centre(j) - x, centre(i) - y) <= radius and 0 <= i < CELLS and 0 <= j < CELLS:
                cells[i * CELLS + j] = lethal
    return cells


def gap_m(row, disc):
    """Distance of a disc from the base rectangle at a true pose."""
    x, y, radius = disc
    x, y = x - row["x_m"], y - row["y_m"]
    # Heading of the body's forward axis, counter-clockwise from Y_g.
    cos, sin = math.cos(row["yaw_rad"]), math.sin(row["yaw_rad"])
    beside = max(abs(x * cos + y * sin) - HALF_WIDTH_M, 0.0)
    front = max(abs(-x * sin + y * cos) - HALF_LENGTH_M, 0.0)
    return math.hypot(beside, front) - radius


def with_costmap(*lines):
    """The run configuration with obstacles on."""
    rows = "".join(f"\n    {line}" for line in lines)
    topic = "local_costmap/costmap"
    return {r"^  use_sim_time: false.*$": f"  costmap:\n    topic: {topic}{rows}\n  use_sim_time: false"}


def blocked(d):
    """Waits until the vehicle stands for an obstacle."""
    d.ros.wait_for(lambda: abs(d.vehicle.now()["traction_m_s"]) > 0.2, "driving", timeout_s=20)
    d.ros.wait_for(d.vehicle.stands, "standing ahead of the obstacle", timeout_s=30)


def test_the_vehicle_waits_for_a_moving_obstacle_and_goes_on(driven, ros):
    costmaps = Costmaps(ros)
    d = driven(with_costmap("patience_s: 30"))
    began = time.monotonic()
    # It crosses from the left at 0.2 m/s, and is in the way from about 7 s to 15 s.
    disc = lambda: (*on_path(4.5, 2.2 - 0.2 * (time.monotonic() - began)), 0.2)
    costmaps.obstacles = lambda: [disc()]
    gaps, stood = [], []

    def ended():
        gaps.append(gap_m(d.vehicle.now(), disc()))
        stood.append(d.vehicle.stands())
        return result.done()

    goal = d.send(ahead(8.0))
    result = goal.get_result_async()
    d.ros.wait_for(ended, "the end", timeout_s=60)
    assert result.result().status == GoalStatus.STATUS_SUCCEEDED, result.result().result
    moving = stood.index(False)
    assert any(stood[moving:]), "it never waited"
    print(f"least gap {min(gaps):.2f} m")
    assert min(gaps) > 0.0


def test_a_report_shows_the_obstacle_at_which_the_vehicle_stopped(driven, ros, tmp_path):
    costmaps = Costmaps(ros)
    x, y, radius = disc = (*on_path(4.0), 0.2)
    costmaps.obstacles = lambda: [disc]
    recording, report = tmp_path / "drive.mcap", tmp_path / "report.html"
    d = driven(with_costmap("patience_s: 2"), {}, "--record", recording, "--report", report)
    status, result = d.ended(d.sent_off(ahead(8.0)), timeout_s=60)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 104)
    d.controller.signal(signal.SIGINT)
    d.controller.process.wait(timeout=20)
    drive = json.loads(re.search(r'<script id="drive"[^>]*>(.*?)</script>', report.read_text(), re.DOTALL)[1])
    _, cell, *rows = drive["obstacles"][-1]
    assert cell == RESOLUTION_M
    rows = [rows[i : i + 4] for i in range(0, len(rows), 4)]
    assert 3 <= len(rows) <= 5
    assert all(abs(from_x - x) < radius + cell and abs(from_y - y) < radius + cell for from_x, from_y, _, _ in rows)
    area = sum(math.hypot(to_x - from_x, to_y - from_y) * cell for from_x, from_y, to_x, to_y in rows)
    assert abs(area - math.pi * radius**2) < 0.5 * math.pi * radius**2


def test_a_stale_costmap_stops_a_fresh_one_goes_on_and_a_silent_one_aborts(driven, ros):
    costmaps = Costmaps(ros)
    d = driven(with_costmap("patience_s: 5"))
    goal = d.sent_off(ahead())
    costmaps.silent = True
    blocked(d)
    costmaps.silent = False
    d.ros.wait_for(lambda: d.vehicle.now()["traction_m_s"] > 0.2, "on again")
    costmaps.silent = True
    status, result = d.ended(goal, timeout_s=20)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 107)
    assert "costmap is" in result.error_msg and "s old" in result.error_msg
    d.stands()


@pytest.mark.parametrize("wide", [False, True])
def test_the_footprint_decides_what_is_in_the_way(driven, ros, wide):
    costmaps = Costmaps(ros)
    # 0.9 m beside the path, of which the disc takes 0.1 m and the padding 0.1 m.
    costmaps.obstacles = lambda: [(*on_path(3.0, 0.9), 0.1)]
    corners = "footprint: [[1.1, 0.9], [1.1, -0.9], [-1.1, -0.9], [-1.1, 0.9]]"
    d = driven(with_costmap("patience_s: 2", *([corners] if wide else [])))
    status, result = d.ended(d.send(ahead(5.0)), timeout_s=60)
    if wide:
        assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 104)
        assert "an obstacle is" in result.error_msg
    else:
        assert status == GoalStatus.STATUS_SUCCEEDED, result


@pytest.mark.parametrize("right_m", [0.75, 0.0])
def test_an_obstacle_that_intrudes_is_passed_within_the_corridor(driven, ros, right_m):
    costmaps = Costmaps(ros)
    disc = (*on_path(5.0, -right_m), 0.15)
    costmaps.obstacles = lambda: [disc]
    d = driven(with_costmap("patience_s: 2", "corridor_m: 0.6"))
    gaps, asides, stood = [], [], []
    cos, sin = math.cos(START_YAW_RAD), math.sin(START_YAW_RAD)

    def ended():
        row = d.vehicle.now()
        gaps.append(gap_m(row, disc))
        asides.append(row["y_m"] * cos - row["x_m"] * sin)
        stood.append(d.vehicle.stands())
        return result.done()

    goal = d.sent_off(ahead(10.0))
    result = goal.get_result_async()
    d.ros.wait_for(ended, "the end", timeout_s=90)
    answer = result.result()
    print(f"least gap {min(gaps):.2f} m, {max(asides):.2f} m aside")
    assert min(gaps) > 0.1
    if right_m:
        assert answer.status == GoalStatus.STATUS_SUCCEEDED, answer.result
        assert 0.15 < max(asides) < 0.6 and min(asides) > -0.1
        assert not any(stood[: gaps.index(min(gaps))]), "it waited"
    else:
        # In the middle of the path it leaves no room.
        assert (answer.status, answer.result.error_code) == (GoalStatus.STATUS_ABORTED, 104)
        assert max(map(abs, asides)) < 0.1


def test_downhill_the_vehicle_stops_in_time(driven, ros, tmp_path):
    folder = os.path.join(REPOSITORY, "config")
    with open(os.path.join(folder, "scenarios", "figure_eight_15deg.yaml")) as file:
        scenario = file.read().replace("../", f"{folder}/")
    # Uphill is behind the vehicle.
    scenario = scenario.replace("uphill_heading_deg: 0}", f"uphill_heading_deg: {90 + math.degrees(START_YAW_RAD):.3f}}}")
    (tmp_path / "downhill.yaml").write_text(scenario)
    costmaps = Costmaps(ros)
    rover = {r"^scenario: .*$": f"scenario: {tmp_path}/downhill.yaml", r"^# plant: .*$": "plant: contact"}
    d = driven(with_costmap("patience_s: 2"), rover)
    disc = (*on_path(5.0), 0.15)
    costmaps.obstacles = lambda: [disc]
    status, result = d.ended(d.sent_off(ahead(8.0)), timeout_s=60)
    assert (status, result.error_code) == (GoalStatus.STATUS_ABORTED, 104)
    gap = gap_m(d.vehicle.now(), disc)
    print(f"stands {gap:.2f} m ahead of it")
    assert 0.2 < gap < 0.8


def test_a_costmap_of_nav2_is_read_with_its_updates(driven, ros):
    stamp = lambda: ros.node.get_clock().now().to_msg()
    full = ros.node.create_publisher(Costmap, "/local_costmap/costmap", LATCHED)
    updates = ros.node.create_publisher(CostmapUpdate, "/local_costmap/costmap_updates", 10)
    map_of = Costmap()
    map_of.header.frame_id = "odom"
    map_of.header.stamp = stamp()
    info = map_of.metadata
    info.resolution, info.size_x, info.size_y = RESOLUTION_M, CELLS, CELLS
    info.origin.position.x = info.origin.position.y = -0.5 * CELLS * RESOLUTION_M
    map_of.data = costs([], 254, "B")
    full.publish(map_of)
    x, y = (int(at / RESOLUTION_M + 0.5 * CELLS) for at in on_path(4.0))
    cost = [0]

    def update():
        message = CostmapUpdate(x=x - 1, y=y - 1, size_x=3, size_y=3)
        message.header.frame_id, message.header.stamp = "odom", stamp()
        message.data = array.array("b", [cost[0]] * 9)
        updates.publish(message)

    ros.node.create_timer(0.2, update)
    d = driven(with_costmap("kind: costmap", "patience_s: 20"))
    cost[0] = -2  # 254 in the int8 of the message
    goal = d.sent_off(ahead(6.0))
    blocked(d)
    cost[0] = 0
    status, result = d.ended(goal, timeout_s=60)
    assert status == GoalStatus.STATUS_SUCCEEDED, result
