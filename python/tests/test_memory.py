"""Policies with a memory (GRU, LSTM) and two-part policies in Python."""

import json
import struct
import unittest
from pathlib import Path

import numpy as np

import gaitfit
from gaitfit.config import Fit, Memory, Optimizer, Parameter, Ppo, Size, Train

from .common import ROOT, Case

#: Policies as rsl_rl exports them, and what onnxruntime makes of a sequence of observations.
FIXTURES = ROOT / "crates" / "gaitfit-policy-files" / "tests" / "fixtures" / "policies"
CELLS = ("gru", "lstm")


def fixture(cell: str) -> "tuple[gaitfit.LoadedPolicy, np.ndarray, np.ndarray]":
    """A policy, observations of 40 steps, and onnxruntime's actions."""
    rows = json.loads((FIXTURES / f"{cell}_rows.json").read_text())
    return gaitfit.load_policy(FIXTURES / f"{cell}.toml"), *(np.array(rows[name], np.float32) for name in ("observation", "actions"))


def safetensors(file: Path, tensors: "dict[str, np.ndarray]") -> None:
    header, data = {}, b""
    for name, values in tensors.items():
        raw = np.ascontiguousarray(values, "<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [len(data), len(data) + len(raw)]}
        data += raw
    text = json.dumps(header).encode()
    file.write_bytes(struct.pack("<Q", len(text)) + text + data)


class Acting(Case):
    def test_calls_remember_as_onnxruntime_does(self) -> None:
        for cell in CELLS:
            with self.subTest(cell):
                policy, observations, actions = fixture(cell)
                self.assertTrue(policy.is_recurrent)
                once = np.array([policy(row) for row in observations])
                np.testing.assert_allclose(once, actions, atol=1e-5)
                # It remembers: the first observation has other actions now, until the policy forgets.
                self.assertGreater(np.abs(policy(observations[0]) - once[0]).max(), 1e-2)
                policy.reset()
                np.testing.assert_array_equal(policy(observations[0]), once[0])

    def test_each_robot_forgets_by_itself(self) -> None:
        for cell in CELLS:
            with self.subTest(cell):
                policy, observations, _ = fixture(cell)
                pair = np.stack([observations[:20], observations[20:]], axis=1)
                for row in pair:
                    last = policy(row)
                alone = gaitfit.load_policy(policy)
                for row in observations[:20]:
                    expected = alone(row)
                np.testing.assert_allclose(last[0], expected, atol=1e-6)
                policy.reset([1])
                after, (first, second) = policy(pair[0]), (alone(pair[0, 0]), gaitfit.load_policy(policy)(pair[0, 1]))
                np.testing.assert_allclose(after, [first, second], atol=1e-6)

    def test_predict_takes_and_returns_the_state(self) -> None:
        """As Stable-Baselines3's learners and ``evaluate_policy`` call it."""
        for cell in CELLS:
            with self.subTest(cell):
                policy, observations, _ = fixture(cell)
                once = np.array([policy(row) for row in observations])
                policy.reset()
                policy(observations[5])
                state, starts = None, np.ones(1, bool)
                for row, expected in zip(observations, once):
                    actions, state = policy.predict(row[None], state=state, episode_start=starts, deterministic=True)
                    np.testing.assert_array_equal(actions[0], expected)
                    starts[:] = False
                # The memory of calls is another one.
                np.testing.assert_array_equal(policy(observations[6]), self.second(policy, observations[5], observations[6]))
                # The start of an episode forgets, and so does no state.
                for given in ({"state": state, "episode_start": [True]}, {}):
                    np.testing.assert_array_equal(policy.predict(observations[:1], **given)[0][0], once[0])
                self.assertEqual(policy.predict(observations[0])[0].shape, (12,))
                for wrong, words in (
                    ({"state": (np.zeros((2, 3)),)}, r"the state has the shape \(2, 3\); needed: \(1, \d+\)"),
                    ({"state": (np.zeros(3),)}, "the state has the shape"),
                    ({"state": state, "episode_start": [True, False]}, r"episode_start has the shape \(2,\); needed: \(1,\)"),
                ):
                    with self.assertRaisesRegex(ValueError, words):
                        policy.predict(observations[:1], **wrong)

    def second(self, policy: gaitfit.LoadedPolicy, *rows: np.ndarray) -> np.ndarray:
        fresh = gaitfit.load_policy(policy)
        return [fresh(row) for row in rows][-1]


class Torch(Case):
    def setUp(self) -> None:
        super().setUp()
        try:
            import torch
        except ImportError as missing:
            self.skipTest(str(missing))
        self.torch = torch

    def test_modules_remember_as_the_policies_do(self) -> None:
        torch = self.torch
        for cell in CELLS:
            with self.subTest(cell):
                policy, observations, _ = fixture(cell)
                module = policy.to_torch()
                rows = np.stack([observations, observations[::-1]], axis=1)
                expected = np.array([policy(row) for row in rows])
                state = None
                with torch.inference_mode():
                    for row, actions in zip(rows, expected):
                        found, state = module(torch.from_numpy(row), state)
                        np.testing.assert_allclose(found.numpy(), actions, atol=1e-6)
                    together, last = module(torch.from_numpy(rows))
                np.testing.assert_allclose(together.numpy(), expected, atol=1e-6)
                np.testing.assert_allclose(last, state, atol=1e-6)
                # The state is that of predict.
                actions, after = policy.predict(rows[0], state=(state.numpy(),))
                with torch.inference_mode():
                    found, state = module(torch.from_numpy(rows[0]), state)
                np.testing.assert_allclose(found.numpy(), actions, atol=1e-6)
                np.testing.assert_allclose(state.numpy(), after[0], atol=1e-6)
                # It can be trained further, through time.
                module(torch.from_numpy(rows))[0].square().sum().backward()
                self.assertTrue(all(one.grad is not None and one.grad.abs().sum() > 0 for one in module.parameters()))

    def test_two_part_policies(self) -> None:
        rng = np.random.default_rng(2)
        text = gaitfit.Interface.read("assets/go2-walk.safetensors").to_toml()
        width = gaitfit.Interface.read("assets/go2-walk.safetensors").observation_width
        sizes = {"encoder.0": (width, 16), "encoder.2": (16, 5), "actor.0": (width + 5, 24), "actor.2": (24, 12)}
        tensors = {}
        for name, (inputs, outputs) in sizes.items():
            tensors |= {f"{name}.weight": rng.normal(0.0, 0.3, (outputs, inputs)), f"{name}.bias": rng.normal(0.0, 0.3, outputs)}
        safetensors(self.folder / "net.safetensors", tensors)
        observations = rng.normal(size=(9, width)).astype(np.float32)
        for latent in ("first", "last"):
            file = self.folder / f"{latent}.toml"
            encoder = f'encoder = {{ tensors = "encoder", passes = "all", latent = "{latent}" }}\n'
            file.write_text(f'file = "net.safetensors"\nactivation = "elu"\n{encoder}{text}', encoding="utf-8")
            policy = gaitfit.load_policy(file)
            with self.torch.inference_mode():
                found = policy.to_torch()(self.torch.from_numpy(observations)).numpy()
            np.testing.assert_allclose(found, policy(observations), atol=1e-6 * max(1.0, np.abs(found).max()))

    def test_graphs_are_refused_by_name(self) -> None:
        with self.assertRaisesRegex(ValueError, r"moe\.toml: the policy is .*, which to_torch\(\) cannot turn into layers"):
            gaitfit.load_policy(FIXTURES / "graphs" / "moe.toml").to_torch()


class Stages(Case):
    def test_a_trained_memory_acts_and_is_evaluated_collected_and_fitted(self) -> None:
        """On the processor. Two iterations do not teach it to walk, but its mean actions stand."""
        for cell in CELLS:
            with self.subTest(cell):
                config = Train(
                    train=Size(num_envs=16, steps=8, iterations=2),
                    ppo=Ppo(memory=Memory(cell=cell, width=8, layers=1), actor_hidden=[16], critic_hidden=[16], minibatches=2),
                )
                trained = gaitfit.train(config, runs=self.folder, name=cell, progress=False)
                policy = gaitfit.load_policy(trained.policy)
                self.assertTrue(policy.is_recurrent)
                robots = gaitfit.Robots(num_envs=4, seed=1)
                first = policy(robots.observation)
                for _ in range(5):
                    robots.step(policy(robots.observation))
                    policy.reset(np.flatnonzero(robots.terminated | robots.truncated))
                self.assertEqual(first.shape, (4, 12))
                walked = gaitfit.evaluate(policy, trajectories=8, seconds=0.4, drift=0, progress=False)
                self.assertEqual(walked.trajectories, 8)
                logs = gaitfit.collect(policy, self.folder / f"logs-{cell}", trajectories=4, seconds=4.0, progress=False)
                self.assertEqual((len(logs.files), logs.falls), (4, 0))
                fit = Fit(
                    robot="assets/go2.xml", costs=["wass"], parameters=[Parameter("delay", per="all", upper=0.04)],
                    optimizer=Optimizer(generations=2, seeds=1, replicates=0),
                )
                result = gaitfit.fit(fit, policy=policy, logs=logs.files, runs=self.folder, name=f"fit-{cell}", progress=False)
                self.assertTrue(np.isfinite(result.cost))


if __name__ == "__main__":
    unittest.main()
