"""Many seeded simulations on this machine."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from . import _sidehill, _table

CHUNK_RUNS = 50
"""Runs between two looks for an interrupt."""

_WORDS = ("campaign", "controller", "completed", "ended_by")


def campaign(
    campaign: str | os.PathLike[str] | Mapping[str, Any],
    runs: range | int | None = None,
    threads: int | None = None,
) -> dict[str, Any]:
    """Runs a campaign on all cores and returns its results as columns, sorted by run and controller.

    campaign: YAML file, or a dict with its keys (config/campaigns/default.yaml), whose names of files are relative to
        the working folder.
    runs: which runs, a range of step 1, or how many from 0 on; the campaign's without it.
    threads: simulations at a time instead of one a core.

    Columns are those of `sidehill campaign --out`, with the same values bit for bit: `campaign` (fingerprint),
    `index`, `seed`, `controller`, the keys that are drawn, `completed` (bool), `ended_by` (why not, else ""), and the
    figures as float64, NaN where a run could not start.

    Raises ValueError with argument, or file, key, value and range; OSError where a file cannot be read. A run that
    fails is no error but a row.
    """
    read = _sidehill.Campaign.read(dict(campaign) if isinstance(campaign, Mapping) else campaign)
    wanted = _range(runs, read.runs)
    if threads is not None and not (isinstance(threads, int) and threads >= 1):
        raise ValueError(f"threads: {threads!r} is not a whole number from 1")
    chunks: list[bytes] = []
    for start in range(wanted.start, wanted.stop, CHUNK_RUNS):
        csv = read.csv(start, min(start + CHUNK_RUNS, wanted.stop), threads)
        chunks.append(csv if not chunks else csv.partition(b"\n")[2])
    return _columns(b"".join(chunks), read.keys)


def _columns(csv: bytes, drawn: list[str]) -> dict[str, Any]:
    columns = _table.columns(csv, _WORDS, drawn)
    columns["index"] = columns["index"].astype(np.int64)
    columns["seed"] = columns["seed"].astype(np.int64)
    columns["completed"] = np.array([value == "true" for value in columns["completed"]])
    return columns


def _range(runs: range | int | None, whole: int) -> range:
    if runs is None:
        runs = whole
    if isinstance(runs, (int, np.integer)) and not isinstance(runs, bool):
        runs = range(int(runs))
    if not isinstance(runs, range) or runs.step != 1 or not 0 <= runs.start < runs.stop < 2**32:
        raise ValueError(f"runs: {runs!r} is not a number of runs from 1, or a range of them with step 1")
    return runs
