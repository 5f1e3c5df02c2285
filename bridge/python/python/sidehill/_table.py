"""CSV that the core writes, as columns."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Collection
from typing import Any

import numpy as np


def columns(text: bytes, words: Collection[str] = (), drawn: Collection[str] = ()) -> dict[str, Any]:
    """Returns a dict of columns: lists of str for `words`, float64 arrays for the others.

    An empty field of a number is NaN. A column in `drawn` that is not a number in every row is a list of what its
    fields say as JSON, with None for an empty one. Numbers are those the core has written, bit for bit.
    """
    reader = csv.reader(io.StringIO(text.decode(), newline=""))
    header = next(reader)
    fields = list(zip(*reader, strict=True)) or [()] * len(header)
    return {name: _column(name, values, words, drawn) for name, values in zip(header, fields, strict=True)}


def _column(name: str, values: tuple[str, ...], words: Collection[str], drawn: Collection[str]) -> Any:
    if name in words:
        return list(values)
    try:
        return np.array([float(value) if value else np.nan for value in values], dtype=np.float64)
    except ValueError:
        if name not in drawn:
            raise
        return [json.loads(value) if value else None for value in values]
