"""Wrong arguments: each is an exception that names the argument, before anything is computed or written."""

import unittest
from pathlib import Path

import numpy as np

import gaitfit
from gaitfit import CMA, Interface, Log, Parameter, Policy, Term

from .common import DEMO, Case

FILE = "assets/go2-walk.safetensors"
NAN = float("nan")


def network(observation: np.ndarray) -> np.ndarray:
    return np.zeros((len(observation), 12))


class Arguments(Case):
    def refused(self, call: object, cases: "list[tuple[dict, type, str]]") -> None:
        for arguments, error, words in cases:
            with self.subTest(words, arguments=str(arguments)), self.assertRaisesRegex(error, words):
                call(**arguments)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_of_worlds(self) -> None:
        common = [
            ({"seconds": "1"}, TypeError, "seconds is '1'; it must be a number"),
            ({"seconds": True}, TypeError, "seconds is True"),
            ({"preset": 3}, TypeError, "preset is 3; it must be a text"),
            ({"task": 3}, TypeError, "task is 3"),
            ({"spring": 3}, TypeError, "spring is 3; give a list of texts"),
            ({"spring": [3]}, TypeError, "an element of spring is 3"),
            ({"torque_noise": "a"}, TypeError, "torque_noise is 'a'"),
            ({"torque_noise": np.zeros(2)}, TypeError, "torque_noise is array"),
            ({"torque_noise": NAN}, gaitfit.GaitfitError, "torque_noise"),
            ({"lenient": "no"}, TypeError, "lenient is 'no'; it must be True or False"),
            ({"randomised": 2}, TypeError, "randomised is 2"),
            ({"robot": 3}, TypeError, "robot is 3; it must be a path"),
            ({"theta": b"x"}, TypeError, "theta is b'x'; it must be a path"),
            ({"threads": 1 << 40}, ValueError, "threads is 1099511627776; it must be at most 4096"),
            ({"seed": 1 << 70}, ValueError, "seed is 1180591620717411303424; it must be at most"),
            ({"policy": 3}, TypeError, r"policy is 3; it must be a path: .* or a gaitfit\.Policy"),
            ({"policy": network}, TypeError, r"give gaitfit\.Policy\(function, interface\)"),
            ({"progress": 3}, TypeError, "progress is 3"),
        ]
        walk = {"policy": FILE, "trajectories": 2, "seconds": 0.1}
        self.refused(lambda **more: gaitfit.evaluate(**{**walk, **more}), [
            *common,
            ({"terrain": 3}, TypeError, "terrain is 3"),
            ({"device": 0}, TypeError, "device is 0; it must be a text"),
        ])
        self.refused(lambda **more: gaitfit.collect(**{"out": self.folder / "logs", **walk, **more}), [
            *common,
            ({"out": None}, TypeError, "out is None; it must be a path"),
            ({"privileged": "x"}, TypeError, "privileged is 'x'"),
            ({"commands": 3}, TypeError, "commands is 3"),
            ({"log_shift": 3}, TypeError, "log_shift is 3; give two numbers"),
        ])

    def test_of_stages_with_a_run_folder(self) -> None:
        common = [
            ({"config": 3}, TypeError, "config is 3; it must be a path"),
            ({"settings": 3}, TypeError, 'settings is 3; give a dict, for example {"optimizer'),
            ({"settings": ["a"]}, TypeError, "settings is"),
            ({"settings": {3: 4}}, TypeError, "a key of settings is 3"),
            ({"settings": {"seeds": network}}, TypeError, "a setting cannot be a function"),
            ({"name": 3}, TypeError, "name is 3; it must be a text"),
            ({"runs": 3}, TypeError, "runs is 3; it must be a path"),
            ({"resume": "x"}, TypeError, "resume is 'x'; it must be True, False or \"auto\""),
            ({"device": 0}, TypeError, "device is 0"),
            ({"threads": 1.5}, TypeError, "threads is 1.5; it must be a whole number"),
        ]

        def at(stage: object, **given: object) -> object:
            return lambda **more: stage(**{"runs": self.folder, "progress": False, **given, **more})

        self.refused(at(gaitfit.fit, config=DEMO / "adapt.toml"), [
            *common,
            ({"logs": 3}, TypeError, "logs is 3; give a list of paths"),
            ({"logs": [3]}, TypeError, "an element of logs is 3"),
            ({"costs": 3}, TypeError, "costs is 3; give a list of texts"),
            ({"costs": [3]}, TypeError, "an element of costs is 3"),
            ({"robot": 3}, TypeError, "robot is 3"),
            ({"policy": 3}, TypeError, r"policy is 3; .* or a gaitfit\.Policy"),
            ({"policy": network}, TypeError, r"give gaitfit\.Policy\(function"),
            ({"settings": {"optimizer.seeds": np.arange(3)}}, gaitfit.GaitfitError, r"optimizer\.seeds.\]=\[0, 1, 2\]"),
        ])
        seeds = [
            ({"seeds": 3}, TypeError, "seeds is 3; give a list"),
            ({"seeds": "12"}, TypeError, "seeds is '12'"),
            ({"seeds": [True]}, TypeError, "a seed is True"),
        ]
        self.refused(at(gaitfit.train), [*common, *seeds, ({"robot": 3}, TypeError, "robot is 3")])
        weights = r"is a function, and a function has no weights.*\.safetensors.*gaitfit\.gym\.GaitfitVecEnv"
        self.refused(at(gaitfit.finetune, policy=FILE), [
            *common,
            *seeds,
            ({"theta": 3}, TypeError, "theta is 3"),
            ({"policy": 3}, TypeError, "policy is 3"),
            ({"policy": network}, TypeError, f"the policy network {weights}"),
            ({"policy": Policy(network, FILE, name="mine")}, TypeError, f"the policy mine {weights}"),
        ])
        self.refused(at(gaitfit.loop, config="nowhere.toml"), common)
        self.refused(lambda **more: gaitfit.validate(**{"theta": "x", "logs": "y", **more}), [
            ({"theta": 3}, TypeError, "theta is 3"),
            ({"logs": 3}, TypeError, "logs is 3"),
            ({"threads": -1}, ValueError, "threads is -1"),
            ({"policy": "p.toml"}, TypeError, r"must be a gaitfit\.Policy: a policy's file is in the fit's configuration"),
            ({"settings": 3}, TypeError, "settings is 3"),
        ])

    def test_of_simulators(self) -> None:
        log = Log(np.eye(20)[:, :1], np.eye(20)[:, :1], joints=["a"])

        def fit(**more: object) -> object:
            given = {"simulate": lambda _: [], "logs": log, "parameters": [Parameter("p", 0.0, 1.0)], "progress": False}
            return gaitfit.fit_simulator(**{**given, **more})

        def of(**more: object) -> dict:
            return {"parameters": [Parameter(**{"name": "p", "lower": 0.0, "upper": 1.0, **more})]}

        self.refused(fit, [
            ({"simulate": 3}, TypeError, "simulate is 3; give a function"),
            ({"simulate": lambda _: None}, TypeError, "simulate returned a NoneType; needed: a list"),
            ({"simulate": lambda _: {}}, TypeError, "simulate returned a dict; needed: a list"),
            ({"logs": 3}, TypeError, r"logs is 3; give a list of gaitfit\.Log"),
            ({"logs": ["log.csv"]}, TypeError, r"logs has 'log.csv'; .*read_log"),
            ({"logs": []}, ValueError, "logs is empty"),
            ({"parameters": 3}, TypeError, "parameters is 3"),
            ({"parameters": [3]}, TypeError, r"parameters has 3; give gaitfit\.Parameter"),
            ({"parameters": []}, ValueError, "parameters is empty"),
            (of(name=3), TypeError, "a parameter's name is 3"),
            (of(unit=3), TypeError, "unit of p is 3"),
            (of(lower="a"), TypeError, "lower of p is 'a'"),
            (of(upper=NAN), ValueError, "upper of p is nan; it must be finite"),
            (of(upper=-1), ValueError, "lower must be below upper"),
            (of(start=3), ValueError, "start of p is 3.0; it must be from 0.0 to 1.0"),
            (of(deviation=0), ValueError, "deviation of p is 0.0; it must be above 0"),
            ({"joints": 3}, TypeError, "joints is 3; give a list of joints' names"),
            ({"joints": "abc"}, TypeError, "joints is 'abc'"),
            ({"cost": 3}, TypeError, "cost is 3"),
            ({"seeds": 3}, TypeError, "seeds is 3"),
            ({"seeds": ["a"]}, TypeError, "a seed is 'a'"),
            ({"seeds": []}, ValueError, "seeds is empty"),
            ({"generations": 1.5}, TypeError, "generations is 1.5"),
            ({"generations": 0}, ValueError, "generations is 0; it must be at least 1"),
            ({"population": -1}, ValueError, "population is -1"),
            ({"tolerance": NAN}, ValueError, "tolerance is nan"),
            ({"tolerance": -1}, ValueError, "tolerance is -1.0; it must be at least 0"),
            ({"skip": -1}, ValueError, "skip is -1"),
            ({"checkpoint": 3}, TypeError, "checkpoint is 3"),
            ({"intervals": "x"}, TypeError, "intervals is 'x'"),
        ])

    def test_of_clamped_robots(self) -> None:
        try:
            from gaitfit.mujoco import ClampedRobot
        except ImportError as missing:
            self.skipTest(str(missing))
        log = gaitfit.read_log(DEMO / "fit.csv")[:20]
        given = {"model": "assets/go2.xml", "logs": log, "parameters": [Parameter("delay", 0.0, 0.02)]}
        self.refused(lambda **more: ClampedRobot(**{**given, **more}), [
            ({"model": 3}, TypeError, "model is 3; it must be a path"),
            ({"logs": 3}, TypeError, "logs is 3"),
            ({"logs": []}, ValueError, "logs is empty"),
            ({"parameters": [3]}, TypeError, "parameters has 3"),
            ({"timestep": "a"}, TypeError, "timestep is 'a'"),
            ({"timestep": 0}, ValueError, "timestep is 0.0; it must be above 0"),
            ({"timestep": NAN}, ValueError, "timestep is nan"),
            ({"torque_limit": 3}, TypeError, "torque_limit is 3; give a list of numbers"),
            ({"torque_limit": ["a"] * 12}, TypeError, "a number of torque_limit is 'a'"),
            ({"torque_limit": [-1.0] * 12}, ValueError, "each must be above 0"),
            ({"threads": 0}, ValueError, "threads is 0"),
        ])

    def test_of_searches(self) -> None:
        self.refused(lambda **more: CMA(**{"start": [1.0], "deviation": [1.0], **more}), [
            ({"seed": -1}, ValueError, "seed is -1"),
            ({"seed": "a"}, TypeError, "seed is 'a'"),
            ({"population": -1}, ValueError, "population is -1"),
            ({"population": 2.5}, TypeError, "population is 2.5"),
            ({"state": 3}, TypeError, "state is 3"),
        ])
        with self.assertRaisesRegex(ValueError, r"costs has the shape \(2, 2\)"):
            CMA([1.0], [1.0], population=4).tell(np.zeros((2, 2)))

    def test_of_interfaces(self) -> None:
        given = {
            "joints": ["a", "b"],
            "default_pose": 0.0,
            "action_scale": 0.25,
            "kp": 20.0,
            "kd": [0.5, np.float32(0.5)],
            "control_dt": 0.02,
            "observation": ["command"],
        }
        self.assertEqual(Interface(**given).observation_width, 3)
        self.refused(lambda **more: Interface(**{**given, **more}), [
            ({"joints": 3}, TypeError, "joints is 3; give a list of joints' names"),
            ({"joints": "ab"}, TypeError, "joints is 'ab'"),
            ({"joints": ["a", 3]}, TypeError, "a name in joints is 3"),
            ({"kp": "x"}, TypeError, "kp is 'x'; it must be a number"),
            ({"kp": [1.0, None]}, TypeError, r"kp\[1\] is None"),
            ({"kd": [1.0, NAN]}, ValueError, r"kd\[1\] is nan; it must be finite"),
            ({"kp": np.ones((2, 2))}, TypeError, r"kp\[0\] is array"),
            ({"control_dt": "x"}, TypeError, "control_dt is 'x'"),
            ({"observation": "command"}, TypeError, r"observation is 'command'; give a list of gaitfit\.Term"),
            ({"observation": [3]}, TypeError, "observation has 3"),
            ({"observation": [Term("command", history=-1)]}, ValueError, "history of command is -1"),
            ({"observation": [Term("command", "x")]}, TypeError, "scale of command is 'x'"),
            ({"held": 3}, TypeError, "held is 3"),
            ({"held": [{"joint": "c", "position": 0.0, "kp": 1.0}]}, TypeError, "kd of c in held is None"),
            ({"history": 3}, TypeError, "history is 3"),
            ({"robot": 3}, TypeError, "robot is 3"),
        ])
        for call in (lambda: Policy(network, 3), lambda: Interface.read(3)):
            with self.assertRaisesRegex(TypeError, "the interface's file is 3; it must be a path"):
                call()
        for wrong in ({"name": 3}, {"task": 3}):
            with self.assertRaisesRegex(TypeError, "is 3; give a text"):
                Policy(network, FILE, **wrong)

    def test_of_robots(self) -> None:
        self.refused(lambda **more: gaitfit.Robots(**{"num_envs": 2, **more}), [
            ({"stagger": "x"}, TypeError, "stagger is 'x'"),
            ({"settings": 3}, TypeError, "settings is 3"),
            ({"config": 3}, TypeError, "config is 3"),
            ({"robot": 3}, TypeError, "robot is 3"),
            ({"seed": 1 << 70}, ValueError, "seed is"),
            ({"threads": 1 << 40}, ValueError, "threads is"),
        ])
        few, many = (gaitfit.Robots(num_envs=2, threads=threads) for threads in (1, 4096))
        for robots in (few, many):
            robots.step(np.zeros((2, 12)))
        np.testing.assert_array_equal(few.observation, many.observation)

    def test_of_logs(self) -> None:
        with self.assertRaisesRegex(TypeError, "path is 3; it must be a path"):
            gaitfit.read_log(3)

    def test_of_charts(self) -> None:
        try:
            import matplotlib

            matplotlib.use("Agg")
            from gaitfit import plots
        except ImportError as missing:
            self.skipTest(str(missing))
        for chart in (plots.plot, plots.parameters, plots.convergence, plots.training, plots.drift):
            with self.subTest(chart.__name__), self.assertRaisesRegex(TypeError, "is a int; give what"):
                chart(3)
        row = {"name": "a", "value": 1.0, "unit": "-", "lower": 0.0}
        moved = Path("nowhere", "policy.safetensors")
        for document, words in (
            ({"parameters": [row]}, "a row of parameters has no upper, which the chart of a fit shows; it has name"),
            ({"drift": [{"name": "ahead"}]}, "a row of drift has no path"),
            ({"seeds": [{"seed": 1}]}, "a row of seeds has no policy"),
            ({"seeds": [{"seed": 1, "policy": moved}]}, "the run folder was moved or removed"),
            ({"rounds": [3]}, "no rounds"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                plots.plot(document)
        log = gaitfit.read_log(DEMO / "fit.csv")
        with self.assertRaisesRegex(ValueError, r"position has the shape \(1,\)"):
            Log([1.0], [2.0])
        for arguments, error, words in (
            ((3,), TypeError, r"log is a int; give a gaitfit\.Log"),
            ((log, 3), TypeError, "joints is 3; give a list"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                plots.log(*arguments)


if __name__ == "__main__":
    unittest.main()
