"""Terms of the user for robots on a GPU, as tensors of PyTorch there."""

from __future__ import annotations

from typing import Any

from ._robots import Robots
from ._robots_state import Motion
from ._terms import Terms

#: Arrays of robots that terms get as tensors.
ARRAYS = ("observation", "critic_observation", "last_observation", "reward", "terminated", "truncated", "commands")


class TensorRobots:
    """Robots on a GPU whose arrays are tensors there, without copies; everything else is theirs."""

    def __init__(self, torch: Any, robots: Robots) -> None:
        self._robots = robots
        for name in ARRAYS:
            setattr(self, name, torch.from_dlpack(getattr(robots, name)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robots, name)


class GpuTerms:
    """What :class:`Terms` are of robots on a GPU. All that is returned are tensors of their own."""

    def __init__(self, terms: Terms, robots: Robots) -> None:
        try:
            import torch
        except ImportError as missing:
            raise ImportError(f"terms of robots on a GPU get tensors of PyTorch, which is not here ({missing}); install torch") from missing
        self._torch: Any = torch
        self._terms, self._robots = terms, robots
        self._shown: Any = TensorRobots(self._torch, robots)

    def motion(self) -> Motion:
        """How the robots move, as tensors that the next call writes over."""
        return Motion(*map(self._torch.from_dlpack, vars(self._robots.motion(on_device=True)).values()))

    def rewarded(self, motion: Motion) -> Any:
        """As :meth:`Terms.rewarded`."""
        if self._terms.reward is None:
            return self._shown.reward.clone()
        found = self._numbers("the reward term", self._terms.reward(self._shown, motion))
        return self._one_each("the reward term", found, "finite numbers")

    def over(self, motion: Motion) -> Any:
        """As :meth:`Terms.over`."""
        if self._terms.terminated is None:
            return self._shown.terminated.clone()
        found = self._torch.as_tensor(self._terms.terminated(self._shown, motion), device=self._robots.device)
        if found.dtype != self._torch.bool:
            raise ValueError(f"the term terminated returned {found.dtype}; needed: ({self._robots.num_envs},) of bool")
        return self._one_each("the term terminated", found, "bool") | self._shown.terminated

    def truncated(self) -> Any:
        """Whose time is up."""
        return self._shown.truncated.clone()

    def clear(self, values: Any, mask: Any) -> None:
        """Makes the ``values`` of the robots of ``mask`` zeros."""
        values[self._torch.as_tensor(mask, device=values.device)] = 0

    def observed(self, motion: Motion) -> Any:
        """As :meth:`Terms.observed`."""
        if self._terms.observation is None:
            return self._shown.observation.clone()
        found = self._numbers("the observation term", self._terms.observation(self._shown, motion))
        if found.ndim == 1:
            found = found[:, None]
        if found.ndim != 2 or len(found) != self._robots.num_envs or not self._torch.isfinite(found).all():
            raise ValueError(
                f"the observation term returned the shape {tuple(found.shape)}; needed: ({self._robots.num_envs}, numbers), "
                "all finite"
            )
        return self._torch.cat([self._shown.observation, found], dim=1)

    def _numbers(self, what: str, found: Any) -> Any:
        try:
            return self._torch.as_tensor(found, dtype=self._torch.float32, device=self._robots.device)
        except (TypeError, ValueError, RuntimeError) as wrong:
            raise ValueError(f"{what} returned what is no tensor of numbers: {wrong}") from wrong

    def _one_each(self, what: str, found: Any, kind: str) -> Any:
        if tuple(found.shape) != (self._robots.num_envs,) or not self._torch.isfinite(found).all():
            raise ValueError(
                f"{what} returned the shape {tuple(found.shape)} and {found.dtype}; needed: ({self._robots.num_envs},) of {kind}"
            )
        return found
