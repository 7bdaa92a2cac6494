"""Rewards and ends of episodes of the user's own in trainings."""

import unittest
from typing import Any

import numpy as np

import gaitfit
from gaitfit import Motion, Terms, TrainingRobots

from .common import Case

SIZE: dict[str, Any] = {"train.num_envs": 300, "train.iterations": 2, "train.steps": 6}


class TrainingTerms(Case):
    def train(self, terms: Terms | None, name: str, **more: Any) -> gaitfit.Training:
        return gaitfit.train(settings=SIZE, terms=terms, runs=self.folder, name=name, progress=False, **more)

    def test_the_tasks_own_reward_changes_nothing(self) -> None:
        counts: set[int] = set()

        def same(robots: TrainingRobots, motion: Motion) -> Any:
            counts.add(robots.num_envs)
            self.assertEqual(motion.joint_position.shape, (robots.num_envs, 12))
            self.assertEqual(robots.commands.shape, (robots.num_envs, 3))
            return robots.reward

        plain, termed = self.train(None, "plain"), self.train(Terms(reward=same), "same", threads=2)
        self.assertEqual(counts, {256, 44})
        files = [one.policy.with_name("metrics.jsonl").read_text().splitlines() for one in (plain, termed)]
        self.assertEqual(len(files[0]), len(files[1]))
        self.assertEqual([row["reward"] for row in plain.history()], [row["reward"] for row in termed.history()])
        observation = np.linspace(-1.0, 1.0, 45, dtype=np.float32)[None]
        acted = [gaitfit.load_policy(one.policy)(observation) for one in (plain, termed)]
        np.testing.assert_array_equal(acted[0], acted[1])

    def test_they_are_what_is_trained(self) -> None:
        ones = self.train(Terms(reward=lambda robots, motion: np.ones(robots.num_envs)), "ones")
        self.assertEqual({round(row["reward"], 6) for row in ones.history()}, {1.0})
        # A robot whose base is above the ground by 0 m or more: every episode ends at once.
        ended = self.train(Terms(terminated=lambda robots, motion: motion.base_position[:, 2] > 0.0), "ended")
        self.assertEqual({row["fall_rate"] for row in ended.history()}, {1.0})
        self.assertEqual({round(row["episode_seconds"], 6) for row in ended.history()}, {0.02})
        tuned = gaitfit.finetune(
            "assets/go2-walk.safetensors", settings=SIZE | {"train.iterations": 1}, runs=self.folder, name="tuned", progress=False,
            terms=Terms(reward=lambda robots, motion: np.full(robots.num_envs, 0.5)),
        )
        self.assertEqual([round(row["reward"], 6) for row in tuned.history()], [0.5])

    def test_runs_continue_with_terms_alone(self) -> None:
        terms = Terms(reward=lambda robots, motion: robots.reward + 1.0)
        whole = self.train(terms, "whole")
        with self.assertRaises(gaitfit.Stopped):
            gaitfit.train(
                settings=SIZE, terms=terms, runs=self.folder, name="cut",
                progress=lambda event: (event.kind, event.done) != ("step", 1),
            )
        with self.assertRaisesRegex(gaitfit.GaitfitError, "settings|cannot be continued|changed"):
            self.train(None, "cut", resume=True)
        cut = self.train(terms, "cut", resume=True)
        self.assertEqual([row["reward"] for row in cut.history()], [row["reward"] for row in whole.history()])

    def test_errors_come_back_unchanged(self) -> None:
        def broken(robots: TrainingRobots, motion: Motion) -> Any:
            raise ArithmeticError("mine")

        with self.assertRaisesRegex(ArithmeticError, "mine"):
            self.train(Terms(reward=broken), "broken")
        for number, (function, words) in enumerate((
            (lambda robots, motion: np.ones(3), r"the reward term returned the shape \(3,\)"),
            (lambda robots, motion: np.full(robots.num_envs, np.nan), "finite numbers"),
            (lambda robots, motion: robots.observation[:, 0], "no 'observation' for terms; there are .*commands"),
        )):
            with self.subTest(words), self.assertRaisesRegex((ValueError, AttributeError), words):
                self.train(Terms(reward=function), f"wrong-{number}")
        for terms, device, error, words in (
            (Terms(observation=lambda robots, motion: robots.reward), "cpu", ValueError, "GaitfitVecEnv"),
            (Terms(), "cuda", ValueError, 'give device="cpu"'),
            ("steady", "cpu", TypeError, "give gaitfit.Terms"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                gaitfit.train(terms=terms, device=device, progress=False)  # type: ignore[arg-type]


if __name__ == "__main__":
    unittest.main()
