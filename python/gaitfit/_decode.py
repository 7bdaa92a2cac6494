"""Plain data, as JSON has it, as dataclasses."""

from __future__ import annotations

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")


class Named(dict[str, T]):
    """Values by name. A name that is absent raises ``KeyError`` with the names that exist.

    >>> Named({"delay": 0.007})["friction"]
    Traceback (most recent call last):
    KeyError: "there is no 'friction'; there are delay"
    """

    def __missing__(self, key: object) -> T:
        raise KeyError(f"there is no {key!r}; there are {', '.join(self) or 'none'}")


def decoded(kind: type[T], document: Any, /, **more: Any) -> T:
    """``document`` as the dataclass ``kind``; ``more`` has fields that are not in the document.

    Keys that the dataclass lacks are left out. Raises ``ValueError`` for a document that lacks a field without a default.
    """
    if not isinstance(document, Mapping):
        raise ValueError(f"a {kind.__name__} is made from an object with names; this is a {type(document).__name__}")
    hints = get_type_hints(kind)
    values = dict(more)
    for one in fields(kind):  # type: ignore[arg-type]
        if one.name in values:
            continue
        if one.name in document:
            values[one.name] = _value(hints[one.name], document[one.name], one.name)
        elif one.default is MISSING and one.default_factory is MISSING:
            raise ValueError(f"{kind.__name__} needs {one.name!r}; there are {', '.join(map(str, document))}")
    return kind(**values)


def _value(hint: Any, value: Any, name: str) -> Any:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        inner = next(one for one in arguments if one is not type(None))
        return None if value is None else _value(inner, value, name)
    if hint is float:
        # JSON has no NaN: it is null there. math.nan is one object, so that copies of a result are equal.
        return math.nan if value is None else float(value)
    if hint is Path:
        return Path(value)
    if origin is tuple:
        return tuple(_value(arguments[0], one, name) for one in value)
    if origin is Named:
        if isinstance(value, list):
            return Named({one["name"]: _value(arguments[0], one, name) for one in value})
        return Named({str(key): _value(arguments[0], one, name) for key, one in value.items()})
    if is_dataclass(hint) and isinstance(hint, type):
        return decoded(hint, value)
    if origin is Literal or hint is Any or value is None:
        return value
    return hint(value) if hint in (int, bool, str) else value
