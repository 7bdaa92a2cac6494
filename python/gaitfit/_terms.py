"""Terms of the user: reward, end of an episode and observation as functions of all robots."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import numbers
from ._robots import Robots
from ._robots_state import Motion

#: What a term is: a function of all robots (:class:`gaitfit.Robots`, in a training :class:`gaitfit.TrainingRobots`) and their motion.
Function = Callable[[Any, Motion], ArrayLike]


@dataclass(frozen=True)
class Terms:
    """Functions of the user in a task's place, for :class:`gaitfit.gym.GaitfitVecEnv`, :func:`gaitfit.train` and
    :func:`gaitfit.finetune`. Each gets all :class:`gaitfit.Robots`, after their step, and their :class:`gaitfit.Motion`, and is
    called once a step. Trainings call them for up to 256 robots at a time, as :class:`gaitfit.TrainingRobots`, and take no
    ``observation``.

    For robots on a GPU the arrays of both are tensors of PyTorch there, and the functions return such tensors. The next step writes
    over the tensors of ``motion`` and ``robots``.

    Attributes:
        reward: The reward instead of the task's, shape ``(num_envs,)``; ``robots.reward`` is the task's.
        terminated: Which episodes end, besides those of robots that fell, shape ``(num_envs,)`` of bool.
        observation: Numbers that follow the task's observation, shape ``(num_envs, numbers)``, or ``(num_envs,)`` for one.

    >>> fast = Terms(reward=lambda robots, motion: robots.reward + 0.1 * motion.base_linear_velocity[:, 0])
    >>> low = Terms(terminated=lambda robots, motion: motion.base_position[:, 2] < 0.2)
    """

    reward: Function | None = None
    terminated: Function | None = None
    observation: Function | None = None

    def __post_init__(self) -> None:
        for name in ("reward", "terminated", "observation"):
            value = getattr(self, name)
            if value is not None and not callable(value):
                raise TypeError(f"{name} is {value!r}; give a function of robots and their motion")

    def rewarded(self, robots: Robots, motion: Motion) -> NDArray[np.float32]:
        """The rewards of ``robots`` with this ``motion``. A robot that diverged has begun a new episode, and functions see that
        one. Raises ``ValueError`` for a term that returns another shape or numbers that are not finite."""
        if self.reward is None:
            return robots.reward.copy()  # type: ignore[no-any-return]
        found = numbers("the reward term", self.reward(robots, motion), np.float32)
        return _one_each("the reward term", found, robots, np.isfinite(found).all())

    def over(self, robots: Robots, motion: Motion) -> NDArray[np.bool_]:
        """Which episodes of ``robots`` with this ``motion`` end, by a fall or by the term. Raises ``ValueError`` for a term that
        returns another shape or no bools."""
        if self.terminated is None:
            return robots.terminated.copy()  # type: ignore[no-any-return]
        found = np.asarray(self.terminated(robots, motion))
        ended: NDArray[np.bool_] = _one_each("the term terminated", found, robots, found.dtype == np.bool_) | robots.terminated
        return ended

    def observed(self, robots: Robots, motion: Motion) -> NDArray[np.float32]:
        """What ``robots`` with this ``motion`` observe, followed by the term's numbers. Raises ``ValueError`` for a term that returns
        another shape or numbers that are not finite."""
        if self.observation is None:
            return robots.observation.copy()  # type: ignore[no-any-return]
        found = numbers("the observation term", self.observation(robots, motion), np.float32)
        if found.ndim == 1:
            found = found[:, None]
        if found.ndim != 2 or len(found) != robots.num_envs or not np.isfinite(found).all():
            raise ValueError(
                f"the observation term returned the shape {found.shape}; needed: ({robots.num_envs}, numbers), all finite"
            )
        return np.concatenate([robots.observation, found], axis=1)


def _one_each(what: str, found: NDArray[Any], robots: Robots, sound: bool | np.bool_) -> NDArray[Any]:
    if found.shape != (robots.num_envs,) or not sound:
        kind = "bool" if "terminated" in what else "finite numbers"
        raise ValueError(f"{what} returned the shape {found.shape} and {found.dtype}; needed: ({robots.num_envs},) of {kind}")
    return found
