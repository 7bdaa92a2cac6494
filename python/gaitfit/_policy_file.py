"""Policies of files that act in Python."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._arguments import count, flag, items, path
from ._arrays import numbers
from ._policy import Interface, interface_of

if TYPE_CHECKING:
    import torch


class LoadedPolicy:
    """A policy of a file at work: called with observations it returns actions. :func:`load_policy` makes one.

    It is a path, too: wherever a policy's file is taken, for example by :func:`evaluate`, a loaded policy is.

    Attributes:
        interface: What it sees, and what its actions mean.
        task: The settings of its task, as TOML; empty where they are not known.
        file: Its file.
        is_recurrent: Whether it remembers what it observed. Then the rows of one call after another are the same robots, and
            :meth:`reset` makes it forget.
        notes: What was assumed when the file was read.

    >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
    >>> policy(np.zeros(policy.interface.observation_width)).shape
    (12,)
    """

    def __init__(self, file: str | os.PathLike[str]) -> None:
        self.file = path("file", file)
        self._native = _gaitfit.PolicyFile(self.file)
        self.interface: Interface = interface_of(self._native.interface)
        self.task: str = self._native.task
        self.is_recurrent: bool = self._native.is_recurrent
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
                say. Normalisation of the policy's own is applied here.

        Returns actions of shape ``(robots, joints)`` or ``(joints,)``.

        Raises ``ValueError`` for an observation of another width.
        """
        array = numbers("observation", observation, np.float32)
        if array.ndim not in (1, 2):
            raise ValueError(f"the observation has the shape {array.shape}; needed: (robots, observation) or (observation,)")
        actions = self._native.act(np.atleast_2d(array))
        return actions if array.ndim == 2 else actions[0]

    def reset(self, rows: Iterable[int] | None = None) -> None:
        """The episodes of these rows begin: a recurrent policy forgets them. Without ``rows`` all do."""
        several = None if rows is None else [count("a row", row, 0) for row in items("rows", rows, "whole numbers")]
        self._native.reset(several)

    def predict(
        self,
        observation: ArrayLike,
        state: object = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], None]:
        """Actions as Stable-Baselines3's ``predict`` gives them: ``(actions, None)``.

        Arguments:
            observation: As for a call.
            state: Of no effect: a recurrent policy remembers by itself.
            episode_start: Whose episodes begin, shape ``(robots,)``: a recurrent policy forgets them.
            deterministic: ``True``. Files have mean actions; draws around them are the learner's.

        Raises ``ValueError`` for ``deterministic=False``.
        """
        if not flag("deterministic", deterministic):
            raise ValueError("deterministic is False; a policy's file has mean actions only: give True")
        if episode_start is not None and self.is_recurrent:
            begins = np.flatnonzero(np.atleast_1d(np.asarray(episode_start, bool)))
            rows = len(np.atleast_2d(np.asarray(observation)))
            self._native.reset([int(row) for row in begins] if len(begins) < rows else None)
        return self(observation), None

    def to_torch(self) -> torch.nn.Module:
        """The policy as a ``torch.nn.Module`` from observations ``(robots, observation)`` to mean actions
        ``(robots, joints)``, with its normalisation, ready to be trained further. Needs ``torch``.

        Raises ``ImportError`` without torch, and ``ValueError`` for a policy with a memory or an encoder.
        """
        try:
            from . import _torch
        except ImportError as missing:
            raise ImportError("to_torch() needs PyTorch: pip install torch") from missing
        try:
            actor = self._native.actor()
        except ValueError as wrong:
            raise ValueError(f"{self.file}: {wrong}; to_torch() takes a perceptron. Export others as ONNX") from None
        return _torch.Actor(actor)


def load_policy(file: str | os.PathLike[str]) -> LoadedPolicy:
    """Reads a policy of any kind that the program reads: ``.safetensors``, ``.onnx`` or a ``.toml`` that describes one.

    Raises ``FileNotFoundError`` if there is no file, and :class:`GaitfitError` for one that is not a policy.

    >>> policy = gaitfit.load_policy("assets/go2-walk.safetensors")
    >>> observations = np.zeros((64, policy.interface.observation_width), np.float32)
    >>> policy(observations).shape, policy.predict(observations)[0].shape
    ((64, 12), (64, 12))
    """
    return LoadedPolicy(file)
