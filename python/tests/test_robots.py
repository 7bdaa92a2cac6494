"""Many robots at a task."""

import pickle
import threading
import unittest

import numpy as np

import gaitfit
from gaitfit._arrays import numbers

from .common import Case

COUNT = 300


class Many(Case):
    def test_steps_depend_on_the_seed_alone(self) -> None:
        robots = [gaitfit.Robots(num_envs=COUNT, seed=4, threads=threads) for threads in (1, 3)]
        other = gaitfit.Robots(num_envs=COUNT, seed=5)
        first = robots[0]
        self.assertEqual(first.observation.shape[0], COUNT)
        self.assertEqual((first.num_actions, len(first.joints), first.control_dt), (12, 12, 0.02))
        self.assertFalse(np.array_equal(first.observation, other.observation))
        rng = np.random.default_rng(0)
        ends = 0
        for _ in range(60):
            actions = rng.normal(0.0, 2.0, size=(COUNT, 12)).astype(np.float32)
            ended = {one.step(actions) for one in robots}
            self.assertEqual(len(ended), 1)
            ends += ended.pop()
            for name in ("observation", "critic_observation", "reward", "terminated", "truncated", "commands"):
                np.testing.assert_array_equal(*(getattr(one, name) for one in robots), err_msg=name)
        # Robots that flail fall.
        self.assertGreater(ends, COUNT // 10)
        self.assertTrue(np.isfinite(first.observation).all() and np.isfinite(first.reward).all())
        self.assertEqual(first.commands.shape, (COUNT, 3))

    def test_a_robot_that_fell_begins_anew(self) -> None:
        robots = gaitfit.Robots(num_envs=64, seed=1)
        for _ in range(200):
            if robots.step(np.full((64, 12), 8.0)):
                break
        self.assertTrue(robots.terminated.any())
        fallen = np.flatnonzero(robots.terminated)
        self.assertFalse(np.array_equal(robots.last_observation[fallen], robots.observation[fallen]))
        held = robots.observation
        self.assertIs(robots.reset(), held)

    def test_a_robot_that_diverges_has_fallen_unless_they_are_many(self) -> None:
        robots = gaitfit.Robots(num_envs=COUNT, seed=1)
        actions = np.zeros((COUNT, 12), np.float32)
        # The reward for smooth actions overflows.
        actions[[7, 270]] = 1e30
        robots.last_observation[:] = 1.0
        self.assertGreaterEqual(robots.step(actions), 2)
        self.assertEqual(robots.diverged, 2)
        self.assertTrue(robots.terminated[[7, 270]].all())
        np.testing.assert_array_equal(robots.reward[[7, 270]], 0.0)
        np.testing.assert_array_equal(robots.last_observation[[7, 270]], 0.0)
        for rows in (robots.observation, robots.critic_observation, robots.reward):
            self.assertTrue(np.isfinite(rows).all())
        # Those of rows 7 and 270 among them: smooth rewards of both overflow again.
        actions[1:11] = 1e30
        with self.assertRaisesRegex(gaitfit.GaitfitError, "11 of 300 robots diverged, the first of them robot 1:"):
            robots.step(actions)

    def test_a_few_robots_that_all_diverge_have_fallen(self) -> None:
        for count in (1, 8):
            robots = gaitfit.Robots(num_envs=count, seed=1)
            for step in range(3):
                self.assertEqual(robots.step(np.full((count, 12), 1e30)), count)
                self.assertEqual(robots.diverged, count * (step + 1))
                self.assertTrue(robots.terminated.all() and np.isfinite(robots.observation).all())
            robots.step(np.zeros((count, 12)))

    def test_the_action_bounds_are_what_a_robot_can_use(self) -> None:
        robots = gaitfit.Robots(num_envs=1)
        low, high = robots.action_bounds.T
        self.assertTrue((low < 0).all() and (high > 0).all())
        self.assertTrue((np.abs(robots.action_bounds) < 30).all(), robots.action_bounds)
        free = gaitfit.Robots(num_envs=1, settings={"task.policy.action_clip": 2.0})
        self.assertEqual((free.action_bounds.min(), free.action_bounds.max()), (-2.0, 2.0))

    def test_wrong_arguments_are_refused(self) -> None:
        for arguments, error in (
            ({"num_envs": 0}, ValueError),
            ({"num_envs": -1}, ValueError),
            ({"num_envs": 1 << 40}, ValueError),
            ({"config": "nowhere.toml"}, FileNotFoundError),
            ({"robot": "nowhere.xml"}, FileNotFoundError),
            ({"settings": {"task.nothing": 1}}, gaitfit.GaitfitError),
            ({"seed": "one"}, TypeError),
        ):
            with self.subTest(str(arguments)), self.assertRaises(error):
                gaitfit.Robots(**{"num_envs": 4, **arguments})
        robots = gaitfit.Robots(num_envs=4)
        for actions, words in (
            (np.zeros((4, 11)), r"\(4, 11\); needed: \(4, 12\)"),
            (np.zeros((5, 12)), "needed"),
            (np.zeros(48), "needed"),
            (np.full((4, 12), np.nan), "environment 0 for FL_hip_joint is not finite"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                robots.step(actions)
        for actions, words in (([["a"] * 12] * 4, "texts stand"), (np.zeros((4, 12), complex), "complex numbers stand")):
            with self.subTest(words), self.assertRaisesRegex(TypeError, words):
                robots.step(actions)
        robots.reward = np.zeros(3, np.float32)
        with self.assertRaisesRegex(ValueError, "reward has 3 numbers; needed: 4"):
            robots.step(np.zeros((4, 12)))
        robots.reward = np.zeros(4, np.float32)
        robots.observation.flags.writeable = False
        with self.assertRaises((ValueError, TypeError, RuntimeError)):
            robots.step(np.zeros((4, 12)))


    def test_states_are_taken_up_to_the_bit(self) -> None:
        rng = np.random.default_rng(0)
        actions = rng.normal(0.0, 1.5, size=(40, COUNT, 12)).astype(np.float32)
        first = gaitfit.Robots(num_envs=COUNT, seed=4)
        for row in actions[:20]:
            first.step(row)
        state = pickle.loads(pickle.dumps(first.state()))
        seen = first.observation.copy()
        other = gaitfit.Robots(num_envs=COUNT, seed=4)
        other.set_state(state)
        np.testing.assert_array_equal(other.observation, seen)
        for row in actions[20:]:
            self.assertEqual(first.step(row), other.step(row))
            for name in ("observation", "critic_observation", "reward", "terminated", "truncated"):
                np.testing.assert_array_equal(getattr(first, name), getattr(other, name), err_msg=name)
        for robots, words in (
            (gaitfit.Robots(num_envs=COUNT, seed=5), "another seed: 4, and here it is 5"),
            (gaitfit.Robots(num_envs=3, seed=4), "another num_envs: 300, and here it is 3"),
            (gaitfit.Robots(num_envs=COUNT, seed=4, settings={"task.episode_seconds": 5.0}), "another task"),
        ):
            with self.assertRaisesRegex(ValueError, words):
                robots.set_state(state)
        with self.assertRaisesRegex(TypeError, "give what state"):
            first.set_state(3)

    def test_reward_terms_sum_to_the_reward(self) -> None:
        robots = gaitfit.Robots(num_envs=COUNT, seed=2)
        rewards = []
        for _ in range(3):
            robots.step(np.zeros((COUNT, 12)))
            rewards.append(robots.reward.mean())
        terms = robots.reward_terms()
        self.assertEqual(list(terms), robots.reward_names)
        self.assertAlmostEqual(sum(terms.values()), float(np.mean(rewards)), places=5)
        self.assertEqual(set(robots.reward_terms().values()), {0.0}, "nothing was stepped since")

    def test_some_robots_begin_anew(self) -> None:
        robots = gaitfit.Robots(num_envs=COUNT, seed=2)
        for _ in range(5):
            robots.step(np.ones((COUNT, 12)))
        before = robots.state()
        mask = np.arange(COUNT) % 3 == 0
        robots.reset(mask)
        after = robots.state()
        self.assertTrue((after.steps[mask] == 0).all())
        np.testing.assert_array_equal(after.steps[~mask], before.steps[~mask])
        for wrong in (np.ones(3, bool), np.ones(COUNT), [1] * COUNT):
            with self.assertRaisesRegex(ValueError, "mask has the shape"):
                robots.reset(wrong)

    def test_pictures_show_the_robot_where_it_is(self) -> None:
        robots = gaitfit.Robots("assets/go2-walk.toml", num_envs=3, seed=1)
        picture = robots.picture(2)
        # Limbs are orange, and nothing else is.
        orange = (picture[..., 0] > 1.4 * picture[..., 2]) & (picture[..., 0] > 60)
        rows, columns = np.nonzero(orange)
        self.assertGreater(orange.mean(), 0.01)
        self.assertTrue(60 < columns.min() and columns.max() < 420 and 60 < rows.min() and rows.max() < 340)
        dark = picture.sum(axis=-1) < 300
        self.assertTrue(dark[165:195, 225:255].mean() > 0.5, "the trunk is in the middle")
        np.testing.assert_array_equal(robots.picture(2), picture)
        robots.step(np.full((3, 12), 3.0))
        self.assertFalse(np.array_equal(robots.picture(2), picture))
        self.assertEqual(robots.picture(width=64, height=32).shape, (32, 64, 3))
        with self.assertRaisesRegex(ValueError, "there is no robot 3; they are numbered from 0 to 2"):
            robots.picture(3)

    def test_shapes_are_hit_where_they_are(self) -> None:
        """By hand: a ray along −x from x = 5 meets a ball, a capsule and a box at their nearest points."""
        from gaitfit._picture import _hit

        eye, ray = np.array([5.0, 0.0, 0.0]), np.array([[[-1.0, 0.0, 0.0]]])
        for shape, distance in (
            ({"sphere": {"radius": 0.5}}, 4.5),
            ({"capsule": {"radius": 0.2, "half_length": 1.0}}, 4.8),
            ({"box": {"half": [0.3, 1.0, 1.0]}}, 4.7),
        ):
            found, normal = _hit(shape, np.zeros(3), np.eye(3), eye, ray)
            self.assertAlmostEqual(float(found[0, 0]), distance, places=12)
            np.testing.assert_allclose(normal[0, 0], [1.0, 0.0, 0.0], atol=1e-12)
            missed, _ = _hit(shape, np.array([0.0, 3.0, 0.0]), np.eye(3), eye, ray)
            self.assertEqual(float(missed[0, 0]), np.inf)
        # On its side the capsule's round end is nearest.
        turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        found, _ = _hit({"capsule": {"radius": 0.2, "half_length": 1.0}}, np.zeros(3), turned, eye, ray)
        self.assertAlmostEqual(float(found[0, 0]), 3.8, places=12)

    def test_two_threads_are_told_of(self) -> None:
        robots = gaitfit.Robots(num_envs=4096, seed=1)
        actions = np.zeros((4096, 12), np.float32)
        told: list[str] = []

        def work() -> None:
            for _ in range(20):
                try:
                    robots.step(actions)
                except RuntimeError as error:
                    told.append(str(error))

        threads = [threading.Thread(target=work) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertIn("two threads use the same robots at once", " ".join(set(told)))
        robots.step(actions)

    def test_robots_on_a_gpu_are_shown_by_copies(self) -> None:
        """Without a GPU: other robots on the processor stand in for those on it."""

        class Stepped:
            def __init__(self, robots: gaitfit.Robots) -> None:
                self.robots = robots

            def show(self, copies) -> None:
                copies.set_state(*self.robots._copies.state())

            def follow(self, copies) -> None:
                self.robots._copies.set_state(*copies.state())

            def take_terms(self) -> list:
                return self.robots._copies.take_terms()

        named = {"num_envs": 5, "seed": 3}
        there, robots = gaitfit.Robots(**named), gaitfit.Robots(**named)
        robots._gpu, robots._copies = Stepped(there), None
        before = robots.state()
        for _ in range(4):
            there.step(np.ones((5, 12)))
        np.testing.assert_array_equal(robots.motion().joint_position, there.motion().joint_position)
        np.testing.assert_array_equal(robots.picture(2), there.picture(2))
        np.testing.assert_array_equal(robots.state().steps, [4] * 5)
        self.assertNotEqual(set(robots.reward_terms().values()), {0.0})
        robots.set_state(before)
        np.testing.assert_array_equal(there.state().numbers, before.numbers)
        self.assertEqual(there.state().step, 0)

    def test_motion_is_what_the_robots_do(self) -> None:
        self.assertEqual(repr(gaitfit.Robots(num_envs=3).motion()), "Motion(3 robots, 12 joints)")
        quiet = {f"task.noise.{name}": 0.0 for name in ("joint_position", "joint_velocity", "projected_gravity", "base_angular_velocity")}
        robots = gaitfit.Robots("assets/go2-walk.toml", num_envs=300, seed=2, settings=quiet)
        policy = gaitfit.load_policy("assets/go2-walk.safetensors")
        before = robots.motion()
        for _ in range(50):
            robots.step(policy(robots.observation))
        after = robots.motion()
        self.assertEqual((after.joint_position.shape, after.base_quaternion.shape), ((300, 12), (300, 4)))
        np.testing.assert_allclose(np.linalg.norm(after.base_quaternion, axis=1), 1.0, atol=1e-4)
        self.assertGreater(np.abs(after.base_position - before.base_position).max(), 0.2)
        # Without noise the observation of joint positions is the motion less the default pose.
        names = [term.quantity if hasattr(term, "quantity") else term for term in robots.interface.observation]
        scales = {term.quantity: term.scale for term in robots.interface.observation}
        widths = {"command": 3, "base_angular_velocity": 3, "projected_gravity": 3}
        at = sum(widths.get(name, 12) for name in names[: names.index("joint_position")])
        scale = np.atleast_1d(scales["joint_position"] or 1.0)[0]
        expected = (after.joint_position - np.asarray(robots.interface.default_pose)) * scale
        np.testing.assert_allclose(robots.observation[:, at : at + 12], expected, atol=1e-4)

    def test_other_libraries_share_the_memory(self) -> None:
        robots = gaitfit.Robots(num_envs=4)
        shared = np.from_dlpack(robots.observation)
        robots.step(np.zeros((4, 12), np.float32))
        np.testing.assert_array_equal(shared, robots.observation)
        self.assertTrue(np.shares_memory(shared, robots.observation))

    def test_torch_and_robots_share_the_memory_both_ways(self) -> None:
        try:
            import torch
        except ImportError as missing:
            self.skipTest(str(missing))
        robots, twin = gaitfit.Robots(num_envs=4), gaitfit.Robots(num_envs=4)
        names = ("observation", "critic_observation", "last_observation", "reward", "terminated", "truncated")
        tensors = {name: torch.from_dlpack(getattr(robots, name)) for name in names}
        actions = torch.full((4, 12), 0.3)
        for _ in range(40):
            robots.step(actions)
            twin.step(np.full((4, 12), 0.3, np.float32))
        for name, tensor in tensors.items():
            array = getattr(robots, name)
            self.assertEqual(tensor.data_ptr(), array.ctypes.data, name)
            np.testing.assert_array_equal(tensor.numpy(), array, err_msg=name)
            np.testing.assert_array_equal(array, getattr(twin, name), err_msg=name)
        self.assertEqual(tensors["terminated"].dtype, torch.bool)
        # Actions are read where they lie.
        self.assertEqual(numbers("actions", actions, np.float32).ctypes.data, actions.data_ptr())
        with self.assertRaisesRegex(TypeError, "actions: no array of numbers"):
            robots.step(torch.zeros(4, 12, device="meta"))
        with self.assertRaisesRegex(TypeError, "actions: no array of numbers"):
            robots.step(torch.zeros(4, 12, requires_grad=True))


if __name__ == "__main__":
    unittest.main()
