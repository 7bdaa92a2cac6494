"""Observations of a policy from what sensors read, for a loop of the user."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._arguments import count
from ._policy import Interface

Array = NDArray[np.float32]


class Observer:
    """Makes the observations of a policy from the sensor readings of your robot or simulator, for a loop of your own: the terms in
    their order, scaled, joint positions less the default pose, and past frames.

    Arguments:
        interface: What the policy sees: ``gaitfit.load_policy(file).interface``.

    Call it once each ``control_dt``. It remembers past frames, the action before the last, and the time since :meth:`reset`. Of a
    policy that follows a motion it fills in the motion, which begins at :meth:`reset` and is turned to face as the robot does then.

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
        self._native = _gaitfit.Observer(interface.to_json())
        self._widths = dict(self._native.quantities())
        #: Names of the quantities that a call takes.
        self.quantities: list[str] = list(self._widths)

    def reset(self, rows: Iterable[int] | None = None) -> None:
        """Begins new episodes: past frames, actions and time are forgotten. ``rows`` are the numbers of the robots whose episodes
        begin; by default those of all robots begin.

        Raises ``IndexError`` for a number that no observed robot has.
        """
        self._native.reset(None if rows is None else [count("a row", row, 0) for row in rows])

    def __call__(self, **quantities: ArrayLike) -> Array:
        """The observation of this control period.

        Arguments:
            quantities: All of :attr:`quantities` by name, as :class:`gaitfit.Term` lists them, unscaled: each of its numbers, or
                of shape ``(robots, numbers)``. ``joint_position`` is what the encoders read, rad; ``base_quaternion``, by which a
                motion is turned, is the base's orientation, wxyz. ``last_action`` is the policy's last action, zeros at first.
                Joints are in the order of ``interface.joints``.

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
        read = {name: self._read(name, quantities[name]) for name in self.quantities}
        several = {len(array) for array in read.values() if array.ndim == 2}
        if len(several) > 1:
            raise ValueError(f"the quantities are of different numbers of robots: {({n: a.shape for n, a in read.items()})}")
        robots = several.pop() if several else 1
        is_one = all(array.ndim == 1 for array in read.values())
        if self._native.robots not in (0, robots):
            raise ValueError(f"there are {robots} robots; there were {self._native.robots}: call reset() first")
        rows = self._native.observe(robots, [np.atleast_2d(array) for array in read.values()])
        row: Array = rows[0] if is_one else rows
        return row

    def _read(self, name: str, value: ArrayLike) -> Array:
        array = np.asarray(value, np.float32)
        width = self._widths[name]
        if name == "base_height" and array.ndim == 0:
            array = array[None]
        if array.ndim not in (1, 2) or array.shape[-1] != width or not np.isfinite(array).all():
            raise ValueError(f"{name} has the shape {array.shape}; needed: ({width},) or (robots, {width}), all finite")
        return array
