"""Policies of files act in Python as they do in the program."""

import json
import pickle
import struct
import unittest
from pathlib import Path

import numpy as np

import gaitfit

from .common import Case
from .test_own_policy import FILE, network


def written(folder: Path, activation: str, norm: bool) -> Path:
    """A small perceptron with random weights, and its description."""
    rng = np.random.default_rng(3)
    interface = gaitfit.Interface.read(FILE)
    widths = [interface.observation_width, 32, 16, 12]
    tensors = {}
    for number, (inputs, outputs) in enumerate(zip(widths, widths[1:])):
        at = (3 if norm else 2) * number
        tensors[f"actor.{at}.weight"] = rng.normal(0.0, 0.3, (outputs, inputs))
        tensors[f"actor.{at}.bias"] = rng.normal(0.0, 0.3, outputs)
        if norm and number < 2:
            tensors[f"actor.{at + 1}.weight"] = rng.uniform(0.5, 1.5, outputs)
            tensors[f"actor.{at + 1}.bias"] = rng.normal(0.0, 0.3, outputs)
    header, data = {}, b""
    for name, values in tensors.items():
        raw = values.astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [len(data), len(data) + len(raw)]}
        data += raw
    text = json.dumps(header).encode()
    (folder / "net.safetensors").write_bytes(struct.pack("<Q", len(text)) + text + data)
    description = folder / "net.toml"
    description.write_text(f'file = "net.safetensors"\nactivation = "{activation}"\n{interface.to_toml()}', encoding="utf-8")
    return description


class Loaded(Case):
    def test_it_acts_as_its_network_in_numpy(self) -> None:
        policy = gaitfit.load_policy(FILE)
        observations = np.random.default_rng(1).normal(size=(300, policy.interface.observation_width)).astype(np.float32)
        actions = policy(observations)
        np.testing.assert_allclose(actions, network(observations), atol=1e-5)
        np.testing.assert_array_equal(policy(observations[7]), actions[7])
        np.testing.assert_array_equal(policy.predict(observations)[0], actions)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(policy))(observations), actions)
        self.assertFalse(policy.is_recurrent)
        self.assertEqual(policy.interface, gaitfit.Interface.read(FILE))

    def test_its_actions_walk(self) -> None:
        """The robots that follow its actions walk as those of the program's evaluation do: none falls."""
        policy = gaitfit.load_policy(FILE)
        robots = gaitfit.Robots("assets/go2-walk.toml", num_envs=16, seed=3)
        fell = np.zeros(16, bool)
        for _ in range(100):
            robots.step(policy(robots.observation))
            fell |= robots.terminated
        self.assertEqual(fell.sum(), 0)

    def test_it_is_a_path_too(self) -> None:
        policy = gaitfit.load_policy(FILE)
        short = {"trajectories": 4, "seconds": 0.4, "drift": 0, "progress": False}
        walks = [gaitfit.evaluate(one, **short) for one in (policy, FILE)]
        self.assertEqual(walks[0].linear_velocity_error, walks[1].linear_velocity_error)

    def test_what_is_wrong_is_named(self) -> None:
        policy = gaitfit.load_policy(FILE)
        width = policy.interface.observation_width
        for call, error, words in (
            (lambda: policy(np.zeros(3)), ValueError, f"has 3 numbers a row; the policy needs {width}"),
            (lambda: policy(np.zeros((1, 1, 1))), ValueError, "needed: .robots, observation."),
            (lambda: policy("x"), TypeError, "observation: texts"),
            (lambda: policy.predict(np.zeros(width), deterministic=False), ValueError, "mean actions only"),
            (lambda: policy.reset([5]), ValueError, "there is no row 5"),
            (lambda: gaitfit.load_policy("assets/go2.xml"), gaitfit.GaitfitError, "no policy by its ending"),
            (lambda: gaitfit.load_policy("assets"), gaitfit.GaitfitError, r"assets is a folder; .*gaitfit.load\('assets'\).policy"),
            (lambda: gaitfit.load_policy("nowhere.onnx"), FileNotFoundError, "the policy: there is no file nowhere.onnx"),
            (lambda: gaitfit.load_policy(3), TypeError, "file is 3; it must be a path"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                call()

    def test_torch_has_the_same_actions(self) -> None:
        try:
            import torch
        except ImportError as missing:
            with self.assertRaisesRegex(ImportError, "to_torch.. needs PyTorch: pip install torch"):
                gaitfit.load_policy(FILE).to_torch()
            self.skipTest(str(missing))
        files = [Path(FILE)]
        for activation in ("relu", "tanh", "selu", "silu", "gelu"):
            for norm in (False, True):
                folder = self.folder / f"{activation}-{norm}"
                folder.mkdir()
                files.append(written(folder, activation, norm))
        for file in files:
            with self.subTest(str(file)):
                policy = gaitfit.load_policy(file)
                module = policy.to_torch()
                observations = np.random.default_rng(1).normal(size=(64, policy.interface.observation_width)).astype(np.float32)
                with torch.inference_mode():
                    actions = module(torch.from_numpy(observations)).numpy()
                scale = np.abs(actions).max()
                np.testing.assert_allclose(policy(observations) / scale, actions / scale, atol=1e-6)
        # It can be trained further.
        module(torch.from_numpy(observations)).sum().backward()
        self.assertTrue(all(one.grad is not None for one in module.parameters()))


if __name__ == "__main__":
    unittest.main()
