"""Go2s in official MuJoCo with random parameters, most with an effect that the model lacks: do fits find the true values?

`draw` writes robots for mujoco_robot.py and the logs of their walks. After a fit of each, `count` compares the values with the
drawn ones. The fit of robot NAME is FOLDER/runs/NAME, or that of the first round of a loop in this folder.

Usage: .venv/bin/python tools/drawn_robots.py draw FOLDER --seed 1 --each 2 --policy policy.onnx
       .venv/bin/python tools/drawn_robots.py count FOLDER
"""

import argparse
import json
import math
import pathlib
import re
import subprocess
import sys
import tomllib

import numpy as np

TOOLS = pathlib.Path(__file__).resolve().parent
MODEL = TOOLS.parent / "assets/go2.xml"
GROUPS = ("hip", "thigh", "calf")
LEGS = ("FL", "FR", "RL", "RR")
FLOOR = 0.6  # sliding friction of the model's feet
CONTACTS = 0.02  # s, time constant of the model's contacts
# Where a load on the base changes its mass alone: the centre of mass of the model's base, m.
CENTRE = {"x": 0.021112, "y": 0.0, "z": -0.005366}


def signed(rng, low, high):
    """A number of this size with either sign."""
    return float(rng.choice([-1, 1]) * rng.uniform(low, high))


def effects_of(kind, rng, size=1.0):
    """The table [effects] of a robot of this kind; `size` scales each effect."""
    def per_group(groups, low, high):
        return {f"*_{group}_joint": size * rng.uniform(low, high) for group in groups}

    kinds = {
        "none": lambda: {},
        "legs differ": lambda: {},
        "play": lambda: {"backlash": per_group(("thigh", "calf"), 0.010, 0.020)},
        "springs": lambda: {"elasticity": {"*_calf_joint": rng.uniform(200, 300) / size}},
        "load friction": lambda: {"load_friction": per_group(GROUPS, 0.04, 0.10), "stiction": per_group(("calf",), 0.1, 0.2)},
        "sensors": lambda: {
            "velocity_filter": rng.uniform(40, 60) / size, "encoder_step": 0.002 * size, "imu_late": 0.005 * size,
            "imu_tilt": [size * signed(rng, 1, 2), size * signed(rng, 1, 2)],
            "gyro_bias": [size * signed(rng, 0.005, 0.02) for _ in range(3)],
        },
        "ground": lambda: {"soft_ground": CONTACTS * (1 + size * rng.uniform(1, 2)), "slope": size * signed(rng, 1, 2)},
    }
    if kind == "everything at half size":
        every = (effects_of(each, rng, 0.5) for each in ("play", "load friction", "sensors", "ground"))
        return {name: value for table in every for name, value in table.items()}
    return kinds[kind]()


KINDS = ("none", "legs differ", "play", "springs", "load friction", "sensors", "ground", "everything at half size")


def draw(kind, rng):
    """A robot of this kind as a table."""
    friction = {group: rng.uniform(0.05, 0.4) for group in GROUPS}
    spread = {"legs differ": 0.3, "everything at half size": 0.15}.get(kind, 0.0)
    return {
        "timestep": 0.001, "delay": 0.001 * int(rng.integers(2, 15)), "torque_noise": rng.uniform(0.1, 0.6),
        "strength": rng.uniform(0.88, 1.08), "friction": FLOOR * rng.uniform(0.7, 1.4),
        "frictionloss": {f"{leg}_{group}_joint": friction[group] * (1 + rng.uniform(-spread, spread))
                         for leg in LEGS for group in GROUPS},
        "armature": {f"*_{group}_joint": rng.uniform(0.005, 0.04) for group in GROUPS},
        "damping": {f"*_{group}_joint": rng.uniform(0.0, 0.15) for group in GROUPS},
        "payload": {"mass": rng.uniform(0.3, 2.0)} | CENTRE,
        "effects": effects_of(kind, rng),
    }  # fmt: skip


def as_toml(robot):
    """A robot's table as text."""
    def line(name, value):
        text = json.dumps(value) if not isinstance(value, dict) else "{ " + ", ".join(line(*each) for each in value.items()) + " }"
        return f'"{name}" = {text}'

    return f'model = "{MODEL}"\n' + "\n".join(line(name, value) for name, value in robot.items() if value != {}) + "\n"


def draw_all(folder, arguments):
    """Writes the robots and their logs."""
    for number, (kind, each) in enumerate((kind, each) for each in range(arguments.each) for kind in KINDS):
        name = f"{kind.replace(' ', '-')}-{each + 1}"
        seed = 1000 * arguments.seed + number
        robot = folder / f"{name}.toml"
        folder.mkdir(parents=True, exist_ok=True)
        robot.write_text(as_toml(draw(kind, np.random.default_rng(seed))), encoding="utf-8")
        subprocess.run(
            [sys.executable, TOOLS / "mujoco_robot.py", "collect", "--policy", arguments.policy, "--robot", robot, "--out",
             folder / name, "--trajectories", str(arguments.walks), "--seconds", "4", "--log-shift", "0.02", "0.1", "--seed",
             str(seed), "--digits", "5", "--base", "imu"],
            check=True,
        )  # fmt: skip


def truth(robot, name):
    """The robot's true value of a fit's parameter; None if the robot has no such number."""
    effects = robot.get("effects", {})
    places = re.fullmatch(r"(.*?)_((FL|FR|RL|RR)_)?(hip|thigh|calf)", name)
    if places:
        kind, leg, group = places[1], places[3], places[4]
        joints = [f"{each}_{group}_joint" for each in LEGS if leg in (None, each)]
        tables = {
            "frictionloss": (robot["frictionloss"], 0), "armature": (robot["armature"], 0), "damping": (robot["damping"], 0),
            "load_friction": (effects.get("load_friction", {}), 0), "play": (effects.get("backlash", {}), 0),
            "compliance": ({key: 1 / value for key, value in effects.get("elasticity", {}).items()}, 0),
            "kp_scale": ({}, 1), "encoder_bias": ({}, 0),
        }  # fmt: skip
        if kind not in tables:
            return None
        table, default = tables[kind]
        return float(np.mean([table.get(joint, table.get(f"*_{group}_joint", default)) for joint in joints]))
    if name.startswith("imu_") and effects.get("slope"):
        return None  # a sloping floor looks like a tilted unit
    tilt, bias = effects.get("imu_tilt", [0, 0]), effects.get("gyro_bias", [0, 0, 0])
    cut = effects.get("velocity_filter", 0)
    return {
        "delay": robot["delay"], "torque_scale": robot["strength"], "floor_friction": robot["friction"] / FLOOR,
        "base_mass": robot["payload"]["mass"], "ground_softness": effects.get("soft_ground", CONTACTS) / CONTACTS - 1,
        "ground_impedance": 0.0,  # the robots have the model's feet
        "imu_roll": math.radians(tilt[0]), "imu_pitch": math.radians(tilt[1]), "imu_delay": effects.get("imu_late", 0),
        "gyro_bias_x": bias[0], "gyro_bias_y": bias[1], "gyro_bias_z": bias[2],
        "velocity_lag": 1 / (2 * math.pi * cut) if cut else 0.0,
    }.get(name)  # fmt: skip


def count(folder):
    """Prints a table of what each fit found."""
    print("| robot | inside | standing | effects that got parameters | outside |\n| --- | --- | --- | --- | --- |")
    totals = {}
    for path in sorted(folder.glob("*.toml")):
        found = [path for path in (folder / f"runs/{path.stem}/round-1/adapt", folder / f"runs/{path.stem}") if (path / "result.json").exists()]
        if not found:
            print(f"| {path.stem} | no fit | | | |")
            continue
        robot = tomllib.loads(path.read_text(encoding="utf-8"))
        result = json.loads((found[0] / "result.json").read_text(encoding="utf-8"))["results"]
        values = [(each, truth(robot, each["name"])) for each in result["parameters"]]
        values = [(each, true) for each, true in values if true is not None]
        outside = [(each, true) for each, true in values if not each["interval"][0] <= true <= each["interval"][1]]
        total = totals.setdefault(result["standing"], [0, 0, 0])
        totals[result["standing"]] = [total[0] + 1, total[1] + len(values) - len(outside), total[2] + len(values)]
        named = next((each for each in result["warnings"] if "do not cover: " in each), "")
        named = named.partition("do not cover: ")[2].partition(". So the fit")[0]
        missed = "; ".join(f"{each['name']} {each['value']:.4g} [{each['interval'][0]:.4g}, {each['interval'][1]:.4g}] for {true:.4g}"
                           for each, true in outside)
        print(f"| {path.stem} | {len(values) - len(outside)} of {len(values)} | {result['standing']} | {named} | {missed} |")
    for standing, (fits, inside, known) in totals.items():
        print(f"\n{fits} fits are {standing}: {inside} of {known} true values are inside.")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    drawing = commands.add_parser("draw", help="write robots and logs of their walks")
    drawing.add_argument("--policy", required=True, help="ONNX file that `gaitfit export` wrote")
    drawing.add_argument("--seed", type=int, default=1, help="of the drawn values and of the walks [1]")
    drawing.add_argument("--each", type=int, default=2, help="robots of each kind [2]")
    drawing.add_argument("--walks", type=int, default=16, help="walks of 4 s of each robot [16]")
    counting = commands.add_parser("count", help="compare fits with the drawn values")
    for each in (drawing, counting):
        each.add_argument("folder", type=pathlib.Path)
    arguments = parser.parse_args()
    if arguments.command == "draw":
        draw_all(arguments.folder, arguments)
    else:
        count(arguments.folder)


if __name__ == "__main__":
    main()
