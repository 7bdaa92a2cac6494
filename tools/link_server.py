"""Runs Unitree's simulator server for any robot of the link: the vendor's bridge as it is, over DDS.

The robot hangs: its base is fixed, and each motor of the robot's file (crates/gaitfit-robot/robots/*.toml) turns a joint with
a small inertia, friction and the file's range, in MuJoCo. So no robot description is needed, and contacts are left out.
Gravity acts on the inertial unit alone: every link's centre of mass is on its axis. The server ends after SECONDS, when its standard input is closed, or when it is killed. Its last line is a JSON
object: states published, commands taken, commands whose checksum is not the SDK's, commands that do not repeat the machine's
kind (humanoids), commands with motors beyond the robot's, the largest torque in parts of the motor's, and how far each joint
moved, rad.

Needs the packages cyclonedds (11.0.1), mujoco and numpy, and the vendor's software (both BSD-3).
Usage: python tools/link_server.py ROBOT.toml [--vendor FOLDER] [--domain 1] [--interface lo] [--seconds 60]
"""

import argparse
import json
import pathlib
import select
import sys
import time
import tomllib
import types

ROOT = pathlib.Path(__file__).resolve().parent.parent
MACHINE = 5  # The kind of machine that a humanoid's state states.
DT = 0.005  # The vendor's time between states, s.


def model_text(motors):
    """A fixed base with a joint for each motor, and the sensors that the bridge reads, in its order."""
    bodies, actuators, sensors = [], [], {"jointpos": [], "jointvel": [], "jointactuatorfrc": []}
    for motor in motors:
        name, torque = motor["joint"], motor["torque"]
        limited = 'range="{} {}" limited="true"'.format(*motor["range"]) if "range" in motor else 'limited="false"'
        # Torque over inertia is that of a Go2's hip.
        inertia = 0.04 * max(torque / 23.7, 0.2)
        bodies.append(
            f'<body><inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>'
            f'<joint name="{name}" type="hinge" axis="0 1 0" damping="{0.3 * torque / 23.7}" {limited}/></body>'
        )
        actuators.append(f'<motor name="{name}" joint="{name}" ctrllimited="true" ctrlrange="{-torque} {torque}"/>')
        for kind, lines in sensors.items():
            lines.append(f'<{kind} name="{name}_{kind}" joint="{name}"/>')
    sensors = "".join(line for lines in sensors.values() for line in lines)
    return (
        f'<mujoco><compiler autolimits="false" angle="radian"/><option timestep="{DT}" gravity="0 0 -9.81" integrator="implicitfast"/>'
        f'<worldbody><body name="base" pos="0 0 1"><inertial pos="0 0 0" mass="10" diaginertia="1 1 1"/><site name="imu"/>'
        f"{''.join(bodies)}</body></worldbody><actuator>{''.join(actuators)}</actuator><sensor>{sensors}"
        '<framequat name="imu_quat" objtype="site" objname="imu"/><gyro name="imu_gyro" site="imu"/>'
        '<accelerometer name="imu_acc" site="imu"/><framepos name="frame_pos" objtype="site" objname="imu"/>'
        '<framelinvel name="frame_vel" objtype="site" objname="imu"/></sensor></mujoco>'
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", type=pathlib.Path)
    parser.add_argument("--vendor", type=pathlib.Path, default=ROOT.parent / "shared/third_party")
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--interface", default="lo")
    parser.add_argument("--seconds", type=float, default=60.0)
    arguments = parser.parse_args()
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

    model = mujoco.MjModel.from_xml_string(model_text(motors))
    data = mujoco.MjData(model)
    data.qpos[:] = [motor["lying"] for motor in motors]
    mujoco.mj_forward(model, data)
    crc = CRC()
    counts = {"states": 0, "commands": 0, "wrong": 0, "machine": 0, "beyond": 0}
    load = numpy.zeros(len(motors))
    strength = numpy.array([motor["torque"] for motor in motors])

    class Counting(UnitreeSdk2Bridge):
        def LowCmdHandler(self, message):
            counts["commands"] += 1
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
    bridge = Counting(model, data)
    print(json.dumps({"ready": True}), flush=True)
    begin = time.perf_counter()
    low, high = data.qpos.copy(), data.qpos.copy()
    steps = 0
    while True:
        if time.perf_counter() - begin > arguments.seconds:
            break
        if select.select([sys.stdin], [], [], 0)[0] and not sys.stdin.readline():
            break
        mujoco.mj_step(model, data)
        steps += 1
        numpy.minimum(low, data.qpos, out=low)
        numpy.maximum(high, data.qpos, out=high)
        wait = steps * DT - (time.perf_counter() - begin)
        if wait > 0:
            time.sleep(wait)
        elif wait < -0.05:
            begin -= wait  # The clock of a simulator that was held up waits for it.
    assert bridge is not None
    moved = {motor["joint"]: round(float(way), 4) for motor, way in zip(motors, high - low, strict=True)}
    print(json.dumps({**counts, "load": round(float(load.max()), 4), "moved": moved}), flush=True)


if __name__ == "__main__":
    main()
