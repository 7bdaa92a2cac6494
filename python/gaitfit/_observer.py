"""Observations of a policy from what sensors read, for a loop of the user."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arguments import count
from ._policy import Interface, Term

Array = NDArray[np.float32]

#: Numbers of a quantity; one for each joint where none is stated.
_WIDTHS = {
    "base_angular_velocity": 3,
    "projected_gravity": 3,
    "command": 3,
    "base_linear_velocity": 3,
    "base_height": 1,
    "gait_phase": 2,
    "gait_sine": 1,
    "constant": 1,
    "reference_orientation": 6,
    "reference_phase": 1,
}
#: Quantities that the observer knows itself.
_KNOWN = {"gait_phase", "gait_sine", "constant", "earlier_action"}


class Observer:
    """Makes the observations of a policy from what your robot or simulator reads, for a loop of your own: the terms in their
    order, scaled, joint positions less the default pose, and past frames.

    Arguments:
        interface: What the policy sees: ``gaitfit.load_policy(file).interface``.

    Call it once each ``control_dt``. It remembers past frames, the action before the last, and the time since :meth:`reset`.

    >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
    >>> observer, action = gaitfit.Observer(policy.interface), np.zeros(12)
    >>> for _ in range(3):
    ...     observation = observer(
    ...         base_angular_velocity=[0.0, 0.0, 0.0],
    ...         projected_gravity=[0.0, 0.0, -1.0],
    ...         command=[0.5, 0.0, 0.0],
    ...         joint_position=policy.interface.default_pose,
    ...         joint_velocity=np.zeros(12),
    ...         last_action=action,
    ...     )
    ...     action = policy(observation)
    ...     targets = policy.interface.targets(action)      # rad, for the joints' PD controllers
    >>> observation.shape, targets.shape
    ((45,), (12,))
    """

    def __init__(self, interface: Interface) -> None:
        if not isinstance(interface, Interface):
            raise TypeError(f"interface is {interface!r}; give a gaitfit.Interface, for example that of a loaded policy")
        self._interface = interface
        self._terms = [Term(term) if isinstance(term, str) else term for term in interface.observation]
        self._widths = [_WIDTHS.get(term.quantity, len(interface.joints)) for term in self._terms]
        self._places = self._layout(interface.history.get("order", "terms"))
        #: Names of the quantities that a call takes.
        self.quantities: list[str] = list(dict.fromkeys(t.quantity for t in self._terms if t.quantity not in _KNOWN))
        if any(term.quantity == "earlier_action" for term in self._terms) and "last_action" not in self.quantities:
            self.quantities.append("last_action")
        self._steps: NDArray[np.int64] = np.zeros(0, np.int64)
        self._frames: list[Array] = []
        self._last = self._earlier = np.zeros((0, 0), np.float32)

    def _layout(self, order: str) -> list[list[int]]:
        """For each term where its frames begin in a row, the oldest first."""
        places, start, frame = [], 0, sum(self._widths)
        for term, width in zip(self._terms, self._widths):
            numbers = range(term.history)
            if order == "terms":
                places.append([start + number * width for number in numbers])
                start += term.history * width
            else:
                newest_first = order == "newest_first"
                places.append([start + (term.history - 1 - n if newest_first else n) * frame for n in numbers])
                start += width
        return places

    def reset(self, rows: Iterable[int] | None = None) -> None:
        """Episodes begin: past frames, actions and time are forgotten. ``rows`` are the numbers of these robots; without them
        all are.

        Raises ``IndexError`` for a robot that was not observed.
        """
        if rows is None:
            self._steps = np.zeros(0, np.int64)
            return
        for row in rows:
            self._steps[count("a row", row, 0)] = 0

    def __call__(self, **quantities: ArrayLike) -> Array:
        """The observation of this control period.

        Arguments:
            quantities: All of :attr:`quantities` by name, as :class:`gaitfit.Term` lists them, unscaled: each of its numbers, or
                of shape ``(robots, numbers)``. ``joint_position`` is what the encoders read, rad. ``last_action`` is the
                policy's last action, zeros at first. Joints are in the order of ``interface.joints``.

        Returns the row, shape ``(observation,)``, or with several robots ``(robots, observation)``.

        Raises ``TypeError`` for quantities that are missing or unknown, and ``ValueError`` for shapes that do not fit, numbers
        that are not finite, or another number of robots than before without :meth:`reset`.
        """
        for name in self.quantities:
            if name not in quantities:
                raise TypeError(f"{name} is missing; this policy observes {', '.join(self.quantities)}")
        for name in quantities:
            if name not in self.quantities:
                raise TypeError(f"{name} is not observed by this policy; it observes {', '.join(self.quantities)}")
        read = {name: self._read(name, value) for name, value in quantities.items()}
        several = any(array.ndim == 2 for array in read.values())
        robots = max((len(array) for array in read.values() if array.ndim == 2), default=1)
        if any(array.ndim == 2 and len(array) != robots for array in read.values()):
            raise ValueError(f"the quantities are of different numbers of robots: {({n: a.shape for n, a in read.items()})}")
        self._take(robots, read)
        for term, width, frames in zip(self._terms, self._widths, self._frames):
            value = np.broadcast_to(self._value(term.quantity, read), (robots, width))
            frames[:, :-1] = frames[:, 1:]
            frames[:, -1] = value * (1.0 if term.scale is None else np.asarray(term.scale, np.float32))
            begins = self._steps == 0
            zeros = self._interface.history.get("start", "first") == "zeros"
            frames[begins, :-1] = 0.0 if zeros else frames[begins, -1:]
        self._steps += 1
        row = np.zeros((robots, self._interface.observation_width), np.float32)
        for width, places, frames in zip(self._widths, self._places, self._frames):
            for number, place in enumerate(places):
                row[:, place : place + width] = frames[:, number]
        return row if several else row[0]

    def _read(self, name: str, value: ArrayLike) -> Array:
        array = np.asarray(value, np.float32)
        width = _WIDTHS.get(name, len(self._interface.joints))
        if name == "base_height" and array.ndim == 0:
            array = array[None]
        if array.ndim not in (1, 2) or array.shape[-1] != width or not np.isfinite(array).all():
            raise ValueError(f"{name} has the shape {array.shape}; needed: ({width},) or (robots, {width}), all finite")
        return array

    def _take(self, robots: int, read: dict[str, Array]) -> None:
        """Room for so many robots, and their actions."""
        if not len(self._steps):
            self._steps = np.zeros(robots, np.int64)
            self._frames = [np.zeros((robots, t.history, w), np.float32) for t, w in zip(self._terms, self._widths)]
            self._last = np.zeros((robots, len(self._interface.joints)), np.float32)
        if len(self._steps) != robots:
            raise ValueError(f"there are {robots} robots; there were {len(self._steps)}: call reset() first")
        if "last_action" in read:
            begins = (self._steps == 0)[:, None]
            self._earlier = np.where(begins, np.float32(0.0), self._last)
            self._last = np.broadcast_to(read["last_action"], self._last.shape).copy()

    def _value(self, quantity: str, read: dict[str, Array]) -> Any:
        interface = self._interface
        if quantity == "joint_position":
            return read[quantity] - np.asarray(interface.default_pose, np.float32)
        if quantity == "earlier_action":
            return self._earlier
        if quantity == "constant":
            return np.ones(1, np.float32)
        if quantity in ("gait_phase", "gait_sine"):
            turns = self._steps * interface.control_dt * (interface.gait_frequency or 0.0)
            angle = (2.0 * np.pi * (turns - np.trunc(turns)))[:, None]
            both = np.concatenate([np.sin(angle), np.cos(angle)], axis=1)
            return both if quantity == "gait_phase" else both[:, :1]
        return read[quantity]
