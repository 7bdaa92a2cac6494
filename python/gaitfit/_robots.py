"""Many robots at a task."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _gaitfit
from ._arguments import count as whole
from ._arguments import existing, flag, text
from ._arguments import threads as checked
from ._arrays import numbers
from ._given import RobotsDevice, Theta, configured, robot_of, theta_file
from ._given import sets as as_sets
from ._policy import Interface, interface_of
from ._settings import meant
from ._robots_state import Motion, RobotsState
from .config import Train

if TYPE_CHECKING:
    from ._policy_file import LoadedPolicy
else:
    from ._hints import LoadedPolicy


class Robots:
    """Many robots at the task of a training's configuration, stepped together by the program's own engine.

    Arguments:
        config: A TOML file as ``gaitfit train`` takes (``gaitfit init ROBOT`` writes one), or a
            :class:`gaitfit.config.Train`; without it the robot is the built-in Go2 at its task.
        num_envs: How many robots.
        robot: The robot's file, MJCF or URDF.
        policy: A policy's file or a :class:`gaitfit.LoadedPolicy`: its own task, in the place of ``config``. The robot is that of
            its file, also if the policy was trained in a fitted simulator: ``theta`` is that simulator.
        theta: What the robots are: a fit's result and more, as for :func:`gaitfit.finetune`. By default the robot of the file.
        settings: Single settings by name, for example ``{"task.noise.joint_position": 0.0}``.
        seed: Draws depend on it and on an environment's number alone, not on ``threads``.
        threads: Threads; by default one for each core. Of no effect on a GPU.
        stagger: Spread the first episodes' ages, so that time-outs do not come in waves.
        autoreset: Whether robots whose episode ended begin the next one within the step. ``False``: they stay as they are until
            :meth:`reset` with their mask; those that diverged begin anew all the same.
        device: ``"cpu"``, ``"cuda"`` (``"cuda:1"``: the second GPU), or ``"auto"``: a GPU if one is there. On a GPU all robots are
            stepped there, and the arrays are :class:`gaitfit.DeviceArray` in its memory:
            ``torch.from_dlpack(robots.observation)`` takes one without a copy. Robots, commands, starts and noise are the processor's; motions differ by rounding.

    Attributes:
        observation: What the robots observe, shape ``(num_envs, observation)``. :meth:`step` writes over this array and over the
            five arrays below, so copy what you keep.
        critic_observation: What a critic observes, shape ``(num_envs, critic)``.
        last_observation: The last observations of robots whose episode ended, shape ``(num_envs, observation)``.
        reward: Reward of the last step, shape ``(num_envs,)``.
        terminated: Which robots fell, shape ``(num_envs,)``.
        truncated: Which robots reached the time limit of their episode, shape ``(num_envs,)``.
        num_actions: Numbers of an action.
        joints: The joints of an action, in its order.
        action_bounds: For each joint the smallest and the largest action that makes a difference, shape ``(num_actions, 2)``.
            It follows from the joint's range, what the motor's torque needs beyond it, and the action's clip. Robots also take
            actions beyond these bounds.
        control_dt: Time of a step, s.
        max_episode_length: Steps of an episode.
        reward_names: Names of the reward terms.
        interface, task: What a :class:`gaitfit.Policy` that was trained on the robots needs.

    A loop with a policy and your own command:

    >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
    >>> robots = gaitfit.Robots(policy=policy, num_envs=2, settings={"task.terms.low": "height < 0.2", "task.rewards.low": -1.0})
    >>> for _ in range(3):
    ...     robots.commands = [0.5, 0.0, 0.0]
    ...     _ = robots.step(policy(robots.observation))
    >>> robots.reward_terms()["low"]
    0.0

    If two threads use the same robots at once, one of them gets a ``RuntimeError``.

    >>> robots = gaitfit.Robots(num_envs=4, seed=1)
    >>> robots.step(np.zeros((4, robots.num_actions)))
    0
    >>> robots.observation.shape[0], robots.reward.shape
    (4, (4,))
    """

    observation: Any
    critic_observation: Any
    last_observation: Any
    reward: Any
    terminated: Any
    truncated: Any

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
        stagger: bool = False,
        autoreset: bool = True,
        device: RobotsDevice = "cpu",
    ) -> None:
        num_envs, seed = whole("num_envs", num_envs, 1), whole("seed", seed, 0)
        model = robot_of(robot)
        if policy is not None:
            if config is not None:
                raise ValueError("config and policy are given, and each states a task: give one of them, and changes as settings")
            config = _task_of(policy)
        file, given = configured(config, Train, settings)
        threads, stagger, autoreset = checked(threads), flag("stagger", stagger), flag("autoreset", autoreset)
        task = _gaitfit.Task(existing("config", file), as_sets(given), model, theta_file(theta))
        where = _gaitfit.robots_device(text("device", device))
        on_gpu = where != "cpu"
        self._gpu = _gaitfit.CudaRobots(task, num_envs, seed, stagger, autoreset, where) if on_gpu else None
        #: The robots on the processor; with a GPU copies of its robots, made when they are first needed.
        self._copies: Any = None if on_gpu else _gaitfit.Robots(task, num_envs, seed, threads, stagger, autoreset)
        self._make_copies = partial(_gaitfit.Robots, task, num_envs, seed, threads, False, True)
        self._lock, self._seed, self._shape = threading.Lock(), seed, json.loads(task.shape)
        self.num_envs: int = num_envs
        self.num_actions: int = task.action_width
        self.joints: list[str] = task.joints
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

        self._made = True

    def __setattr__(self, name: str, value: Any) -> None:
        # A misspelt ``robots.commands = ...`` must not be lost. Classes of the user may have attributes of their own.
        if type(self) is Robots and "_made" in vars(self) and not (name.startswith("_") or hasattr(self, name)):
            raise AttributeError(f"Robots have no {name!r} to set{meant(name, [one for one in dir(self) if one[0] != '_'])}")
        object.__setattr__(self, name, value)

    def _make_arrays(self, observation: int, critic: int) -> None:
        count = self.num_envs
        self.observation = np.zeros((count, observation), np.float32)
        self.critic_observation = np.zeros((count, critic), np.float32)
        self.last_observation = np.zeros_like(self.observation)
        self.reward = np.zeros(count, np.float32)
        self.terminated, self.truncated = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._observe()

    def _observe(self) -> None:
        self._copies.observe(self.observation, self.critic_observation)

    def _shown(self) -> Any:
        """The robots on the processor: those of a GPU are copied there."""
        if self._gpu is not None:
            self._copies = self._copies or self._make_copies()
            self._gpu.show(self._copies)
        return self._copies

    @contextmanager
    def _alone(self) -> Generator[None, None, None]:
        if not self._lock.acquire(blocking=False):
            raise RuntimeError(
                "two threads use the same robots at once, and a step is of all of them together: give each thread robots of its "
                "own, or a lock"
            )
        try:
            yield
        finally:
            self._lock.release()

    def __repr__(self) -> str:
        return f"Robots({self.interface.robot!r}, num_envs={self.num_envs}, device={self.device!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError(
            "robots cannot be pickled: their state is the engine's own. Make them anew in each process; state() can be pickled"
        )

    def reset(self, mask: Any = None) -> Any:
        """Begins new episodes for all robots, or for those of ``mask``, shape ``(num_envs,)``. Returns what the robots observe, shape
        ``(num_envs, observation)``. On a GPU it first waits for all work of this process there; the mask may be an array there.

        Raises ``ValueError`` for a mask of another shape.
        """
        chosen = None if mask is None else self._mask(mask)
        with self._alone():
            if self._gpu is not None:
                self._gpu.restart(chosen)
                return self.observation
            self._copies.restart(chosen)
            self._observe()
            return self.observation

    def _reset_after_end(self, mask: NDArray[np.bool_]) -> None:
        """New episodes for the robots of ``mask``, whose last step pays and ends nothing."""
        with self._alone():
            if self._gpu is not None:
                self._gpu.restart(mask, True)
                return
            self._copies.restart(mask)
            self._observe()
            for values in (self.reward, self.terminated, self.truncated):
                values[mask] = 0

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        if isinstance(mask, _gaitfit.DeviceArray):
            mask = mask.numpy()
        elif hasattr(mask, "cpu"):
            # A tensor of PyTorch, wherever it lies.
            mask = mask.cpu()
        array = np.asarray(mask)
        if array.dtype != np.bool_ or array.shape != (self.num_envs,):
            raise ValueError(f"mask has the shape {array.shape} and {array.dtype}; needed: ({self.num_envs},) of bool")
        return np.ascontiguousarray(array)

    def step(self, actions: Any) -> int:
        """One control period.

        Arguments:
            actions: Shape ``(num_envs, num_actions)``, unitless, in the order of :attr:`joints`. On a GPU they are an array of
                another library in the GPU's memory, 32-bit floats in one block, which is read there without a copy, by DLPack
                (``__dlpack__``). The step waits for all earlier work on the current stream of that library, also for reading of
                the robots' arrays. The step is done when this returns.

        It fills :attr:`observation` and :attr:`critic_observation` (after an episode's end those of the new episode),
        :attr:`last_observation` (only the rows of episodes that ended), :attr:`reward`, :attr:`terminated` and
        :attr:`truncated`. A robot whose simulation diverged counts as one that fell: its reward is 0, and its row of
        :attr:`last_observation` has zeros. :attr:`diverged` counts such robots.

        Returns how many episodes ended.

        Raises ``ValueError`` for actions that have a wrong shape or are not finite, :class:`GaitfitError` if more than ten robots,
        and more than one in a hundred, diverged in the step (the simulation is broken then), and ``RuntimeError`` if another
        thread uses the robots.
        """
        with self._alone():
            if self._gpu is not None:
                shape = (self.num_envs, self.num_actions)
                return self._gpu.step(
                    _gaitfit.DeviceInput("actions", actions, shape, self._gpu.device, self._gpu.stream)
                )
            actions = numbers("actions", actions, np.float32)
            if actions.ndim != 2:
                raise ValueError(f"actions have the shape {actions.shape}; needed: {(self.num_envs, self.num_actions)}")
            ended: int = self._copies.step(
                actions,
                self.observation,
                self.critic_observation,
                self.last_observation,
                self.reward,
                self.terminated,
                self.truncated,
            )
            return ended

    def reward_terms(self) -> dict[str, float]:
        """The weighted reward terms of a control step by name: means over all robots and over the steps since the last call.
        Their sum is the mean of :attr:`reward`, except for robots that diverged.
        """
        with self._alone():
            terms = self._copies.take_terms() if self._gpu is None else self._gpu.take_terms()
            return dict(zip(self.reward_names, terms))

    def state(self) -> RobotsState:
        """Everything that changes from step to step. If robots that were made with the same arguments take it with
        :meth:`set_state`, they continue in the same way, bit for bit. Robots on the processor also take the state of robots on a
        GPU, and the other way round; motions then differ by rounding.

        >>> robots = gaitfit.Robots(num_envs=2)
        >>> kept = robots.state()
        >>> _ = robots.step(np.ones((2, 12)))
        >>> robots.set_state(kept)
        """
        with self._alone():
            values, steps, step = self._shown().state()
            return RobotsState(self.task, self._seed, values, steps, step)

    def set_state(self, state: RobotsState) -> None:
        """Takes the state of robots that were made with the same arguments, on any device; :attr:`observation` is then what these
        robots observed. On a GPU it first waits for all work of this process there.

        Raises ``ValueError`` for a state of other robots; the message names what differs.
        """
        if not isinstance(state, RobotsState):
            raise TypeError(f"state is {state!r}; give what state() returned")
        for what, mine, theirs in (
            ("task", self.task, state.task),
            ("seed", self._seed, state.seed),
            ("num_envs", self.num_envs, len(state.steps)),
        ):
            if mine != theirs:
                values = "" if what == "task" else f": {theirs}, and here it is {mine}"
                raise ValueError(f"the state is of robots with another {what}{values}")
        with self._alone():
            if self._gpu is None:
                self._copies.set_state(state.numbers, state.steps, state.step)
                self._observe()
                return
            copies = self._copies = self._copies or self._make_copies()
            copies.set_state(state.numbers, state.steps, state.step)
            self._gpu.follow(copies)

    def motion(self, on_device: bool = False) -> Motion:
        """How all robots move, as copies on the processor. From a GPU all robots are copied, which takes longer than a step.

        Arguments:
            on_device: With ``True`` the arrays of robots on a GPU are :class:`gaitfit.DeviceArray` there. The next call writes over
                them. This call first waits for all work of this process on the GPU. On the processor it has no effect.

        Returns the arrays. Raises ``RuntimeError`` if another thread uses the robots.

        >>> gaitfit.Robots(num_envs=3).motion().base_position.shape
        (3, 3)
        """
        on_device = flag("on_device", on_device)
        with self._alone():
            if self._gpu is not None and on_device:
                return Motion(*self._gpu.motion())
            return Motion(*self._shown().motion())

    def picture(self, robot: int = 0, width: int = 480, height: int = 360) -> NDArray[np.uint8]:
        """A picture of a robot, seen from the front, the side and above. The ground is drawn level at height 0.

        Arguments:
            robot: Its number.
            width, height: Pixels.

        Returns red, green and blue, shape ``(height, width, 3)``.

        Raises ``ValueError`` for a number that no robot has.

        >>> robots = gaitfit.Robots(num_envs=2)
        >>> robots.picture(1, width=64, height=48).shape
        (48, 64, 3)
        """
        from ._picture import picture

        number, size = whole("robot", robot, 0), [whole("width", width, 8, 8192), whole("height", height, 8, 8192)]
        with self._alone():
            pose = self._shown().pose(number)
        return picture(self._shape, pose, *size)

    @property
    def diverged(self) -> int:
        """How many episodes ended because the simulation diverged."""
        diverged: int = (self._gpu or self._copies).diverged
        return diverged

    @property
    def ended(self) -> Any:
        """Which episodes ended in the last step, by a fall or by time; shape ``(num_envs,)``."""
        return self.terminated | self.truncated if self._gpu is None else self._gpu.array("ended")

    @property
    def commands(self) -> Any:
        """The commands of the robots: velocity ahead and to the left, m/s, and yaw rate, rad/s; shape ``(num_envs, 3)``.

        They can be set: ``robots.commands = [0.5, 0.0, 0.0]`` sets the command of all robots, and :attr:`observation` contains it at
        once. The task draws new commands at an episode's beginning and every ``command.seconds``. To keep yours, set them before
        each step. The array itself is a read-only copy. On a GPU it is the robots' own array, and setting it copies all robots.

        Ahead is the direction in which the base faces; :attr:`Motion.base_linear_velocity` is in the world's frame instead.
        :func:`evaluate` measures how well a policy follows commands."""
        if self._gpu is not None:
            return self._gpu.array("commands")
        found = np.asarray(self._copies.commands(), np.float32)
        # Writing into a copy would change nothing.
        found.flags.writeable = False
        return found

    @commands.setter
    def commands(self, commands: Any) -> None:
        array = numbers("commands", commands, np.float32)
        if array.shape not in ((3,), (self.num_envs, 3)) or not np.isfinite(array).all():
            raise ValueError(f"commands have the shape {array.shape}; needed: (3,) or ({self.num_envs}, 3), all finite")
        rows = np.broadcast_to(array, (self.num_envs, 3)).tolist()
        with self._alone():
            if self._gpu is not None:
                self._gpu.set_commands(rows)
                return
            self._copies.set_commands(rows)
            self._observe()


def _task_of(policy: Any) -> Train:
    """A training at the task of a policy's file."""
    from ._policy_file import LoadedPolicy, load_policy
    from .config import Task, Train

    loaded = policy if isinstance(policy, LoadedPolicy) else load_policy(policy)
    if not loaded.task:
        raise ValueError("the policy's file states no task, as those of other programs do not: give config or settings")
    return Train(task=Task.from_toml(loaded.task))
