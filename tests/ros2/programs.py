"""`sidehill` as a process, the virtual vehicle with its truth, and paths to drive; nothing of ROS."""

import contextlib
import math
import os
import re
import signal
import subprocess
import threading
import time

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SIDEHILL = os.environ.get("SIDEHILL", os.path.join(REPOSITORY, "target", "release", "sidehill"))

# What an answer may take on a machine that others use too: a limit for liveness, not a figure.
PATIENCE_S = 10.0


def wait_for(condition, what, timeout_s=PATIENCE_S, step_s=0.005):
    """Returns the first true value of `condition`; fails with `what` where none comes in time."""
    until = time.monotonic() + timeout_s
    while True:
        value = condition()
        if value:
            return value
        assert time.monotonic() < until, f"{what}: not within {timeout_s} s"
        time.sleep(step_s)


@contextlib.contextmanager
def repeating(action, period_s=0.05):
    """Calls `action` again and again, in a thread of its own, while the block runs."""
    ended = threading.Event()

    def repeat():
        while not ended.is_set():
            action()
            ended.wait(period_s)

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


class Program:
    """`sidehill` with arguments, in a domain; ends with the test."""

    def __init__(self, arguments, domain, log, **environment):
        self.log = log
        self.file = open(log, "w")
        self.process = subprocess.Popen(
            [SIDEHILL, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=self.file,
            stderr=subprocess.STDOUT,
            env={
                **os.environ,
                "ROS_DOMAIN_ID": str(domain),
                "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
                **environment,
            },
        )

    def running(self):
        return self.process.poll() is None

    def output(self):
        self.file.flush()
        with open(self.log) as file:
            return file.read()

    def signal(self, which):
        self.process.send_signal(which)

    def end(self):
        """Asks it to end and returns its exit status."""
        if self.running():
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"it did not end on SIGINT: {self.output()}") from None

    def kill(self):
        self.process.kill()
        self.process.wait()


def adapted(name, replaced, tmp_path):
    """A configuration of the repository with some of its lines replaced: {pattern: text}."""
    folder = os.path.join(REPOSITORY, "config", "bridge")
    with open(os.path.join(folder, name)) as file:
        text = file.read()
    text = re.sub(r"\.\./", os.path.join(REPOSITORY, "config") + "/", text)
    for pattern, replacement in replaced.items():
        text, count = re.subn(pattern, lambda _: replacement, text, flags=re.MULTILINE)
        assert count == 1, f"{pattern} is {count} times in {name}"
    path = tmp_path / name
    path.write_text(text)
    return path


class Vehicle:
    """A virtual vehicle on ROS 2 and its truth."""

    def __init__(self, program, truth):
        self.program, self.truth_file = program, truth
        self.names, self.rows, self.bytes_read = None, [], 0

    def _read(self):
        """Reads the rows that were written since the last call, and returns all so far."""
        if os.path.exists(self.truth_file):
            with open(self.truth_file) as file:
                file.seek(self.bytes_read)
                text = file.read()
            whole = text[: text.rfind("\n") + 1]
            self.bytes_read += len(whole)
            number = lambda text: float(text) if re.match(r"^-?[0-9.]", text) else text
            for line in whole.splitlines():
                if self.names is None:
                    self.names = line.split(",")
                else:
                    self.rows.append(dict(zip(self.names, map(number, line.split(",")))))
        return self.rows

    def truth(self, until_unix_s=0.0):
        """Rows of the truth as dictionaries, numbers as numbers; there are some, the last no earlier than asked."""
        wait_for(lambda: self._read() and self.rows[-1]["unix_s"] >= until_unix_s, "the vehicle's truth")
        return list(self.rows)

    def now(self):
        if not self._read():
            self.truth()
        return self.rows[-1]

    def stands(self):
        row = self.now()
        return row["traction_m_s"] == 0.0 and row["steer_m_s"] == 0.0


def figure_eight(count=1000):
    """Points of the figure of eight of design and scenario: 4.8 m by 7.8 m."""
    angles = (2 * math.pi * index / (count - 1) for index in range(count))
    return [(2.4 * math.sin(2 * a), 3.9 * math.sin(a)) for a in angles]


def straight(length_m, start=(0.0, 0.0), yaw_rad=math.pi / 2, step_m=0.05):
    """Points of a straight line."""
    count = round(length_m / step_m) + 1
    along = (index * step_m for index in range(count))
    return [(start[0] + s * math.cos(yaw_rad), start[1] + s * math.sin(yaw_rad)) for s in along]


def cross_track_m(rows, points):
    """Distances of places to a path, each to the stretch that follows the one before."""
    distances, near = [], 0
    for row in rows:
        place = (row["x_m"], row["y_m"])
        stretch = range(near, min(near + 60, len(points) - 1))
        best, near = min((_to_segment(place, points[i], points[i + 1]), i) for i in stretch)
        distances.append(best)
    return distances


def _to_segment(p, a, b):
    (ax, ay), (bx, by) = a, b
    dx, dy = bx - ax, by - ay
    along = ((p[0] - ax) * dx + (p[1] - ay) * dy) / (dx * dx + dy * dy)
    along = min(1.0, max(0.0, along))
    return math.dist(p, (ax + along * dx, ay + along * dy))
