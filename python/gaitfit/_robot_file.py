"""What a robot's file states."""

from __future__ import annotations

import json
from dataclasses import dataclass

from . import _gaitfit
from ._arguments import flag, path
from ._decode import Named, decoded
from ._given import PathLike, robot_of


@dataclass(frozen=True)
class RobotJoint:
    """The numbers of a joint that a robot's file states, in the units of a hinge. Those of a slide are in m, m/s, N and kg: its
    damping is in N·s/m, its stiffness in N/m.

    Attributes:
        name: Name of the joint.
        slides: Whether it slides along its axis instead of turning about it.
        range: Its limits, rad; ``None`` without limits.
        frictionloss: Dry friction torque, N·m.
        armature: Reflected rotor inertia, kg·m².
        damping: Viscous damping, N·m·s/rad.
        stiffness: Stiffness of a spring, N·m/rad.
        rest: Rest angle of that spring, rad.
        torque_limit: Largest torque, N·m; ``None`` without a limit.
        velocity_limit: Largest speed, rad/s; ``None`` if the file does not state it.

    >>> gaitfit.read_robot("assets/go2.xml").joints["FL_calf_joint"].torque_limit
    45.43
    """

    name: str
    slides: bool
    range: tuple[float, float] | None
    frictionloss: float
    armature: float
    damping: float
    stiffness: float
    rest: float
    torque_limit: float | None
    velocity_limit: float | None


@dataclass(frozen=True)
class RobotFile:
    """What :func:`gaitfit.read_robot` returns: a robot before a fit.

    Attributes:
        name: Name of the robot.
        mass: Mass of all bodies, kg.
        joints: The joints by name, in the file's order.

    Other quantities of a fit are no part of such a file: delays, play, biases and the like are 0, and factors are 1.

    >>> len(gaitfit.read_robot("assets/go2.xml").joints)
    12
    """

    name: str
    mass: float
    joints: Named[RobotJoint]


def read_robot(robot: PathLike = "unitree-go2", *, lenient: bool = False) -> RobotFile:
    """The numbers of a robot's file, which the values of a fit or of ``theta=`` replace.

    Arguments:
        robot: The robot's file, MJCF or URDF; by default the built-in Go2.
        lenient: Leave out what the engine cannot simulate in the robot's file.

    Returns its mass and the numbers of its joints.

    Raises ``FileNotFoundError`` for a file that is missing, and :class:`GaitfitError` for one that is no robot.

    >>> gaitfit.read_robot().joints["FL_calf_joint"].frictionloss
    0.0
    """
    file = robot_of(path("robot", robot))
    return decoded(RobotFile, json.loads(_gaitfit.robot_numbers(str(file), flag("lenient", lenient))))
