"""An observer and the engine's robots make the same observations."""

import itertools
import unittest
from typing import Any

import numpy as np

import gaitfit

from .common import Case

CALM: dict[str, Any] = {
    **{f"task.noise.{name}": 0.0 for name in ("base_angular_velocity", "projected_gravity", "joint_position", "joint_velocity")},
    "task.push.velocity": 0.0,
    "task.episode_seconds": 100.0,
}


def gravity(quaternion: np.ndarray) -> np.ndarray:
    """Down in the frame of bodies of these orientations, wxyz."""
    w, x, y, z = quaternion.T
    return -np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)


def read(robots: gaitfit.Robots, action: np.ndarray) -> dict[str, np.ndarray]:
    motion = robots.motion()
    return {
        "base_angular_velocity": motion.base_angular_velocity,
        "projected_gravity": gravity(motion.base_quaternion),
        "command": robots.commands,
        "joint_position": motion.joint_position,
        "joint_velocity": motion.joint_velocity,
        "last_action": action,
    }


class Observers(Case):
    def test_they_observe_what_the_robots_do(self) -> None:
        several = [
            {"quantity": "joint_position", "history": 3},
            {"quantity": "base_angular_velocity", "scale": [0.25], "history": 3},
            {"quantity": "last_action", "history": 3},
        ]
        layouts: list[dict[str, Any]] = [{}]
        layouts += [
            {"task.policy.observation": several, "task.policy.history": {"order": order, "start": start}}
            for order, start in itertools.product(("terms", "frames", "newest_first"), ("first", "zeros"))
        ]
        plain = [{"quantity": name} for name in ("joint_velocity", "last_action", "earlier_action", "command", "constant")]
        layouts.append({"task.policy.observation": [*plain, {"quantity": "projected_gravity", "scale": [1.0, 2.0, 3.0]}]})
        rng = np.random.default_rng(2)
        for layout in layouts:
            with self.subTest(**layout):
                robots = gaitfit.Robots(num_envs=4, seed=3, settings={**CALM, **layout})
                observer, action = gaitfit.Observer(robots.interface), np.zeros((4, 12), np.float32)
                for step in range(12):
                    given = {name: value for name, value in read(robots, action).items() if name in observer.quantities}
                    row = observer(**given)
                    np.testing.assert_allclose(row, robots.observation, atol=2e-6, err_msg=f"step {step}")
                    action = rng.normal(0.0, 0.3, (4, 12)).astype(np.float32)
                    self.assertEqual(robots.step(action), 0)
                # Two robots begin anew; a single robot's row is as the many's.
                mask = np.array([True, False, True, False])
                robots.reset(mask)
                observer.reset([0, 2])
                action[mask] = 0.0
                given = {name: value for name, value in read(robots, action).items() if name in observer.quantities}
                row = observer(**given)
                np.testing.assert_allclose(row[mask], robots.observation[mask], atol=2e-6)
                observer.reset()
                alone = observer(**{name: value[0] for name, value in given.items()})
                self.assertEqual(alone.shape, (robots.interface.observation_width,))
                np.testing.assert_allclose(alone, row[0], atol=2e-6)

    def test_the_clock_of_the_gait(self) -> None:
        terms = ["gait_phase", "gait_sine", "joint_position"]
        interface = gaitfit.Interface(["a"], 0.5, 0.3, 1.0, 0.1, 0.02, terms, gait_frequency=1.5)
        observer = gaitfit.Observer(interface)
        self.assertEqual(observer.quantities, ["joint_position"])
        for step in range(100):
            angle = 2.0 * np.pi * 1.5 * 0.02 * step
            np.testing.assert_allclose(observer(joint_position=[0.7]), [np.sin(angle), np.cos(angle), np.sin(angle), 0.2], atol=1e-5)

    def test_a_motion_is_filled_in(self) -> None:
        """Three joints of which the first turns the anchor; the motion turns 0.4 rad/s from 40° on."""
        time = np.arange(101) / 100.0
        position = np.stack([0.0 * time, 0.5 * time, -time], axis=1)
        yaw = np.deg2rad(40.0) + 0.4 * time
        table = np.column_stack([time, position, np.tile([0.0, 0.5, -1.0], (101, 1)), np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)])
        names = ["time", "q_a", "q_b", "q_c", "dq_a", "dq_b", "dq_c", *(f"base_quat_{axis}" for axis in "wxyz")]
        np.savetxt(self.folder / "dance.csv", table, delimiter=",", header=",".join(names), comments="")
        common = (
            'joints = ["a", "b", "c"]\ndefault_pose = 0.1\naction_scale = 0.3\nkp = 1.0\nkd = 0.1\ncontrol_dt = 0.02\n'
            'observation = [{ quantity = "reference_joint_position" }, { quantity = "reference_joint_velocity", ahead = 5 },\n'
            '    { quantity = "reference_orientation" }, { quantity = "reference_phase" }, { quantity = "joint_velocity" }]\n'
        )
        anchor = 'reference = { file = "dance.csv", anchor = [{ joint = "a", axis = [0, 0, 1] }] }\n'
        for reference, needed in (('reference = "dance.csv"\n', []), (anchor, ["joint_position"])):
            (self.folder / "p.toml").write_text(common + reference)
            interface = gaitfit.Interface.read(self.folder / "p.toml")
            observer = gaitfit.Observer(interface)
            self.assertEqual(observer.quantities, ["base_quaternion", *needed, "joint_velocity"])
            for episode, heading in enumerate((0.7, -1.1)):
                observer.reset()
                for step in range(60):
                    now = min(0.02 * step, 1.0)
                    # The robot turns by 0.1 rad/s, half of it in the base if the anchor is behind joint `a`.
                    turned = 0.1 * 0.02 * step
                    base = heading + (0.5 * turned if needed else turned)
                    given = {"base_quaternion": [np.cos(base / 2), 0.0, 0.0, np.sin(base / 2)], "joint_velocity": np.zeros(3)}
                    if needed:
                        given["joint_position"] = [0.5 * turned, 0.2, 0.3]
                    apart = 0.4 * now - turned
                    moves = [0.0, 0.5, -1.0] if 0.02 * (step + 5) <= 1.0 + 1e-9 else [0.0] * 3
                    c, s = np.cos(apart), np.sin(apart)
                    expected = [0.0, 0.5 * now, -now, *moves, c, -s, s, c, 0.0, 0.0, now, 0.0, 0.0, 0.0]
                    np.testing.assert_allclose(observer(**given), expected, atol=2e-6, err_msg=f"{episode}, {step}")
            # What was read can be written, and read again.
            self.assertEqual(gaitfit.Observer(interface).quantities, observer.quantities)
            (self.folder / "again.toml").write_text(interface.to_toml())
            self.assertEqual(gaitfit.Interface.read(self.folder / "again.toml"), interface)

    def test_what_does_not_fit_is_named(self) -> None:
        observer = gaitfit.Observer(gaitfit.Interface(["a", "b"], 0.0, 0.3, 1.0, 0.1, 0.02, ["command", "joint_position"]))
        good: dict[str, Any] = {"command": [0.0, 0.0, 0.0], "joint_position": [0.0, 0.0]}
        for given, error, words in (
            ({"command": [0.0] * 3}, TypeError, "joint_position is missing; this policy observes command, joint_position"),
            ({**good, "torque": [0.0]}, TypeError, "torque is not observed"),
            ({**good, "command": [0.0] * 2}, ValueError, r"command has the shape \(2,\); needed: \(3,\)"),
            ({**good, "joint_position": [0.0, np.nan]}, ValueError, "all finite"),
            ({"command": np.zeros((4, 3)), "joint_position": np.zeros((3, 2))}, ValueError, "different numbers of robots"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                observer(**given)
        observer(**good)
        with self.assertRaisesRegex(ValueError, r"there are 2 robots; there were 1: call reset\(\)"):
            observer(command=np.zeros((2, 3)), joint_position=np.zeros((2, 2)))
        with self.assertRaises(IndexError):
            observer.reset([3])
        with self.assertRaisesRegex(TypeError, "give a gaitfit.Interface"):
            gaitfit.Observer("walk.safetensors")  # type: ignore[arg-type]


if __name__ == "__main__":
    unittest.main()
