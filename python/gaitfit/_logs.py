"""Logs as arrays."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _gaitfit
from ._arguments import path as named


@dataclass(frozen=True)
class Log:
    """One recorded run of the robot, joints in the order of ``joints``.

    ``position``, rad, and ``velocity``, rad/s, have shape ``(samples, joints)``, and so have the policy's ``action``,
    unitless, and the position ``target``, rad, held from its sample to the next, where there are any. ``dt`` is the
    time between samples, s; ``kp``, N·m/rad, and ``kd``, N·m·s/rad, are the gains, shape ``(joints,)``; ``command`` is
    what the robot was asked to do, m/s, m/s and rad/s, shape ``(samples, 3)``; ``time`` is in s, shape ``(samples,)``.
    """

    position: ArrayLike
    velocity: ArrayLike
    action: ArrayLike | None = None
    target: ArrayLike | None = None
    dt: float | None = None
    joints: Sequence[str] | None = None
    kp: ArrayLike | None = None
    kd: ArrayLike | None = None
    command: ArrayLike | None = None
    time: ArrayLike | None = None

    def __getitem__(self, samples: slice) -> Log:
        """A stretch of the log: ``log[200:1000]``."""
        if not isinstance(samples, slice):
            raise TypeError("a log is cut by a slice of samples, for example log[200:1000]")
        rows = ("position", "velocity", "action", "target", "command", "time")
        cut = {name: getattr(self, name) for name in rows}
        cut = {name: None if value is None else np.asarray(value)[samples] for name, value in cut.items()}
        dt = None if self.dt is None else self.dt * (samples.step or 1)
        return Log(**cut, dt=dt, joints=self.joints, kp=self.kp, kd=self.kd)

    def columns(self) -> dict[str, Any]:
        """The log as columns named as in its file (``q_FL_hip``), for ``pandas.DataFrame`` or ``polars.DataFrame``."""
        joints = self.joints or [str(number) for number in range(np.asarray(self.position).shape[1])]
        columns: dict[str, Any] = {} if self.time is None else {"time": np.asarray(self.time)}
        for name, values in (("q", self.position), ("dq", self.velocity), ("qdes", self.target), ("act", self.action)):
            if values is not None:
                columns.update({f"{name}_{joint}": np.asarray(values)[:, at] for at, joint in enumerate(joints)})
        if self.command is not None:
            columns.update({name: np.asarray(self.command)[:, at] for at, name in enumerate(("vx_cmd", "vy_cmd", "wz_cmd"))})
        return columns


def read_log(path: str | os.PathLike[str], allow: Sequence[str] = ()) -> Log:
    """Reads a log, a CSV file as the program takes it, with the TOML file beside it if there is one.

    Raises :class:`gaitfit.GaitfitError` for a file that cannot be read, where the text names the line, and for a log that
    ``gaitfit inspect`` forbids; ``allow`` names findings that do not forbid it. Parts in which the robot falls, hangs or
    is stuck are yours to cut.
    """
    return Log(**_gaitfit.read_log(named("path", path), [str(name) for name in allow]))
