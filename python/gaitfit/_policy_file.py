"""Policies of files that act in Python."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._alone import Alone
from ._arguments import count, existing, flag, items, path
from ._arrays import numbers
from ._policy import Interface, interface_of

if TYPE_CHECKING:
    import torch
else:
    from ._hints import torch


class LoadedPolicy:
    """A policy that was read from a file. Call it with observations, and it returns actions. :func:`load_policy` makes one.

    It is a path, too: functions that take a policy's file, such as :func:`evaluate`, also take a loaded policy.

    Attributes:
        interface: What it observes, and what its actions mean.
        task: The settings of its task, as TOML; empty if they are not known.
        file: Its file.
        is_recurrent: Whether it remembers what it observed (GRU, LSTM). Then row 0 of every call must be the same robot, and so on,
            and :meth:`reset` makes it forget.
        notes: What was assumed when the file was read.

    >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
    >>> policy(np.zeros(policy.interface.observation_width)).shape
    (12,)
    """

    def __init__(self, file: str | os.PathLike[str]) -> None:
        self.file = path("file", file)
        if os.path.isdir(self.file):
            raise _gaitfit.GaitfitError(
                f"{self.file} is a folder; give a policy's file. Of a run folder it is gaitfit.load({self.file!r}).policy"
            )
        existing("the policy", self.file)
        self._native, self._alone = _gaitfit.PolicyFile(self.file), Alone("policy")
        self.interface: Interface = interface_of(self._native.interface)
        self.task: str = self._native.task
        self.is_recurrent: bool = self._native.is_recurrent
        self._state_width = self._native.state_width
        self.notes: list[str] = self._native.notes

    def __fspath__(self) -> str:
        return self.file

    def __repr__(self) -> str:
        return f"LoadedPolicy({self.file!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.file,)

    def __call__(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Mean actions, unitless, before scaling and clipping, in the order of ``interface.joints``.

        Arguments:
            observation: Shape ``(robots, observation)``, or ``(observation,)`` for one robot, scaled as the interface's terms
                state. The policy's own normalisation is applied here.

        Returns actions of shape ``(robots, joints)`` or ``(joints,)``.

        Raises ``ValueError`` for an observation that has another width or is not finite, and ``RuntimeError`` if another thread uses
        the policy.
        """
        array = self._observation(observation)
        with self._alone():
            actions = self._native.act(np.atleast_2d(array))
        return actions if array.ndim == 2 else actions[0]

    def _observation(self, observation: ArrayLike) -> NDArray[np.float32]:
        array = numbers("observation", observation, np.float32)
        if array.ndim not in (1, 2):
            raise ValueError(f"the observation has the shape {array.shape}; needed: (robots, observation) or (observation,)")
        finite = np.isfinite(array)
        if not finite.all():
            place = ", ".join(str(one) for one in np.argwhere(~finite)[0])
            raise ValueError(f"observation[{place}] is {array[~finite][0]}; it must be finite")
        return array

    def reset(self, rows: Iterable[int] | None = None) -> None:
        """Begins new episodes for these rows, by default for all: a recurrent policy forgets what it observed.

        Raises ``ValueError`` for a row for which the policy has not acted.
        """
        several = None if rows is None else [count("a row", row, 0) for row in items("rows", rows, "whole numbers")]
        with self._alone():
            self._native.reset(several)

    def predict(
        self,
        observation: ArrayLike,
        state: tuple[NDArray[np.float32], ...] | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], tuple[NDArray[np.float32], ...] | None]:
        """Returns ``(actions, state)``, as Stable-Baselines3's ``predict`` does. The memory of calls of the policy itself is not used
        and does not change.

        Arguments:
            observation: As for a call.
            state: The state that the last ``predict`` returned; ``None`` if all episodes begin. For a recurrent policy it is one
                array of shape ``(robots, numbers)``, in a tuple. Other policies need none.
            episode_start: Which robots begin an episode, shape ``(robots,)``: a recurrent policy forgets these first.
            deterministic: Must be ``True``: files have only the mean actions.

        Returns the actions, and the state for the next call, ``None`` unless the policy is recurrent.

        Raises ``ValueError`` for ``deterministic=False``, and for a state or an observation of another shape.

        >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
        >>> actions, state = policy.predict(np.zeros((2, policy.interface.observation_width)))
        >>> actions.shape, state
        ((2, 12), None)
        """
        if not flag("deterministic", deterministic):
            raise ValueError("deterministic is False; a policy's file has mean actions only: give True")
        if not self.is_recurrent:
            return self(observation), None
        array = self._observation(observation)
        rows = np.atleast_2d(array)
        kept = np.zeros((len(rows), self._state_width), np.float32)
        if state is not None:
            given = state[0] if isinstance(state, tuple) and len(state) == 1 else state
            kept = numbers("state", given, np.float32).copy()
        if episode_start is not None:
            begins = np.atleast_1d(np.asarray(episode_start, bool))
            if begins.shape != (len(rows),):
                raise ValueError(f"episode_start has the shape {begins.shape}; needed: ({len(rows)},)")
            if kept.shape[:1] == begins.shape:
                kept[begins] = 0.0
        if kept.ndim != 2:
            raise ValueError(f"the state has the shape {kept.shape}; needed: what the last predict returned, or None")
        with self._alone():
            actions, after = self._native.act_from(rows, kept)
        return (actions if array.ndim == 2 else actions[0]), (after,)

    def to_torch(self) -> torch.nn.Module:
        """The policy as a ``torch.nn.Module`` with its normalisation, ready to be trained further. Needs ``torch``.

        It takes observations of shape ``(robots, observation)`` and returns mean actions of shape ``(robots, joints)``.

        The module of a recurrent policy returns ``(actions, state)``, and takes that state with the next observation:
        ``actions, state = module(observation, state)``. The state has the shape ``(robots, module.state_width)``; ``None`` and
        rows of zeros begin an episode. Observations of shape ``(steps, robots, observation)`` are steps that follow each other.

        ``gaitfit export POLICY --onnx FILE`` writes a recurrent policy with ``h_in`` and ``h_out`` (an LSTM also with ``c_in``
        and ``c_out``) for programs without torch.

        Raises ``ImportError`` without torch, and ``ValueError`` for a graph of other operators.

        >>> module = gaitfit.load_policy("assets/go2-walk.safetensors").to_torch()      # doctest: +SKIP
        >>> module(torch.zeros(64, 45)).shape      # doctest: +SKIP
        torch.Size([64, 12])
        """
        try:
            from . import _torch
        except ImportError as missing:
            raise ImportError("to_torch() needs PyTorch: pip install torch") from missing
        try:
            networks = self._native.networks()
        except ValueError as wrong:
            raise ValueError(f"{self.file}: {wrong}, which to_torch() cannot turn into layers. Run its ONNX file with onnxruntime") from None
        return _torch.module(networks)


def load_policy(file: str | os.PathLike[str]) -> LoadedPolicy:
    """Reads a policy of any kind that the program reads: ``.safetensors``, ``.onnx`` or a ``.toml`` that describes one.

    Returns the policy, which you call with observations. ``policy.interface`` states what these contain, in which order and scale,
    and how an action becomes the joints' targets: :class:`Interface`, :class:`Term`.

    Raises ``FileNotFoundError`` if there is no file, and :class:`GaitfitError` for one that is not a policy.

    >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
    >>> observations = np.zeros((64, policy.interface.observation_width), np.float32)
    >>> policy(observations).shape, policy.predict(observations)[0].shape
    ((64, 12), (64, 12))
    """
    return LoadedPolicy(file)
