"""MuJoCo Warp as the simulator of a fit. Needs ``mujoco-warp`` (``pip install "gaitfit[mujoco-warp]"``)."""

# MuJoCo is compiled and names its contents at run time.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import copy

import mujoco
import mujoco_warp
import numpy as np
import warp
from numpy.typing import NDArray

from ._clamped import Clamped

__all__ = ["ClampedRobot"]

# What a candidate changes in its model; each world has its own.
_OWN = (
    "dof_frictionloss",
    "dof_armature",
    "dof_damping",
    "dof_invweight0",
    "body_invweight0",
    "actuator_gainprm",
    "actuator_biasprm",
)


class ClampedRobot(Clamped):
    """:class:`gaitfit.mujoco.ClampedRobot` in MuJoCo Warp, one world for each candidate, on Warp's default device (the
    first GPU, else the processor). Arguments as there, without ``threads``. Warp computes with 32 bits, and compiles its
    kernels at the first use: half a minute on a processor, kept for later processes.

    >>> simulate = ClampedRobot("assets/go2.xml", log, parameters)      # doctest: +SKIP
    """

    def _simulated(
        self, models: list[mujoco.MjModel], start: NDArray[np.float64], control: NDArray[np.float64], every: int
    ) -> NDArray[np.float64]:
        count, steps, width = control.shape
        # Warp leaves out what is zero in the model that it gets.
        whole = copy.copy(models[0])
        whole.dof_frictionloss[:], whole.dof_damping[:] = 1.0, 1.0
        model = mujoco_warp.put_model(whole)
        for name in _OWN:
            shared, own = getattr(model, name), np.stack([getattr(one, name) for one in models])
            if own.ndim > shared.ndim:
                # Vectors: MuJoCo's may be longer than Warp's.
                own = own[..., : shared.dtype._length_]
            setattr(model, name, warp.array(np.ascontiguousarray(own, np.float32), dtype=shared.dtype))
        data = mujoco_warp.put_data(whole, mujoco.MjData(whole), nworld=count)
        for array, values in ((data.qpos, start[:width]), (data.qvel, start[width:])):
            array.assign(np.tile(values, (count, 1)).astype(np.float32))
        # Step by step, as Warp's arrays are one block each.
        control = warp.array(np.ascontiguousarray(control.swapaxes(0, 1), np.float32))
        found = np.empty((count, steps // every, 2 * width))
        for period in range(steps // every):
            for step in range(period * every, (period + 1) * every):
                warp.copy(data.ctrl, control[step])
                mujoco_warp.step(model, data)
            found[:, period, :width], found[:, period, width:] = data.qpos.numpy(), data.qvel.numpy()
        return found
