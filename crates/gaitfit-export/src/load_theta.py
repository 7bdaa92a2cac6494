"""theta.json as a dictionary, and its numbers in a MuJoCo model (for MJX and MuJoCo Playground: before put_model)."""

import json
import math
import pathlib

import mujoco

# What a file may switch off, and theta.json has for every joint; the tendons' numbers that a switch concerns stay off.
FLAGS = {"mjDSBL_FRICTIONLOSS": ("tendon_frictionloss",), "mjDSBL_SPRING": ("tendon_stiffness",),
         "mjDSBL_DAMPER": ("tendon_damping",), "mjDSBL_PASSIVE": ("tendon_stiffness", "tendon_damping")}


def load(path=pathlib.Path(__file__).with_name("theta.json")):
    return json.loads(pathlib.Path(path).read_text(encoding="utf-8"))


def apply(model, theta):
    """Joints' numbers and masses of links of a model of the robot's original file; friction of all contacts. A spring_torque
    of a joint without stiffness is not among them: add it to data.qfrc_applied at every physics step."""
    for flag, numbers in FLAGS.items():
        bit = int(getattr(mujoco.mjtDisableBit, flag, 0))
        if model.opt.disableflags & bit:
            model.opt.disableflags &= ~bit
            for name in numbers:
                getattr(model, name)[:] = 0
    for name, joint in theta["joints"].items():
        place, dof = model.joint(name).id, model.joint(name).dofadr[0]
        model.dof_armature[dof], model.dof_frictionloss[dof] = joint["armature"], joint["frictionloss"]
        # From MuJoCo 4 on these are polynomials; their first number is the linear one.
        model.dof_damping.reshape(model.nv, -1)[dof, 0] = joint["damping"]
        model.jnt_stiffness.reshape(model.njnt, -1)[place, 0] = joint["stiffness"]
        if joint["stiffness"]:
            model.qpos_spring[model.jnt_qposadr[place]] = joint["spring_torque"] / joint["stiffness"]
    for name, link in theta["links"].items():
        body = model.body(name).id
        model.body_mass[body] *= link["mass_factor"]
        model.body_inertia[body] *= link["mass_factor"]
        model.body_ipos[body] += link["com_shift"]
    if theta["links"]:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    friction(model, theta)


def stribeck(model, data, theta, torque=None):
    """Dry friction of joints with stiction or load_friction, at their present velocities: call it before every mj_step.
    torque: what the motors give in this step, as drive.torque does; without it what the actuators gave last."""
    for place, (name, joint) in enumerate(theta["joints"].items()):
        if joint["stiction"] or joint["load_friction"]:
            dof = model.joint(name).dofadr[0]
            left = math.exp(-((data.qvel[dof] / joint["stribeck_velocity"]) ** 2))
            load = joint["load_friction"] * abs(data.qfrc_actuator[dof] if torque is None else torque[place])
            model.dof_frictionloss[dof] = joint["frictionloss"] + joint["stiction"] * left + load


def gears(spec, theta):
    """Play and compliance between motors and links: adds joints NAME_play and NAME_twist behind each joint that has them, to
    an MjSpec before it is compiled. Actuators and encoders stay at joint NAME, the motor. Keyframes get longer. MuJoCo's
    joint stops are soft: play opens by some thousandths of a radian more."""
    unit = math.degrees(1) if spec.compiler.degree else 1.0
    for name, joint in theta["joints"].items():
        motor = spec.joint(name)
        # A part without mass between two joints needs some inertia, or its stop gives way.
        armature = 1e-3 if joint["play"] and joint["compliance"] else 2e-4
        # MuJoCo's own defaults: the file's are for its joints.
        between = {"default": mujoco.MjSpec().default, "type": motor.type, "axis": motor.axis, "pos": motor.pos,
                   "armature": armature}
        if joint["play"]:
            end = unit * joint["play"] / 2
            motor.parent.add_joint(name=f"{name}_play", range=[-end, end], limited=True, solref_limit=[0.004, 1.0],
                                   solimp_limit=[0.99, 0.999, 0.001, 0.5, 2.0], damping=[1e-3, 0, 0], **between)
        if joint["compliance"]:
            stiffness = 1 / joint["compliance"]
            motor.parent.add_joint(name=f"{name}_twist", stiffness=[stiffness, 0, 0],
                                   damping=[2e-3 * stiffness, 0, 0], **between)


def friction(model, theta):
    """Friction of all contacts, and time constant and impedance of the ground's, which no exported robot file says.

    The impedance is set geom by geom. It is the fitted one where foot or ground has priority, as the Go2's feet have,
    or where the ground is one geom. Otherwise MuJoCo mixes foot and ground afterwards. Contacts of the robot with
    itself change too.
    """
    least = theta.get("ground_impedance", 0.0)
    before = model.geom_solimp.copy()
    model.geom_friction[:] *= theta["friction_factor"]
    model.pair_friction[:] *= theta["friction_factor"]
    for solref in [*model.geom_solref, *model.pair_solref]:
        if solref[0] > 0:
            solref[0] *= 1 + theta["ground_softness"]
    for solimp in [*model.geom_solimp, *model.pair_solimp]:
        if solimp[2] > 0:
            solimp[0] = max(solimp[0], min(least, solimp[1]))
    fixed = model.body_weldid[model.geom_bodyid] == 0
    if least > 0 and fixed.sum() == 1:
        ground = int(fixed.argmax())
        for geom in range(model.ngeom):
            share = model.geom_solmix[geom] / (model.geom_solmix[geom] + model.geom_solmix[ground] + 1e-300)
            if geom == ground or model.geom_priority[geom] != model.geom_priority[ground] or share < 1e-9:
                continue
            # MuJoCo mixes these two: the geom's number becomes the one with which the mixture is the fitted impedance.
            mixed = share * before[geom] + (1 - share) * before[ground]
            if mixed[2] > 0:
                wanted = max(mixed[0], min(least, mixed[1]))
                model.geom_solimp[geom, 0] = (wanted - (1 - share) * model.geom_solimp[ground, 0]) / share
