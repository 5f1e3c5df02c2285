"""Python values as JSON, which the core reads as YAML."""

from __future__ import annotations

import json
import os
from typing import Any


def dump(value: Any) -> str:
    """Returns `value` as JSON; numpy's numbers and arrays, and paths, become plain ones.

    Raises ValueError where something in it has no form in JSON.
    """
    try:
        return json.dumps(value, default=_plain, ensure_ascii=False)
    except (TypeError, RecursionError) as error:
        raise ValueError(str(error)) from None


def _plain(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "to_dict"):
        return value.to_dict()
    raise TypeError(f"{value!r} is neither a number, text, list nor dict")
