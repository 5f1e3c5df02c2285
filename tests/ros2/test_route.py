"""`sidehill route live`: the path of a drive that a peer publishes."""

import csv
import math
import re
import time
import xml.etree.ElementTree

import wire
from peer import now
from programs import PATIENCE_S, repeating, wait_for

# Of one step of the drive, m, and so many are published each second.
STEP_M, RATE_HZ = 0.06, 100
# Figures are printed to half of this, m.
MILLIMETRE = 0.001


def drive(count=400):
    """Points of a slalom that climbs, with noise of 1 cm to both sides in turn."""
    points = []
    for index in range(count):
        x = STEP_M * index
        y = 0.5 * math.sin(2 * math.pi * x / 12) + (0.01 if index % 2 else -0.01)
        points.append((x, y, 0.1 * x))
    return points


def odometry(point, frame="odom"):
    x, y, z = point
    place = wire.Pose(position=wire.Point(x=x, y=y, z=z), orientation=wire.Quaternion(w=1.0))
    header = wire.Header(stamp=now(), frame_id=frame)
    return wire.Odometry(header=header, pose=wire.PoseWithCovariance(pose=place))


def publish(program, writer, messages):
    """Publishes the first message until it is recorded, then each in turn."""
    first, *others = messages
    with repeating(lambda: writer.write(first)):
        wait_for(lambda: "recording" in program.output(), "recording")
    for message in others:
        writer.write(message)
        time.sleep(1 / RATE_HZ)
    time.sleep(0.3)


def from_path(point, path):
    """The horizontal distance of a point from a polyline."""

    def from_segment(a, b):
        dx, dy = b[0] - a[0], b[1] - a[1]
        square = dx * dx + dy * dy
        share = ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / square if square else 0.0
        share = min(max(share, 0.0), 1.0)
        return math.hypot(point[0] - a[0] - share * dx, point[1] - a[1] - share * dy)

    return min(map(from_segment, path, path[1:]))


def check(program, published, path):
    """The written path is as far from the published drive as the program says, and no farther."""
    said = re.search(r"(\d+) points over ([\d.]+) m, from (\d+) positions.* path ([\d.]+) m", program.output())
    points, length_m, positions, deviation_m = (float(figure) for figure in said.groups())
    assert points == len(path) < 0.3 * len(published)
    assert positions >= 0.95 * len(published)
    largest_m = max(from_path(point, path) for point in published)
    assert largest_m <= deviation_m + MILLIMETRE
    # The noise is part of it, and nothing else is cut away: it begins and ends within it.
    assert 0.01 - MILLIMETRE <= deviation_m < 0.05
    for end in (0, -1):
        assert math.dist(path[end], published[end]) <= deviation_m + MILLIMETRE
    assert all(abs(z - 0.1 * x) < 0.02 for x, _, z in path)
    assert abs(length_m - sum(math.dist(a[:2], b[:2]) for a, b in zip(path, path[1:]))) < 0.1


def test_a_published_drive_becomes_a_path_at_ctrl_c(start, peer, tmp_path):
    out = tmp_path / "route.csv"
    arguments = ["route", "live", "--odometry", "odom", "--out", out]
    remapped = ["--ros-args", "-r", "odom:=/odometry/filtered"]
    program = start(*arguments, *remapped)
    writer = peer.writer("/odometry/filtered", wire.Odometry)
    published = drive()
    messages = [odometry(point) for point in published]
    # Another frame is no part of the drive.
    messages.insert(250, odometry((900.0, 0.0, 0.0), "map"))
    publish(program, writer, messages)
    assert not out.exists()
    assert program.end() == 0, program.output()
    assert 'messages left out: 1; the last because its frame is "map"' in program.output()
    with open(out) as file:
        path = [tuple(map(float, row.values())) for row in csv.DictReader(file)]
    check(program, published, path)
    assert [file.name for file in tmp_path.iterdir() if file.suffix != ".log"] == ["route.csv"]

    # The file stays as it is, and the program says so before it drives.
    before = out.read_bytes()
    second = start(*arguments, *remapped)
    assert second.process.wait(PATIENCE_S) == 2
    assert "exists already" in second.output() and out.read_bytes() == before


def test_published_fixes_become_gpx_after_a_time(start, peer, tmp_path):
    out = tmp_path / "route.gpx"
    program = start("route", "live", "--fix", "/gps/fix", "--seconds", "8", "--out", out)
    writer = peer.writer("/gps/fix", wire.NavSatFix)
    latitude_deg, longitude_deg, height_m = 36.717, -4.489, 60.0
    # Metres of a degree on WGS 84, by its radii of curvature.
    sine = math.sin(math.radians(latitude_deg))
    whole = 1 - 6.69437999014e-3 * sine * sine
    east_m = math.radians(6378137.0 / math.sqrt(whole)) * math.cos(math.radians(latitude_deg))
    north_m = math.radians(6378137.0 * (1 - 6.69437999014e-3) / whole**1.5)

    published = drive()
    messages = [
        wire.NavSatFix(
            latitude=latitude_deg + y / north_m,
            longitude=longitude_deg + x / east_m,
            altitude=height_m + z,
        )
        for x, y, z in published
    ]
    publish(program, writer, messages)
    assert program.process.wait(PATIENCE_S) == 0, program.output()
    root = xml.etree.ElementTree.parse(out).getroot()
    space = {"gpx": "http://www.topografix.com/GPX/1/1"}
    path = [
        (
            (float(point.get("lon")) - longitude_deg) * east_m,
            (float(point.get("lat")) - latitude_deg) * north_m,
            float(point.find("gpx:ele", space).text) - height_m,
        )
        for point in root.iterfind(".//gpx:trkpt", space)
    ]
    check(program, published, path)


def test_a_topic_without_positions_is_named(start, peer, tmp_path):
    peer_writer = peer.writer("/odometry/filtered", wire.Odometry)
    receiver = peer.writer("/gps/fix", wire.NavSatFix)
    no_fix = wire.NavSatFix(status=wire.NavSatStatus(status=-1))
    out = tmp_path / "route.csv"
    silent = start("route", "live", "--odometry", "/odom", "--out", out)
    blind = start("route", "live", "--fix", "/gps/fix", "--out", out)
    quiet = start("route", "live", "--odometry", "/odometry/filtered", "--out", out)
    stopped = start("route", "live", "--odometry", "/odometry/filtered", "--out", out)
    with repeating(lambda: receiver.write(no_fix)):
        wait_for(lambda: peer_writer.get_matched_subscriptions(), "subscription")
        assert stopped.end() == 2
        for program in (silent, blind, quiet):
            assert program.process.wait(2 * PATIENCE_S) == 2
    # How much it knows of the graph depends on when it was stopped.
    assert "no position within" in stopped.output() and "from /odometry/filtered" in stopped.output()
    assert "no position within 10 s" in quiet.output() and "no message yet" in quiet.output()
    assert "no position within 10 s from /odom (nav_msgs/msg/Odometry): no publisher" in silent.output()
    assert "this type is on /odometry/filtered" in silent.output()
    assert "a fix without a position (status -1)" in blind.output()
    assert not out.exists()


def test_what_cannot_become_a_path_is_refused_before_the_drive(start, tmp_path):
    for words, reason in [
        (["--odometry", "odom", "--out", tmp_path / "a.gpx"], "write a .csv"),
        (["--odometry", "odom", "--out", tmp_path / "a.txt"], "must end with .gpx or .csv"),
        (["--odometry", "odom", "--out", tmp_path / "no" / "a.csv"], "there is no folder"),
        (["--odometry", "odom", "--seconds", "0", "--out", tmp_path / "a.csv"], "--seconds"),
        (["--odometry", "a//b", "--out", tmp_path / "a.csv"], "a//b"),
        (["--out", tmp_path / "a.csv"], "--odometry TOPIC or --fix TOPIC"),
    ]:
        program = start("route", "live", *words)
        assert program.process.wait(PATIENCE_S) == 2, words
        assert reason in program.output(), program.output()
