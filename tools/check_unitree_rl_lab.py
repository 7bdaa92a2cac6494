"""Runs policies in unitree_rl_lab's own deployment program beside gaitfit's reading of the same folder, and prints the largest
differences of observations, actions and targets.

unitree_rl_lab trains in Isaac Sim. What runs on the robot is a C++ program: its reader of deploy.yaml, its observation and action
managers and its ONNX runner are compiled into tools/unitree_rl_lab_steps.cpp, which gives them states of a file in place of the
robot's messages. Both get the same random states: joints within 0.3 rad of the pose at about 1 rad/s, a base that tilts by up to
0.3 rad about each axis, sticks within the ranges of deploy.yaml.

Usage: python tools/check_unitree_rl_lab.py CHECKOUT ONNXRUNTIME [FOLDER...] [--steps N] [--include FOLDER...] [--out FOLDER]
CHECKOUT is a clone of unitree_rl_lab, ONNXRUNTIME a folder with include/ and lib/ as its releases have, FOLDER a policy with
exported/policy.onnx and params/deploy.yaml. Without FOLDER it runs the policies in the checkout and those of gaitfit's tests.
The program reads no names of joints: the trainer's lists of them are taken from its Python source.
Later versions of the program take headers from Unitree's C++ SDK: --include names its folder.
With --out the steps of the policies of gaitfit's tests are written for these tests.
Needs g++, yaml-cpp, Eigen, fmt, spdlog (libyaml-cpp-dev, libeigen3-dev, libspdlog-dev) and gaitfit's Python package with PyYAML.
"""

import argparse
import ast
import pathlib
import subprocess
import tempfile

import numpy as np
import yaml

import trainer_steps

ROOT = pathlib.Path(__file__).parent.parent
OWN = ROOT / "crates/gaitfit-policy-files/tests/fixtures/policies"
MOTORS = 35


class Loader(yaml.SafeLoader):
    """Reads Isaac Lab's slices as their lists."""


Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, _, node: loader.construct_sequence(node))


def joints_of(checkout, motors):
    """The joints of a robot with so many motors in the order of the vendor's SDK, as the trainer lists them."""
    tree = ast.parse((checkout / "source/unitree_rl_lab/unitree_rl_lab/assets/robots/unitree.py").read_text())
    lists = [node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "joint_sdk_names"]
    return next(names for names in map(ast.literal_eval, lists) if len(names) == motors)


def build(options, work):
    runtime = options.onnxruntime.resolve()
    program = work / "steps"
    folders = [options.checkout / "deploy/include", *options.include, runtime / "include", "/usr/include/eigen3"]
    include = [f"-I{folder}" for folder in folders]
    library = sorted((runtime / "lib").glob("libonnxruntime.so*"))[-1]
    command = ["g++", "-std=c++17", "-O1", "-w", *include, "-o", str(program), str(ROOT / "tools/unitree_rl_lab_steps.cpp")]
    command += [str(library), f"-Wl,-rpath,{library.parent}", "-lyaml-cpp", "-lfmt", "-lpthread"]
    subprocess.run(command, check=True)
    return program


def states(deploy, count, seed):
    """Random states, one after another near: quaternion, angular velocity, sticks, position and velocity of each motor."""
    rng = np.random.default_rng(seed)
    walk = lambda width, size: size * np.cumsum(rng.normal(0.0, 0.3, (count, width)), axis=0).clip(-1.0, 1.0)
    tilt, motors = walk(3, 0.3), np.zeros((count, MOTORS, 2))
    turn = np.linalg.norm(tilt, axis=1, keepdims=True) + 1e-12
    quaternion = np.hstack([np.cos(turn / 2), np.sin(turn / 2) * tilt / turn])
    ranges = deploy["commands"]["base_velocity"]["ranges"]
    limits = np.array([ranges[name] for name in ("lin_vel_x", "lin_vel_y", "ang_vel_z")])
    command = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * rng.uniform(0.0, 1.0, (count, 3))
    place = deploy["joint_ids_map"]
    motors[:, place, 0] = np.array(deploy["default_joint_pos"]) + walk(len(place), 0.3)
    motors[:, place, 1] = rng.normal(0.0, 1.0, (count, len(place)))
    # The left stick's and the right stick's axes to the side point to the right.
    sticks = command * [1.0, -1.0, -1.0]
    return np.hstack([quaternion, rng.normal(0.0, 0.5, (count, 3)), sticks, motors.reshape(count, -1)]).astype(np.float32)


def run(program, folder, rows, joints, place):
    """The program's steps. The joints are its own, in its order."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        np.savetxt(file, rows, "%.9g")
        file.flush()
        text = subprocess.run([program, folder, file.name], check=True, capture_output=True, text=True).stdout
    steps = trainer_steps.Steps(joints)
    for row, line in zip(rows, text.splitlines(), strict=True):
        words, parts = line.split(), []
        while words:
            count = int(words[0])
            parts.append([float(word) for word in words[1 : count + 1]])
            words = words[count + 1 :]
        motors = row[10:].reshape(MOTORS, 2)[place]
        w, x, y, z = row[:4].astype(float)
        readings = {
            "base_angular_velocity": row[4:7],
            "projected_gravity": -np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]),
            "base_quaternion": row[:4],
            "command": row[7:10] * np.float32([1.0, -1.0, -1.0]),
            "joint_position": motors[:, 0],
            "joint_velocity": motors[:, 1],
        }
        steps.add(readings, *parts)
    return steps


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=pathlib.Path)
    parser.add_argument("onnxruntime", type=pathlib.Path)
    parser.add_argument("--include", type=pathlib.Path, nargs="*", default=[])
    parser.add_argument("folders", type=pathlib.Path, nargs="*")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    folders = options.folders or [
        *sorted(file.parent.parent for file in options.checkout.glob("deploy/robots/**/params/deploy.yaml")),
        *sorted(file.parent.parent for file in OWN.glob("unitree*/params/deploy.yaml")),
    ]
    with tempfile.TemporaryDirectory() as work:
        program = build(options, pathlib.Path(work))
        for seed, folder in enumerate(folders):
            deploy = yaml.load((folder / "params/deploy.yaml").read_text(), Loader)
            file = folder / "exported/policy.onnx"
            place, names = deploy["joint_ids_map"], joints_of(options.checkout, len(deploy["stiffness"]))
            rows = states(deploy, options.steps, seed)
            steps = run(program, folder, rows, [names[motor] for motor in place], place)
            found, policy = trainer_steps.compare(file, steps)
            print(f"{folder}: {steps.describe()}", *policy.notes, sep="\n    ")
            for what, difference in found.items():
                print(f"    {what}: at most {difference:.1e} apart")
            if options.out and folder.parent == OWN:
                steps.save(options.out / f"{folder.name}_steps.json", "unitree_rl_lab", 12)


if __name__ == "__main__":
    main()
