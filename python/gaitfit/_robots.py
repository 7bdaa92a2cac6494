"""Many robots at a task."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._arguments import count as whole
from ._arguments import flag, maybe, path
from ._arguments import threads as checked
from ._arrays import numbers
from ._policy import Interface, interface_of
from ._stages import _sets


class Robots:
    """Many robots at the task of a training's configuration, stepped together by the program's own engine.

    ``config`` is a TOML file as ``gaitfit train`` takes (``gaitfit init ROBOT`` writes one); without it the robot is the
    built-in Go2 at its task. ``settings`` has single settings by name, for example
    ``{"task.noise.joint_position": 0.0}``. Draws depend on ``seed`` and an environment's number alone, not on
    ``threads``. ``stagger`` spreads the first episodes' ages, so that time-outs do not come in waves.

    ``interface`` and ``task`` are what a :class:`gaitfit.Policy` trained on them needs. The arrays that :meth:`step` returns are the same ones at every call: copy what must last.
    """

    def __init__(
        self,
        config: str | os.PathLike[str] | None = None,
        *,
        num_envs: int = 1024,
        robot: str | os.PathLike[str] | None = None,
        settings: Mapping[str, Any] | None = None,
        seed: int = 0,
        threads: int | None = None,
        stagger: bool = False,
    ) -> None:
        num_envs, seed = whole("num_envs", num_envs, 1), whole("seed", seed, 0)
        files = {name: maybe(path, name, value) for name, value in (("config", config), ("robot", robot))}
        sets, threads, stagger = _sets(settings or {}), checked(threads), flag("stagger", stagger)
        self._robots = _gaitfit.Robots(files["config"], sets, files["robot"], num_envs, seed, threads, stagger)
        count = self._robots.count
        self.num_envs: int = count
        self.num_actions: int = self._robots.action_width
        self.joints: list[str] = self._robots.joints
        self.control_dt: float = self._robots.control_dt
        self.max_episode_length: int = self._robots.episode_steps
        self.reward_names: list[str] = self._robots.rewards
        self.interface: Interface = interface_of(self._robots.interface)
        self.task: str = self._robots.task
        self.observation: NDArray[np.float32] = np.zeros((count, self._robots.observation_width), np.float32)
        self.critic_observation: NDArray[np.float32] = np.zeros((count, self._robots.critic_width), np.float32)
        self.last_observation: NDArray[np.float32] = np.zeros_like(self.observation)
        self.reward: NDArray[np.float32] = np.zeros(count, np.float32)
        self.terminated: NDArray[np.bool_] = np.zeros(count, np.bool_)
        self.truncated: NDArray[np.bool_] = np.zeros(count, np.bool_)
        self._robots.observe(self.observation, self.critic_observation)

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("robots cannot be pickled: their state is the engine's own. Make them anew in each process")

    def reset(self) -> NDArray[np.float32]:
        """New episodes for all; what the robots observe, shape ``(num_envs, observation)``."""
        self._robots.restart()
        self._robots.observe(self.observation, self.critic_observation)
        return self.observation

    def step(self, actions: ArrayLike) -> int:
        """One control period under ``actions``, shape ``(num_envs, num_actions)``, unitless, in the order of
        :attr:`joints`. Fills :attr:`observation` and :attr:`critic_observation` (of the new episode where one ended),
        :attr:`last_observation` (of the ended one; other rows are left as they were), :attr:`reward`,
        :attr:`terminated` (it fell) and :attr:`truncated` (time is up). Returns how many episodes ended.

        A robot whose simulation diverged counts as one that fell: its reward is 0, and so is its row of
        :attr:`last_observation`. :attr:`diverged` counts them.

        Raises ``ValueError`` for actions of a wrong shape or not finite, :class:`GaitfitError` if more than one robot in a
        hundred diverged in the step.
        """
        actions = numbers("actions", actions, np.float32)
        if actions.ndim != 2:
            raise ValueError(f"actions have the shape {actions.shape}; needed: {(self.num_envs, self.num_actions)}")
        return self._robots.step(
            actions,
            self.observation,
            self.critic_observation,
            self.last_observation,
            self.reward,
            self.terminated,
            self.truncated,
        )

    @property
    def diverged(self) -> int:
        """How many episodes ended because the simulation diverged."""
        return self._robots.diverged

    @property
    def commands(self) -> NDArray[np.float32]:
        """What the robots are asked to do: ahead and to the side, m/s, and turning, rad/s; shape ``(num_envs, 3)``."""
        return np.asarray(self._robots.commands(), np.float32)
