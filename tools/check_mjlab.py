"""Runs policies in mjlab's own environments beside gaitfit's reading of their ONNX files, and prints the largest differences of
observations, actions and targets.

mjlab builds its environment with one robot, its runner trains for a few iterations and writes the ONNX file with its metadata, and
the policy acts in the environment without noise and pushes. gaitfit gets the file and what sensors would read: nothing else.

    go1        the velocity task of the Go1 on flat ground, as mjlab has it
    g1         the same of the G1
    changed    the Go1 without its linear velocity, with scales, histories and a smaller network
    tracking   the task of the G1 that follows a motion, without state estimation, with a motion of sines and a smaller network

Usage: python tools/check_mjlab.py [TASK...] [--steps N] [--work FOLDER] [--out FOLDER]
Needs mjlab 1.6 and gaitfit's Python package (pip install mjlab ./python). It runs on the CPU, less than a minute a task. --work keeps
all files, with a log of each run for `gaitfit inspect LOG --policy POLICY --robot ROBOT`. --out writes the last two tasks for the
tests of gaitfit-policy-files.
"""

import argparse
import dataclasses
import importlib.metadata
import pathlib
import tempfile

import mujoco
import numpy as np
import torch
from mjlab.asset_zoo.robots.unitree_g1.g1_constants import get_spec
from mjlab.envs import ManagerBasedRlEnv
from mjlab.rl import RslRlVecEnvWrapper
from mjlab.tasks.registry import load_env_cfg, load_rl_cfg, load_runner_cls

import mjlab.tasks  # noqa: F401
import trainer_steps

TASKS = {
    "go1": "Mjlab-Velocity-Flat-Unitree-Go1",
    "g1": "Mjlab-Velocity-Flat-Unitree-G1",
    "changed": "Mjlab-Velocity-Flat-Unitree-Go1",
    "tracking": "Mjlab-Tracking-Flat-Unitree-G1-No-State-Estimation",
}
DESCRIPTION = """# Made by tools/check_mjlab.py.
file = "mjlab_tracking.onnx"
[reference]
file = "mjlab_tracking.csv"
anchor = [
    { joint = "waist_yaw_joint", axis = [0, 0, 1] },
    { joint = "waist_roll_joint", axis = [1, 0, 0] },
    { joint = "waist_pitch_joint", axis = [0, 1, 0] },
]
"""
# Samples of the motion, at 50 Hz.
ROWS = 31
# Not a quantity of gaitfit: the velocity that its simulator gives to a policy that observes one.
AT_ORIGIN = "velocity of the base's origin"
HISTORIES = {"base_ang_vel": 3, "joint_pos": 2, "actions": 2}
SCALES = {"base_ang_vel": 0.25, "joint_vel": 0.05, "command": (2.0, 2.0, 0.25)}


def change(env_cfg, rl_cfg):
    """What users change in the task of a robot without state estimation."""
    terms = env_cfg.observations["actor"].terms
    del terms["base_lin_vel"]
    for name, length in HISTORIES.items():
        terms[name].history_length = length
    for name, scale in SCALES.items():
        terms[name].scale = scale
    terms["joint_vel"].clip = (-100.0, 100.0)
    rl_cfg.actor.hidden_dims = (16, 8)


def build(name, work):
    (work / name).mkdir(parents=True, exist_ok=True)
    env_cfg, rl_cfg = load_env_cfg(TASKS[name], play=True), load_rl_cfg(TASKS[name])
    env_cfg.scene.num_envs, env_cfg.seed, rl_cfg.seed = 1, 1, 1
    if "twist" in env_cfg.commands:
        env_cfg.commands["twist"].resampling_time_range = (0.3, 0.6)
        env_cfg.commands["twist"].rel_standing_envs = 0.0
    if name == "changed":
        change(env_cfg, rl_cfg)
    if name == "tracking":
        rl_cfg.actor.hidden_dims = (16, 8)
        motion(work / name)
        env_cfg.terminations, env_cfg.events = {}, {}
        # gaitfit turns the motion to face as the robot does at the beginning: it must begin as the motion does.
        env_cfg.commands["motion"].joint_position_range = (0.0, 0.0)
        env_cfg.commands["motion"].motion_file = str(work / name / "motion.npz")
    assert not env_cfg.observations["actor"].enable_corruption
    rl_cfg.logger, rl_cfg.upload_model = "tensorboard", False
    env = RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg=env_cfg, device="cpu"), clip_actions=rl_cfg.clip_actions)
    runner = load_runner_cls(TASKS[name])(env, dataclasses.asdict(rl_cfg), str(work / name), "cpu")
    runner.learn(num_learning_iterations=3)
    # Its checkpoint comes with the ONNX file, which is named after the folder.
    runner.save(str(work / name / "model.pt"))
    return env, runner


def motion(work):
    """A short motion as mjlab's tracking task reads it, and the same for gaitfit: all joints swing, the robot turns."""
    model = get_spec().compile()
    data, joints = mujoco.MjData(model), [model.joint(number).name for number in range(1, model.njnt)]
    rng = np.random.default_rng(1)
    turn, phase = 2 * np.pi * rng.uniform(0.5, 1.5, len(joints)), rng.uniform(0.0, 2 * np.pi, len(joints))
    middle = (model.jnt_range[1:, 0] + model.jnt_range[1:, 1]) / 2
    swing = np.minimum(0.2, (model.jnt_range[1:, 1] - model.jnt_range[1:, 0]) / 4)
    rows = {name: [] for name in ("joint_pos", "joint_vel", "body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w")}
    for row in range(ROWS):
        time = row / 50
        data.qpos[:3], data.qvel[:6] = (0.1 * time, 0.0, 0.76), (0.1, 0.0, 0.0, 0.0, 0.0, 0.5)
        mujoco.mju_axisAngle2Quat(data.qpos[3:7], np.array([0.0, 0.0, 1.0]), 0.4 + 0.5 * time)
        data.qpos[7:] = middle + swing * np.sin(turn * time + phase)
        data.qvel[6:] = swing * turn * np.cos(turn * time + phase)
        mujoco.mj_forward(model, data)
        moving = np.zeros((model.nbody, 6))
        for body in range(model.nbody):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, moving[body], 0)
        found = (data.qpos[7:], data.qvel[6:], data.xpos[1:], data.xquat[1:], moving[1:, 3:], moving[1:, :3])
        for name, value in zip(rows, found):
            rows[name].append(value.astype(np.float32))
    np.savez(work / "motion.npz", fps=[50], **rows)
    torso = np.array(rows["body_quat_w"])[:, model.body("torso_link").id - 1]
    table = [np.arange(ROWS)[:, None] / 50, rows["joint_pos"], rows["joint_vel"], torso]
    names = ["time", *(f"q_{joint}" for joint in joints), *(f"dq_{joint}" for joint in joints)]
    names += [f"base_quat_{axis}" for axis in "wxyz"]
    np.savetxt(work / "mjlab_tracking.csv", np.hstack(table), "%.8g", ",", header=",".join(names), comments="")
    (work / "mjlab_tracking.toml").write_text(DESCRIPTION)


def read(robot, env):
    """What sensors of the robot, its user and a simulator would say now."""
    data, manager = robot.data, env.unwrapped.command_manager
    readings = {
        # Where the inertial unit is: mjlab's velocity tasks observe this one.
        "base_linear_velocity": env.unwrapped.scene["robot/imu_lin_vel"].data,
        AT_ORIGIN: data.root_link_lin_vel_b,
        "base_angular_velocity": data.root_link_ang_vel_b,
        "projected_gravity": data.projected_gravity_b,
        "base_quaternion": data.root_link_quat_w,
        "joint_position": data.joint_pos_biased,
        "joint_velocity": data.joint_vel,
    }
    if "twist" in manager.active_terms:
        readings["command"] = manager.get_command("twist")
    return {name: value[0].numpy().copy() for name, value in readings.items()}


def play(env, runner, count):
    robot, action_term = env.unwrapped.scene["robot"], env.unwrapped.action_manager.get_term("joint_pos")
    steps = trainer_steps.Steps(robot.joint_names)
    policy = runner.get_inference_policy(device="cpu")
    with torch.inference_mode():
        observation, _ = env.reset()
        for step in range(count):
            readings, seen = read(robot, env), observation["actor"][0].numpy().copy()
            action = policy(observation)
            observation, _, done, _ = env.step(action)
            # In an episode that ends here the terms are reset already.
            targets = action * action_term.scale + action_term.offset
            steps.add(readings, seen, action[0].numpy(), targets[0].numpy())
            if done[0]:
                steps.begins.append(step + 1)
    return steps


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=[*TASKS], help=f"{', '.join(TASKS)}; default: all")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--work", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    if unknown := [name for name in options.tasks if name not in TASKS]:
        parser.error(f"no task {unknown[0]}")
    work = options.work or pathlib.Path(tempfile.mkdtemp())
    work.mkdir(parents=True, exist_ok=True)
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("mjlab", "rsl-rl-lib", "mujoco-warp"))
    lines = [versions]
    for name in options.tasks:
        env, runner = build(name, work)
        steps = play(env, runner, min(options.steps, ROWS - 2) if name == "tracking" else options.steps)
        at_origin = steps.readings.pop(AT_ORIGIN)
        file = work / name / f"mjlab_{name}.onnx"
        (work / name / f"{name}.onnx").rename(file)
        file = file.with_suffix(".toml") if name == "tracking" else file
        found, policy = trainer_steps.compare(file, steps)
        lines.append(f"{name}: {steps.describe()}")
        lines += [f"    {what}: at most {difference:.1e} apart" for what, difference in found.items()]
        if "base_lin_vel" in env.unwrapped.observation_manager.active_terms["actor"]:
            steps.readings["base_linear_velocity"] = at_origin
            apart = trainer_steps.compare(file, steps)[0]["actions"]
            lines.append(f"    actions: at most {apart:.1e} apart with the {AT_ORIGIN}")
        steps.log(work / name / "log.csv", policy.interface.control_dt)
        if options.out and name in ("changed", "tracking"):
            for made in (work / name).glob("mjlab_*"):
                (options.out / made.name).write_bytes(made.read_bytes())
            steps.save(options.out / f"mjlab_{name}_steps.json", versions, 20)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
