"""Robots as environments of Gymnasium, Stable-Baselines3 and rsl_rl."""

import io
import pickle
import time
import unittest
import urllib.error
import urllib.request
import warnings
from unittest import mock

import numpy as np

import gaitfit
from gaitfit.config import TrueParameter

from .common import Case

POLICY = "assets/go2-walk.safetensors"


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
        with self.assertRaisesRegex(TypeError, "give gaitfit.Terms"):
            GaitfitVecEnv(num_envs=2, terms=3)

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

    def test_closed_environments_and_unknown_options_are_errors(self) -> None:
        try:
            from gymnasium.error import ClosedEnvironmentError

            from gaitfit.gym import GaitfitEnv, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        for env, actions in ((GaitfitVecEnv(num_envs=2), np.zeros((2, 12))), (GaitfitEnv(), np.zeros(12))):
            env.reset()
            with self.assertRaisesRegex(TypeError, "robots cannot be pickled"):
                pickle.dumps(env)
            env.close()
            env.close()
            for call in (env.reset, lambda: env.step(actions)):
                with self.assertRaisesRegex(ClosedEnvironmentError, "make another one"):
                    call()
        with self.assertRaisesRegex(ValueError, "options has 'mask'; the only option is 'reset_mask'"):
            GaitfitVecEnv(num_envs=2).reset(options={"mask": np.ones(2, bool)})

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

    def test_environments_are_those_of_a_fit(self) -> None:
        try:
            from gaitfit.gym import GaitfitEnv, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        stiff = TrueParameter("frictionloss", value=3.0)
        for theta in (stiff, None):
            robots = gaitfit.Robots(policy=POLICY, num_envs=3, seed=1, theta=theta)
            many = GaitfitVecEnv(policy=POLICY, num_envs=3, theta=theta)
            one = GaitfitEnv(policy=POLICY, theta=theta)
            seen = [many.reset(seed=1)[0], one.reset(seed=1)[0][None]]
            for _ in range(5):
                robots.step(np.ones((3, 12)))
                seen = [many.step(np.ones((3, 12), np.float32))[0], one.step(np.ones(12, np.float32))[0][None]]
            np.testing.assert_array_equal(seen[0], robots.observation)
            np.testing.assert_array_equal(seen[1], robots.observation[:1])
        with self.assertRaisesRegex(ValueError, "config and policy are given"):
            GaitfitVecEnv("assets/go2-walk.toml", policy=POLICY)

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
