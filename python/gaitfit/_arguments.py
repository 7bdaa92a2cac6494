"""Arguments that users give: each is named where it is wrong, before anything begins."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

#: More threads than any machine has cores.
MAX_THREADS = 4096
#: Candidates of a generation, and searches at once: as for the settings ``optimizer.population`` and ``optimizer.seeds``.
MAX_POPULATION, MAX_SEEDS = 10_000, 1000


def count(name: str, value: Any, least: int, most: int = 2**64 - 1) -> int:
    """A whole number from ``least`` to ``most``."""
    if isinstance(value, (bool, np.bool_)) or not hasattr(value, "__index__"):
        raise TypeError(f"{name} is {value!r}; it must be a whole number")
    if value < least:
        raise ValueError(f"{name} is {value}; it must be at least {least}")
    if value > most:
        raise ValueError(f"{name} is {value}; it must be at most {most}")
    return int(value)


def real(name: str, value: Any) -> float:
    """A number, finite or not: the library itself refuses what is too small or too large."""
    if isinstance(value, (bool, np.bool_, str, bytes)) or getattr(value, "shape", ()) != ():
        raise TypeError(f"{name} is {value!r}; it must be a number")
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}; it must be a number") from None


def finite(name: str, value: Any) -> float:
    """A number that is one."""
    number = real(name, value)
    if not np.isfinite(number):
        raise ValueError(f"{name} is {number}; it must be finite")
    return number


def flag(name: str, value: Any) -> bool:
    """True or false."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} is {value!r}; it must be True or False")
    return bool(value)


def text(name: str, value: Any) -> str:
    """A text."""
    if not isinstance(value, str):
        raise TypeError(f"{name} is {value!r}; it must be a text")
    return unicode(name, value)


def unicode(name: str, value: str) -> str:
    """A text that is one: paths of Linux may be bytes that are no UTF-8, and settings are UTF-8."""
    try:
        value.encode()
    except UnicodeEncodeError:
        raise ValueError(
            f"{name} is {value!r}, which is no UTF-8: settings and results are text files in UTF-8. Rename the file or folder"
        ) from None
    return value


def path(name: str, value: Any, otherwise: str = "") -> str:
    """A path as text; ``otherwise`` names other possibilities for the message."""
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise TypeError(f"{name} is {value!r}; it must be a path: a text or a pathlib.Path{otherwise}")
    return os.fspath(value)


def existing(name: str, file: str | os.PathLike[str] | None) -> str | None:
    """The path of a file, after a check that the file exists."""
    if file is None:
        return None
    found = path(name, file)
    if not os.path.exists(found):
        raise FileNotFoundError(f"{name}: there is no file {found}")
    return found


def maybe(check: Any, name: str, value: Any) -> Any:
    """What ``check`` takes, or nothing."""
    return None if value is None else check(name, value)


def items(name: str, value: Any, what: str) -> list[Any]:
    """The elements of a list, a tuple or the like; a text is none."""
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        raise TypeError(f"{name} is {value!r}; give a list of {what}")
    return list(value)


def mapping(name: str, value: Any, example: str) -> dict[str, Any]:
    """A dict with texts as its keys."""
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} is {value!r}; give a dict, for example {example}")
    for key in value:
        text(f"a key of {name}", key)
    return dict(value)


def threads(value: Any) -> int | None:
    """How many threads compute; nothing: as many as there are cores."""
    return None if value is None else count("threads", value, 1, MAX_THREADS)


def time_limit(max_seconds: Any) -> float | None:
    """How long a call may take, s; nothing: as long as it needs."""
    if max_seconds is None:
        return None
    seconds = real("max_seconds", max_seconds)
    if not seconds > 0.0:
        raise ValueError(f"max_seconds is {seconds}; it must be above 0")
    return seconds
