"""Robots as Gymnasium environments: many as a vector environment, or one. Needs ``gymnasium``
(``pip install "gaitfit[gym]"``).

``gymnasium.make("gaitfit.gym:gaitfit/Go2-v0")`` is one built-in Go2 at its task, and ``gymnasium.make_vec`` many.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from ._needs import lacking

try:
    import gymnasium
except ImportError as missing:
    raise lacking("gym", "gym", missing) from missing
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ._arguments import count, flag
from ._arrays import numbers
from ._given import RobotsDevice, Theta
from ._robots import Robots
from ._robots_state import RobotsState
from ._terms import Terms
from ._terms_gpu import GpuTerms
from ._window import Window
from .config import Train

if TYPE_CHECKING:
    from ._policy_file import LoadedPolicy
else:
    from ._hints import LoadedPolicy

__all__ = ["AutoresetMode", "GaitfitEnv", "GaitfitVecEnv", "Terms"]

Box = spaces.Box
#: A vector environment's state.
State = tuple[RobotsState, NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]


def _open(closed: bool) -> None:
    if closed:
        raise ClosedEnvironmentError("the environment is closed: make another one")


def _spaces(robots: Robots) -> tuple[Box, Box]:
    """Of one robot: what it observes, and the actions that it can use."""
    low, high = robots.action_bounds.T
    return (
        spaces.Box(-np.inf, np.inf, (robots.observation.shape[1],), np.float32),
        spaces.Box(low, high, dtype=np.float32),
    )


class GaitfitVecEnv(VectorEnv[Any, Any, Any]):  # type: ignore[misc, unused-ignore]
    """Robots at a task as a ``gymnasium.vector.VectorEnv``.

    By default, when an episode ends, the next one begins within the same step (``AutoresetMode.SAME_STEP``). ``infos["final_obs"]``
    then has the last observations of the episodes that ended, and ``infos["_final_obs"]`` is the mask of these robots.
    ``infos["final_info"]`` has their ``episode_return``, ``episode_length`` and ``fell``, arrays of shape ``(num_envs,)`` with masks
    (``_episode_return``, …). A robot whose simulation diverged counts as fallen: its episode is terminated, and a new one begins.
    The action space is :attr:`gaitfit.Robots.action_bounds`.

    Arguments:
        config, num_envs, robot, policy, theta, settings, seed, threads, device: As for :class:`gaitfit.Robots`.
        copy: ``False`` hands out the environment's own arrays, without copies; the next step writes over them.
        log_rewards: Whether ``infos["log"]`` has the reward terms of each step by name, means over the robots.
        terms: Reward, end of an episode and observation of your own (:class:`gaitfit.Terms`).
        autoreset_mode: ``AutoresetMode.SAME_STEP``; ``NEXT_STEP``: the step after an episode's end begins the next one, without
            an action and reward; ``DISABLED``: ``reset(options={"reset_mask": mask})`` begins it.

    With ``device="cuda"`` all robots are stepped on a GPU. Actions are an array of another library in its memory. The environment
    returns its own :class:`gaitfit.DeviceArray`, without copies: ``copy`` must be ``False``. ``infos["final_obs"]`` is one array of
    all robots' last observations, ``infos["_final_obs"]`` is the mask of the new ones, and there is no ``final_info``. With
    ``terms`` the environment returns tensors of PyTorch instead.

    >>> env = GaitfitVecEnv(num_envs=8)
    >>> observation, infos = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, infos = env.step(env.action_space.sample())
    >>> reward.shape
    (8,)
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
        copy: bool | None = None,
        device: RobotsDevice = "cpu",
        log_rewards: bool = False,
        terms: Terms | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
    ) -> None:
        self._mode, self._terms = AutoresetMode(autoreset_mode), terms
        if terms is not None and not isinstance(terms, Terms):
            raise TypeError(f"terms is {terms!r}; give gaitfit.Terms")

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
                autoreset=self._mode == AutoresetMode.SAME_STEP and terms is None,
                device=device,
            )

        self._make = make
        self._copy = device == "cpu" if copy is None else flag("copy", copy)
        self._log = flag("log_rewards", log_rewards)
        if device != "cpu" and self._copy:
            raise ValueError("copy is True; robots on a GPU hand out their own arrays: give copy=False")
        self._begin(seed)
        self.num_envs = num_envs
        _, self.single_action_space = _spaces(self._robots)
        width = self._observed().shape[1]
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (width,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"autoreset_mode": self._mode}
        self.render_mode = None
        self.spec = None

    def _begin(self, seed: int) -> None:
        self._robots = self._make(seed)
        on_gpu = self._robots.device != "cpu"
        self._gpu_terms = GpuTerms(self._terms, self._robots) if on_gpu and self._terms is not None else None
        self._seed, self._fresh = seed, True
        self._returns = np.zeros(self._robots.num_envs)
        self._lengths = np.zeros(self._robots.num_envs, np.int64)
        #: Whose episode the last step ended, and nothing has begun since.
        self._over = np.zeros(self._robots.num_envs, np.bool_)

    @property
    def robots(self) -> Robots:
        """The robots themselves."""
        return self._robots

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """New episodes.

        Arguments:
            seed: The same seed gives the same episodes. If there are several seeds, only the first counts.
            options: ``{"reset_mask": mask}`` begins only the episodes of ``mask``, shape ``(num_envs,)``; not with a seed.

        Returns what the robots observe, shape ``(num_envs, observation)``, and no infos.

        Raises ``ValueError`` for other options and masks of another shape, and Gymnasium's ``ClosedEnvironmentError``.
        """
        _open(self.closed)
        unknown = [name for name in options or {} if name != "reset_mask"]
        if unknown:
            raise ValueError(f"options has {unknown[0]!r}; the only option is 'reset_mask'")
        if isinstance(seed, (list, tuple)):
            # One seed is enough: draws depend on it and on an environment's number.
            seed = next((one for one in seed if one is not None), None)
        chosen = None if seed is None else count("seed", seed, 0)
        mask = None if options is None else options.get("reset_mask")
        mask = None if mask is None else self._robots._mask(mask)
        if mask is not None and chosen is not None:
            raise ValueError("reset_mask and seed are given; a seed makes all robots anew: give one of them")
        super().reset(seed=chosen)
        if chosen is not None and not (self._fresh and chosen == self._seed):
            self._begin(chosen)
        elif mask is not None or not self._fresh:
            self._robots.reset(mask)
        who = slice(None) if mask is None else mask
        self._returns[who], self._lengths[who], self._over[who] = 0.0, 0, False
        self._fresh = False
        return self._out(self._observed()), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One control period under ``actions``, shape ``(num_envs, joints)``. Returns observations, rewards, which robots fell, which
        robots reached their time limit, and infos. Raises as :meth:`gaitfit.Robots.step`, ``ValueError`` for a term that returns
        something else, and Gymnasium's ``ClosedEnvironmentError``."""
        _open(self.closed)
        self._fresh = False
        robots, terms = self._robots, self._terms
        ends = robots.step(actions)
        infos = {"log": robots.reward_terms()} if self._log else {}
        if self._gpu_terms is not None:
            return self._judged(self._gpu_terms, infos)
        if robots.device != "cpu":
            if ends and self._mode == AutoresetMode.SAME_STEP:
                infos |= {"final_obs": robots.last_observation, "_final_obs": robots.ended}
            if self._mode == AutoresetMode.NEXT_STEP:
                if self._over.any():
                    robots._reset_after_end(self._over)
                self._over = robots.ended.numpy() if ends else np.zeros(self.num_envs, np.bool_)
            return robots.observation, robots.reward, robots.terminated, robots.truncated, infos
        observation, reward, terminated, truncated = robots.observation, robots.reward, robots.terminated, robots.truncated
        if terms is not None:
            motion = robots.motion()
            reward, terminated = terms.rewarded(robots, motion), terms.over(robots, motion)
            observation = terms.observed(robots, motion)
        begun = self._over if self._mode == AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, np.bool_)
        if begun.any():
            # What these robots did in this step belongs to no episode.
            robots.reset(begun)
            for values in (reward, terminated, truncated, self._returns, self._lengths):
                values[begun] = 0
            observation = self._observed()
        self._returns += reward
        self._lengths += ~begun
        self._over = ended = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP and ended.any():
            infos |= self._final(ended, terminated, robots.last_observation if terms is None else observation)
            if terms is not None:
                robots.reset(ended)
                observation = self._observed()
        return self._out(observation), self._out(reward), self._out(terminated), self._out(truncated), infos

    def _judged(self, terms: GpuTerms, infos: dict[str, Any]) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """The step of robots on a GPU by the user's terms."""
        motion = terms.motion()
        reward, terminated, truncated = terms.rewarded(motion), terms.over(motion), terms.truncated()
        observation = terms.observed(motion)
        if self._mode == AutoresetMode.NEXT_STEP:
            if self._over.any():
                self._robots._reset_after_end(self._over)
                for values in (reward, terminated, truncated):
                    terms.clear(values, self._over)
                observation = terms.observed(terms.motion())
            self._over = (terminated | truncated).cpu().numpy()
            return observation, reward, terminated, truncated, infos
        ended = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP and bool(ended.any()):
            infos |= {"final_obs": observation, "_final_obs": ended}
            self._robots.reset(ended)
            observation = terms.observed(terms.motion())
        return observation, reward, terminated, truncated, infos

    def _observed(self) -> Any:
        """What the robots observe now."""
        robots = self._robots
        if self._gpu_terms is not None:
            return self._gpu_terms.observed(self._gpu_terms.motion())
        return robots.observation if self._terms is None else self._terms.observed(robots, robots.motion())

    def _final(self, ended: NDArray[np.bool_], terminated: NDArray[np.bool_], last: NDArray[np.float32]) -> dict[str, Any]:
        """Infos of episodes that ended, with what their robots observed ``last``."""
        final = np.full(self.num_envs, None, object)
        for index in np.flatnonzero(ended):
            final[index] = last[index].copy()
        values = {
            "episode_return": np.where(ended, self._returns, 0.0),
            "episode_length": np.where(ended, self._lengths, 0),
            "fell": terminated.copy(),
        }
        masks = {f"_{name}": ended.copy() for name in values}
        self._returns[ended], self._lengths[ended] = 0.0, 0
        return {"final_obs": final, "_final_obs": ended, "final_info": {**values, **masks}, "_final_info": ended.copy()}

    def state(self) -> State:
        """The robots' state (:meth:`gaitfit.Robots.state`), return and length of their episodes so far, and which episodes ended in
        the last step."""
        return self._robots.state(), self._returns.copy(), self._lengths.copy(), self._over.copy()

    def set_state(self, state: State) -> Any:
        """Takes the state of an environment that was made with the same arguments. Returns what the robots observe. Raises
        ``ValueError`` for a state of other robots."""
        robots, returns, lengths, over = state
        self._robots.set_state(robots)
        self._returns[:], self._lengths[:], self._over = returns, lengths, over.copy()
        self._fresh = False
        return self._out(self._observed())

    def __reduce__(self) -> tuple[Any, ...]:
        return self._robots.__reduce__()

    def _out(self, array: Any) -> Any:
        return array.copy() if self._copy else array


class GaitfitEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):  # type: ignore[misc, unused-ignore]
    """One robot at a task as a ``gymnasium.Env``, for trying things out. For learning take many robots: the engine steps hundreds in
    the time of about ten.

    Observations have the shape ``(observation,)``, actions ``(joints,)``, unitless; the action space is
    :attr:`gaitfit.Robots.action_bounds`. A robot whose simulation diverged counts as fallen: its episode is terminated.
    ``info["reward_terms"]`` has the weighted terms of the step's reward by name.

    Arguments:
        config, robot, policy, theta, settings, seed: As for :class:`gaitfit.Robots`.
        render_mode: ``"rgb_array"``: :meth:`render` returns pictures (:meth:`gaitfit.Robots.picture`). ``"human"``: a page in
            the browser shows every step, in real time if the machine is fast enough. Only this machine can open it. ``None``: no
            pictures.

    >>> env = GaitfitEnv()
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

    def __init__(
        self,
        config: str | os.PathLike[str] | Train | None = None,
        *,
        robot: str | os.PathLike[str] | None = None,
        policy: str | os.PathLike[str] | LoadedPolicy | None = None,
        theta: Theta | None = None,
        settings: Mapping[str, Any] | None = None,
        seed: int = 0,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, "human", "rgb_array"):
            raise ValueError(f"render_mode is {render_mode!r}; give 'human', 'rgb_array' or None")

        def make(seed: int) -> Robots:
            return Robots(
                config, num_envs=1, threads=1, robot=robot, policy=policy, theta=theta, settings=settings, seed=seed
            )

        self._make = make
        self._begin(seed)
        observed, moved = _spaces(self._robots)
        self.observation_space = cast("spaces.Space[NDArray[np.float32]]", observed)
        self.action_space = cast("spaces.Space[NDArray[np.float32]]", moved)
        self.render_mode = render_mode
        self._window = Window(self._robots.control_dt) if render_mode == "human" else None
        self._closed = False
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self._robots.control_dt)}

    @property
    def robots(self) -> Robots:
        """The robot itself, as one of many."""
        return self._robots

    def _begin(self, seed: int) -> None:
        # What the robots begin with is an episode already.
        self._robots = self._make(seed)
        self._seed, self._fresh = seed, True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """A new episode; with a ``seed`` the same one every time. ``options`` have no effect. Returns what the robot observes, and no
        infos. Raises ``ValueError`` for a wrong seed, and Gymnasium's ``ClosedEnvironmentError``."""
        _open(self._closed)
        super().reset(seed=seed)
        if seed is not None and not (self._fresh and seed == self._seed):
            self._begin(seed)
        elif not self._fresh:
            self._robots.reset()
        self._fresh = False
        self._show()
        return self._robots.observation[0].copy(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One control period under ``action``, shape ``(joints,)``. Returns what the robot observes, its reward, whether it fell,
        whether it reached its time limit, and infos. Raises ``ValueError`` for an action that has another shape or is not finite, and
        Gymnasium's ``ClosedEnvironmentError``."""
        _open(self._closed)
        robots = self._robots
        action = numbers("action", action, np.float32)
        if action.shape != self.action_space.shape:
            raise ValueError(f"the action has the shape {action.shape}; needed: {self.action_space.shape}")
        ended = robots.step(action[None, :])
        # The robots are in their next episode by then.
        if ended:
            self._seed, self._fresh = -1, True
        self._show()
        observation = (robots.last_observation if ended else robots.observation)[0].copy()
        info = {"reward_terms": robots.reward_terms()}
        return observation, float(robots.reward[0]), bool(robots.terminated[0]), bool(robots.truncated[0]), info

    def __reduce__(self) -> tuple[Any, ...]:
        return self._robots.__reduce__()

    def render(self) -> Any:
        """A picture of the robot, shape ``(360, 480, 3)``, with ``render_mode="rgb_array"``; else ``None``. After an episode's end
        it shows the next one's beginning."""
        return self._robots.picture() if self.render_mode == "rgb_array" else None

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self._robots.picture())

    def close(self) -> None:
        """Ends the page of ``render_mode="human"``, and the environment."""
        self._closed = True
        if self._window is not None:
            self._window.close()
            self._window = None


gymnasium.register(
    "gaitfit/Go2-v0", entry_point="gaitfit.gym:GaitfitEnv", vector_entry_point="gaitfit.gym:GaitfitVecEnv"
)
