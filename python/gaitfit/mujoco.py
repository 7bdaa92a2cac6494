"""Official MuJoCo as the simulator of a fit. Needs ``mujoco`` (``pip install "gaitfit[mujoco]"``)."""

# MuJoCo is compiled and names its contents at run time.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
from collections.abc import Sequence

from ._needs import lacking

try:
    import mujoco
except ImportError as missing:
    raise lacking("mujoco", "mujoco", missing) from missing
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from ._arguments import threads as checked
from ._clamped import Clamped
from ._logs import Log
from ._own_simulator import Parameter

__all__ = ["ClampedRobot"]


class ClampedRobot(Clamped):
    """A robot whose base is held and whose legs hang in the air, in official MuJoCo, for :func:`gaitfit.fit_simulator`.

    It plays the logs' position targets through the logs' PD gains, which MuJoCo evaluates at every physics step, on all
    candidates at once with ``mujoco.rollout``. Contacts are off. A replay starts in the log's first sample. A free joint of the
    model's base is removed and its actuators are replaced.

    Arguments:
        model: An MJCF or URDF file.
        logs: The logs whose targets it plays.
        parameters: What is searched.
        timestep: The physics step, s.
        torque_limit: N·m, one number for each joint, instead of the model's limits.
        threads: Threads; by default one for each core.

    Raises ``ValueError`` for logs without targets or gains, and for parameters that it does not have.

    A parameter's name is what it sets: ``frictionloss``, N·m, ``armature``, kg·m², or ``damping``, N·m·s/rad, of all
    joints, or of those that a pattern takes, as in ``frictionloss:*_hip``; or ``delay``, s, of the targets.

    >>> log = gaitfit.read_log("examples/go2-demo/fit.csv")[:20]
    >>> simulate = ClampedRobot("assets/go2.xml", log, [Parameter("frictionloss:*_hip", 0.0, 1.5)], timestep=0.001)
    >>> simulate(np.array([[0.1], [0.2]]))[0]["position"].shape
    (2, 20, 12)
    """

    def __init__(
        self,
        model: str | os.PathLike[str],
        logs: Log | Sequence[Log],
        parameters: Sequence[Parameter],
        *,
        timestep: float = 0.00025,
        torque_limit: Sequence[float] | None = None,
        threads: int | None = None,
    ) -> None:
        super().__init__(model, logs, parameters, timestep=timestep, torque_limit=torque_limit)
        self._threads = checked(threads) or len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1))

    def _simulated(
        self, models: list[mujoco.MjModel], start: NDArray[np.float64], control: NDArray[np.float64], every: int
    ) -> NDArray[np.float64]:
        state = np.zeros((len(models), mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        # A full state begins with the time; positions and velocities follow.
        here = slice(1, 1 + len(start))
        state[:, here] = start
        data = [mujoco.MjData(self._model) for _ in range(min(self._threads, len(models)))]
        # What comes back begins after the first step.
        found = np.asarray(rollout.rollout(models, data, state, control)[0], np.float64)
        return found[:, every - 1 :: every, here]
