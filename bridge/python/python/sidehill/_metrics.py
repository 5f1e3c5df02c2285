"""Figures of any log."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _sidehill, _table
from ._arrays import numbers
from ._logs import Log
from ._sidehill import Scenario, Vehicle


def metrics(log: Log, path: Scenario | npt.ArrayLike, vehicle: Vehicle | None = None) -> dict[str, Any]:
    """Returns how well a log follows a path, by the same figures as `simulate` and its `Run.metrics`.

    log: path of a CSV file, or columns as a dict or DataFrame: `time_s`, `x_m`, `y_m`, `yaw_rad`, and where known `z_m`,
        `roll_rad`, `pitch_rad`, and the effective command `command_traction_m_s`, `command_steer_m_s`; others are left
        alone, so `Run.log` is one. Rows without a pose (NaN) are left out. Rows should be a control period apart: errors
        count at the rate of the log, in `simulate` at that of the plant's steps.
    path: a Scenario, whose course or route is the path; or an array of shape (n, 2), points (x_m, y_m), which becomes a
        path as in Scenario(path=...).
    vehicle: of a path by points, the vehicle whose width limits its curvature; the paper's J8 without it.

    The result has `completed`, `cross_track_rms_m`, `cross_track_p95_m`, `cross_track_max_m`, `along_track_rms_m`,
    `heading_rms_rad`, `goal_error_m`, `mean_speed_m_s` and `time_s`, up to where the path has been followed to its end;
    with commands `steer_total_variation_m_s` and `constraint_violations`; of several laps `laps`; and with another
    tracked point than the origin `origin_cross_track_rms_m`. The first 2 s do not count in errors.

    Raises ValueError naming argument and column, and OSError where a file cannot be read.
    """
    scenario = path if isinstance(path, Scenario) else Scenario(path=path, vehicle=vehicle or Vehicle.j8())
    if isinstance(log, (str, os.PathLike)):
        log = _table.columns(Path(log).read_bytes(), ("status", "reason", "learned_unobserved"))
    if not hasattr(log, "keys"):
        raise ValueError(f"log: a path, a dict of columns or a DataFrame is needed, not {type(log).__name__}")
    time_s = _column(log, "time_s")
    if not (np.diff(time_s) > 0).all():
        raise ValueError("log: time_s does not increase from row to row")
    pose = [_column(log, name, time_s, name == "z_m") for name in ("x_m", "y_m", "z_m", "yaw_rad")]
    attitude = [_column(log, name, time_s, True) for name in ("roll_rad", "pitch_rad")]
    names = ("command_traction_m_s", "command_steer_m_s")
    command = [_column(log, name, time_s) for name in names] if names[0] in log.keys() else None
    known = np.isfinite(np.sum(pose + attitude, axis=0))
    if not known.any():
        raise ValueError("log: no row has a pose")
    cut = [[column[known] for column in columns] for columns in (pose, attitude, command or [])]
    return _sidehill.figures_of_log(scenario, time_s[known], cut[0], cut[1], cut[2] or None)


def _column(
    log: Any, name: str, beside: npt.NDArray[np.float64] | None = None, optional: bool = False
) -> npt.NDArray[np.float64]:
    if name not in log.keys():
        if optional and beside is not None:
            return np.zeros(len(beside))
        raise ValueError(f"log: the column {name} is missing")
    column = numbers(f"log: {name}", log[name], 1, holes=name not in ("time_s",))
    if beside is not None and len(column) != len(beside):
        raise ValueError(f"log: {name} has {len(column)} values, time_s has {len(beside)}")
    return column
