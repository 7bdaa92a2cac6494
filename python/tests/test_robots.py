"""Many robots at a task: the environment alone, for Gymnasium and for rsl_rl."""

import io
import pickle
import threading
import time
import unittest
import urllib.error
import urllib.request
import warnings
from unittest import mock

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
        with self.assertRaisesRegex(gaitfit.GaitfitError, "11 of 300 environments diverged, the first of them environment 1:"):
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


class ForLearners(Case):
    def test_final_infos_and_masks(self) -> None:
        try:
            from gymnasium.vector import AutoresetMode

            from gaitfit.gym import GaitfitEnv, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        env = GaitfitVecEnv(num_envs=32, log_rewards=True)
        env.reset(seed=3)
        returns, lengths, ends = np.zeros(32), np.zeros(32, int), 0
        for number in range(150):
            _, reward, terminated, truncated, infos = env.step(np.full((32, 12), 4.0 * np.sin(number)))
            returns, lengths = returns + reward, lengths + 1
            self.assertAlmostEqual(sum(infos["log"].values()), float(reward.mean()), places=5)
            ended = terminated | truncated
            if ended.any():
                ends += 1
                final = infos["final_info"]
                np.testing.assert_allclose(final["episode_return"][ended], returns[ended], rtol=1e-12)
                np.testing.assert_array_equal(final["episode_length"][ended], lengths[ended])
                np.testing.assert_array_equal(final["fell"], terminated)
                np.testing.assert_array_equal(final["_episode_return"], ended)
                returns[ended], lengths[ended] = 0.0, 0
        self.assertGreater(ends, 0)
        state = env.state()
        first = env.step(np.zeros((32, 12)))[0]
        env.set_state(state)
        np.testing.assert_array_equal(env.step(np.zeros((32, 12)))[0], first)
        mask = np.arange(32) < 4
        kept = env.robots.state().steps
        env.reset(options={"reset_mask": mask})
        np.testing.assert_array_equal(env.robots.state().steps[~mask], kept[~mask])
        with self.assertRaisesRegex(ValueError, "reset_mask and seed"):
            env.reset(seed=1, options={"reset_mask": mask})
        one = GaitfitEnv()
        one.reset(seed=1)
        _, reward, _, _, info = one.step(np.zeros(12, np.float32))
        self.assertAlmostEqual(sum(info["reward_terms"].values()), reward, places=5)

    def test_terms_of_the_user(self) -> None:
        try:
            from gymnasium.vector import AutoresetMode

            from gaitfit.gym import GaitfitVecEnv, Terms
        except ImportError as missing:
            self.skipTest(str(missing))
        plain = GaitfitVecEnv(num_envs=32)
        terms = Terms(
            reward=lambda robots, motion: robots.reward + motion.base_position[:, 2],
            terminated=lambda robots, motion: motion.base_position[:, 2] < 0.25,
            observation=lambda robots, motion: motion.base_position[:, 2],
        )
        for mode in (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP):
            env = GaitfitVecEnv(num_envs=32, terms=terms, autoreset_mode=mode)
            width = plain.single_observation_space.shape[0]
            self.assertEqual(env.single_observation_space.shape, (width + 1,))
            first, _ = env.reset(seed=3)
            np.testing.assert_array_equal(first[:, :width], plain.reset(seed=3)[0])
            np.testing.assert_array_equal(first[:, width], env.robots.motion().base_position[:, 2])
            ends, begun = 0, np.zeros(32, bool)
            for number in range(60):
                found = env.step(np.full((32, 12), 3.0 * np.sin(number), np.float32))
                observation, reward, terminated, truncated, infos = found
                ended = terminated | truncated
                self.assertTrue((observation[~ended, width] >= 0.25).all() or mode == AutoresetMode.SAME_STEP)
                if mode == AutoresetMode.SAME_STEP:
                    for index in np.flatnonzero(terminated):
                        self.assertLess(infos["final_obs"][index][width], 0.26)
                else:
                    np.testing.assert_array_equal(reward[begun], 0.0)
                    self.assertTrue((observation[terminated, width] < 0.26).all())
                    begun = ended
                ends += ended.sum()
            self.assertGreater(ends, 0)
        for wrong, words in (
            ({"reward": lambda robots, motion: [1.0]}, r"the reward term returned the shape \(1,\)"),
            ({"reward": lambda robots, motion: np.full(32, np.nan)}, "of finite numbers"),
            ({"terminated": lambda robots, motion: np.zeros(32)}, "the term terminated returned .* of bool"),
            ({"observation": lambda robots, motion: np.zeros((3, 2))}, "the observation term returned the shape"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                GaitfitVecEnv(num_envs=32, terms=Terms(**wrong)).step(np.zeros((32, 12)))
        with self.assertRaisesRegex(TypeError, "reward is 3; give a function"):
            Terms(reward=3)
        with self.assertRaisesRegex(TypeError, "give gaitfit.gym.Terms"):
            GaitfitVecEnv(num_envs=2, terms=3)
        with self.assertRaisesRegex(ValueError, "terms are functions of the processor's robots, and device is 'cuda'"):
            GaitfitVecEnv(num_envs=2, terms=Terms(), device="cuda")

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

    def test_autoreset_modes(self) -> None:
        try:
            from gymnasium.vector import AutoresetMode

            from gaitfit.gym import GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        same, later = (GaitfitVecEnv(num_envs=32, autoreset_mode=mode) for mode in (AutoresetMode.SAME_STEP, "NextStep"))
        off = GaitfitVecEnv(num_envs=32, autoreset_mode=AutoresetMode.DISABLED)
        self.assertEqual(later.metadata["autoreset_mode"], AutoresetMode.NEXT_STEP)
        for env in (same, later, off):
            env.reset(seed=3)
        ended = np.zeros(32, bool)
        for number in range(150):
            action = np.full((32, 12), 4.0 * np.sin(number), np.float32)
            steps = [env.step(action) for env in (same, later, off)]
            ended = steps[0][2] | steps[0][3]
            for found in steps[1:]:
                for mine, theirs in zip(found[1:4], steps[0][1:4]):
                    np.testing.assert_array_equal(mine, theirs)
                # The last observation is that of the episode that ended.
                for index in np.flatnonzero(ended):
                    np.testing.assert_array_equal(found[0][index], steps[0][4]["final_obs"][index])
            if ended.any():
                break
        self.assertTrue(ended.any() and not ended.all())
        before = later.robots.state()
        observation, reward, terminated, truncated, _ = later.step(np.ones((32, 12), np.float32))
        np.testing.assert_array_equal(reward[ended], 0.0)
        self.assertFalse((terminated | truncated)[ended].any())
        self.assertTrue((later.robots.state().steps[ended] == 0).all(), "the action had no effect")
        others = ~ended & ~(terminated | truncated)
        np.testing.assert_array_equal(later.robots.state().steps[others], before.steps[others] + 1)
        self.assertTrue(np.isfinite(observation).all())
        off.reset(options={"reset_mask": ended})
        np.testing.assert_array_equal(off.robots.state().steps == 0, ended)

    def test_stable_baselines3(self) -> None:
        try:
            from stable_baselines3 import PPO

            from gaitfit.sb3 import Sb3VecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        env = Sb3VecEnv(num_envs=32, seed=1)
        env.seed(5)
        first = env.reset()
        np.testing.assert_array_equal(first, gaitfit.Robots(num_envs=32, seed=5).observation)
        ends = 0
        for number in range(120):
            observation, reward, done, infos = env.step(np.full((32, 12), 4.0 * np.sin(number), np.float32))
            for index in np.flatnonzero(done):
                ends += 1
                self.assertEqual(infos[index]["terminal_observation"].shape, observation[index].shape)
                self.assertGreater(infos[index]["episode"]["l"], 0)
            self.assertTrue(all(not infos[index] for index in np.flatnonzero(~done)))
        self.assertGreater(ends, 0)
        model = PPO("MlpPolicy", env, n_steps=8, batch_size=64, n_epochs=1, device="cpu").learn(512)
        self.assertEqual(model.predict(observation)[0].shape, (32, 12))

    def test_gymnasium(self) -> None:
        try:
            from gymnasium.vector import AutoresetMode, VectorEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        from gaitfit.gym import GaitfitVecEnv

        env = GaitfitVecEnv(num_envs=32)
        self.assertIsInstance(env, VectorEnv)
        self.assertEqual(env.metadata["autoreset_mode"], AutoresetMode.SAME_STEP)
        first, infos = env.reset(seed=3)
        self.assertEqual((first.shape, first.dtype, infos), (env.observation_space.shape, np.float32, {}))
        self.assertTrue(env.observation_space.contains(first))
        env.action_space.seed(0)
        kept = first.copy()
        ends = 0
        for _ in range(150):
            found = env.step(env.action_space.sample())
            observation, reward, terminated, truncated, infos = found
            self.assertTrue(env.observation_space.contains(observation))
            self.assertEqual((reward.shape, terminated.dtype, truncated.shape), ((32,), np.bool_, (32,)))
            if (terminated | truncated).any():
                ends += 1
                np.testing.assert_array_equal(infos["_final_obs"], terminated | truncated)
                self.assertEqual([one is not None for one in infos["final_obs"]], (terminated | truncated).tolist())
        self.assertGreater(ends, 0)
        np.testing.assert_array_equal(first, kept)
        np.testing.assert_array_equal(env.reset(seed=3)[0], first)
        self.assertFalse(np.array_equal(env.reset()[0], first))
        for seeds in ([3, 4], (3, 4), (None, np.int64(3))):
            np.testing.assert_array_equal(env.reset(seed=seeds)[0], first)
        for wrong, error in (("one", TypeError), (1.5, TypeError), ((True,), TypeError), (-1, ValueError)):
            with self.subTest(wrong=wrong), self.assertRaisesRegex(error, "seed is"):
                env.reset(seed=wrong)
            self.assertTrue(np.isfinite(env.step(np.zeros((32, 12)))[0]).all(), "the robots are as before")

    def test_random_actions_never_end_a_run(self) -> None:
        try:
            from gaitfit.gym import GaitfitEnv, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        env = GaitfitEnv()
        self.assertTrue(np.isfinite(env.action_space.low).all() and np.isfinite(env.action_space.high).all())
        env.action_space.seed(0)
        env.reset(seed=0)
        ends = 0
        for _ in range(2000):
            observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            self.assertTrue(np.isfinite(observation).all() and np.isfinite(reward))
            if terminated or truncated:
                ends += 1
                env.reset()
        self.assertGreater(ends, 0)
        many = GaitfitVecEnv(num_envs=256)
        many.action_space.seed(0)
        many.reset(seed=0)
        for _ in range(100):
            many.step(many.action_space.sample())

    def test_gymnasiums_checker_passes(self) -> None:
        try:
            import gymnasium
            from gymnasium.utils.env_checker import check_env

            from gaitfit.gym import GaitfitEnv, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        # The checker renders in each mode.
        opened = mock.patch("webbrowser.open", return_value=True)
        with opened, warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            check_env(GaitfitEnv())
            check_env(gymnasium.make("gaitfit.gym:gaitfit/Go2-v0").unwrapped)
        # Bounds of spaces are a matter of taste, and only what `make` made has a spec.
        words = ("infinity", "normalized", "not having a spec")
        others = [str(one.message) for one in said if not any(word in str(one.message) for word in words)]
        self.assertEqual(others, [])
        many = gymnasium.make_vec("gaitfit.gym:gaitfit/Go2-v0", num_envs=3, vectorization_mode="vector_entry_point")
        self.assertIsInstance(many.unwrapped, GaitfitVecEnv)
        self.assertEqual(many.reset(seed=1)[0].shape[0], 3)
        with self.assertRaisesRegex(ValueError, "give 'human', 'rgb_array' or None"):
            GaitfitEnv(render_mode="ansi")
        drawn = GaitfitEnv(render_mode="rgb_array")
        drawn.reset(seed=1)
        self.assertEqual((drawn.render().shape, drawn.render().dtype, drawn.metadata["render_fps"]), ((360, 480, 3), np.uint8, 50))

    def test_a_page_shows_every_step(self) -> None:
        try:
            from gaitfit.gym import GaitfitEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        from gaitfit._window import png

        with mock.patch("webbrowser.open", return_value=True) as opened:
            env = GaitfitEnv(render_mode="human")
            begun = time.monotonic()
            env.reset(seed=1)
            for _ in range(3):
                env.step(np.zeros(12, np.float32))
        # It does not run faster than the robot.
        self.assertGreater(time.monotonic() - begun, 3 * 0.02)
        opened.assert_called_once()
        address = opened.call_args.args[0]
        self.assertRegex(address, r"^http://127\.0\.0\.1:\d+/$")
        self.assertIn(b"<img", urllib.request.urlopen(address).read())
        with urllib.request.urlopen(f"{address}picture?seen=2") as answer:
            self.assertEqual((answer.headers["X-Number"], answer.read()), ("4", png(env.robots.picture())))
        with self.assertRaisesRegex(urllib.error.HTTPError, "404"):
            urllib.request.urlopen(f"{address}other")
        env.close()
        with self.assertRaises(urllib.error.URLError):
            urllib.request.urlopen(address)

    def test_a_png_file_has_the_pixels(self) -> None:
        try:
            from matplotlib import image
        except ImportError as missing:
            self.skipTest(str(missing))
        from gaitfit._window import png

        picture = np.random.default_rng(0).integers(0, 256, (7, 5, 3), np.uint8)
        read = image.imread(io.BytesIO(png(picture)))
        np.testing.assert_array_equal(np.round(255 * read[..., :3]), picture)

    def test_one_robot_is_the_first_of_many(self) -> None:
        try:
            from gaitfit.gym import GaitfitEnv, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        one, many = GaitfitEnv(seed=7), GaitfitVecEnv(num_envs=2, seed=7)
        np.testing.assert_array_equal(one.reset(seed=7)[0], many.reset(seed=7)[0][0])
        action, ended = np.full(12, 6.0, np.float32), False
        for _ in range(150):
            observation, reward, fell, late, _ = one.step(action)
            others, rewards, falls, lates, infos = many.step(np.tile(action, (2, 1)))
            self.assertEqual((reward, fell, late), (rewards[0], falls[0], lates[0]))
            ended = fell or late
            np.testing.assert_array_equal(observation, infos["final_obs"][0] if ended else others[0])
            if ended:
                # The next episode is the one that many robots are in.
                np.testing.assert_array_equal(one.reset()[0], others[0])
                break
        self.assertTrue(ended, "a robot that is bent falls")
        with self.assertRaisesRegex(ValueError, r"shape \(3,\); needed: \(12,\)"):
            one.step(np.zeros(3))
        with self.assertRaisesRegex(ValueError, "not finite"):
            one.step(np.full(12, np.nan))

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

    def test_arrays_are_handed_out_without_copies(self) -> None:
        robots = gaitfit.Robots(num_envs=4)
        names = ("observation", "critic_observation", "last_observation", "reward", "terminated", "truncated")
        places = {name: getattr(robots, name).ctypes.data for name in names}
        actions = np.zeros((4, 12), np.float32)
        for _ in range(3):
            robots.step(actions)
        self.assertEqual({name: getattr(robots, name).ctypes.data for name in names}, places)
        try:
            from gaitfit.gym import GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        for copy in (False, True):
            env = GaitfitVecEnv(num_envs=4, copy=copy)
            first, _ = env.reset()
            second, reward, *_ = env.step(actions)
            self.assertEqual(np.shares_memory(first, second), not copy)
            self.assertEqual(np.shares_memory(reward, env.step(actions)[1]), not copy)

    def test_rsl_rl(self) -> None:
        try:
            from gaitfit.rsl_rl import RslRlVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        import torch
        from rsl_rl.env import VecEnv

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            env = RslRlVecEnv(num_envs=32)
        self.assertIsInstance(env, VecEnv)
        observations = env.get_observations()
        kept = observations["policy"].clone()
        self.assertEqual(observations.batch_size[0], 32)
        ages = env.episode_length_buf.clone()
        found, reward, dones, extras = env.step(torch.zeros(32, env.num_actions))
        self.assertEqual((found["policy"].shape, reward.shape, dones.dtype), (kept.shape, (32,), torch.long))
        self.assertEqual(extras["time_outs"].shape, (32,))
        self.assertTrue(torch.equal(observations["policy"], kept), "what was handed out is not written over")
        self.assertTrue(torch.equal(env.episode_length_buf[dones == 0], ages[dones == 0] + 1))

    def test_rsl_rls_ppo_trains_through_it(self) -> None:
        try:
            from rsl_rl.runners import OnPolicyRunner

            from gaitfit.rsl_rl import RslRlVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        import torch

        torch.manual_seed(1)
        network = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "elu"}
        noise = {"class_name": "GaussianDistribution", "init_std": 0.5}
        runner = OnPolicyRunner(
            RslRlVecEnv(num_envs=64),
            {
                "num_steps_per_env": 8,
                "save_interval": 1000,
                "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
                "actor": {**network, "distribution_cfg": noise},
                "critic": network,
                "algorithm": {"class_name": "PPO", "num_learning_epochs": 2},
            },
        )
        before = [value.clone() for value in runner.alg.actor.parameters()]
        runner.learn(num_learning_iterations=3)
        after = list(runner.alg.actor.parameters())
        self.assertTrue(all(torch.isfinite(value).all() for value in after))
        self.assertFalse(any(torch.equal(*pair) for pair in zip(before, after)))


if __name__ == "__main__":
    unittest.main()
