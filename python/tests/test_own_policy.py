"""Policies that are functions of Python: the committed walk's network in NumPy, and functions that misbehave."""

import json
import multiprocessing
import pickle
import struct
import subprocess
import threading
import time
import unittest

import numpy as np

import gaitfit
from gaitfit import Interface, Policy, Term

from .common import PROGRAM, ROOT, Case
from .test_hostile import Press, written

FILE = "assets/go2-walk.safetensors"
WALKS = {"trajectories": 10, "seconds": 2.5, "seed": 3, "progress": False}
FIT = {
    "costs": "wass",
    "runs": None,
    "progress": False,
    "settings": {
        "parameter": [{"kind": "frictionloss", "per": "all", "upper": 0.8}],
        "optimizer.generations": 5,
        "optimizer.seeds": 1,
    },
}


def walk() -> "list[tuple[np.ndarray, np.ndarray]]":
    """The layers of the committed walk: weights, outputs × inputs, and biases."""
    data = (ROOT / FILE).read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])

    def tensor(name: str) -> np.ndarray:
        begin, end = header[name]["data_offsets"]
        return np.frombuffer(data[8 + length + begin : 8 + length + end], np.float32).reshape(header[name]["shape"])

    return [(tensor(f"actor.{number}.weight"), tensor(f"actor.{number}.bias")) for number in (0, 2, 4, 6)]


LAYERS = walk()


def network(observation: np.ndarray) -> np.ndarray:
    hidden = observation
    for number, (weight, bias) in enumerate(LAYERS):
        hidden = hidden @ weight.T + bias
        if number < len(LAYERS) - 1:
            hidden = np.where(hidden > 0, hidden, np.expm1(np.minimum(hidden, 0)))
    return hidden


in_fork = None


def called_in_fork(seed: int) -> float:
    return in_fork(seed)


class OwnPolicy(Case):
    def fit(self, policy: object, name: str, **more: object) -> gaitfit.FitResult:
        arguments = {**FIT, "runs": self.folder / "runs", "logs": self.folder / "logs", "policy": policy, "name": name, **more}
        return gaitfit.fit(**arguments)

    def test_the_committed_walk_walks_the_same(self) -> None:
        own = Policy(network, FILE)
        self.assertEqual(own.name, "network")
        for number, policy in enumerate((FILE, own)):
            gaitfit.collect(policy, self.folder / str(number), **WALKS)
        logs = [
            [gaitfit.read_log(path) for path in sorted((self.folder / str(number)).glob("*.csv"))] for number in range(2)
        ]
        self.assertEqual([len(one) for one in logs], [10, 10])
        for first, second in zip(*logs):
            # Rounding grows in a walk, with every step of a foot.
            np.testing.assert_allclose(first.action[:10], second.action[:10], atol=1e-3)
            np.testing.assert_allclose(first.position[:10], second.position[:10], atol=1e-4)
            np.testing.assert_allclose(first.position[:50], second.position[:50], atol=2e-2)
            np.testing.assert_array_equal(first.command, second.command)
        results = [
            gaitfit.evaluate(policy, trajectories=96, seconds=2.0, drift=4, progress=False) for policy in (FILE, own)
        ]
        for name in ("linear_velocity_error", "angular_velocity_error", "reward"):
            first, second = (getattr(one, name).mean for one in results)
            self.assertAlmostEqual(first, second, delta=0.01 * abs(first), msg=name)
        self.assertEqual(results[0].fall_rate.mean, results[1].fall_rate.mean)
        self.assertEqual(results[1].policy, "network")

    def test_a_fit_ends_at_the_same_answer(self) -> None:
        gaitfit.collect(FILE, self.folder / "logs", **WALKS)
        found = [self.fit(policy, name) for policy, name in ((FILE, "file"), (Policy(network, FILE), "own"))]
        values = [one.rows()[0]["value"] for one in found]
        self.assertAlmostEqual(*values, delta=0.01)
        # The final costs are near 0 and depend on rounding, so they are compared with a part of the mean cost at the start.
        tolerance = 0.15 * found[0].history()[0]["mean"]
        self.assertAlmostEqual(found[0].cost, found[1].cost, delta=tolerance)
        checks = [
            gaitfit.validate(one.theta, self.folder / "logs", policy=policy)
            for one, policy in zip(found, (None, Policy(network, FILE)))
        ]
        self.assertAlmostEqual(checks[0].cost, checks[1].cost, delta=tolerance)
        with self.assertRaisesRegex(gaitfit.GaitfitError, "the function network"):
            gaitfit.validate(found[1].theta, self.folder / "logs")

    def test_an_exception_in_a_fit_keeps_the_checkpoint(self) -> None:
        gaitfit.collect(FILE, self.folder / "logs", **WALKS)
        whole = self.fit(Policy(network, FILE), "whole")
        generation = 0

        def count(event: gaitfit.Event) -> None:
            nonlocal generation
            generation = event.done if event.kind == "step" else generation

        def breaks(observation: np.ndarray) -> np.ndarray:
            if generation == 3:
                raise LookupError("the network is gone")
            return network(observation)

        with self.assertRaisesRegex(LookupError, "the network is gone"):
            self.fit(Policy(breaks, FILE, name="network"), "broken", progress=count)
        folder = next((self.folder / "runs").glob("broken*"))
        self.assertEqual(json.loads((folder / "checkpoint.json").read_text())["fit"]["generation"], 3)
        self.assertFalse((folder / "theta.toml").exists())
        resumed = self.fit(Policy(network, FILE), "broken", resume=True)
        self.assertEqual(resumed.to_dict()["parameters"], whole.to_dict()["parameters"])
        fields = {name: value for name, value in vars(Interface.read(FILE)).items() if not name.startswith("_")}
        clipped = Interface(**{**fields, "action_clip": 9.0})
        with self.assertRaisesRegex(gaitfit.GaitfitError, "policy"):
            self.fit(Policy(network, clipped, name="network"), "broken", resume=True)

    def test_what_a_function_does_wrong_is_said(self) -> None:
        calls = []

        def raises(_: np.ndarray) -> np.ndarray:
            calls.append(threading.current_thread() is threading.main_thread())
            raise ZeroDivisionError("mine")

        with self.assertRaisesRegex(ZeroDivisionError, "mine"):
            gaitfit.evaluate(Policy(raises, FILE), trajectories=2000, seconds=1.0, progress=False)
        self.assertEqual(calls, [True], "nothing is asked after a failure")
        nan = lambda x: np.full((len(x), 12), np.nan)  # noqa: E731
        for act, error, words in (
            (lambda x: np.zeros((len(x), 11)), ValueError, r"shape \(\d+, 11\); needed: \(robots, joints\)"),
            (lambda x: np.zeros(12), ValueError, r"shape \(12,\)"),
            (nan, ValueError, "row 0 for FL_hip_joint is nan"),
            (lambda x: np.full((len(x), 12), 1e300), ValueError, "is inf"),
            (lambda x: None, TypeError, "returned None"),
            (lambda x: "stand", TypeError, "texts stand where real numbers"),
            (lambda x: np.zeros((len(x), 12), np.complex64), TypeError, "complex numbers stand where"),
            (lambda x: np.full((len(x), 12), "0.0"), TypeError, "texts stand where"),
            (lambda x: [[1.0], [2.0, 3.0]], TypeError, "no array of numbers"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                gaitfit.collect(Policy(act, FILE), self.folder / "wrong", trajectories=2, seconds=0.5, progress=False)
            self.assertEqual(list(self.folder.glob("wrong/*.csv")), [], "no log is written")
        with self.assertRaisesRegex(TypeError, "has no weights"):
            gaitfit.finetune(Policy(network, FILE), progress=False)
        with self.assertRaisesRegex(TypeError, "give a function"):
            Policy(3, FILE)
        for wrong in ({"name": 3}, {"task": 3}):
            with self.assertRaisesRegex(TypeError, "is 3; give a text"):
                Policy(network, FILE, **wrong)
        with self.assertRaisesRegex(FileNotFoundError, "nowhere.toml"):
            Policy(network, "nowhere.toml")

    def test_forked_processes_have_their_own(self) -> None:
        def walks(seed: int) -> float:
            found = gaitfit.evaluate(Policy(network, FILE), trajectories=4, seconds=0.5, drift=0, seed=seed, progress=False)
            return found.linear_velocity_error.mean

        global in_fork
        in_fork = walks
        expected = [walks(seed) for seed in (1, 2, 1)]
        with multiprocessing.get_context("fork").Pool(2) as pool:
            self.assertEqual(pool.map_async(called_in_fork, (1, 2, 1)).get(120), expected)

    def test_a_function_that_writes_in_its_observation_harms_nobody(self) -> None:
        def writes(observation: np.ndarray) -> np.ndarray:
            actions = network(observation)
            observation[:] = np.nan
            return actions

        for number, act in enumerate((network, writes)):
            gaitfit.collect(Policy(act, FILE), self.folder / str(number), **WALKS)
        for path in sorted((self.folder / "0").glob("*.csv")):
            self.assertEqual(path.read_bytes(), (self.folder / "1" / path.name).read_bytes())

    def test_ctrl_c_reaches_the_function(self) -> None:
        def sleeps(_: np.ndarray) -> None:
            (self.folder / "called").write_text("now")
            time.sleep(60)

        press = Press(written(self.folder, "called"))
        with self.assertRaises(KeyboardInterrupt):
            gaitfit.evaluate(Policy(sleeps, FILE), progress=False)
        # Within a second on a quiet machine.
        self.assertLess(time.monotonic() - press.clock, 30.0)

    def test_calls_in_threads_and_within_each_other(self) -> None:
        def errors(policy: Policy) -> float:
            return gaitfit.evaluate(policy, trajectories=8, seconds=0.5, drift=0, progress=False).linear_velocity_error.mean

        expected, found = errors(Policy(network, FILE)), []
        threads = [threading.Thread(target=lambda: found.append(errors(Policy(network, FILE)))) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(found, [expected] * 3)
        inner = []

        def nested(observation: np.ndarray) -> np.ndarray:
            if not inner:
                inner.append(None)
                inner[0] = errors(Policy(network, FILE))
            return network(observation)

        self.assertEqual((errors(Policy(nested, FILE)), inner), (expected, [expected]))

    def test_interfaces_are_read_and_written(self) -> None:
        read = Interface.read(FILE)
        self.assertEqual((read.observation_width, len(read.joints), read.control_dt), (45, 12, 0.02))
        self.assertEqual(read.observation[0], Term("base_angular_velocity", [0.25]))
        by_hand = Interface(
            joints=read.joints,
            default_pose=np.array(read.default_pose),
            action_scale=0.25,
            kp=25,
            kd=0.5,
            control_dt=0.02,
            robot="go2",
            observation=[
                Term("base_angular_velocity", 0.25),
                "projected_gravity",
                "command",
                "joint_position",
                Term("joint_velocity", (0.05,)),
                "last_action",
            ],
        )
        toml = self.folder / "interface.toml"
        toml.write_text(by_hand.to_toml())
        task = Policy(network, FILE).task
        figures = [
            gaitfit.evaluate(Policy(network, one, task=task), trajectories=4, seconds=0.5, drift=0, progress=False).reward.mean
            for one in (FILE, by_hand, toml)
        ]
        self.assertEqual(figures, [figures[0]] * 3)
        self.assertEqual(pickle.loads(pickle.dumps(Policy(network, by_hand))).interface.to_json(), by_hand.to_json())
        fields = {name: value for name, value in vars(by_hand).items() if not name.startswith("_")}
        for wrong, words in (
            ({"kp": [1.0, 2.0]}, "kp has 2 numbers for 12 joints"),
            ({"control_dt": 0.0}, "control_dt is 0"),
            ({"observation": []}, "no terms"),
            ({"observation": ["smell"]}, "smell"),
            ({"observation": [Term("command", [1.0, 2.0])]}, "command"),
            ({"default_pose": float("nan")}, "default_pose is nan"),
            ({"joints": []}, "joint"),
            ({"history": {"order": "sideways"}}, "sideways"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                Interface(**{**fields, **wrong})

    def test_a_torch_module(self) -> None:
        try:
            import torch
        except ImportError as missing:
            self.skipTest(str(missing))
        layers: list = []
        for weight, bias in LAYERS:
            layer = torch.nn.Linear(weight.shape[1], weight.shape[0])
            layer.weight.data, layer.bias.data = torch.from_numpy(weight.copy()), torch.from_numpy(bias.copy())
            layers += [layer, torch.nn.ELU()]
        module = torch.nn.Sequential(*layers[:-1])
        arguments = {"trajectories": 16, "seconds": 1.0, "drift": 0, "progress": False}
        ours, theirs = (
            gaitfit.evaluate(one, **arguments).linear_velocity_error.mean for one in (FILE, Policy(module, FILE))
        )
        self.assertAlmostEqual(ours, theirs, delta=1e-3)
        # Tensors that want gradients are taken too.
        closure = Policy(lambda x: module(torch.from_numpy(x)), FILE)
        self.assertEqual(gaitfit.evaluate(closure, **arguments).linear_velocity_error.mean, theirs)

    def test_an_onnx_session(self) -> None:
        try:
            import onnxruntime
        except ImportError as missing:
            self.skipTest(str(missing))
        file = self.folder / "walk.onnx"
        subprocess.run([PROGRAM, "export", FILE, "--onnx", file], check=True, capture_output=True)
        session = onnxruntime.InferenceSession(file)
        name = session.get_inputs()[0].name
        policy = Policy(lambda x: session.run(None, {name: x})[0], file, name="onnx")
        arguments = {"trajectories": 16, "seconds": 1.0, "drift": 0, "progress": False}
        ours, theirs = (gaitfit.evaluate(one, **arguments).linear_velocity_error.mean for one in (file, policy))
        self.assertAlmostEqual(ours, theirs, delta=1e-3)


if __name__ == "__main__":
    unittest.main()
