"""Objects and arrays as the keys of a scenario, with the texts of the files that they stand for."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _json
from ._arrays import numbers
from ._sidehill import Vehicle

_DEFAULTS: dict[str, Any] = {
    "name": "scenario",
    "terrain": {"kind": "level"},
    "controllers": ["icrik-mpc"],
    "plant": "icrik",
    "seed": 1,
    "step_s": 0.005,
}


class Grid:
    """Heights of the ground at the points of a grid, for the key `terrain` of a scenario.

    x_m, y_m: coordinates of columns and rows in the world, m: arrays of shapes (n,) and (m,), increasing by one and
        the same step.
    height_m: height of the ground, m: array of shape (m, n), NaN where there is none, or a function of arrays x and y
        of this shape that returns one.

    Between the points the ground is that of `terrain: {kind: grid}`. Raises ValueError naming the argument.
    """

    def __init__(
        self,
        x_m: npt.ArrayLike,
        y_m: npt.ArrayLike,
        height_m: npt.ArrayLike | Callable[[npt.NDArray[np.float64], npt.NDArray[np.float64]], npt.ArrayLike],
    ) -> None:
        x, y = numbers("x_m", x_m, 1), numbers("y_m", y_m, 1)
        steps = np.concatenate([np.diff(x), np.diff(y)])
        if len(x) < 2 or len(y) < 2 or not (steps > 0).all() or np.ptp(steps) > 1e-6 * steps[0]:
            raise ValueError("x_m, y_m: at least two of each, increasing by one and the same step, are needed")
        given = height_m(*np.meshgrid(x, y)) if callable(height_m) else height_m
        heights = numbers("height_m", given, 2, holes=True)
        if heights.shape != (len(y), len(x)):
            raise ValueError(f"height_m: shape {heights.shape} is not {(len(y), len(x))}, that of (y_m, x_m)")
        step = float(np.mean([(x[-1] - x[0]) / (len(x) - 1), (y[-1] - y[0]) / (len(y) - 1)]))
        rows = (" ".join("nan" if value != value else repr(value) for value in row) for row in heights[::-1].tolist())
        self._text = (
            f"ncols {len(x)}\nnrows {len(y)}\nxllcenter {float(x[0])!r}\nyllcenter {float(y[0])!r}\n"
            f"cellsize {step!r}\n" + "\n".join(rows) + "\n"
        )

    def text(self) -> str:
        """Returns the heights as an ESRI ASCII grid."""
        return self._text


def of_new(given: Mapping[str, Any]) -> dict[str, Any]:
    """Returns all keys of a new scenario of which these are given."""
    return keys(_DEFAULTS | {"vehicle": Vehicle.j8()} | dict(given), {})


def keys(given: Mapping[str, Any], before: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the keys of the YAML for those that are given; `before` are those of the scenario so far."""
    out = dict(given)
    texts: dict[str, str] = {}

    def named(name: str, text: str) -> str:
        # In a folder of their own, where no file of the user's is.
        texts[f"python/{name}"] = text
        return f"python/{name}"

    vehicle = out.get("vehicle", "")
    if not _is_object(vehicle) and not isinstance(vehicle, (str, os.PathLike)):
        raise ValueError(f"vehicle: a sidehill.Vehicle, a dict or a file's name is needed, not {vehicle!r}")
    if _is_object(vehicle):
        out["vehicle"] = named("vehicle.yaml", _json.dump(vehicle))
    if isinstance(out.get("terrain"), Grid):
        out["terrain"] = {"kind": "grid", "file": named("terrain.asc", out["terrain"].text())}
    if isinstance(out.get("contact"), Mapping):
        out["contact"] = {
            key: named(f"contact_{key}.yaml", _json.dump(value)) if key != "variation" and _is_object(value) else value
            for key, value in out["contact"].items()
        }
    if "path" in out:
        route = {"file": named("path.csv", _path(out.pop("path")))}
        out = {"course": None} | out | {"route": dict(out.get("route", before.get("route")) or {}) | route}
    if texts or out.get("files"):
        out["files"] = dict(before.get("files") or {}) | dict(out.get("files") or {}) | texts
    return out


def _is_object(value: Any) -> bool:
    """Whether a value is what a file would hold, and not a file's name."""
    return isinstance(value, Mapping) or hasattr(value, "to_dict")


def _path(value: Any) -> str:
    points = numbers("path", value, 2)
    names = ("x_m", "y_m", "z_m")[: points.shape[1]]
    if len(names) != points.shape[1] or len(names) < 2:
        raise ValueError(f"path: shape {points.shape} is neither (n, 2) nor (n, 3), points (x_m, y_m[, z_m])")
    out = io.StringIO()
    out.write(",".join(names) + "\n")
    out.writelines(",".join(map(repr, row)) + "\n" for row in points.tolist())
    return out.getvalue()

