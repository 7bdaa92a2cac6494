"""Runs Unitree's simulator server for any robot of the link: the vendor's bridge as it is, over DDS, without a window.

The bridge (unitree_mujoco, simulate_python/unitree_sdk2py_bridge.py) imports modules `config` and `pygame`. This script replaces
them by small modules. The robot's file (crates/gaitfit-robot/robots/*.toml) states the motors, their order and their torques.

Without --model the robot hangs: its base is fixed, and each motor turns a joint with a small inertia, friction and the file's
range. So no robot description is needed, and contacts are left out. Gravity acts on the inertial unit alone: every link's centre
of mass is on its axis.

With --model it is on a level floor: an MJCF file without includes (`gaitfit init --one-file` writes one). Meshes are left out. A
robot that can lie lies on its belly at first. One that must hang (`hangs` in its file) is held upright above the floor. LOWER
seconds after the first command it is lowered until its feet bear most of its weight, and let go LET_GO seconds after that command.
If its base then sinks below CATCH of its height, it is held there, as by a rope.

The server ends after SECONDS, when its standard input is closed, or when it is killed. Its last line is a JSON object: states
published, those between the first and the last command, commands taken, commands whose checksum is not the SDK's, commands that
do not repeat the machine's kind (humanoids), commands with motors beyond the robot's, the largest torque in parts of the motor's,
how far each joint moved, rad; and of a robot on the floor the base's path, how far it leaned, when it was let go and held again,
s since 1970. A row of the path, ten a second: x, y, z, m, heading, rad, and when, s since 1970.

Needs the packages cyclonedds (11.0.1), mujoco and numpy, and the vendor's software (both BSD-3).
Usage: python tools/link_server.py ROBOT.toml [--model FILE.xml] [--vendor FOLDER] [--domain 1] [--interface lo] [--seconds 60]
       [--dt 0.005] [--substeps 1] [--frictionloss 0] [--armature 0] [--payload 0] [--lower 4] [--let-go 13]
       [--real-time]
"""

import argparse
import json
import math
import os
import pathlib
import select
import sys
import time
import tomllib
import types
import xml.etree.ElementTree as ElementTree

ROOT = pathlib.Path(__file__).resolve().parent.parent
MACHINE = 5  # The kind of machine that a humanoid's state states.
HANG = 0.03  # Height of the feet above the floor while the robot is held, m.
LOWER_SPEED = 0.1  # m/s
BORNE = 0.7  # Part of its weight that the feet bear when it is let go.
CATCH = 0.85


def hanging_text(motors):
    """A fixed base with a joint for each motor."""
    bodies = []
    for motor in motors:
        torque = motor["torque"]
        limited = 'range="{} {}" limited="true"'.format(*motor["range"]) if "range" in motor else 'limited="false"'
        # Torque over inertia is that of a Go2's hip.
        inertia = 0.04 * max(torque / 23.7, 0.2)
        bodies.append(
            f'<body><inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>'
            f'<joint name="{motor["joint"]}" type="hinge" axis="0 1 0" damping="{0.3 * torque / 23.7}" {limited}/></body>'
        )
    return (
        '<mujoco><compiler autolimits="false" angle="radian"/><option gravity="0 0 -9.81" integrator="implicitfast"/>'
        '<worldbody><body name="base" pos="0 0 1"><inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/><site name="imu"/>'
        f"{''.join(bodies)}</body></worldbody></mujoco>"
    )


def on_floor_text(path):
    """The robot of a file without meshes, motors and sensors, on a floor."""
    tree = ElementTree.parse(path).getroot()
    for parent in list(tree.iter()):
        for child in list(parent):
            is_mesh = child.get("mesh") or child.tag == "mesh" or child.get("type") == "mesh"
            if is_mesh or (parent is tree and child.tag in ("actuator", "sensor", "keyframe")):
                parent.remove(child)
    world = tree.find("worldbody")
    if all(geom.get("type") != "plane" for geom in world.findall("geom")):
        ElementTree.SubElement(world, "geom").attrib.update(name="floor", type="plane", size="0 0 0.05")
    bodies = [body for body in world.findall("body") if body.find("freejoint") is not None
              or any(joint.get("type") == "free" for joint in body.findall("joint"))]
    if len(bodies) != 1:
        sys.exit(f"error: {path} has {len(bodies)} bodies with a free joint in its world, and needs one; write one file with "
                 "`gaitfit init --one-file`")
    base = bodies[0]
    if all(site.get("name") != "imu" for site in base.iter("site")):
        ElementTree.SubElement(base, "site").attrib.update(name="imu")
    return ElementTree.tostring(tree, encoding="unicode")


def joint_names(text, motors):
    """The robot's name of each motor's joint."""
    names = {joint.get("name") for joint in ElementTree.fromstring(text).iter("joint")}
    found = []
    for motor in motors:
        known = [motor["joint"], *motor.get("aliases", [])]
        known += [name + "_joint" for name in known]
        name = next((name for name in known if name in names), None)
        if name is None:
            sys.exit(f"error: the model has no joint {motor['joint']}")
        found.append(name)
    return found


def with_motors(text, motors, names):
    """The model with a motor for each joint and the sensors that the bridge reads, in its order."""
    actuators, sensors = [], {"jointpos": [], "jointvel": [], "jointactuatorfrc": []}
    for motor, name in zip(motors, names, strict=True):
        torque = motor["torque"]
        actuators.append(f'<motor name="{name}" joint="{name}" ctrllimited="true" ctrlrange="{-torque} {torque}"/>')
        for kind, lines in sensors.items():
            lines.append(f'<{kind} name="{name}_{kind}" joint="{name}"/>')
    sensors = "".join(line for lines in sensors.values() for line in lines)
    return text.replace(
        "</mujoco>",
        f"<actuator>{''.join(actuators)}</actuator><sensor>{sensors}"
        '<framequat name="imu_quat" objtype="site" objname="imu"/><gyro name="imu_gyro" site="imu"/>'
        '<accelerometer name="imu_acc" site="imu"/><framepos name="frame_pos" objtype="site" objname="imu"/>'
        '<framelinvel name="frame_vel" objtype="site" objname="imu"/></sensor></mujoco>',
    )


class OnFloor:
    """A robot with a floating base: where it begins, who holds it, and what is seen of it."""

    def __init__(self, mujoco, numpy, model, data, hangs, lower, let_go):
        self.mujoco, self.numpy, self.model, self.data = mujoco, numpy, model, data
        self.lower, self.let_go_after = lower, let_go
        self.weight = -model.opt.gravity[2] * sum(model.body_mass)
        self.path, self.highest, self.least_up = [], 0.0, 1.0
        self.let_go, self.caught, self.released_at = None, None, None
        paired = {*model.pair_geom1, *model.pair_geom2}
        bottom = min(
            data.geom_xpos[geom][2] - self.reach(geom)
            for geom in range(model.ngeom)
            if model.geom_bodyid[geom] != 0
            and (model.geom_contype[geom] or model.geom_conaffinity[geom] or geom in paired)
        )
        data.qpos[2] += (HANG if hangs else 0.01) - bottom
        self.held = data.qpos[:7].copy() if hangs else None
        mujoco.mj_forward(model, data)

    def reach(self, geom):
        """How far a geom reaches below its centre, m."""
        kind, size, down = self.model.geom_type[geom], self.model.geom_size[geom], abs(self.data.geom_xmat[geom][6:9])
        kinds = self.mujoco.mjtGeom
        if kind == kinds.mjGEOM_SPHERE:
            return size[0]
        if kind == kinds.mjGEOM_CAPSULE:
            return size[0] + size[1] * down[2]
        if kind == kinds.mjGEOM_CYLINDER:
            return size[1] * down[2] + size[0] * math.sqrt(max(0.0, 1.0 - down[2] ** 2))
        return float(size @ down)

    def hold(self, dt, commanded):
        """Holds the base, lowers it, lets it go and catches it. `commanded`: since when there have been commands, s."""
        data = self.data
        if self.held is None:
            if self.released_at is not None and self.caught is None and data.qpos[2] < CATCH * self.released_at:
                self.held, self.caught = data.qpos[:7].copy(), time.time()
            return
        if self.caught is None and commanded is not None and commanded > self.lower:
            if self.borne() < BORNE * self.weight:
                self.held[2] -= LOWER_SPEED * dt
            elif commanded > self.let_go_after:
                self.released_at, self.held, self.let_go = float(data.qpos[2]), None, time.time()
                return
        data.qpos[:7] = self.held
        data.qvel[:6] = 0.0

    def borne(self):
        """The force with which the floor bears the robot, N, without that on slopes."""
        borne = 0.0
        for number in range(self.data.ncon):
            contact, force = self.data.contact[number], self.numpy.zeros(6)
            if 0 in self.model.geom_bodyid[[contact.geom1, contact.geom2]]:
                self.mujoco.mj_contactForce(self.model, self.data, number, force)
                borne += force[0]
        return borne

    def look(self):
        """Notes the base's height and lean."""
        self.highest = max(self.highest, float(self.data.qpos[2]))
        self.least_up = min(self.least_up, float(1 - 2 * (self.data.qpos[4] ** 2 + self.data.qpos[5] ** 2)))

    def note_path(self):
        """Adds a row to the path."""
        w, x, y, z = self.data.qpos[3:7]
        heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.path.append([round(float(value), 4) for value in (*self.data.qpos[:3], heading, time.time())])

    def seen(self):
        """What the last line has of the robot."""
        return {
            "highest": self.highest, "least_up": self.least_up, "end": [float(x) for x in self.data.qpos[:3]],
            "let_go": self.let_go, "caught": self.caught, "path": self.path,
        }


def read_arguments():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", type=pathlib.Path)
    parser.add_argument("--model", type=pathlib.Path, help="MJCF file of the robot, which is on a floor then")
    parser.add_argument("--vendor", type=pathlib.Path, default=ROOT.parent / "shared/third_party")
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--interface", default="lo")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--dt", type=float, default=0.005, help="time between states, s; the vendor's is 0.005")
    parser.add_argument("--substeps", type=int, default=1, help="physics steps between states")
    parser.add_argument("--frictionloss", type=float, default=0.0, help="added to every joint, N·m")
    parser.add_argument("--armature", type=float, default=0.0, help="added to every joint, kg·m²")
    parser.add_argument("--payload", type=float, default=0.0, help="added to the mass of the base, kg")
    parser.add_argument("--lower", type=float, default=4.0, help="a robot that hangs is lowered this long after the first command, s")
    parser.add_argument("--let-go", type=float, default=13.0, help="and let go this long after it, s")
    parser.add_argument("--real-time", action="store_true", help="ask for real-time priority, as on a robot's own computer")
    return parser.parse_args()


def make_model(mujoco, arguments, motors):
    """Model and data of the robot, and the places of the motors' joints in `qpos`."""
    text = on_floor_text(arguments.model) if arguments.model else hanging_text(motors)
    names = joint_names(text, motors)
    model = mujoco.MjModel.from_xml_string(with_motors(text, motors, names))
    model.opt.timestep = arguments.dt / arguments.substeps
    joints = [model.joint(name) for name in names]
    places = [joint.qposadr[0] for joint in joints]
    for joint in joints:
        model.dof_frictionloss[joint.dofadr[0]] += arguments.frictionloss
        model.dof_armature[joint.dofadr[0]] += arguments.armature
    model.body_mass[1] += arguments.payload
    data = mujoco.MjData(model)
    for motor, place in zip(motors, places, strict=True):
        data.qpos[place] = motor["lying"]
    mujoco.mj_forward(model, data)
    return model, data, places


def main():
    arguments = read_arguments()
    if arguments.real_time:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
        except (AttributeError, PermissionError) as refused:
            print(f"no real-time priority: {refused}", file=sys.stderr)
    robot = tomllib.loads(arguments.robot.read_text())
    motors, humanoid = robot["motors"], robot["messages"] == "unitree_hg"
    sys.path.insert(0, str(arguments.vendor / "unitree_sdk2_python"))
    sys.path.insert(0, str(arguments.vendor / "unitree_mujoco/simulate_python"))
    config = types.ModuleType("config")
    # The bridge takes the humanoids' messages for this name alone.
    config.ROBOT = "g1" if humanoid else "go2"
    sys.modules["config"] = config
    sys.modules["pygame"] = types.ModuleType("pygame")

    import mujoco
    import numpy
    from unitree_sdk2py.core.channel import ChannelFactoryInitialize
    from unitree_sdk2py.utils.crc import CRC
    from unitree_sdk2py_bridge import UnitreeSdk2Bridge

    model, data, places = make_model(mujoco, arguments, motors)
    on_floor = None
    if arguments.model:
        on_floor = OnFloor(mujoco, numpy, model, data, robot.get("hangs", False), arguments.lower, arguments.let_go)
    crc = CRC()
    counts = {"states": 0, "commands": 0, "wrong": 0, "machine": 0, "beyond": 0}
    at_commands = []
    load = numpy.zeros(len(motors))
    strength = numpy.array([motor["torque"] for motor in motors])

    class Counting(UnitreeSdk2Bridge):
        def LowCmdHandler(self, message):
            counts["commands"] += 1
            at_commands[1:] = [(counts["states"], time.perf_counter())]
            # A robot drops what its checksum refuses; the bridge does not look.
            if crc.Crc(message) != message.crc:
                counts["wrong"] += 1
                return
            counts["machine"] += humanoid and message.mode_machine != MACHINE
            counts["beyond"] += any(motor.mode or motor.kp or motor.kd for motor in message.motor_cmd[len(motors) :])
            super().LowCmdHandler(message)
            numpy.maximum(load, numpy.abs(self.mj_data.ctrl) / strength, out=load)

        def PublishLowState(self):
            counts["states"] += 1
            if humanoid:
                self.low_state.mode_machine = MACHINE
            super().PublishLowState()

    ChannelFactoryInitialize(arguments.domain, arguments.interface)
    step = model.opt.timestep
    # The bridge publishes once in this time.
    model.opt.timestep = arguments.dt
    bridge = Counting(model, data)
    model.opt.timestep = step
    print(json.dumps({"ready": True}), flush=True)
    begin = begun = time.perf_counter()
    low, high = data.qpos[places].copy(), data.qpos[places].copy()
    steps, late = 0, 0
    while True:
        now = time.perf_counter() - begin
        if now > arguments.seconds or select.select([sys.stdin], [], [], 0)[0] and not sys.stdin.readline():
            break
        commanded = time.perf_counter() - at_commands[0][1] if at_commands else None
        for _ in range(arguments.substeps):
            if on_floor:
                on_floor.hold(step, commanded)
            mujoco.mj_step(model, data)
        steps += 1
        numpy.minimum(low, data.qpos[places], out=low)
        numpy.maximum(high, data.qpos[places], out=high)
        if on_floor:
            on_floor.look()
            if steps % max(1, round(0.1 / arguments.dt)) == 0:
                on_floor.note_path()
        wait = steps * arguments.dt - (time.perf_counter() - begin)
        if wait > 0:
            time.sleep(wait)
        elif wait < -0.05:
            late += 1
            begin -= wait  # The clock of a simulator that was held up waits for it.
    assert bridge is not None
    moved = {motor["joint"]: round(float(way), 4) for motor, way in zip(motors, high - low, strict=True)}
    commanded = at_commands[-1][0] - at_commands[0][0] if at_commands else 0
    seen = on_floor.seen() if on_floor else {}
    result = {**counts, "states_commanded": commanded, "load": round(float(load.max()), 4), "moved": moved}
    result |= {"seconds": round(steps * arguments.dt, 3), "held_up": late}
    result |= {"pace": round(steps * arguments.dt / (time.perf_counter() - begun), 4)}
    print(json.dumps(result | seen), flush=True)


if __name__ == "__main__":
    main()
