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
    """One part of an observation.

    Attributes:
        quantity: What is observed.
        scale: Factor on it: one number, or one for each of its elements; ``None``: 1.
        history: Frames: the present one and those before it; 1: the present alone.
        ahead: Control periods by which the motion is read ahead; for quantities of a motion.

    Quantities, with their numbers: ``base_angular_velocity`` (3, rad/s, body frame), ``projected_gravity`` (3, unit
    vector down, body frame), ``command`` (3: m/s, m/s, rad/s), ``joint_position`` (joints, rad, minus the default pose),
    ``joint_velocity`` (joints, rad/s), ``last_action`` (joints), ``base_linear_velocity`` (3, m/s, body frame),
    ``base_height`` (1, m above the ground, of simulators alone), ``gait_phase`` (2: sine and cosine of
    the gait clock), ``gait_sine`` (1), ``constant`` (1: the number 1, before its scale) and ``earlier_action``
    (joints: the action before the last, beside ``last_action``). Policies from files may also observe a motion that they follow:
    ``reference_joint_position``, ``reference_joint_velocity``, ``reference_orientation``, ``reference_phase``.

    >>> Term("base_angular_velocity", 0.25).history
    1
    """

    quantity: str
    scale: Numbers | None = None
    history: int = 1
    ahead: int = 0


@dataclass(frozen=True)
class Interface:
    """What a policy sees and what its actions mean; joints in the policy's order.

    Every ``control_dt`` the joints' targets become ``default_pose + action_scale * action``, and PD controllers hold them until
    the next. Numbers over joints are one for each joint, or one for all.

    Attributes:
        joints: The joints.
        default_pose: Targets at action 0, rad.
        action_scale: Change of a target by an action of 1, rad.
        kp: Position gains, N·m/rad.
        kd: Velocity gains, N·m·s/rad.
        control_dt: Time between actions, s.
        observation: :class:`Term` or quantities' names, one after another in a row.
        action_clip: Largest magnitude of an action; ``None``: not limited.
        held: Joints that the policy does not move: ``{"joint": ..., "position": ..., "kp": ..., "kd": ...}``.
        gait_frequency: Frequency of the gait clock, Hz; needed for ``gait_phase``.
        history: How past frames lie: ``{"order": "terms" or "frames" or "newest_first", "start": "first" or "zeros"}``.
        robot: Name of the robot.
        reference: The motion that the policy follows, as its file describes it: ``rate_hz``, and ``position``, ``velocity`` and
            ``orientation`` of all samples one after another.

    Raises ``TypeError`` for fields of a wrong kind, and ``ValueError`` where they contradict each other.

    >>> Interface(["a", "b"], 0.0, 0.5, kp=20.0, kd=0.5, control_dt=0.02, observation=["command", "joint_position"]).observation_width
    5
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
    reference: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        # Refused here, and not in the middle of a call.
        self._check()
        _gaitfit.observation_width(self.to_json())

    def _check(self) -> None:
        """Every field is of its kind; the native half checks whether they fit together."""
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
                count(f"ahead of {term.quantity}", term.ahead, 0)
                _over_joints(f"scale of {term.quantity}", term.scale)
        for one in items("held", self.held, "dicts"):
            found = mapping("an element of held", one, '{"joint": "waist", "position": 0.0, "kp": 100.0, "kd": 2.0}')
            text("joint in held", found.get("joint"))
            for name in ("position", "kp", "kd"):
                finite(f"{name} of {found['joint']} in held", found.get(name))
        mapping("history", self.history, '{"order": "frames"}')
        if self.reference is not None:
            mapping("reference", self.reference, '{"rate_hz": 50.0, "position": [...], "velocity": [...]}')

    @property
    def observation_width(self) -> int:
        """Numbers in an observation."""
        return _gaitfit.observation_width(self.to_json())

    def targets(self, actions: ArrayLike) -> NDArray[np.float64]:
        """The joints' position targets, rad, for ``actions``, shape ``(joints,)`` or ``(robots, joints)``: clipped, scaled, and
        added to the default pose. The result has the shape of ``actions``.

        Raises ``ValueError`` for actions of another shape, or that are not finite.

        >>> interface = gaitfit.load_policy("assets/go2-walk.safetensors").interface
        >>> interface.targets(np.ones(12))[:3]
        array([ 0.35,  1.05, -1.25])
        """
        array = numbers("actions", actions, np.float64)
        if array.ndim not in (1, 2) or array.shape[-1] != len(self.joints) or not np.isfinite(array).all():
            raise ValueError(f"actions have the shape {array.shape}; needed: ({len(self.joints)},) or (robots, {len(self.joints)}), all finite")
        if self.action_clip is not None:
            limit = np.asarray(self.action_clip, np.float64)
            array = np.clip(array, -limit, limit)
        targets: NDArray[np.float64] = np.asarray(self.default_pose, np.float64) + np.asarray(self.action_scale, np.float64) * array
        return targets

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Interface:
        """The interface of a policy's file (``.safetensors``, ``.onnx``), or of a ``.toml`` that describes a policy, with
        or without its ``file``. Raises ``FileNotFoundError`` if there is no file, and :class:`GaitfitError` for one that is
        not a policy. ``path`` is the file."""
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

    Attributes:
        act: Gets observations, shape ``(robots, observation)``, 32-bit, and returns actions, shape ``(robots, joints)``, before
            scaling. It is called on the calling thread, with some 30 to 256 robots at a time, and must remember nothing between
            calls. A robot whose simulation diverged (a number of its observation is NaN or beyond ±1e6) observes zeros. A
            ``torch.nn.Module`` is called with a tensor on its own device, without gradients.
        interface: An :class:`Interface`, or a file as :meth:`Interface.read` takes it.
        name: What results and messages call it; by default the function's name.
        task: Settings of the policy's task as TOML; by default those in the interface's file.

    An exception in ``act`` ends the call and comes back as it is; actions of another shape, or not finite, are a
    ``ValueError``. A fit keeps its checkpoint.

    >>> standing = Policy(lambda observation: np.zeros((len(observation), 12)), "assets/go2-walk.safetensors", name="standing")
    >>> gaitfit.evaluate(standing, trajectories=4, seconds=0.2, drift=0, progress=False).policy
    'standing'
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
    terms = [Term(one["quantity"], one.get("scale") or None, one.get("history", 1), one.get("ahead", 0)) for one in document.pop("observation")]
    return Interface(observation=terms, **document)


def _term(term: Term | str) -> dict[str, Any]:
    if isinstance(term, str):
        return {"quantity": term}
    scale = {} if term.scale is None else {"scale": _spread(_plain(term.scale))}
    ahead = {"ahead": term.ahead} if term.ahead else {}
    return {"quantity": term.quantity, "history": term.history, **ahead, **scale}


def _over_joints(name: str, value: Any) -> None:
    """One number, or a list of them."""
    if value is None and name != "default_pose":
        # The native half refuses a required value that is missing.
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
