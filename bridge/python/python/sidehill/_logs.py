"""Logs of drives: identification of a vehicle, and odometry."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias, Union

import numpy as np

from . import _sidehill
from ._sidehill import Identification, Vehicle


class _Columns(Protocol):
    """A DataFrame, which is no Mapping."""

    def keys(self) -> Any: ...
    def __getitem__(self, name: Any, /) -> Any: ...


Log: TypeAlias = Union[str, "os.PathLike[str]", Mapping[str, Any], _Columns]
"""A log: path of a CSV file, or its columns as a dict or pandas DataFrame.

Columns: `time_s`, `v_left_m_s`, `v_right_m_s` (as measured, before c_l and c_r), `roll_rad`, `pitch_rad`, and where
known `x_m`, `y_m`, `z_m`, `yaw_rad`, NaN in rows without a new pose; the paper's frames (right side down, nose up,
counter-clockwise from Y_g positive).
"""

_POSE = ("x_m", "y_m", "z_m", "yaw_rad")


def identify(
    *,
    level: Sequence[Log] = (),
    slope: Sequence[Log] = (),
    vehicle: Vehicle,
    segment_s: float = 8.0,
    smoothing_s: float = 0.2,
    columns: str | os.PathLike[str] | None = None,
    contact: bool = False,
) -> Identification:
    """Identifies a vehicle's parameters from logs in the paper's two stages (section III).

    level: logs of varied driving on level ground, for ICRs, c_l and c_r.
    slope: logs of turning on a slope, for lambda_1 and lambda_2; without one these stay.
    vehicle: where the fit starts; its base and largest speed are kept.
    segment_s: length of the dead-reckoned segments, s.
    smoothing_s: standard deviation of the Gaussian that smooths roll and pitch, s, 0 to 10.
    columns: YAML file of other names, units and frames of the logs' columns, as `sidehill identify --columns`.
    contact: whether to identify the vehicle on wheels with friction as well, from which contact-mpc starts.

    Returns the identified vehicle, with reports in `level` and `slope`, how far to trust it in `verdict`, and in `text`
    what `sidehill identify` prints. Raises ValueError with log, row and column, or with what the logs lack, and OSError
    where a log cannot be read.
    """
    stages = {"level": level, "slope": slope}
    texts = {}
    for stage, logs in stages.items():
        if isinstance(logs, (str, os.PathLike, Mapping)) or not hasattr(logs, "__iter__"):
            raise ValueError(f"{stage}: a list of logs is needed, not {type(logs).__name__}")
        texts[stage] = [_text(f"{stage}[{index}]", log) for index, log in enumerate(logs)]
    if not any(texts.values()):
        raise ValueError("level, slope: at least one log is needed")
    return _sidehill.identify(texts["level"], texts["slope"], vehicle, segment_s, smoothing_s, columns, bool(contact))


def odometry(log: Log, vehicle: Vehicle, columns: str | os.PathLike[str] | None = None) -> dict[str, Any]:
    """Judges dead reckoning of a log against its poses, as Table II of the paper.

    vehicle: whose parameters are used. columns: as in `identify`.

    Returns what `sidehill odometry --format json` prints: `samples`, and for `icrhk`, `icrik` and `diff_drive` the mean
    squared errors `mse_x`, `mse_y`, `mse_z` (m^2), `mse_yaw` (rad^2) and `j_over_n`, their sum.

    Raises ValueError with row and column, or with what the log lacks, and OSError where it cannot be read.
    """
    return _sidehill.odometry(_text("log", log), vehicle, columns)


def _text(name: str, log: Log) -> tuple[str, bytes]:
    """Returns the log's name for messages and its text as CSV."""
    if isinstance(log, (str, os.PathLike)):
        return f"{name} ({os.fspath(log)})", Path(log).read_bytes()
    if not hasattr(log, "keys"):
        raise ValueError(f"{name}: a path, a dict of columns or a DataFrame is needed, not {type(log).__name__}")
    arrays = {}
    for column in log.keys():
        values = np.asarray(log[column])
        if values.ndim != 1:
            raise ValueError(f"{name}: {column} has shape {values.shape}, one dimension is needed")
        arrays[str(column)] = values
    sizes = {column: len(values) for column, values in arrays.items()}
    for column, size in sizes.items():
        first = next(iter(sizes))
        if size != sizes[first]:
            raise ValueError(f"{name}: {column} has {size} values, {first} has {sizes[first]}")
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(arrays)
    lists = [_fields(column, values) for column, values in arrays.items()]
    writer.writerows(zip(*lists, strict=True))
    return name, out.getvalue().encode()


def _fields(column: str, values: np.ndarray) -> list[Any]:
    fields: list[Any] = values.tolist()
    if column in _POSE:
        # An empty field: there is no new pose in this row.
        return ["" if value is None or value != value else value for value in fields]
    return fields
