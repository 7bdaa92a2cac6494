"""What robots are and do at a moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RobotsState:
    """Everything of :class:`Robots` that changes from step to step. It can be pickled.

    Attributes:
        task: Settings of the task, as TOML.
        seed: Seed of the robots.
        numbers: The engine's numbers.
        steps: Steps since each episode began, shape ``(num_envs,)``.
        step: Steps of all robots.

    >>> robots = gaitfit.Robots(num_envs=3)
    >>> len(robots.state().steps)
    3
    """

    task: str
    seed: int
    numbers: NDArray[np.float32]
    steps: NDArray[np.uint32]
    step: int


@dataclass(frozen=True, eq=False)
class Motion:
    """How all robots move: the true values of the simulation, without the noise of observations. After an episode's end they are
    those of the next episode, unless ``autoreset`` is off. The arrays have 32-bit floats. They are NumPy's, or on a GPU those that
    :meth:`Robots.motion` describes.

    Attributes:
        base_position: Position of the base, m, world frame, shape ``(num_envs, 3)``.
        base_quaternion: Its orientation, wxyz, shape ``(num_envs, 4)``.
        base_linear_velocity: Its velocity, m/s, world frame, shape ``(num_envs, 3)``.
        base_angular_velocity: Its angular velocity, rad/s, body frame, shape ``(num_envs, 3)``.
        joint_position: Joint positions as the encoders report them, rad, shape ``(num_envs, joints)``.
        joint_velocity: Joint velocities, rad/s, shape ``(num_envs, joints)``.
        torque: Torques on the joints in the last physics step, N·m, shape ``(num_envs, joints)``.

    >>> motion = gaitfit.Robots(num_envs=3).motion()
    >>> motion.base_position.shape, motion.joint_position.shape
    ((3, 3), (3, 12))
    """

    base_position: Any
    base_quaternion: Any
    base_linear_velocity: Any
    base_angular_velocity: Any
    joint_position: Any
    joint_velocity: Any
    torque: Any

    def __repr__(self) -> str:
        return f"Motion({self.base_position.shape[0]} robots, {self.joint_position.shape[1]} joints)"
