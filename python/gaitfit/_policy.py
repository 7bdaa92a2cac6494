"""Policies of your own: any callable in the place of a policy's file."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _gaitfit
from ._arguments import count, finite, items, mapping, maybe, text
from ._arguments import path as named
from ._arrays import numbers
from ._toml import toml

Act = Callable[[NDArray[np.float32]], ArrayLike]
Numbers = float | Sequence[float]


@dataclass(frozen=True)
class Term:
    """One part of an observation: a ``quantity``, times ``scale`` (one number, or one for each of its elements), with
    ``history`` frames (1: the present alone).

    Quantities, with their numbers: ``base_angular_velocity`` (3, rad/s, body frame), ``projected_gravity`` (3, body
    frame), ``command`` (3: m/s, m/s, rad/s), ``joint_position`` (joints, rad, minus the default pose),
    ``joint_velocity`` (joints, rad/s), ``last_action`` (joints), ``base_linear_velocity`` (3, m/s, body frame) and
    ``gait_phase`` (2).
    """

    quantity: str
    scale: Numbers | None = None
    history: int = 1


@dataclass(frozen=True)
class Interface:
    """What a policy sees and what its actions mean; joints in the policy's order.

    Every ``control_dt``, s, the joints' targets become ``default_pose + action_scale * action``, rad, and PD controllers
    with the gains ``kp``, N·m/rad, and ``kd``, N·m·s/rad, hold them until the next. Numbers over joints are one for
    each joint, or one for all. ``observation`` is a list of :class:`Term` or of quantities' names, one after another in a
    row. ``action_clip`` is the largest magnitude of an action. ``held`` has joints that the policy does not move:
    ``{"joint": ..., "position": ..., "kp": ..., "kd": ...}``. ``gait_frequency``, Hz, is needed for ``gait_phase``.
    ``history`` says how past frames lie: ``{"order": "terms" or "frames" or "newest_first", "start": "first" or
    "zeros"}``.

    Raises ``ValueError`` where it contradicts itself.
    """

    joints: Sequence[str]
    default_pose: Numbers
    action_scale: Numbers
    kp: Numbers
    kd: Numbers
    control_dt: float
    observation: Sequence[Term | str]
    action_clip: Numbers | None = None
    held: Sequence[Mapping[str, Any]] = ()
    gait_frequency: float | None = None
    history: Mapping[str, str] = field(default_factory=dict)
    robot: str = ""

    def __post_init__(self) -> None:
        # Refused here, and not in the middle of a call.
        self._check()
        _gaitfit.observation_width(self.to_json())

    def _check(self) -> None:
        """Every field is of its kind; whether they fit together the native half says."""
        for joint in items("joints", self.joints, "joints' names"):
            text("a name in joints", joint)
        for name in ("default_pose", "action_scale", "kp", "kd", "action_clip"):
            _over_joints(name, getattr(self, name))
        finite("control_dt", self.control_dt)
        maybe(finite, "gait_frequency", self.gait_frequency)
        text("robot", self.robot)
        for term in items("observation", self.observation, "gaitfit.Term or quantities' names"):
            if not isinstance(term, (Term, str)):
                raise TypeError(f"observation has {term!r}; give a gaitfit.Term or a quantity's name")
            if isinstance(term, Term):
                text("a term's quantity", term.quantity)
                count(f"history of {term.quantity}", term.history, 1)
                _over_joints(f"scale of {term.quantity}", term.scale)
        for one in items("held", self.held, "dicts"):
            found = mapping("an element of held", one, '{"joint": "waist", "position": 0.0, "kp": 100.0, "kd": 2.0}')
            text("joint in held", found.get("joint"))
            for name in ("position", "kp", "kd"):
                finite(f"{name} of {found['joint']} in held", found.get(name))
        mapping("history", self.history, '{"order": "frames"}')

    @property
    def observation_width(self) -> int:
        """Numbers in an observation."""
        return _gaitfit.observation_width(self.to_json())

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Interface:
        """The interface of a policy's file (``.safetensors``, ``.onnx``), or of a ``.toml`` that describes a policy, with
        or without its ``file``."""
        return _read(path)[0]

    def to_toml(self) -> str:
        """The interface as a file describes it: with lines for the weights (``file = "policy.safetensors"``, see
        docs/policies.md) it is a policy for the program."""
        return "".join(f"{key} = {toml(value)}\n" for key, value in self._document().items())

    def to_json(self) -> str:
        """The interface as the native half takes it."""
        return json.dumps({"file": "", **self._document()}, allow_nan=False)

    def _document(self) -> dict[str, Any]:
        document: dict[str, Any] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            if value is None or one.name == "history" and not value:
                continue
            document[one.name] = [_term(term) for term in value] if one.name == "observation" else _plain(value)
        return document


@dataclass(frozen=True)
class Policy:
    """A policy that is a function of yours, for ``policy=`` of :func:`gaitfit.evaluate`, :func:`gaitfit.collect`,
    :func:`gaitfit.fit` and :func:`gaitfit.validate`.

    ``act`` gets observations, shape ``(robots, observation)``, 32-bit, and returns actions, shape ``(robots, joints)``,
    before scaling. It is called on the calling thread, with some 30 to 256 robots at a time, and must remember nothing
    between calls. A ``torch.nn.Module`` is called with a tensor on its own device, without gradients. ``interface`` is an
    :class:`Interface`, or a file as :meth:`Interface.read` takes it. ``name`` stands in results and messages. ``task`` is
    the settings of the policy's task as TOML, by default those in the interface's file.

    An exception in ``act`` ends the call and comes back as it is; actions of another shape, or not finite, are a
    ``ValueError``. A fit keeps its checkpoint.
    """

    act: Act
    interface: Interface | str | os.PathLike[str]
    name: str | None = None
    task: str | None = None

    def __post_init__(self) -> None:
        if not callable(self.act):
            raise TypeError(f"act is {self.act!r}; give a function from observations to actions")
        for key in ("name", "task"):
            value = getattr(self, key)
            if not (value is None or isinstance(value, str)):
                raise TypeError(f"{key} is {value!r}; give a text")
        interface, task = self.interface, ""
        if not isinstance(interface, Interface):
            interface, task = _read(interface)
        name = self.name or getattr(self.act, "__name__", type(self.act).__name__)
        for key, value in (("interface", interface), ("name", name), ("task", task if self.task is None else self.task)):
            object.__setattr__(self, key, value)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The actions, shape ``(robots, joints)``, for ``observation``, shape ``(robots, observation)``, checked."""
        joints = list(self.described.joints)
        found: Any = _torch_act(self.act, observation) if _is_module(self.act) else self.act(observation)
        if hasattr(found, "detach"):
            found = found.detach().cpu()
        if found is None:
            raise TypeError(f"the policy {self.name} returned None; needed: actions (robots, joints)")
        actions = numbers(f"the policy {self.name} returned", found, np.float32)
        needed = (len(observation), len(joints))
        if actions.shape != needed:
            raise ValueError(
                f"the policy {self.name} returned actions of shape {actions.shape}; needed: (robots, joints) = {needed}"
            )
        if not np.isfinite(actions).all():
            row, column = np.argwhere(~np.isfinite(actions))[0]
            raise ValueError(
                f"the policy {self.name}: the action of row {row} for {joints[column]} is {actions[row, column]}; its "
                f"observation is {np.array2string(observation[row], precision=3, threshold=60)}"
            )
        return actions

    @property
    def described(self) -> Interface:
        """The interface; of a file the one that was read."""
        assert isinstance(self.interface, Interface), "files are read when the policy is made"
        return self.interface

    def native(self) -> dict[str, Any]:
        """The policy as the native half takes it."""
        return {"name": self.name, "interface": self.described.to_json(), "task": self.task, "act": self}


def _read(path: str | os.PathLike[str]) -> tuple[Interface, str]:
    found, task = _gaitfit.interface_of(named("the interface's file", path))
    return interface_of(found), task


def interface_of(text: str) -> Interface:
    """The interface that the native half gives as JSON."""
    document = json.loads(text)
    document.pop("critic_observation", None)
    terms = [Term(one["quantity"], one.get("scale") or None, one.get("history", 1)) for one in document.pop("observation")]
    return Interface(observation=terms, **document)


def _term(term: Term | str) -> dict[str, Any]:
    if isinstance(term, str):
        return {"quantity": term}
    scale = {} if term.scale is None else {"scale": _spread(_plain(term.scale))}
    return {"quantity": term.quantity, "history": term.history, **scale}


def _over_joints(name: str, value: Any) -> None:
    """One number, or a list of them."""
    if value is None and name != "default_pose":
        # What must not be left out has no default; the native half says so.
        return
    if isinstance(value, (str, bytes)) or not np.iterable(value):
        finite(name, value)
        return
    for at, one in enumerate(value):
        finite(f"{name}[{at}]", one)


def _spread(scale: Any) -> Any:
    # One number in a list is one for all.
    return scale[0] if isinstance(scale, list) and len(scale) == 1 else scale


def _plain(value: Any) -> Any:
    """Arrays, tuples and mappings as JSON has them."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return value


def _is_module(act: object) -> bool:
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(act, torch.nn.Module)


def _torch_act(module: Any, observation: NDArray[np.float32]) -> Any:
    import torch

    device = next((one.device for one in module.parameters()), torch.device("cpu"))
    with torch.inference_mode():
        return module(torch.from_numpy(observation).to(device))
