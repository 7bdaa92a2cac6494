"""Terms of the user in a training: functions of all robots of a tile, after each of their steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._policy import Interface, interface_of
from ._robots_state import Motion
from ._terms import Terms


class TrainingRobots:
    """Some robots of a training, as its terms see them after a step. It has those attributes of :class:`gaitfit.Robots` that do
    not depend on observations.

    Attributes:
        num_envs: How many robots.
        num_actions: Numbers of an action.
        joints: Their joints.
        interface: What the policy sees and does.
        control_dt: Time of a step, s.
        reward: What the task pays for the step, shape ``(num_envs,)``.
        terminated: Who fell, shape ``(num_envs,)``.
        truncated: Whose time is up, shape ``(num_envs,)``.
        commands: What the robots are asked to do: ahead and to the side, m/s, and turning, rad/s; shape ``(num_envs, 3)``.

    >>> def steady(robots, motion):
    ...     return robots.reward - 0.1 * robots.control_dt * np.abs(motion.base_angular_velocity[:, 0])
    """

    def __init__(
        self,
        interface: Interface,
        commands: NDArray[np.float32],
        reward: NDArray[np.float32],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> None:
        self.interface = interface
        self.joints: list[str] = list(interface.joints)
        self.num_envs, self.num_actions, self.control_dt = len(reward), len(self.joints), interface.control_dt
        self.commands, self.reward, self.terminated, self.truncated = commands, reward, terminated, truncated

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Whose episode ended in the step, in either way; shape ``(num_envs,)``."""
        return self.terminated | self.truncated

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"robots of a training have no {name!r} for terms; there are {', '.join(vars(self))} and ended")


class Called:
    """What the native half calls."""

    def __init__(self, terms: Terms) -> None:
        self._terms = terms
        self._interface: Interface | None = None

    def begin(self, interface: str) -> None:
        """The training begins; its policy sees and does this."""
        self._interface = interface_of(interface)

    def __call__(
        self,
        motion: Sequence[NDArray[np.float32]],
        commands: NDArray[np.float32],
        reward: NDArray[np.float32],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Rewards, and whose episode ends by a fall or by a term."""
        assert self._interface is not None, "begin() comes first"
        robots: Any = TrainingRobots(self._interface, commands, reward, terminated, truncated)
        moved = Motion(*motion)
        rewards = self._terms.rewarded(robots, moved)
        return np.ascontiguousarray(rewards), np.ascontiguousarray(self._terms.over(robots, moved))


def called(terms: Terms | None, device: str) -> Called | None:
    """Terms as the native half takes them. Raises ``TypeError`` and ``ValueError`` for what a training cannot have."""
    if terms is None:
        return None
    if not isinstance(terms, Terms):
        raise TypeError(f"terms is {terms!r}; give gaitfit.Terms(reward=..., terminated=...)")
    if terms.observation is not None:
        raise ValueError(
            "terms has an observation, which no policy's file can have: a policy that is trained here sees what its task names. "
            "Train it with a learner of your own on gaitfit.gym.GaitfitVecEnv(terms=terms)"
        )
    if device != "cpu":
        raise ValueError(
            f"device is {device!r}, and terms are functions of Python, which the processor calls: give device=\"cpu\". On a GPU "
            "write them as expressions, settings={\"task.terms.NAME\": \"...\", \"task.rewards.NAME\": 1.0}, or train with a "
            "learner of your own on gaitfit.gym.GaitfitVecEnv(device=\"cuda\", terms=terms)"
        )
    return Called(terms)
