"""Values as TOML writes them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from typing import Any

from ._arguments import unicode


def key(name: str) -> str:
    """A key as TOML writes it."""
    bare = bool(name) and all(letter.isascii() and (letter.isalnum() or letter in "_-") for letter in name)
    return name if bare else toml(name)


def toml(value: Any) -> str:
    """``value`` as TOML; ``TypeError`` for what has no place in a setting."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(unicode("a setting", os.fspath(value)), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key(str(name))} = {toml(one)}" for name, one in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(one) for one in value) + "]"
    if hasattr(value, "tolist"):
        # NumPy's numbers and arrays.
        return toml(value.tolist())
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else {math.inf: "inf", -math.inf: "-inf"}.get(value, "nan")
    if isinstance(value, int):
        return str(value)
    raise TypeError(f"a setting cannot be a {type(value).__name__}: give a number, a text, a list or a dict")
