"""Search of a controller's settings."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any

from . import _sidehill
from ._sidehill import Scenario


def tune(
    campaign: str | os.PathLike[str] | Mapping[str, Any] | Scenario,
    controller: str = "icrik-mpc",
    keys: Sequence[str] | None = None,
    factor: float = 8.0,
    calmness: float = 0.2,
    training: int = 60,
    held_out: int = 120,
    tries: int = 120,
    minutes: float = 10.0,
    threads: int | None = None,
) -> dict[str, Any]:
    """Searches settings that drive a campaign better, judged by runs that the search has not seen: `sidehill tune`.

    campaign: YAML file, a dict with its keys, or a scenario, whose runs then differ by their seeds only.
    keys: settings within `controller`, with dots as in `weights.cross_per_m2`; by default six weights and figures of
        the estimator. Their present values are where the search begins.
    factor: by how much a setting may be larger or smaller.
    calmness: weight of ln(steer total variation / before) beside ln(cross-track RMS / before) in the cost of a run.
    training, held_out: runs that the search sees, and those after them that decide.
    tries, minutes: the budget.
    threads: simulations at a time, one a core by default.

    Returns what `sidehill tune --format json` prints: `improved`, `settings` (dicts of `key`, `before`, `after`),
    `training` and `held_out` with figures before and after, `tried` with the costs in order. Only where `improved` is
    true do the held-out runs show that the settings are better.

    Raises ValueError naming the argument or setting, and OSError where a file cannot be read.
    """
    for name, count in (("training", training), ("held_out", held_out), ("tries", tries), ("threads", threads)):
        if name == "threads" and count is None:
            continue
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count < 2**31:
            raise ValueError(f"{name}: {count!r} is not a whole number from 1")
    for name, number in (("factor", factor), ("calmness", calmness), ("minutes", minutes)):
        if isinstance(number, bool) or not isinstance(number, (int, float)) or not math.isfinite(number):
            raise ValueError(f"{name}: {number!r} is not a number")
    if keys is not None and (isinstance(keys, str) or not all(isinstance(key, str) for key in keys)):
        raise ValueError(f"keys: a list of names is needed, not {keys!r}")
    given: Any = dict(campaign) if isinstance(campaign, Mapping) else campaign
    names = None if keys is None else list(keys)
    return _sidehill.tune(given, controller, names, factor, calmness, training, held_out, tries, minutes, threads)
