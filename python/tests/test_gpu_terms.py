"""Chosen robots of a GPU begin anew, and functions of the user judge them: with tensors on the processor, and on a GPU where one is."""

import unittest
from typing import Any

import numpy as np

import gaitfit

from .common import Case, GpuCase

#: Functions of a user, for arrays and for tensors.
TERMS: dict[str, Any] = {
    "reward": lambda robots, motion: robots.reward + 0.1 * motion.base_linear_velocity[:, 0],
    "terminated": lambda robots, motion: motion.base_position[:, 2] < 0.25,
    "observation": lambda robots, motion: motion.torque,
}


class Tensors(Case):
    def test_terms_as_tensors_are_those_of_arrays(self) -> None:
        """What a GPU's robots do with terms, with tensors on the processor."""
        try:
            import torch
            from gymnasium.vector import AutoresetMode

            from gaitfit._terms_gpu import GpuTerms
            from gaitfit.gym import GaitfitVecEnv, Terms
        except ImportError as missing:
            self.skipTest(str(missing))
        terms = Terms(**TERMS)
        for mode in AutoresetMode:
            arrays, tensors = (GaitfitVecEnv(num_envs=32, seed=3, terms=terms, autoreset_mode=mode) for _ in range(2))
            tensors._gpu_terms, tensors._copy = GpuTerms(terms, tensors.robots), False
            ends = 0
            for number in range(60):
                action = np.full((32, 12), 4.0 * np.sin(number), np.float32)
                found, wanted = tensors.step(action), arrays.step(action)
                for one, other in zip(found[:4], wanted[:4]):
                    self.assertIsInstance(one, torch.Tensor)
                    np.testing.assert_array_equal(one.numpy(), other)
                ended = wanted[2] | wanted[3]
                ends += int(ended.sum())
                self.assertEqual("_final_obs" in found[4], bool(ended.any()) and mode == AutoresetMode.SAME_STEP)
                if "_final_obs" in found[4]:
                    np.testing.assert_array_equal(found[4]["_final_obs"].numpy(), ended)
                    for row in np.flatnonzero(ended):
                        np.testing.assert_array_equal(found[4]["final_obs"][row].numpy(), wanted[4]["final_obs"][row])
                elif ended.any() and mode == AutoresetMode.DISABLED:
                    np.testing.assert_array_equal(
                        tensors.reset(options={"reset_mask": torch.from_numpy(ended)})[0].numpy(),
                        arrays.reset(options={"reset_mask": ended})[0],
                    )
            self.assertGreater(ends, 32)
        wrong = (
            ({"reward": lambda robots, motion: motion.torque}, "the reward term returned the shape"),
            ({"reward": lambda robots, motion: "much"}, "the reward term returned what is no tensor"),
            ({"reward": lambda robots, motion: robots.reward / 0.0}, r"needed: \(32,\) of finite"),
            ({"terminated": lambda robots, motion: robots.reward}, "returned torch.float32"),
            ({"observation": lambda robots, motion: motion.torque[:3]}, r"the shape \(3, 12\); needed: \(32, numbers\)"),
        )
        robots = gaitfit.Robots(num_envs=32, autoreset=False)
        robots.step(np.zeros((32, 12)))
        for given, words in wrong:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                one = GpuTerms(Terms(**given), robots)
                motion = one.motion()
                one.rewarded(motion), one.over(motion), one.observed(motion)


class OnGpu(GpuCase):
    def test_chosen_robots_begin_anew(self) -> None:
        torch, count = self.torch, 300
        common: dict[str, Any] = {"num_envs": count, "seed": 4, "settings": {"task.episode_seconds": 0.6}, "autoreset": False}
        cpu, gpu = gaitfit.Robots(**common), gaitfit.Robots(**common, device="cuda")
        for action in self.actions(count, 35):
            cpu.step(action)
            gpu.step(torch.from_numpy(action).cuda())
        self.assertTrue(gpu.ended.numpy().all(), "nobody begins anew by itself")
        np.testing.assert_array_equal(gpu.state().steps, cpu.state().steps)
        motion = gpu.motion(on_device=True)
        for name, array in vars(motion).items():
            np.testing.assert_allclose(array.numpy(), getattr(gpu.motion(), name), atol=1e-5, err_msg=name)
        before, mask = gpu.observation.numpy(), np.arange(count) % 3 == 0
        cpu.reset(mask)
        for chosen in (mask, torch.from_numpy(mask).cuda()):
            gpu.reset(chosen)
            self.assertTrue((gpu.state().steps[mask] == 0).all())
            np.testing.assert_array_equal(gpu.observation.numpy()[~mask], before[~mask])
            if chosen is mask:
                self.assertLess(np.abs(gpu.observation.numpy() - cpu.observation)[mask].max(), 1e-5)
                np.testing.assert_array_equal(gpu.commands.numpy(), cpu.commands)
        gpu.step(torch.zeros(count, 12, device="cuda"))
        np.testing.assert_array_equal(gpu.ended.numpy(), ~mask)
        gpu.reset(gpu.ended)
        self.assertTrue((gpu.state().steps[~mask] == 0).all())
        with self.assertRaisesRegex(ValueError, "the mask|mask has the shape"):
            gpu.reset(mask[:5])

    def test_the_step_after_an_end_begins_the_next_episode(self) -> None:
        torch, count = self.torch, 300
        try:
            from gaitfit.gym import AutoresetMode, GaitfitVecEnv
        except ImportError as missing:
            self.skipTest(str(missing))
        common: dict[str, Any] = {"num_envs": count, "seed": 3, "autoreset_mode": AutoresetMode.NEXT_STEP}
        cpu, gpu = (GaitfitVecEnv(**common, device=device) for device in ("cpu", "cuda"))
        together, ended, ends, compared = np.ones(count, bool), np.zeros(count, bool), 0, 0
        for number in range(40):
            action = np.full((count, 12), 4.0 * np.sin(number), np.float32)
            wanted, found = cpu.step(action), [one.numpy() for one in gpu.step(torch.from_numpy(action).cuda())[:4]]
            begun, ended = ended, found[2] | found[3]
            np.testing.assert_array_equal(found[1][begun], 0.0)
            self.assertFalse(ended[begun].any(), "a step that begins an episode ends none")
            self.assertTrue((gpu.robots.state().steps[begun] == 0).all())
            np.testing.assert_array_equal(gpu.robots.ended.numpy(), ended)
            together &= (found[2] == wanted[2]) & (found[3] == wanted[3])
            # Draws of new episodes count the resets so far: these are as many only until a robot ends at another step.
            if together.all():
                self.assertLess(np.median(np.abs(found[1] - wanted[1])), 0.05)
                self.assertLess(np.abs(found[0] - wanted[0])[begun].max(initial=0.0), 1e-4)
                compared += int(begun.sum())
            ends += int(ended.sum())
        self.assertGreater(ends, 30)
        self.assertGreater(compared, 5)
        self.assertGreater(together.mean(), 0.5)

    def test_terms_of_the_user(self) -> None:
        torch = self.torch
        try:
            from gaitfit.gym import AutoresetMode, GaitfitVecEnv, Terms
        except ImportError as missing:
            self.skipTest(str(missing))
        terms = Terms(**TERMS)
        for mode in AutoresetMode:
            cpu, gpu = (GaitfitVecEnv(num_envs=300, seed=3, terms=terms, autoreset_mode=mode, device=d) for d in ("cpu", "cuda"))
            self.assertEqual(gpu.single_observation_space, cpu.single_observation_space)
            together, ends = np.ones(300, bool), 0
            for number in range(25):
                action = np.full((300, 12), 4.0 * np.sin(number), np.float32)
                wanted, found = cpu.step(action), gpu.step(torch.from_numpy(action).cuda())
                self.assertTrue(all(one.is_cuda for one in found[:4]))
                together &= (found[2].cpu().numpy() == wanted[2]) & (found[3].cpu().numpy() == wanted[3])
                apart = np.abs(found[1].cpu().numpy() - wanted[1])[together]
                self.assertLess(np.median(apart), 0.02)
                ended = found[2] | found[3]
                ends += int(ended.sum())
                if mode == AutoresetMode.SAME_STEP:
                    self.assertEqual("_final_obs" in found[4], bool(ended.any()))
                elif ended.any() and mode == AutoresetMode.DISABLED:
                    gpu.reset(options={"reset_mask": ended})
                    cpu.reset(options={"reset_mask": ended.cpu().numpy()})
            self.assertGreater(ends, 30)
            self.assertGreater(together.mean(), 0.5)


if __name__ == "__main__":
    unittest.main()
