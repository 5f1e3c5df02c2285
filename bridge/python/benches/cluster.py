"""Campaigns on a Ray cluster of this machine: equality under killed tasks, efficiency, and what limits many workers.

    python bridge/python/benches/cluster.py [equal] [efficiency] [limits] --runs 20000

equal: two nodes of one worker each (`ray.cluster_utils.Cluster`); a share of the tasks kills its process, before the work
    or in the middle of it. The file must be that of one machine without Ray, byte for byte; exit status 1 where not.
efficiency: time of the same campaign with one and with two workers, and with plain threads. Needs two idle cores.
limits: what the driver spends on a task and on a row, and what putting the file in order takes, by number of rows.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ray
from ray.cluster_utils import Cluster
from sidehill import _sidehill, distributed

CONFIG = Path(__file__).resolve().parents[3] / "config"


def campaign(runs: int, length_m: float) -> dict[str, Any]:
    """Returns a campaign of straight lines on random slopes with one controller."""
    return {
        "name": "cluster",
        "seed": 11,
        "runs": runs,
        "controllers": ["icrik-mpc"],
        "scenario": str(CONFIG / "scenarios/slalom.yaml"),
        "with": {"course": {"shape": "straight", "length_m": length_m, "speed_m_s": 0.5}, "plant": "icrik"},
        "draws": [
            {"key": "terrain.slope_deg", "uniform": [0, 12]},
            {"key": "terrain.uphill_heading_deg", "uniform": [-180, 180]},
            {"key": "model_error.lambda_1", "uniform": [0.7, 1.3]},
        ],
    }


def killed(share: float) -> Callable[[str, int, int], bytes]:
    """Returns the work of a task, whose process dies in a share of them."""

    def work(bundle: str, start: int, stop: int) -> bytes:
        if random.random() < share:
            if random.random() < 0.5:
                distributed._run(bundle, start, (start + stop + 1) // 2)
            os.kill(os.getpid(), signal.SIGKILL)
        return distributed._run(bundle, start, stop)

    return work


class Nodes:
    """A local cluster of so many nodes of one worker each, connected to."""

    def __init__(self, nodes: int) -> None:
        self.nodes = nodes

    def __enter__(self) -> None:
        self.cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        for _ in range(self.nodes - 1):
            self.cluster.add_node(num_cpus=1)
        self.cluster.wait_for_nodes()
        ray.init(address=self.cluster.address, log_to_driver=False)
        # What starts with the first task of each worker is no part of the campaign.
        warm = ray.remote(num_cpus=1)(lambda: (time.sleep(1), __import__("sidehill"))[0])
        ray.get([warm.remote() for _ in range(2 * self.nodes)])

    def __exit__(self, *_: object) -> None:
        ray.shutdown()
        self.cluster.shutdown()


def load() -> str:
    return f"load {os.getloadavg()[0]:.1f}"


def equal(keys: dict[str, Any], task_runs: int, share: float, folder: Path) -> bool:
    begin = time.perf_counter()
    whole = _sidehill.Campaign.read(keys).csv(0, keys["runs"])
    alone_s = time.perf_counter() - begin
    with Nodes(2):
        begin = time.perf_counter()
        out = folder / "equal.csv"
        report = distributed.run(keys, out, task_runs=task_runs, work=killed(share))
        took_s = time.perf_counter() - begin
    same = out.read_bytes() == whole
    print(
        f"equal: {report.runs} runs in {report.tasks} tasks, {report.lost} of {report.tasks + report.lost} lost, "
        f"{took_s:.1f} s on two nodes (two threads without Ray {alone_s:.1f} s); {len(whole)} bytes, "
        f"{'the same byte for byte' if same else 'DIFFERENT'}; {load()}"
    )
    return same


def efficiency(keys: dict[str, Any], task_runs: int, folder: Path) -> None:
    times = {}
    for workers in (1, 2):
        with Nodes(workers):
            begin = time.perf_counter()
            distributed.run(keys, folder / f"efficiency_{workers}.csv", task_runs=task_runs)
            times[workers] = time.perf_counter() - begin
        print(f"efficiency: {workers} worker(s) {times[workers]:.1f} s; {load()}")
    threads = {}
    read = _sidehill.Campaign.read(keys)
    for count in (1, 2):
        begin = time.perf_counter()
        read.csv(0, keys["runs"], threads=count)
        threads[count] = time.perf_counter() - begin
    print(
        f"efficiency: {times[1] / (2 * times[2]):.3f} at two workers; plain threads {threads[1]:.1f} s and "
        f"{threads[2]:.1f} s, {threads[1] / (2 * threads[2]):.3f}; one worker costs {times[1] / threads[1]:.3f} of a thread"
    )


MERGE = """
import resource, sys, time
from sidehill import _sidehill
campaign = _sidehill.Campaign.read({keys!r})
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
begin = time.perf_counter()
results = _sidehill.Results(sys.argv[1], campaign)
opened = time.perf_counter() - begin
results.finish()
print(opened, time.perf_counter() - begin - opened, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def limits(keys: dict[str, Any], folder: Path) -> None:
    with Nodes(2):
        empty = ray.remote(num_cpus=1, max_retries=0)(lambda bundle, start, stop: b"")
        bundle = ray.put(_sidehill.Campaign.read(keys).bundle())
        count = 2000
        begin = time.perf_counter()
        pending = [empty.remote(bundle, 0, 1) for _ in range(count)]
        while pending:
            done, pending = ray.wait(pending, num_returns=1)
            ray.get(done)
        task_s = (time.perf_counter() - begin) / count
    print(f"limits: an empty task costs {1e3 * task_s:.2f} ms from end to end with two workers; {load()}")
    read = _sidehill.Campaign.read(keys)
    header, *rows = read.csv(0, 250).splitlines(keepends=True)
    chunk = header + b"".join(rows)
    results = _sidehill.Results(folder / "append.csv", read)
    begin = time.perf_counter()
    for _ in range(40):
        results.append(chunk)
    append_s = (time.perf_counter() - begin) / 40
    print(f"limits: a task's 250 rows ({len(chunk)} bytes) are checked, written and synced in {1e3 * append_s:.2f} ms")
    del results
    for count in (20_000, 1_000_000):
        path = folder / f"merge_{count}.csv"
        with path.open("wb") as file:
            file.write(header)
            order = list(range(count))
            random.Random(1).shuffle(order)
            for index in order:
                fields = rows[index % len(rows)].split(b",", 2)
                file.write(b",".join([fields[0], str(index).encode(), fields[2]]))
        command = [sys.executable, "-c", MERGE.format(keys=keys), path]
        opened, finished, memory = map(float, subprocess.run(command, check=True, capture_output=True).stdout.split())
        print(
            f"limits: {count} rows of {path.stat().st_size / 1e6:.0f} MB: opened in {opened:.2f} s, put in order and "
            f"written in {finished:.2f} s, {memory:.0f} MiB of memory at most; {load()}"
        )
        path.unlink()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", nargs="*", default=["equal", "efficiency", "limits"])
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--length-m", type=float, default=1.0)
    parser.add_argument("--task-runs", type=int, default=250)
    parser.add_argument("--kill", type=float, default=0.2)
    given = parser.parse_args()
    keys = campaign(given.runs, given.length_m)
    same = True
    with tempfile.TemporaryDirectory() as name:
        if "equal" in given.what:
            same = equal(keys, given.task_runs, given.kill, Path(name))
        if "efficiency" in given.what:
            efficiency(keys, given.task_runs, Path(name))
        if "limits" in given.what:
            limits(keys, Path(name))
    print(f"most memory of the driver: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    sys.exit(not same)
