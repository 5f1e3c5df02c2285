"""Arrays of numbers that come in."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


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
