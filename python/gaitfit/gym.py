"""Robots as Gymnasium environments: many as a vector environment, or one. Needs ``gymnasium``
(``pip install "gaitfit[gym]"``).

``gymnasium.make("gaitfit.gym:gaitfit/Go2-v0")`` is one built-in Go2 at its task, and ``gymnasium.make_vec`` many.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ._arguments import count, flag
from ._arrays import numbers
from ._robots import Robots

def _spaces(robots: Robots) -> tuple[spaces.Box, spaces.Box]:
    """Of one robot: what it observes, and the actions that it can use."""
    low, high = robots.action_bounds.T
    return (
        spaces.Box(-np.inf, np.inf, (robots.observation.shape[1],), np.float32),
        spaces.Box(low, high, dtype=np.float32),
    )


class GaitfitVecEnv(VectorEnv):
    """Robots at a task as a ``gymnasium.vector.VectorEnv``. Arguments as of :class:`gaitfit.Robots`.

    Episodes that end begin anew within the same step (``AutoresetMode.SAME_STEP``): ``infos["final_obs"]`` has what
    those robots observed before, ``infos["_final_obs"]`` which they are. A robot whose simulation diverged has fallen: it is
    terminated, and begins anew. The action space is :attr:`gaitfit.Robots.action_bounds`.
    ``copy=False`` hands out the environment's own arrays, without copies; the next step writes over them.

    With ``device="cuda"`` all robots are stepped on a GPU. Actions are an array of another library there, and what comes back
    are the environment's own :class:`gaitfit.DeviceArray`, without copies: ``copy`` must be ``False``.
    ``infos["final_obs"]`` is one array of all robots' last observations, ``infos["_final_obs"]`` says whose are new.
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
        copy: bool | None = None,
        device: str = "cpu",
    ) -> None:
        self._arguments = {
            "config": config,
            "num_envs": num_envs,
            "robot": robot,
            "settings": settings,
            "threads": threads,
            "device": device,
        }
        self._copy = device == "cpu" if copy is None else flag("copy", copy)
        if self._copy and device != "cpu":
            raise ValueError("copy is True; robots on a GPU hand out their own arrays: give copy=False")
        self._begin(seed)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces(self._robots)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.render_mode = None
        self.spec = None

    def _begin(self, seed: int) -> None:
        self._robots = Robots(**self._arguments, seed=seed)
        self._seed, self._fresh = seed, True

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """New episodes; with a ``seed`` the same ones every time. Of several seeds the first counts."""
        if isinstance(seed, (list, tuple)):
            # One seed is enough: draws depend on it and on an environment's number.
            seed = next((one for one in seed if one is not None), None)
        seed = None if seed is None else count("seed", seed, 0)
        super().reset(seed=seed)
        if seed is not None and not (self._fresh and seed == self._seed):
            self._begin(seed)
        elif not self._fresh:
            self._robots.reset()
        self._fresh = False
        return self._out(self._robots.observation), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One control period."""
        self._fresh = False
        robots, infos = self._robots, {}
        ends = robots.step(actions)
        if ends and robots.device != "cpu":
            infos = {"final_obs": robots.last_observation, "_final_obs": robots.ended}
        elif ends:
            ended = robots.ended
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

    def _out(self, array: Any) -> Any:
        return array.copy() if self._copy else array


class GaitfitEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One robot at a task as a ``gymnasium.Env``. Arguments as of :class:`gaitfit.Robots`. For trying things out: the
    engine steps hundreds of robots in the time of some ten.

    Observations have the shape ``(observation,)``, actions ``(joints,)``, unitless; the action space is
    :attr:`gaitfit.Robots.action_bounds`. A robot whose simulation diverged has fallen: it is terminated.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        config: str | os.PathLike[str] | None = None,
        *,
        robot: str | os.PathLike[str] | None = None,
        settings: Mapping[str, Any] | None = None,
        seed: int = 0,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode is {render_mode!r}; this environment draws nothing: give None")
        self._arguments = {"config": config, "robot": robot, "settings": settings, "num_envs": 1, "threads": 1}
        self._begin(seed)
        self.observation_space, self.action_space = _spaces(self._robots)
        self.render_mode = None

    def _begin(self, seed: int) -> None:
        # What the robots begin with is an episode already.
        self._robots = Robots(**self._arguments, seed=seed)
        self._seed, self._fresh = seed, True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """A new episode; with a ``seed`` the same one every time."""
        super().reset(seed=seed)
        if seed is not None and not (self._fresh and seed == self._seed):
            self._begin(seed)
        elif not self._fresh:
            self._robots.reset()
        self._fresh = False
        return self._robots.observation[0].copy(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One control period."""
        robots = self._robots
        action = numbers("action", action, np.float32)
        if action.shape != self.action_space.shape:
            raise ValueError(f"the action has the shape {action.shape}; needed: {self.action_space.shape}")
        ended = robots.step(action[None, :])
        # The robots are in their next episode by then.
        if ended:
            self._seed, self._fresh = -1, True
        observation = (robots.last_observation if ended else robots.observation)[0].copy()
        return observation, float(robots.reward[0]), bool(robots.terminated[0]), bool(robots.truncated[0]), {}


gymnasium.register(
    "gaitfit/Go2-v0", entry_point="gaitfit.gym:GaitfitEnv", vector_entry_point="gaitfit.gym:GaitfitVecEnv"
)
