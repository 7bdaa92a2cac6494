"""A clamped robot in a simulator that takes MuJoCo's models: what official MuJoCo and MuJoCo Warp have in common."""

# MuJoCo is compiled and names its contents at run time.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import copy
import fnmatch
import os
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from ._arguments import finite, items, path, real
from ._logs import Log
from ._own_simulator import Parameter, logs_of, parameters_of

_FIELDS = {"frictionloss": "dof_frictionloss", "armature": "dof_armature", "damping": "dof_damping"}


class Clamped:
    """The robot of ``model`` without its base's free joint, under the logs' targets; :meth:`_simulated` is the simulator."""

    def __init__(
        self,
        model: str | os.PathLike[str],
        logs: Log | Sequence[Log],
        parameters: Sequence[Parameter],
        *,
        timestep: float = 0.00025,
        torque_limit: Sequence[float] | None = None,
    ) -> None:
        self._logs = logs_of(logs)
        self._names = [parameter.name for parameter in parameters_of(parameters)]
        timestep = finite("timestep", timestep)
        if timestep <= 0:
            raise ValueError(f"timestep is {timestep}; it must be above 0 s")
        if torque_limit is not None:
            torque_limit = [real("a number of torque_limit", one) for one in items("torque_limit", torque_limit, "numbers")]
            if not all(one > 0 for one in torque_limit):
                raise ValueError(f"torque_limit is {torque_limit}; each must be above 0 N·m, or infinite")
        self._timestep = timestep
        spec = mujoco.MjSpec.from_file(path("model", model))
        for joint in list(spec.joints):
            if joint.type == mujoco.mjtJoint.mjJNT_FREE:
                spec.delete(joint)
        for item in [*spec.keys, *spec.sensors]:
            spec.delete(item)
        limits = {} if torque_limit is not None else _limits(spec.copy().compile())
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        for joint in spec.joints:
            actuator = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            actuator.set_to_position(kp=1.0, kv=1.0)
        self._model = spec.compile()
        self._model.opt.timestep = timestep
        self._model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        names = [self._model.joint(number).name for number in range(self._model.njnt)]
        self._joints = [name.removesuffix("_joint") for name in names]
        if self._model.nq != self._model.nv or self._model.nv != len(names):
            raise ValueError("the robot has joints that are neither hinges nor slides")
        if torque_limit is None:
            torque_limit = [limits.get(name, np.inf) for name in names]
        if len(torque_limit) != len(names):
            raise ValueError(f"torque_limit has {len(torque_limit)} numbers; the robot has {len(names)} joints")
        limited = np.isfinite(torque_limit)
        self._model.actuator_forcelimited[:] = limited
        self._model.actuator_forcerange[:] = np.where(limited, torque_limit, 0.0)[:, None] * np.array([-1.0, 1.0])
        self._masks = [self._mask(name) for name in self._names]
        self._plans = [self._plan(number, log) for number, log in enumerate(self._logs)]

    @property
    def joints(self) -> list[str]:
        """The robot's joints, in the order of all signals."""
        return list(self._joints)

    def __call__(self, candidates: NDArray[np.float64]) -> list[dict[str, NDArray[np.float32]]]:
        """Simulates candidates, shape ``(candidates, parameters)``, on every log."""
        delays = np.zeros(len(candidates))
        if "delay" in self._names:
            delays = candidates[:, self._names.index("delay")]
        return [self._play(candidates, delays, plan) for plan in self._plans]

    def _mask(self, name: str) -> NDArray[np.bool_]:
        field, _, pattern = name.partition(":")
        if name != "delay" and field not in _FIELDS:
            raise ValueError(f"the parameter {name!r} is none of delay, {', '.join(_FIELDS)} (with a pattern: armature:*_hip)")
        mask = np.array([fnmatch.fnmatchcase(joint, pattern or "*") for joint in self._joints])
        if not mask.any():
            raise ValueError(f"the pattern of {name!r} takes no joint of {', '.join(self._joints)}")
        return mask

    def _plan(self, number: int, log: Log) -> tuple[NDArray[np.float64], int, NDArray[np.int64], Log]:
        if log.target is None or log.dt is None or log.kp is None or log.kd is None:
            raise ValueError(f"log {number} needs target, dt, kp and kd: a robot without a policy replays its targets")
        if log.joints is None or sorted(log.joints) != sorted(self._joints):
            raise ValueError(f"log {number} has the joints {log.joints}; the robot has {self._joints}")
        every = round(log.dt / self._timestep)
        if every < 1 or abs(every * self._timestep - log.dt) > 1e-9:
            raise ValueError(f"log {number}: {log.dt} s between samples is no multiple of the timestep, {self._timestep} s")
        order = np.array([list(log.joints).index(joint) for joint in self._joints])
        return np.asarray(log.target, np.float64)[:, order], every, order, log

    def _candidate(self, values: NDArray[np.float64], log: Log, order: NDArray[np.int64]) -> mujoco.MjModel:
        model = copy.copy(self._model)
        kp, kd = np.asarray(log.kp, np.float64)[order], np.asarray(log.kd, np.float64)[order]
        model.actuator_gainprm[:, 0] = kp
        model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -kp, -kd
        for name, mask, value in zip(self._names, self._masks, values):
            if name != "delay":
                getattr(model, _FIELDS[name.partition(":")[0]])[mask] = value
        # The softness of friction loss depends on the armature.
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def _play(
        self,
        candidates: NDArray[np.float64],
        delays: NDArray[np.float64],
        plan: tuple[NDArray[np.float64], int, NDArray[np.int64], Log],
    ) -> dict[str, NDArray[np.float32]]:
        target, every, order, log = plan
        dt = log.dt or 0.0
        count, width, samples = len(candidates), len(self._joints), len(target)
        models = [self._candidate(values, log, order) for values in candidates]
        steps = samples * every
        control = np.empty((count, steps, width))
        for row, delay in zip(control, delays):
            row[:] = self._delayed(target, dt, delay, steps)
        start = np.concatenate([np.asarray(log.position)[0, order], np.asarray(log.velocity)[0, order]])
        later = self._simulated(models, start, control, every)[:, : samples - 1]
        found = np.concatenate([np.broadcast_to(start, (count, 1, 2 * width)), later], axis=1)
        back = np.argsort(order)
        return {
            "position": found[:, :, :width][:, :, back].astype(np.float32),
            "velocity": found[:, :, width:][:, :, back].astype(np.float32),
        }

    def _simulated(
        self, models: list[mujoco.MjModel], start: NDArray[np.float64], control: NDArray[np.float64], every: int
    ) -> NDArray[np.float64]:
        """Positions and velocities, shape ``(candidates, periods, 2 * joints)``, after each ``every`` steps of all
        ``models``, from ``start``, shape ``(2 * joints,)``, under ``control``, shape ``(candidates, steps, joints)``."""
        raise NotImplementedError

    def _delayed(self, target: NDArray[np.float64], dt: float, delay: float, steps: int) -> NDArray[np.float64]:
        """The mean target of each physics step; each target comes ``delay`` s late. The cost is smooth in the delay."""
        sums = np.vstack([np.zeros(target.shape[1]), np.cumsum(target, axis=0)]) * dt
        at = np.arange(steps + 1) * self._timestep - delay
        whole = np.clip(np.floor(at / dt).astype(int), 0, len(target) - 1)
        # Before the first target there was the first target.
        reached = sums[whole] + (at - whole * dt)[:, None] * target[whole]
        mean: NDArray[np.float64] = np.diff(reached, axis=0) / self._timestep
        return mean


def _limits(model: mujoco.MjModel) -> dict[str, float]:
    """The greatest torque of each joint that a motor of the model drives, N·m."""
    limits: dict[str, float] = {}
    for number in range(model.nu):
        if model.actuator_trntype[number] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        ranges = []
        if model.actuator_forcelimited[number]:
            ranges.append(np.abs(model.actuator_forcerange[number]).max())
        if model.actuator_ctrllimited[number] and model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_NONE:
            gear = abs(model.actuator_gear[number, 0] * model.actuator_gainprm[number, 0])
            ranges.append(np.abs(model.actuator_ctrlrange[number]).max() * gear)
        if ranges:
            limits[model.joint(model.actuator_trnid[number, 0]).name] = min(ranges)
    return limits
