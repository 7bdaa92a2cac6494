"""Logs of files, and files of logs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from . import _gaitfit
from ._arguments import items, text
from ._arguments import path as named
from ._logs import Log


def read_log(path: str | os.PathLike[str], allow: Sequence[str] = ()) -> Log:
    """Reads a log, a CSV file as the program takes it, with the TOML file beside it if there is one.

    Arguments:
        path: The file.
        allow: Names of findings that are allowed (:attr:`Finding.kind`): the log is read in spite of them.

    Returns the log, joints in the file's order.

    Raises ``FileNotFoundError`` if there is no file, and :class:`gaitfit.GaitfitError` for a file that cannot be read (the message
    names the line) and for a log that ``gaitfit inspect`` forbids. It does not cut parts in which the robot falls, hangs or is
    stuck.

    >>> log = gaitfit.read_log("examples/go2-demo/fit.csv")
    >>> log.position.shape, log.dt
    ((1800, 12), 0.005)
    """
    names = [text("a name in allow", name) for name in items("allow", allow, "findings' names")]
    return Log(**_gaitfit.read_log(named("path", path), names))


def kept(log: Log, folder: Path) -> Path:
    """A file with the log in ``folder``: the same log has the same name, so that a run finds it again."""
    native = log.native()
    digest = hashlib.sha256()
    for name in sorted(native):
        value = native[name]
        digest.update(name.encode())
        digest.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    file = folder / f"log-{digest.hexdigest()[:16]}.csv"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        log.write(file)
    return file
