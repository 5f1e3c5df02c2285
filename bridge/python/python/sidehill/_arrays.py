"""Arrays of numbers that come in."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]


def numbers(name: str, value: Any, dimensions: int | None = None, holes: bool = False) -> npt.NDArray[np.float64]:
    """Returns an array of finite numbers, or with `holes` of numbers and NaN, of so many dimensions.

    Raises ValueError with `name` where it is not.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
        array = array.astype(np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: numbers are needed, not {value!r}") from None
    if dimensions is not None and array.ndim != dimensions:
        raise ValueError(f"{name}: shape {array.shape}, {dimensions} dimensions are needed")
    wrong = np.isinf(array) if holes else ~np.isfinite(array)
    if wrong.any():
        raise ValueError(f"{name}: {array[wrong].flat[0]} is not finite")
    return array


def broadcast(named: dict[str, Any]) -> tuple[tuple[int, ...], list[npt.NDArray[np.float64]]]:
    """Returns the shape that arrays have together, and each as a flat array of that size.

    Raises ValueError with the name of one that is not finite numbers or does not fit those before.
    """
    arrays = {name: numbers(name, value) for name, value in named.items()}
    shape: tuple[int, ...] = ()
    for name, array in arrays.items():
        try:
            shape = np.broadcast_shapes(shape, array.shape)
        except ValueError:
            raise ValueError(f"{name}: shape {array.shape} does not fit {shape}, that of those before") from None
    flat = (np.broadcast_to(array, shape).ravel() for array in arrays.values())
    return shape, [np.ascontiguousarray(array) for array in flat]


def extra_terms(stages: int, weight: Any, target: Any, rows: Any, low: Any, high: Any) -> tuple[_Floats, _Floats, _Floats]:
    """Returns weight, target and (rows, low, high) of all stages as flat arrays.

    Raises ValueError with the name of an argument that has another shape or is missing.
    """

    def alike(name: str, value: Any, own: tuple[int, ...]) -> _Floats:
        """Returns an array of shape (stages, *own)."""
        array = _floats(name, value)
        if array.shape not in (own, (stages, *own)):
            raise ValueError(f"{name}: shape {array.shape}, {own} or {(stages, *own)} is needed")
        return np.broadcast_to(array, (stages, *own))

    if (weight is None) != (target is None):
        raise ValueError(f"{'target' if target is None else 'weight'}: weight and target are needed together")
    costs = [np.zeros((stages, 5, 5)), np.zeros((stages, 5))]
    if weight is not None:
        costs = [alike("weight", weight, (5, 5)), alike("target", target, (5,))]
    constraints = np.zeros((stages, 0, 7))
    if rows is None:
        if low is not None or high is not None:
            raise ValueError("rows: low and high are their ends, so rows are needed")
    else:
        array = _floats("rows", rows)
        count = array.shape[-2] if array.ndim in (2, 3) else 1
        array = alike("rows", rows, (count, 5))
        ends = []
        for name, value, none in (("low", low, -np.inf), ("high", high, np.inf)):
            end = _floats(name, none if value is None else value)
            try:
                ends.append(np.broadcast_to(end, (stages, count)))
            except ValueError:
                raise ValueError(f"{name}: shape {end.shape} does not fit {(stages, count)}, that of the rows") from None
        constraints = np.concatenate([array, np.stack(ends, -1)], -1)
    weights, targets, lines = (np.ascontiguousarray(array).ravel() for array in (*costs, constraints))
    return weights, targets, lines


def _floats(name: str, value: Any) -> _Floats:
    try:
        return np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: numbers are needed, not {value!r}") from None
