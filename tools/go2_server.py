"""Runs Unitree's simulator server for a Go2 without a window: the vendor's bridge as it is, over DDS.

The bridge (unitree_mujoco, simulate_python/unitree_sdk2py_bridge.py) imports modules `config` and `pygame`; this script
puts small stand-ins there. The robot is the vendor's go2.xml without its meshes, on a level floor, lying at first. The
server ends after SECONDS, when its standard input is closed, or when it is killed; its last line is a JSON object: states
published, those between the first and the last command, commands taken, commands whose checksum is not the SDK's, the
base's path, how far it leaned. A row of the path, ten a second: x, y, z, m, heading, rad, and when, s since 1970.

Needs the packages cyclonedds (11.0.1), mujoco and numpy, and the vendor's software (both BSD-3).
Usage: python tools/go2_server.py [--vendor FOLDER] [--domain 1] [--interface lo] [--dt 0.005] [--seconds 120]
       [--frictionloss 0] [--armature 0] [--payload 0] [--real-time]
"""

import argparse
import json
import math
import os
import pathlib
import select
import sys
import time
import types
import xml.etree.ElementTree as ElementTree

ROOT = pathlib.Path(__file__).resolve().parent.parent
LYING = {"hip": 0.0, "thigh": 1.36, "calf": -2.65}


def model_text(path):
    """The vendor's robot without meshes, on a floor."""
    tree = ElementTree.parse(path).getroot()
    for parent in list(tree.iter()):
        for child in list(parent):
            if child.get("mesh") or child.tag == "mesh" or child.get("type") == "mesh" or child.tag == "keyframe":
                parent.remove(child)
    floor = ElementTree.SubElement(tree.find("worldbody"), "geom")
    floor.attrib.update(name="floor", type="plane", size="0 0 0.05")
    return ElementTree.tostring(tree, encoding="unicode")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vendor", type=pathlib.Path, default=ROOT.parent / "shared/third_party")
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--interface", default="lo")
    parser.add_argument("--dt", type=float, default=0.005, help="physics step and time between states, s; the vendor's is 0.005")
    parser.add_argument("--frictionloss", type=float, default=0.0, help="added to every joint, N·m")
    parser.add_argument("--armature", type=float, default=0.0, help="added to every joint, kg·m²")
    parser.add_argument("--payload", type=float, default=0.0, help="added to the mass of the base, kg")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--real-time", action="store_true", help="ask for real-time priority, as on a robot's own computer")
    arguments = parser.parse_args()
    if arguments.real_time:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
        except (AttributeError, PermissionError) as refused:
            print(f"no real-time priority: {refused}", file=sys.stderr)
    sys.path.insert(0, str(arguments.vendor / "unitree_sdk2_python"))
    sys.path.insert(0, str(arguments.vendor / "unitree_mujoco/simulate_python"))
    config = types.ModuleType("config")
    config.ROBOT = "go2"
    sys.modules["config"] = config
    sys.modules["pygame"] = types.ModuleType("pygame")

    import mujoco
    from unitree_sdk2py.core.channel import ChannelFactoryInitialize
    from unitree_sdk2py.utils.crc import CRC
    from unitree_sdk2py_bridge import UnitreeSdk2Bridge

    model = mujoco.MjModel.from_xml_string(
        model_text(arguments.vendor / "unitree_mujoco/unitree_robots/go2/go2.xml")
    )
    model.opt.timestep = arguments.dt
    model.dof_frictionloss[6:] += arguments.frictionloss
    model.dof_armature[6:] += arguments.armature
    model.body_mass[1] += arguments.payload
    data = mujoco.MjData(model)
    for joint in range(1, model.njnt):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
        data.qpos[model.jnt_qposadr[joint]] = LYING[name.split("_")[1]]
    data.qpos[2] = 0.12
    mujoco.mj_forward(model, data)

    crc = CRC()
    counts = {"states": 0, "commands": 0, "wrong": 0}
    at_commands = []

    class Counting(UnitreeSdk2Bridge):
        def LowCmdHandler(self, message):
            counts["commands"] += 1
            at_commands[1:] = [counts["states"]]
            # A robot drops what its checksum refuses; the bridge does not look.
            if crc.Crc(message) != message.crc:
                counts["wrong"] += 1
                return
            super().LowCmdHandler(message)

        def PublishLowState(self):
            counts["states"] += 1
            super().PublishLowState()

    ChannelFactoryInitialize(arguments.domain, arguments.interface)
    bridge = Counting(model, data)
    print(json.dumps({"ready": True}), flush=True)
    begin = begun = time.perf_counter()
    path, highest, least_up, late = [], 0.0, 1.0, 0
    steps = 0
    while True:
        now = time.perf_counter() - begin
        if now > arguments.seconds or select.select([sys.stdin], [], [], 0)[0] and not sys.stdin.readline():
            break
        mujoco.mj_step(model, data)
        steps += 1
        if steps % int(0.1 / arguments.dt) == 0:
            w, x, y, z = data.qpos[3:7]
            heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
            path.append([round(float(x), 4) for x in (*data.qpos[:3], heading, time.time())])
        highest = max(highest, float(data.qpos[2]))
        least_up = min(least_up, float(1 - 2 * (data.qpos[4] ** 2 + data.qpos[5] ** 2)))
        wait = steps * arguments.dt - (time.perf_counter() - begin)
        if wait > 0:
            time.sleep(wait)
        elif wait < -0.05:
            late += 1
            begin -= wait  # The clock of a simulator that was held up waits for it.
    assert bridge is not None
    print(
        json.dumps(
            {**counts, "states_commanded": at_commands[-1] - at_commands[0] if at_commands else 0}
            | {"seconds": round(steps * arguments.dt, 3), "held_up": late, "highest": highest}
            | {"pace": round(steps * arguments.dt / (time.perf_counter() - begun), 4)}
            | {"least_up": least_up, "end": [float(x) for x in data.qpos[:3]], "path": path}
        ),
        flush=True,
    )


if __name__ == "__main__":
    main()
