"""Campaigns on many machines, with Ray as the engine: `python -m sidehill.distributed CAMPAIGN --out FILE`.

The driver cuts what the file of results lacks into tasks, which come back as text and are appended at once; when all
are there the file is put in order. It is then the file that `sidehill campaign` writes on one machine, byte for byte,
and either of them goes on with the file of the other. The campaign's files travel with the tasks: a worker needs only
this package of the same version.
"""

from __future__ import annotations

import argparse
import functools
import os
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from . import _sidehill
from ._campaign import _range

TASK_RUNS = 250
"""Runs of every controller in a task: about a minute of work, so that a killed task loses little."""
RETRIES = 10
"""How often one task may be lost with its worker before the campaign gives up."""
_REPORT_S = 1.0


@dataclass(frozen=True)
class Report:
    """What a campaign took."""

    tasks: int
    """Tasks that brought results."""
    lost: int
    """Tasks that were lost with their worker or node and run again."""
    runs: int
    """Runs that the file lacked."""


@functools.lru_cache(maxsize=4)
def _campaign(bundle: str) -> _sidehill.Campaign:
    return _sidehill.Campaign.from_bundle(bundle)


def _run(bundle: str, start: int, stop: int) -> bytes:
    """The work of a task, on one thread."""
    return _campaign(bundle).csv(start, stop, threads=1)


def run(
    campaign: str | os.PathLike[str] | Mapping[str, Any],
    out: str | os.PathLike[str],
    runs: range | int | None = None,
    task_runs: int = TASK_RUNS,
    work: Callable[[str, int, int], bytes] = _run,
) -> Report:
    """Runs on the Ray cluster that this process is connected to what `out` lacks of a campaign.

    campaign, runs: as `sidehill.campaign`.
    out: CSV file of the results, held against a second campaign meanwhile.
    task_runs: runs of every controller in a task.
    work: what a task does, for tests: of a bundle and the begin and end of its runs it returns their CSV.

    A task whose worker or node is lost is run again, up to RETRIES times. After an interrupt or an error, the rows that
    came are in the file, and the same call goes on with it. Raises ValueError as `sidehill.campaign` and for results of
    another campaign, OSError for files, and Ray's error where a task fails by itself or is lost too often.
    """
    import ray
    from ray.exceptions import (
        NodeDiedError,
        ObjectLostError,
        OutOfMemoryError,
        OwnerDiedError,
        WorkerCrashedError,
    )

    if isinstance(task_runs, bool) or not isinstance(task_runs, int) or task_runs < 1:
        raise ValueError(f"task_runs: {task_runs!r} is not a whole number from 1")
    read = _sidehill.Campaign.read(dict(campaign) if isinstance(campaign, Mapping) else campaign)
    wanted = _range(runs, read.runs)
    results = _sidehill.Results(out, read)
    missing = results.missing(read, wanted.start, wanted.stop)
    waiting = deque((part, 0) for part in _parts(missing, task_runs))
    # Ray's own retries would hide what was lost.
    task = ray.remote(num_cpus=1, max_retries=0)(work)
    bundle = ray.put(read.bundle())
    pending: dict[Any, tuple[range, int]] = {}
    tasks = lost = 0
    lasting = (WorkerCrashedError, NodeDiedError, ObjectLostError, OwnerDiedError, OutOfMemoryError)
    resources: Any = ray.cluster_resources  # Ray has no type for it.
    workers = int(resources().get("CPU", 1))
    with _progress(len(missing)) as progress:
        while waiting or pending:
            # Enough that no worker waits for the driver, few enough that the driver's memory does not grow with the
            # campaign.
            while waiting and len(pending) < 2 * workers + 8:
                part, losses = waiting.popleft()
                pending[task.remote(bundle, part.start, part.stop)] = (part, losses)
            done, _ = ray.wait(list(pending), num_returns=1, timeout=_REPORT_S)
            for reference in done:
                part, losses = pending.pop(reference)
                try:
                    csv = ray.get(reference)
                except lasting:
                    if losses >= RETRIES:
                        raise
                    lost += 1
                    waiting.append((part, losses + 1))
                    continue
                results.append(csv)
                tasks += 1
                progress.update(len(part))
            progress.refresh()
    results.finish()
    return Report(tasks=tasks, lost=lost, runs=len(missing))


def _parts(missing: list[int], most: int) -> Iterator[range]:
    """Cuts ascending numbers into ranges of at most `most`."""
    start = 0
    for index in range(1, len(missing) + 1):
        new = index == len(missing) or missing[index] != missing[index - 1] + 1
        if new or index - start == most:
            yield range(missing[start], missing[index - 1] + 1)
            start = index


def _progress(runs: int) -> Any:
    from tqdm import tqdm

    return tqdm(total=runs, unit="run", disable=None, smoothing=0.05)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sidehill.distributed", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("campaign", metavar="CAMPAIGN", help="campaign, as for `sidehill campaign`")
    held = "CSV file of the results; where it exists, what it holds is not run again"
    parser.add_argument("--out", required=True, metavar="FILE", help=held)
    address = "`auto` for the Ray cluster of this machine, `local` for a new one on it, or host:port"
    parser.add_argument("--address", default="local", help=f"{address} (default: %(default)s)")
    parser.add_argument("--runs", type=int, help="runs of each controller instead of the campaign's")
    size = "runs of every controller in a task (default: %(default)s)"
    parser.add_argument("--task-runs", type=int, default=TASK_RUNS, help=size)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line and returns its exit status: 0, or 2 with the reason on standard error.

    arguments: of the command line, those of the process without it. Raises SystemExit where they are wrong.
    """
    given = _arguments().parse_args(arguments)
    try:
        import ray
        import tqdm  # noqa: F401
        from ray.exceptions import RayError
    except ImportError as error:
        print(f"sidehill: {error.name} is missing: pip install 'ray' 'tqdm'", file=sys.stderr)
        return 2
    try:
        ray.init(address=given.address, log_to_driver=False)
        report = run(given.campaign, given.out, given.runs, given.task_runs)
    except (ValueError, OSError, RayError) as error:
        print(f"sidehill: {error}", file=sys.stderr)
        return 2
    finally:
        ray.shutdown()
    print(f"{report.runs} runs in {report.tasks} tasks; {report.lost} were lost and run again", file=sys.stderr)
    return 0


if __name__ == "__main__":
    # What `__main__` defines a worker could not import.
    from sidehill import distributed

    sys.exit(distributed.main())
