"""Many robots as an environment of rsl_rl (3.0 or later). Needs ``torch``, ``tensordict`` and ``rsl-rl-lib``
(``pip install "gaitfit[rsl-rl]"``)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from torch.utils.dlpack import from_dlpack

from ._given import RobotsDevice, Theta
from ._robots import Robots
from .config import Train

if TYPE_CHECKING:
    from ._policy_file import LoadedPolicy
else:
    from ._hints import LoadedPolicy

__all__ = ["RslRlVecEnv"]


class RslRlVecEnv(VecEnv):  # type: ignore[misc, unused-ignore]
    """Robots at a task as rsl_rl's ``VecEnv``.

    Arguments:
        config, num_envs, robot, policy, theta, settings, seed, threads: As for :class:`gaitfit.Robots`. ``stagger`` is on.
        device: PyTorch's device, where the tensors are; the robots are stepped there, too.
        robots_device: Where the robots are stepped instead.

    ``extras["log"]`` has the reward terms of each step, ``"/reward/NAME"``, means over the robots.
    Observation groups are ``policy`` and, where the task has one, ``critic``. Tensors are copies on ``device``, since rsl_rl
    keeps them until its update. Robots are stepped on ``device`` too; with ``robots_device="cpu"`` they are stepped on the
    processor, and observations and actions cross the bus.

    >>> env = RslRlVecEnv(num_envs=8)
    >>> env.get_observations()["policy"].shape
    torch.Size([8, 45])
    """

    def __init__(
        self,
        config: str | os.PathLike[str] | Train | None = None,
        *,
        num_envs: int = 1024,
        robot: str | os.PathLike[str] | None = None,
        policy: str | os.PathLike[str] | LoadedPolicy | None = None,
        theta: Theta | None = None,
        settings: Mapping[str, Any] | None = None,
        seed: int = 0,
        threads: int | None = None,
        device: str = "cpu",
        robots_device: RobotsDevice | None = None,
    ) -> None:
        self._robots = Robots(
            config,
            num_envs=num_envs,
            robot=robot,
            policy=policy,
            theta=theta,
            settings=settings,
            seed=seed,
            threads=threads,
            stagger=True,
            device=cast(RobotsDevice, str(device)) if robots_device is None else robots_device,
        )
        self.num_envs = num_envs
        self.num_actions = self._robots.num_actions
        self.max_episode_length = self._robots.max_episode_length
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=device)
        self.device = device
        named = config.to_dict() if isinstance(config, Train) else None if config is None else os.fspath(config)
        self.cfg = {"config": named, "settings": dict(settings or {})}
        take = from_dlpack
        self._observation, self._critic = take(self._robots.observation), take(self._robots.critic_observation)
        self._reward, self._late = take(self._robots.reward), take(self._robots.truncated)

    @property
    def robots(self) -> Robots:
        """The robots themselves, with the interface and task that a :class:`gaitfit.Policy` needs."""
        return self._robots

    def get_observations(self) -> TensorDict:
        """What the robots observe now."""
        groups = {"policy": self._on(self._observation)}
        if self._critic.shape[1]:
            groups["critic"] = self._on(self._critic)
        return TensorDict(groups, batch_size=[self.num_envs], device=self.device)

    def reset(self) -> tuple[TensorDict, dict[str, Any]]:
        """New episodes."""
        self._robots.reset()
        self.episode_length_buf.zero_()
        return self.get_observations(), {}

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One control period under ``actions``, shape ``(num_envs, num_actions)``; episodes that end begin anew within it.

        Returns what the robots observe, rewards, whose episode ended, and extras. Raises as :meth:`gaitfit.Robots.step`.
        """
        robots = self._robots
        robots.step(actions.detach().to(robots.device, torch.float32).contiguous())
        ended = from_dlpack(robots.ended).to(self.device)
        self.episode_length_buf += 1
        self.episode_length_buf[ended] = 0
        found = self.get_observations()
        extras: dict[str, Any] = {"time_outs": self._on(self._late)}
        extras["log"] = {f"/reward/{name}": value for name, value in robots.reward_terms().items()}
        return found, self._on(self._reward), ended.to(torch.long), extras

    def _on(self, tensor: torch.Tensor) -> torch.Tensor:
        # rsl_rl keeps what it is given until the update; the robots write over their own.
        return tensor.to(self.device, copy=True)
