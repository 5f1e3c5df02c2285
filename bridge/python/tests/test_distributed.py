"""Campaigns on Ray: workers of two nodes, tasks killed, the same file."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sidehill
from conftest import repository, untyped
from sidehill import _sidehill, distributed

ray = pytest.importorskip("ray")
# Ray warns of itself; what matters here are results.
pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture
def campaign(tmp_path: Path) -> Any:
    """A campaign of short runs, two to a task's second."""
    keys = {
        "name": "short",
        "seed": 7,
        "runs": 60,
        "controllers": ["icrik-mpc", "pure-pursuit"],
        "scenario": str(repository("config/scenarios/slalom.yaml")),
        "conditions": "realistic",
        "with": {"course": {"shape": "straight", "length_m": 1.5, "speed_m_s": 0.5}},
        "draws": [
            {"key": "terrain.slope_deg", "uniform": [0, 10]},
            {"key": "vehicle", "one_of": [str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml")]},
        ],
    }
    j8 = sidehill.Vehicle.load(repository("config/vehicles/j8.yaml"))
    j8.save(tmp_path / "a.yaml")
    sidehill.Vehicle.from_dict(j8.to_dict() | {"lambda_1_s_per_rad": 2.0}).save(tmp_path / "b.yaml")
    path = tmp_path / "campaign.yaml"
    path.write_text(json.dumps(keys))
    return path


@pytest.fixture
def whole(campaign: Any) -> Any:
    """The file of one machine."""
    return _sidehill.Campaign.read(campaign).csv(0, 60)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two nodes of one CPU each."""
    from ray.cluster_utils import Cluster

    # Workers cannot import this file.
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    ray.init(address=cluster.address, log_to_driver=False)
    yield cluster
    ray.shutdown()
    untyped(cluster).shutdown()


KILLED = {4: False, 18: True, 20: False, 38: True}
"""Tasks by the first of their runs whose process dies at the first attempt: before the work, or after half of it."""


def killed_once(memory: Path) -> Any:
    """The work, whose process dies at the first attempt of the tasks of KILLED; `memory` keeps which died."""

    def work(bundle: Any, start: Any, stop: Any) -> Any:
        if start in KILLED and not (memory / str(start)).exists():
            (memory / str(start)).touch()
            if KILLED[start]:
                distributed._run(bundle, start, (start + stop) // 2)
            os.kill(os.getpid(), signal.SIGKILL)
        return distributed._run(bundle, start, stop)

    return work


def test_a_bundle_is_the_campaign_without_its_files(campaign: Any, whole: Any, tmp_path: Path) -> None:
    bundle = _sidehill.Campaign.read(campaign).bundle()
    for name in ("campaign.yaml", "a.yaml", "b.yaml"):
        (tmp_path / name).unlink()
    other = _sidehill.Campaign.from_bundle(bundle)
    assert other.csv(0, 60) == whole
    assert len({line.split(b",")[5] for line in whole.splitlines()[1:]}) == 2


def test_tasks_killed_and_a_node_lost_leave_the_file_of_one_machine(
    cluster: Any, campaign: Any, whole: Any, tmp_path: Path
) -> None:
    out = tmp_path / "out.csv"
    memory = tmp_path / "killed"
    memory.mkdir()
    report = distributed.run(campaign, out, runs=40, task_runs=2, work=killed_once(memory))
    assert out.read_bytes() == b"".join(whole.splitlines(keepends=True)[: 1 + 40 * 2])
    assert report.runs == 40 and report.tasks == 20 and report.lost >= len(KILLED)

    # More runs, and the second node goes while they are made.
    node = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    gone: list[Any] = []

    def work(bundle: Any, start: Any, stop: Any) -> Any:
        return distributed._run(bundle, start, stop)

    original = _sidehill.Results.append

    class Removing:
        def __init__(self, *arguments: Any) -> None:
            self.results = _sidehill.Results(*arguments)

        def __getattr__(self, name: Any) -> Any:
            return getattr(self.results, name)

        def append(self, csv: Any) -> None:
            original(self.results, csv)
            if not gone:
                gone.append(cluster.remove_node(node, allow_graceful=False))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sidehill.distributed._sidehill", type("Core", (), {
            "Campaign": _sidehill.Campaign, "Results": Removing}))  # fmt: skip
        report = distributed.run(campaign, out, task_runs=2, work=work)
    assert gone and report.runs == 20
    assert out.read_bytes() == whole
    # Nothing is left to do.
    assert distributed.run(campaign, out).tasks == 0
    assert out.read_bytes() == whole


def test_a_file_with_gaps_is_filled(cluster: Any, campaign: Any, whole: Any, tmp_path: Path) -> None:
    lines = whole.splitlines(keepends=True)
    out = tmp_path / "out.csv"
    # One controller of run 3 is missing, runs 10 to 11 and 50 on; the last line is torn.
    kept = [line for index, line in enumerate(lines) if index not in (8, 21, 22, 23, 24) and index < 101]
    out.write_bytes(b"".join(kept) + lines[101][:20])
    report = distributed.run(campaign, out, task_runs=250)
    assert (report.runs, report.tasks, report.lost) == (1 + 2 + 10, 3, 0)
    assert out.read_bytes() == whole


def test_a_task_that_fails_or_is_always_lost_ends_the_campaign(
    cluster: Any, campaign: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(bundle: Any, start: Any, stop: Any) -> None:
        raise ValueError("no such thing")

    with pytest.raises(ValueError, match="no such thing"):
        distributed.run(campaign, tmp_path / "out.csv", work=untyped(fails))

    def dies(bundle: Any, start: Any, stop: Any) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(distributed, "RETRIES", 1)
    with pytest.raises(ray.exceptions.WorkerCrashedError):
        distributed.run(campaign, tmp_path / "out.csv", work=untyped(dies))


def test_parts_are_ranges_of_at_most_so_many() -> None:
    parts = distributed._parts([0, 1, 2, 3, 4, 7, 9, 10], 2)
    assert list(parts) == [range(0, 2), range(2, 4), range(4, 5), range(7, 8), range(9, 11)]
    assert list(distributed._parts([], 2)) == []


def test_what_is_wrong_is_named(campaign: Any, tmp_path: Path) -> None:
    for task_runs in (0, "5", True, 1.5):
        with pytest.raises(ValueError, match="task_runs"):
            distributed.run(campaign, tmp_path / "out.csv", task_runs=untyped(task_runs))
    assert not (tmp_path / "out.csv").exists()


def test_the_command_line(campaign: Any, whole: Any, tmp_path: Path) -> None:
    def command(*arguments: Any) -> Any:
        command = [sys.executable, "-m", "sidehill.distributed", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300)

    out = tmp_path / "out.csv"
    done = command(campaign, "--address", "local", "--out", out, "--runs", 10, "--task-runs", 4)
    assert done.returncode == 0, done.stderr
    assert out.read_bytes() == b"".join(whole.splitlines(keepends=True)[: 1 + 10 * 2])
    assert "10 runs in 3 tasks; 0 were lost" in done.stderr
    done = command(tmp_path / "none.yaml", "--out", out)
    assert done.returncode == 2 and "none.yaml" in done.stderr
