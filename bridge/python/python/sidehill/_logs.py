"""Logs of drives: identification of a vehicle and of its drives, and odometry."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeAlias, Union

import numpy as np

from . import _sidehill
from ._plant import Plant
from ._sidehill import Identification, Vehicle


class _Columns(Protocol):
    """A DataFrame, which is no Mapping."""

    def keys(self) -> Any: ...
    def __getitem__(self, name: Any, /) -> Any: ...


Log: TypeAlias = Union[str, "os.PathLike[str]", Mapping[str, Any], _Columns]
"""A log: path of a CSV file, of a bag of ROS 2 (a folder, .mcap or .db3) or of a recording of `sidehill run`; or columns as
a dict or pandas DataFrame.

Columns: `time_s`, `v_left_m_s`, `v_right_m_s` (as measured, before c_l and c_r), `roll_rad`, `pitch_rad`, and where
known `x_m`, `y_m`, `z_m`, `yaw_rad`, NaN in rows without a new pose; the paper's frames (right side down, nose up,
counter-clockwise from Y_g positive).
"""

_Path: TypeAlias = Union[str, "os.PathLike[str]"]
_Given: TypeAlias = tuple[str, Union[str, bytes]]
_POSE = ("x_m", "y_m", "z_m", "yaw_rad")


def identify(
    *,
    level: Sequence[Log] = (),
    slope: Sequence[Log] = (),
    plant: Plant | None = None,
    seed: int = 1,
    vehicle: Vehicle,
    segment_s: float = 8.0,
    smoothing_s: float = 0.2,
    columns: _Path | None = None,
    topics: _Path | None = None,
    max_bytes: int | None = None,
    contact: bool = False,
) -> Identification:
    """Identifies a vehicle's parameters from logs in the paper's two stages (section III).

    level: logs of varied driving on level ground, for ICRs, c_l and c_r.
    slope: logs of turning on a slope, for lambda_1 and lambda_2; without one these stay.
    plant: instead of logs, an object that is driven through the paper's procedure, by 62,400 steps of 0.01 s. It is reset
        on level ground and twice on a slope of 4 deg; its ground must go on as the plane that the attitude of `reset`
        lies in. What it gives gets the noise of `sidehill identify --simulate`.
    seed: of that noise.
    vehicle: where the fit starts; its base and largest speed are kept.
    segment_s: length of the dead-reckoned segments, s.
    smoothing_s: standard deviation of the Gaussian that smooths roll and pitch, s, 0 to 10.
    columns: YAML file of other names, units and frames of the logs' columns, as `sidehill identify --columns`.
    topics: YAML file of the topics of bags, as `--topics`.
    max_bytes: largest size of a log, and of what a file of a bag decompresses to, as `--max-bytes`.
    contact: whether to identify the vehicle on wheels with friction as well, from which contact-mpc starts.

    Returns the identified vehicle, with reports in `level`, `slope` and `extension_report`, how far to trust it in
    `verdict`, and in `text` what `sidehill identify` prints. Raises ValueError with log, row and column or topic, or with
    what the logs lack, and OSError where a log cannot be read; what the plant raises comes through as it is.
    """
    given = {stage: _all(stage, logs) for stage, logs in (("level", level), ("slope", slope))}
    if (plant is None) != any(given.values()):
        raise ValueError("level, slope, plant: logs or a plant, one of both is needed")
    maps = (columns, topics, max_bytes)
    return _sidehill.identify(
        given["level"], given["slope"], plant, seed, vehicle, segment_s, smoothing_s, maps, bool(contact)
    )


def identify_drives(
    logs: Sequence[Log],
    vehicle: Vehicle,
    *,
    columns: _Path | None = None,
    topics: _Path | None = None,
    max_bytes: int | None = None,
) -> dict[str, Any]:
    """Identifies how the drives respond to commands: `sidehill identify --drives`.

    logs: with the commands, in the columns `command_traction_m_s` and `command_steer_m_s` or in the topic that `topics`
        names; a recording has them.
    vehicle: whose c_l and c_r count.
    columns, topics, max_bytes: as in `identify`.

    Returns what `sidehill identify --drives --format json` prints: `drives` with `traction` and `steer` (by quantity:
    `value` and `interval_95`, `at_least`, `at_most`, or None where the logs do not tell; None of a motor that was never
    driven), `verdict`, a list of texts, and `controller`, settings for `Scenario.with_(controller=...)`. Also `text`, the
    tables that it prints, and `notes`, what reading the logs left out.

    Raises ValueError with log, row and column or topic, or with what the logs lack, and OSError where one cannot be read.
    """
    return _sidehill.identify_drives(_all("logs", logs), vehicle, (columns, topics, max_bytes))


def odometry(
    log: Log,
    vehicle: Vehicle,
    columns: _Path | None = None,
    *,
    topics: _Path | None = None,
    max_bytes: int | None = None,
) -> dict[str, Any]:
    """Judges dead reckoning of a log against its poses, as Table II of the paper.

    vehicle: whose parameters are used.
    columns, topics, max_bytes: as in `identify`.

    Returns what `sidehill odometry --format json` prints: `samples`, and for `icrhk`, `icrik`, `extended` and `diff_drive`
    the mean squared errors `mse_x`, `mse_y`, `mse_z` (m^2), `mse_yaw` (rad^2) and `j_over_n`, their sum. Also `notes`, what
    reading the log left out and what in it looks wrong.

    Raises ValueError with row and column or topic, or with what the log lacks, and OSError where it cannot be read.
    """
    return _sidehill.odometry(_given("log", log), vehicle, (columns, topics, max_bytes))


def _all(name: str, logs: Sequence[Log]) -> list[_Given]:
    """Returns each of a list of logs."""
    if isinstance(logs, (str, os.PathLike, Mapping)) or not hasattr(logs, "__iter__"):
        raise ValueError(f"{name}: a list of logs is needed, not {type(logs).__name__}")
    return [_given(f"{name}[{index}]", log) for index, log in enumerate(logs)]


def _given(name: str, log: Log) -> _Given:
    """Returns the log's name for messages, and its path or its text as CSV."""
    if isinstance(log, (str, os.PathLike)):
        os.stat(log)
        return name, os.fspath(log)
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
