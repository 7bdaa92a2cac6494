"""Logs as arrays."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._arguments import finite, flag, items, mapping, maybe, real, text
from ._arguments import path as named
from ._arrays import numbers

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
else:
    from ._hints import Figure, pd

Array = NDArray[np.float64]

#: Matrices of a log with their columns in a file: a column for each joint, or a fixed list.
_OF_JOINTS = {"position": "q_", "velocity": "dq_", "target": "qdes_", "action": "act_"}
_FIXED = {
    "command": ("vx_cmd", "vy_cmd", "wz_cmd"),
    "base_position": ("base_pos_x", "base_pos_y", "base_pos_z"),
    "base_quaternion": ("base_quat_w", "base_quat_x", "base_quat_y", "base_quat_z"),
    "base_linear_velocity": ("base_vel_x", "base_vel_y", "base_vel_z"),
    "base_angular_velocity": ("wx", "wy", "wz"),
    "motion": ("motion_time", "motion_heading"),
}


@dataclass(frozen=True)
class Finding:
    """What :meth:`Log.check` found in a log.

    Attributes:
        kind: Its name, for example ``"time-gap"``; ``allow`` takes it.
        severity: ``"error"``: the log, or the part that is named, must not be used as it is. ``"warning"``: results may
            be worse. ``"note"``: worth knowing.
        message: What was found, in numbers, and what to do.
        joints: The joints concerned; empty if the finding is not about joints.
        samples: The samples concerned, ``log[samples]``; ``None``: the whole log.

    >>> log = gaitfit.Log.from_arrays(joints=["knee"], time=[0.0, 2.0, 1.0], position=[[0.0]] * 3, velocity=[[0.0]] * 3)
    >>> [finding.kind for finding in log.check()]
    ['non-monotonic-time', 'rate-mismatch']
    """

    kind: str
    severity: Literal["note", "warning", "error"]
    message: str
    joints: tuple[str, ...] = ()
    samples: slice | None = None


@dataclass(frozen=True, eq=False)
class Log:
    """One recorded run of the robot, joints in the order of ``joints``. :func:`read_log`, :meth:`from_arrays` and
    :meth:`from_dataframe` make one. Arrays are 64-bit; two logs are equal if all their numbers are.

    Attributes:
        position: Joint positions, rad, shape ``(samples, joints)``.
        velocity: Joint velocities, rad/s, shape ``(samples, joints)``.
        action: The policy's actions, unitless, shape ``(samples, joints)``.
        target: Position targets of the PD controllers, rad, shape ``(samples, joints)``, each held until the next.
        dt: Time between samples, s.
        joints: Names of the joints.
        kp: Position gains, N·m/rad, shape ``(joints,)``.
        kd: Velocity gains, N·m·s/rad, shape ``(joints,)``.
        command: Commanded velocity ahead and to the left, m/s, and yaw rate, rad/s; shape ``(samples, 3)``.
        time: Times of the samples, s, shape ``(samples,)``.
        base_position: Position of the base, m, world frame, shape ``(samples, 3)``.
        base_quaternion: Its orientation, wxyz, shape ``(samples, 4)``.
        base_linear_velocity: Its velocity, m/s, world frame, shape ``(samples, 3)``.
        base_angular_velocity: Its angular velocity, as a gyroscope reads it, rad/s, body frame, shape ``(samples, 3)``.
        robot: Name of the robot.
        simulated_step: Physics step of the simulator that made the log, s; ``None`` for a real robot.
        fell: Whether the recording ends because the robot fell.
        motion: Place in the motion that the policy follows: its time, s, and the angle about the vertical by which it is turned, rad;
            shape ``(samples, 2)``.
        target_lead: How long after its sample a target was sent, s: the middle and the spread; ``None``: at the sample's time.
        velocity_joints: Names of joints whose targets are velocities, rad/s (wheels).

    Raises ``ValueError`` for arrays whose shapes do not fit together, and ``TypeError`` for a value that is not an array of numbers.

    >>> log = gaitfit.read_log("examples/go2-demo/fit.csv")
    >>> len(log), log.position.shape, len(log[:200])
    (1800, (1800, 12), 200)
    """

    position: Array
    velocity: Array
    action: Array | None = None
    target: Array | None = None
    dt: float | None = None
    joints: Sequence[str] | None = None
    kp: Array | None = None
    kd: Array | None = None
    command: Array | None = None
    time: Array | None = None
    base_position: Array | None = None
    base_quaternion: Array | None = None
    base_linear_velocity: Array | None = None
    base_angular_velocity: Array | None = None
    robot: str | None = None
    simulated_step: float | None = None
    fell: bool = False
    motion: Array | None = None
    target_lead: tuple[float, float] | None = None
    velocity_joints: Sequence[str] = ()

    def __post_init__(self) -> None:
        checked: dict[str, Any] = {}
        for name in (*_OF_JOINTS, *_FIXED):
            value = getattr(self, name)
            checked[name] = None if value is None else numbers(name, value, np.float64)
        position = checked["position"]
        if position is None or position.ndim != 2:
            shape = None if position is None else position.shape
            raise ValueError(f"position has the shape {shape}; needed: samples × joints")
        samples, joints = position.shape
        for name, value in checked.items():
            width = len(_FIXED[name]) if name in _FIXED else joints
            if name == "velocity" and value is None:
                raise ValueError("velocity is None; needed: samples × joints")
            if value is not None and value.shape != (samples, width):
                what = f"samples × {width}" if name in _FIXED else "samples × joints"
                raise ValueError(f"{name} has the shape {value.shape}; needed: {what} = {(samples, width)}, as position has")
        for name, count in (("kp", joints), ("kd", joints), ("time", samples)):
            value = getattr(self, name)
            checked[name] = None if value is None else numbers(name, value, np.float64)
            if name != "time" and checked[name] is not None and checked[name].ndim == 0:
                checked[name] = np.full(joints, checked[name])
            if checked[name] is not None and checked[name].shape != (count,):
                raise ValueError(f"{name} has the shape {checked[name].shape}; needed: {(count,)}")
        if (self.kp is None) != (self.kd is None):
            given, absent = ("kp", "kd") if self.kd is None else ("kd", "kp")
            raise ValueError(f"{given} is given without {absent}: give both gains of the PD controllers, or none")
        if self.joints is not None:
            names = [text("a name in joints", one) for one in items("joints", self.joints, "joints' names")]
            if len(names) != joints:
                raise ValueError(f"joints has {len(names)} names, and position has {joints} columns")
            checked["joints"] = names
        if self.dt is not None and not finite("dt", self.dt) > 0:
            raise ValueError(f"dt is {self.dt}; it must be above 0")
        flag("fell", self.fell)
        if self.target_lead is not None:
            lead = [finite("target_lead", one) for one in items("target_lead", self.target_lead, "numbers")]
            if len(lead) != 2:
                raise ValueError(f"target_lead has {len(lead)} numbers; needed: the middle and the spread, s")
            checked["target_lead"] = (lead[0], lead[1])
        wheels = items("velocity_joints", self.velocity_joints, "joints' names")
        checked["velocity_joints"] = tuple(text("a name in velocity_joints", one) for one in wheels)
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_arrays(
        cls,
        *,
        joints: Sequence[str],
        position: ArrayLike,
        velocity: ArrayLike,
        dt: float | None = None,
        time: ArrayLike | None = None,
        target: ArrayLike | None = None,
        action: ArrayLike | None = None,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        command: ArrayLike | None = None,
        base_position: ArrayLike | None = None,
        base_quaternion: ArrayLike | None = None,
        base_linear_velocity: ArrayLike | None = None,
        base_angular_velocity: ArrayLike | None = None,
        robot: str | None = None,
        motion: ArrayLike | None = None,
        target_lead: tuple[float, float] | None = None,
        velocity_joints: Sequence[str] = (),
        simulated_step: float | None = None,
        fell: bool = False,
    ) -> Log:
        """Makes a log from arrays or lists, with the shapes and units of the fields. It needs ``dt`` or ``time``; ``kp`` and
        ``kd`` are one number for all joints, or one for each.

        Arguments:
            joints, position, velocity, dt, time, target, action, command, robot: As the fields.
            kp, kd: As the fields, or one number for all joints.
            base_position, base_quaternion, base_linear_velocity, base_angular_velocity: As the fields.
            motion, target_lead, velocity_joints, fell: As the fields.
            simulated_step: Physics step of your simulator, s; ``None`` for a real robot. The velocities of a simulator lag by half a
                step, and no check calls this a fault then.

        Raises ``ValueError`` for shapes that do not fit together.

        >>> log = Log.from_arrays(joints=["knee"], dt=0.01, position=[[0.0], [0.1]], velocity=[[10.0], [10.0]])
        >>> len(log), log.time
        (2, array([0.  , 0.01]))
        """
        q = numbers("position", position, np.float64)
        if time is None:
            if dt is None:
                raise ValueError("neither dt nor time is given: give the time between samples, s, or the samples' times")
            time = np.arange(len(q)) * finite("dt", dt)
        arrays: dict[str, ArrayLike | None] = {
            **{"velocity": velocity, "target": target, "action": action, "kp": kp, "kd": kd, "command": command},
            **{"time": time, "base_position": base_position, "base_quaternion": base_quaternion},
            **{"base_linear_velocity": base_linear_velocity, "base_angular_velocity": base_angular_velocity},
            "motion": motion,
        }
        given: dict[str, Any] = {name: None if one is None else numbers(name, one, np.float64) for name, one in arrays.items()}
        spacing = _spacing(given["time"]) if dt is None else dt
        named: dict[str, Any] = {"robot": robot, "target_lead": target_lead, "velocity_joints": velocity_joints}
        named |= {"simulated_step": simulated_step, "fell": fell}
        return cls(position=q, joints=joints, dt=spacing, **named, **given)

    @classmethod
    def from_dataframe(
        cls,
        table: Any,
        *,
        dt: float | None = None,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        robot: str | None = None,
        names: Mapping[str, str] | None = None,
        target_lead: tuple[float, float] | None = None,
        velocity_joints: Sequence[str] = (),
        simulated_step: float | None = None,
        fell: bool = False,
    ) -> Log:
        """Makes a log from a table with the columns of a CSV log. Other columns are left out.

        Each joint J, named as in the robot's file, has the columns ``q_J``, its position, rad, and ``dq_J``, its velocity, rad/s.
        A fit also needs ``qdes_J``, the target that the joint was sent, rad; walks may have ``act_J``, the policy's action,
        instead. ``time`` is in s. The base may have ``base_quat_w`` to ``base_quat_z`` (orientation), ``wx``, ``wy``, ``wz``
        (gyroscope, rad/s), ``base_pos_x`` … (m) and ``base_vel_x`` … (m/s), world frame. Commands are ``vx_cmd``, ``vy_cmd`` (m/s)
        and ``wz_cmd`` (rad/s). Logs of a policy that follows a motion have ``motion_time`` (s) and ``motion_heading`` (rad).

        Arguments:
            table: A table of pandas or polars, or a dict of columns.
            dt: Time between samples, s; needed without ``time``.
            kp: Position gains of the PD controllers, N·m/rad: one for all joints, or one for each in the columns' order.
            kd: Velocity gains, N·m·s/rad, likewise.
            robot: Name of the robot.
            names: Names of columns in the table, each with its name in a log: ``{"t": "time", "knee_pos": "q_knee"}``. Other
                columns keep their names.
            target_lead, velocity_joints, simulated_step, fell: As for :meth:`from_arrays`.

        Raises ``ValueError`` if a column is missing.

        >>> log = Log.from_dataframe({"time": [0.0, 0.1], "q_knee": [0.0, 1.0], "dq_knee": [10.0, 10.0]})
        >>> log.joints, log.dt
        (['knee'], 0.1)
        """
        own = [str(name) for name in (table if isinstance(table, Mapping) else getattr(table, "columns", ()))]
        renamed = {} if names is None else mapping("names", names, '{"t": "time"}')
        unknown = [name for name in renamed if name not in own]
        if unknown:
            raise ValueError(f"names has {unknown[0]!r}, which is no column of the table; it has {', '.join(own)}")
        table = {renamed.get(name, name): table[name] for name in own}
        columns_there = list(table)
        joints = [name[2:] for name in columns_there if name.startswith("q_")]
        if not joints:
            raise ValueError(f"the table has no column q_J, a joint's position; it has {', '.join(columns_there) or 'no columns'}")

        def matrix(columns: Sequence[str], needed: bool) -> Any:
            missing = [name for name in columns if name not in columns_there]
            if missing and (needed or len(missing) < len(columns)):
                beside = next((name for name in columns if name in columns_there), f"q_{joints[0]}")
                raise ValueError(f"the table has no column {missing[0]}; a log needs it beside {beside}")
            return None if missing else np.column_stack([numbers(name, table[name], np.float64) for name in columns])

        arrays = {
            name: matrix([f"{prefix}{joint}" for joint in joints], name in ("position", "velocity"))
            for name, prefix in _OF_JOINTS.items()
        }
        arrays |= {name: matrix(columns, False) for name, columns in _FIXED.items()}
        time = numbers("time", table["time"], np.float64) if "time" in columns_there else None
        known: dict[str, Any] = {"robot": robot, "target_lead": target_lead, "velocity_joints": velocity_joints}
        known |= {"simulated_step": simulated_step, "fell": fell}
        return cls.from_arrays(joints=joints, dt=dt, time=time, kp=kp, kd=kd, **known, **arrays)

    def __len__(self) -> int:
        return len(self.position)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Log):
            return NotImplemented
        pairs = [(getattr(self, one.name), getattr(other, one.name)) for one in fields(self)]
        return all(_same(mine, theirs) for mine, theirs in pairs)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        have = [name for name in (*_OF_JOINTS, *_FIXED) if getattr(self, name) is not None]
        joints = self.position.shape[1]
        return f"Log({len(self)} samples, {joints} joints, dt={self.dt}, {', '.join(have)})"

    def __getitem__(self, samples: slice) -> Log:
        """A stretch of the log: ``log[200:1000]``."""
        if not isinstance(samples, slice):
            raise TypeError("a log is cut by a slice of samples, for example log[200:1000]")
        cut = {one.name: getattr(self, one.name) for one in fields(self)}
        for name in (*_OF_JOINTS, *_FIXED, "time"):
            cut[name] = None if cut[name] is None else cut[name][samples]
        cut["dt"] = None if self.dt is None else self.dt * (samples.step or 1)
        if self.fell and samples.indices(len(self))[1] < len(self):
            cut["fell"] = False
        return Log(**cut)

    def between(self, start: float | None = None, end: float | None = None) -> Log:
        """The samples from the time ``start`` to before ``end``, s, by the log's own clock (:attr:`time`; without it, time begins at
        0).
        Raises ``ValueError`` for a log without ``dt`` and ``time``.

        >>> log = Log.from_arrays(joints=["a"], dt=0.5, position=[[0.0]] * 6, velocity=[[0.0]] * 6)
        >>> log.between(1.0, 2.0).time
        array([1. , 1.5])
        """
        times = self._times()
        first = 0 if start is None else int(np.searchsorted(times, real("start", start)))
        last = len(self) if end is None else int(np.searchsorted(times, real("end", end)))
        return self[first:last]

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        times = self._times()
        return float(times[-1] - times[0]) if len(times) else 0.0

    def columns(self) -> dict[str, Array]:
        """The log as columns named as in its file (``q_FL_hip``), each of shape ``(samples,)``, for ``pandas.DataFrame`` or
        ``polars.DataFrame``."""
        joints = self.joints or [str(number) for number in range(self.position.shape[1])]
        columns: dict[str, Array] = {} if self.time is None else {"time": self.time}
        for name, prefix in _OF_JOINTS.items():
            values = getattr(self, name)
            if values is not None:
                columns.update({f"{prefix}{joint}": values[:, at] for at, joint in enumerate(joints)})
        for name, names in _FIXED.items():
            values = getattr(self, name)
            if values is not None:
                columns.update({column: values[:, at] for at, column in enumerate(names)})
        return columns

    def to_dataframe(self) -> pd.DataFrame:
        """:meth:`columns` as a ``pandas.DataFrame``. Raises ``ImportError`` without pandas."""
        try:
            import pandas
        except ImportError as missing:
            raise ImportError("to_dataframe() needs pandas: pip install pandas. columns() needs nothing") from missing
        return pandas.DataFrame(self.columns())

    def check(self) -> tuple[Finding, ...]:
        """The findings of ``gaitfit inspect`` in the log, the worst first: units, gaps, joints that do not follow,
        falls. Needs ``joints``, and ``dt`` or ``time``.

        >>> for finding in log.check():      # doctest: +SKIP
        ...     print(finding.severity, finding.kind, finding.message)
        """
        found = json.loads(_gaitfit.check_log(self.native()))
        order = ("error", "warning", "note")
        return tuple(sorted((_finding(one) for one in found), key=lambda one: order.index(one.severity)))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the log as CSV to ``path``; :func:`read_log` reads the same log again. Needs ``joints``, and ``dt`` or ``time``.

        Raises :class:`gaitfit.GaitfitError` for a log that lacks them, and ``FileNotFoundError`` or ``PermissionError`` where the
        file cannot be written.
        """
        _gaitfit.write_log(named("path", path), self.native())

    def plot(self, joints: Sequence[str] | None = None) -> Figure:
        """Draws position and target of some ``joints``, by default of the first three, over time (:func:`gaitfit.plots.log`). Needs
        ``matplotlib``.

        Raises ``ValueError`` for a joint that the log does not have."""
        from .plots import log

        return log(self, joints)

    def _times(self) -> Array:
        if self.time is not None:
            return self.time
        if self.dt is None:
            raise ValueError("the log has neither time nor dt: give one of them, s")
        return np.arange(len(self), dtype=np.float64) * self.dt

    def native(self) -> dict[str, Any]:
        """The log as the native half takes it."""
        if self.joints is None:
            raise ValueError("the log does not name its joints: give joints=[...], one name for each column")
        times = self._times()
        dt = _spacing(times) if self.dt is None else self.dt
        if dt is None:
            raise ValueError("the log has one sample and no dt: give the time between samples, s")
        given = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in ("dt", "time")}
        gains = {name: None if given[name] is None else given[name].tolist() for name in ("kp", "kd")}
        step = maybe(finite, "simulated_step", self.simulated_step)
        joints = list(self.joints)
        whole = {"joints": joints, "velocity_joints": list(self.velocity_joints), "simulated_step": step}
        return {**given, **gains, **whole, "time": times, "rate_hz": 1.0 / dt}


def _finding(found: Mapping[str, Any]) -> Finding:
    span = found.get("span")
    samples = None if span is None else slice(span["start"], span["end"])
    return Finding(found["kind"], found["severity"], found["message"], tuple(found["joints"]), samples)


def _spacing(times: Array) -> float | None:
    """The middle time between samples, s."""
    # Times of a log are sums with rounding errors: 0.005, not 0.004999999999999893.
    return float(f"{np.median(np.diff(times)):.9g}") if len(times) > 1 else None


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    return bool(one == other) if not isinstance(one, np.ndarray) and not isinstance(other, np.ndarray) else False
