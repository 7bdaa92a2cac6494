"""Many robots at a task."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _gaitfit
from ._arguments import count as whole
from ._arguments import flag, maybe, path, text
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

    ``device`` is ``"cpu"`` or ``"cuda"`` (``"cuda:1"``: the second GPU). On a GPU all robots are stepped there, and the
    arrays are :class:`gaitfit.DeviceArray` in its memory: ``torch.from_dlpack(robots.observation)`` takes one without a
    copy. Robots, commands, starts and noise are the processor's, motions differ by rounding. ``threads`` is of no effect.

    ``interface`` and ``task`` are what a :class:`gaitfit.Policy` trained on them needs. The arrays that :meth:`step` fills are the same ones at every call: copy what must last.
    """

    #: What robots show, arrays of NumPy or, on a GPU, :class:`gaitfit.DeviceArray`. They are written over at every step.
    observation: Any
    critic_observation: Any
    last_observation: Any
    reward: Any
    terminated: Any
    truncated: Any

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
        device: str = "cpu",
    ) -> None:
        num_envs, seed = whole("num_envs", num_envs, 1), whole("seed", seed, 0)
        files = {name: maybe(path, name, value) for name, value in (("config", config), ("robot", robot))}
        sets, threads, stagger = _sets(settings or {}), checked(threads), flag("stagger", stagger)
        task = _gaitfit.Task(files["config"], sets, files["robot"])
        on_gpu = text("device", device) != "cpu"
        self._gpu = _gaitfit.CudaRobots(task, num_envs, seed, stagger, device) if on_gpu else None
        self._robots: Any = self._gpu or _gaitfit.Robots(task, num_envs, seed, threads, stagger)
        self.num_envs: int = num_envs
        self.num_actions: int = task.action_width
        self.joints: list[str] = task.joints
        #: For each joint the smallest and the largest action that makes a difference, shape ``(num_actions, 2)``: from the
        #: joint's range, what the motor's torque needs beyond it, and the action's clip. Other actions are taken, too.
        self.action_bounds: NDArray[np.float32] = np.asarray(task.action_bounds, np.float32)
        self.control_dt: float = task.control_dt
        self.max_episode_length: int = task.episode_steps
        self.reward_names: list[str] = task.rewards
        self.interface: Interface = interface_of(task.interface)
        self.task: str = task.settings
        self.device: str = "cpu" if self._gpu is None else f"cuda:{self._gpu.device}"
        if self._gpu is not None:
            for name in ("observation", "critic_observation", "last_observation", "reward", "terminated", "truncated"):
                setattr(self, name, self._gpu.array(name))
        else:
            self._make_arrays(task.observation_width, task.critic_width)

    def _make_arrays(self, observation: int, critic: int) -> None:
        count = self.num_envs
        self.observation = np.zeros((count, observation), np.float32)
        self.critic_observation = np.zeros((count, critic), np.float32)
        self.last_observation = np.zeros_like(self.observation)
        self.reward = np.zeros(count, np.float32)
        self.terminated, self.truncated = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._observe()

    def _observe(self) -> None:
        self._robots.observe(self.observation, self.critic_observation)

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("robots cannot be pickled: their state is the engine's own. Make them anew in each process")

    def reset(self) -> Any:
        """New episodes for all; what the robots observe, shape ``(num_envs, observation)``. On a GPU it waits first for all
        that this process does there.
        """
        self._robots.restart()
        if self._gpu is None:
            self._observe()
        return self.observation

    def step(self, actions: Any) -> int:
        """One control period under ``actions``, shape ``(num_envs, num_actions)``, unitless, in the order of
        :attr:`joints`. Fills :attr:`observation` and :attr:`critic_observation` (of the new episode where one ended),
        :attr:`last_observation` (of the ended one; other rows are left as they were), :attr:`reward`,
        :attr:`terminated` (it fell) and :attr:`truncated` (time is up). Returns how many episodes ended.

        A robot whose simulation diverged counts as one that fell: its reward is 0, and so is its row of
        :attr:`last_observation`. :attr:`diverged` counts them.

        On a GPU ``actions`` are an array of another library there, 32-bit floats in one block, and are read where they lie, by
        DLPack (``__dlpack__``). They may be computed on any stream: the step waits for its library's present one, and so for
        what was begun there before, also for reading of the robots' arrays. The step is done when this returns.

        Raises ``ValueError`` for actions of a wrong shape or not finite, :class:`GaitfitError` if more than ten robots, and
        more than one in a hundred, diverged in the step: the simulation is broken then.
        """
        if self._gpu is not None:
            shape = (self.num_envs, self.num_actions)
            return self._gpu.step(
                _gaitfit.DeviceInput("actions", actions, shape, self._gpu.device, self._gpu.stream)
            )
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
    def ended(self) -> Any:
        """Whose episode ended in the last step, in either way; shape ``(num_envs,)``."""
        return self.terminated | self.truncated if self._gpu is None else self._gpu.array("ended")

    @property
    def commands(self) -> Any:
        """What the robots are asked to do: ahead and to the side, m/s, and turning, rad/s; shape ``(num_envs, 3)``."""
        if self._gpu is not None:
            return self._gpu.array("commands")
        return np.asarray(self._robots.commands(), np.float32)
