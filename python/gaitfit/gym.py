"""Many robots as a Gymnasium vector environment. Needs ``gymnasium`` (``pip install "gaitfit[gym]"``)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ._robots import Robots

# Actions are offsets from the default pose in units of the action scale; policies stay far inside.
_MOST_ACTION = 100.0


class GaitfitVecEnv(VectorEnv):
    """Robots at a task as a ``gymnasium.vector.VectorEnv``. Arguments as of :class:`gaitfit.Robots`.

    Episodes that end begin anew within the same step (``AutoresetMode.SAME_STEP``): ``infos["final_obs"]`` has what
    those robots observed before, ``infos["_final_obs"]`` which they are.
    ``copy=False`` hands out the environment's own arrays, which the next step writes over.
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
        copy: bool = True,
    ) -> None:
        self._arguments = {"config": config, "num_envs": num_envs, "robot": robot, "settings": settings, "threads": threads}
        self._copy = copy
        self._begin(seed)
        self.num_envs = num_envs
        width = self._robots.observation.shape[1]
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (width,), np.float32)
        self.single_action_space = spaces.Box(-_MOST_ACTION, _MOST_ACTION, (self._robots.num_actions,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.render_mode = None
        self.spec = None

    def _begin(self, seed: int) -> None:
        self._seed, self._fresh = seed, True
        self._robots = Robots(**self._arguments, seed=seed)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """New episodes; with a ``seed`` the same ones every time."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        if isinstance(seed, list):
            seed = next((one for one in seed if one is not None), None)
        if seed is not None and not (self._fresh and seed == self._seed):
            self._begin(seed)
        elif not self._fresh:
            self._robots.reset()
        self._fresh = False
        return self._out(self._robots.observation), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """One control period."""
        self._fresh = False
        robots, infos = self._robots, {}
        if robots.step(actions):
            ended = robots.terminated | robots.truncated
            final = np.full(self.num_envs, None, object)
            for index in np.flatnonzero(ended):
                final[index] = robots.last_observation[index].copy()
            infos = {"final_obs": final, "_final_obs": ended}
        return (
            self._out(robots.observation),
            self._out(robots.reward),
            self._out(robots.terminated),
            self._out(robots.truncated),
            infos,
        )

    def _out(self, array: NDArray[Any]) -> NDArray[Any]:
        return array.copy() if self._copy else array
