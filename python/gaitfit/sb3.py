"""Many robots as a vector environment of Stable-Baselines3. Needs ``stable-baselines3`` (``pip install "gaitfit[sb3]"``)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from ._needs import lacking

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as missing:
    raise lacking("sb3", "sb3", missing) from missing

from ._arguments import count
from ._given import Theta
from ._robots import Robots
from .config import Train
from .gym import _spaces

if TYPE_CHECKING:
    from ._policy_file import LoadedPolicy
else:
    from ._hints import LoadedPolicy

__all__ = ["Sb3VecEnv"]


class Sb3VecEnv(VecEnv):  # type: ignore[misc, unused-ignore]
    """Robots at a task as a ``VecEnv`` of Stable-Baselines3.

    Episodes that end begin anew within the same step. Their info has ``"terminal_observation"``, ``"TimeLimit.truncated"`` and
    ``"episode"`` (return ``r`` and length ``l``), as ``Monitor`` gives it. Arrays are copies. A learner that clips actions
    clips them to :attr:`gaitfit.Robots.action_bounds`.

    Arguments:
        config, num_envs, robot, policy, theta, settings, seed, threads: As for :class:`gaitfit.Robots`. ``stagger`` is on.

    >>> Sb3VecEnv(num_envs=8).reset().shape
    (8, 45)
    >>> from stable_baselines3 import PPO      # doctest: +SKIP
    >>> PPO("MlpPolicy", Sb3VecEnv(num_envs=64), n_steps=24).learn(1536)      # doctest: +SKIP
    """

    def __init__(
        self,
        config: str | os.PathLike[str] | Train | None = None,
        *,
        num_envs: int = 256,
        robot: str | os.PathLike[str] | None = None,
        policy: str | os.PathLike[str] | LoadedPolicy | None = None,
        theta: Theta | None = None,
        settings: Mapping[str, Any] | None = None,
        seed: int = 0,
        threads: int | None = None,
    ) -> None:
        def make(seed: int) -> Robots:
            return Robots(
                config,
                num_envs=num_envs,
                robot=robot,
                policy=policy,
                theta=theta,
                settings=settings,
                seed=seed,
                threads=threads,
                stagger=True,
            )

        self._make, self._robots = make, make(seed)
        self._actions: NDArray[np.float32] | None = None
        self._returns, self._lengths = np.zeros(num_envs), np.zeros(num_envs, np.int64)
        self.render_mode = None
        super().__init__(num_envs, *_spaces(self._robots))

    @property
    def robots(self) -> Robots:
        """The robots themselves, with the interface and task that a :class:`gaitfit.Policy` needs."""
        return self._robots

    def reset(self) -> NDArray[np.float32]:
        """New episodes; what the robots observe, shape ``(num_envs, observation)``."""
        seeds = [one for one in self._seeds if one is not None]
        if seeds:
            # Draws depend on one seed and an environment's number.
            self._robots = self._make(count("seed", seeds[0], 0))
        else:
            self._robots.reset()
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._copied(self._robots.observation)

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Takes actions, shape ``(num_envs, joints)``, for :meth:`step_wait`, which raises what is wrong with them as
        ``ValueError``."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One control period: observations, rewards, whose episode ended, and infos."""
        robots = self._robots
        if self._actions is None:
            raise RuntimeError("step_wait() comes after step_async()")
        ends = robots.step(self._actions)
        self._returns += robots.reward
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        done = robots.terminated | robots.truncated
        for index in np.flatnonzero(done) if ends else ():
            infos[index] = {
                "terminal_observation": robots.last_observation[index].copy(),
                "TimeLimit.truncated": bool(robots.truncated[index] and not robots.terminated[index]),
                "episode": {"r": float(self._returns[index]), "l": int(self._lengths[index])},
            }
        self._returns[done], self._lengths[done] = 0.0, 0
        return self._copied(robots.observation), self._copied(robots.reward), done, infos

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: None | int | Iterable[int] = None) -> list[Any]:
        """The attribute ``attr_name`` of :attr:`robots`, once for each of ``indices``. Raises ``AttributeError`` if there is none."""
        value = self.render_mode if attr_name == "render_mode" else getattr(self._robots, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: None | int | Iterable[int] = None) -> None:
        """Refused, whatever ``attr_name``, ``value`` and ``indices``: robots are stepped together and have no attributes of their
        own."""
        raise AttributeError(f"{attr_name} cannot be set for single robots: make the environment with other arguments")

    def env_method(
        self, method_name: str, *method_args: Any, indices: None | int | Iterable[int] = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refused, as :meth:`set_attr`: no ``method_name`` is called with ``method_args`` or ``method_kwargs`` on ``indices``."""
        raise AttributeError(f"single robots have no method {method_name}: use the attribute robots")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: None | int | Iterable[int] = None) -> list[bool]:
        """No robot of ``indices`` is in a ``wrapper_class``: returns ``False`` for each. Raises nothing."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Nothing is drawn."""
        return [None] * self.num_envs

    @staticmethod
    def _copied(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return array.copy()
