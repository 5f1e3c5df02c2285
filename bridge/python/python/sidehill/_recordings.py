"""Recordings of drives: replay, report, and paths."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any, TypeAlias, Union

from . import _sidehill
from ._kinds import Kind

_Path: TypeAlias = Union[str, "os.PathLike[str]"]


def replay(
    recording: _Path,
    *,
    controller: Kind | None = None,
    vehicle: _Path | None = None,
    settings: Mapping[str, Any] | None = None,
    closed_loop: bool = False,
    plant: str | None = None,
    tolerance_m_s: float | None = None,
    report: _Path | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Feeds the readings of a recording (MCAP) to its controller again, and compares the commands.

    controller: name of another controller.
    vehicle: vehicle file for it instead of the recorded vehicle.
    settings: settings of the controller instead of the recorded ones, by keys with dots: {"weights.cross_per_m2": 80}.
    closed_loop: drive a simulated vehicle along the recorded path instead; plant: "icrik" or "contact", which moves it.
    tolerance_m_s: largest difference of a command that does not count, m/s; 0 by default.
    report: file for a page with plots, which `force` lets be overwritten.

    Returns what `sidehill replay --format json` prints: `cycles`, how many of them are `different`, the differences of
    the commands in m/s, and `cross_track_rms_m` of the recorded and of the replayed drive, m.

    Raises ValueError for a recording without steps of a controller or a wrong setting, and OSError where a file
    cannot be read or written.
    """
    changed = [f"{key}={json.dumps(value)}" for key, value in (settings or {}).items()]
    return _sidehill.replay({
        "recording": _read("recording", recording), "controller": controller, "vehicle": vehicle, "settings": changed,
        "closed_loop": closed_loop, "plant": plant, "tolerance": tolerance_m_s, "report": report, "force": force,
    })  # fmt: skip


def report(
    recording: _Path,
    out: _Path | None = None,
    *,
    map: _Path | None = None,
    geojson: _Path | None = None,
    kml: _Path | None = None,
    limits: Mapping[str, float] | None = None,
    force: bool = False,
) -> dict[str, Any]:
    """Judges a recorded drive (MCAP), and writes a page about it.

    out: file for the page, HTML. map: MBTiles file, which is drawn below the drive on the page.
    geojson, kml: files for what was driven, stops and worst places. These and `map` need a datum in the recording.
    limits: what the drive has to keep to, by the options of `sidehill report`, such as {"max_cross_track_m": 0.2}.
    force: whether files that exist are overwritten.

    Returns what `sidehill report --format json` prints, with units in the names of the figures: `driven`,
    `cross_track`, `stops`, `worst`, `sensors`, and `passed`, None without limits.

    Raises ValueError for a recording without a drive or an unknown limit, and OSError where a file cannot be read or
    written.
    """
    if map is not None and out is None:
        raise ValueError("map: it is drawn on the page, so `out` is needed")
    return _sidehill.report({
        "recording": _read("recording", recording), "out": out, "map": map, "geojson": geojson, "kml": kml,
        "limits": dict(limits or {}), "force": force,
    })  # fmt: skip


def route(
    log: _Path,
    out: _Path,
    *,
    topic: str | None = None,
    columns: _Path | None = None,
    accuracy_m: float | None = None,
    smoothing_m: float | None = None,
    vehicle: _Path | None = None,
    tolerance_m: float = 0.02,
    force: bool = False,
) -> dict[str, Any]:
    """Writes the path of a recorded drive, which controllers can follow.

    log: bag of ROS 2, recording, or log as CSV. columns: YAML file of other names of its columns, as in `identify`.
    topic: topic of the positions, where a bag has several.
    out: file of the path, .csv, or .gpx for positions of a satellite receiver.
    accuracy_m: standard deviation of the positions in each direction, m; by default estimated from them.
    smoothing_m: standard deviation of a Gaussian along the path that smooths it beforehand, m.
    vehicle: vehicle file, whose track width limits the curvature; without it, to 1 1/m.
    tolerance_m: points closer than this to the line between their neighbours are left out, m.
    force: whether a file that exists is overwritten.

    Returns `points`, `length_m`, `positions`, `accuracy_m`, `deviation_m` (largest distance between recorded and written
    path) and `notes`, texts that `sidehill route` prints.

    Raises ValueError for a drive that no path comes near enough to, with the place, and OSError where a file cannot be
    read or written.
    """
    return _sidehill.route({
        "from": _read("log", log), "out": out, "topic": topic, "columns": columns, "accuracy_m": accuracy_m,
        "smoothing_m": smoothing_m, "vehicle": vehicle, "tolerance_m": tolerance_m, "force": force,
    })  # fmt: skip


def _read(name: str, value: Any) -> str:
    """Returns the path of what can be read."""
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{name}: a path is needed, not {value!r}")
    os.stat(value)
    return os.fspath(value)
