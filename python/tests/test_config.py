"""Typed settings: they are the program's own, and go to TOML and back."""

import inspect
import subprocess
import sys
import tomllib
import unittest
from dataclasses import FrozenInstanceError, replace
from typing import get_args

import numpy as np

import gaitfit
from gaitfit import _gaitfit, config
from gaitfit.config import Finetune, Fit, Loop, Number, Optimizer, Parameter, Simulation, Task, Train
from gaitfit._given import in_file, sets
from gaitfit.config import _fit as choices

from .common import DEMO, ROOT, Case


class Generated(Case):
    def test_the_classes_are_current(self) -> None:
        tool = [sys.executable, str(ROOT / "tools" / "make_python_config.py"), "--check"]
        found = subprocess.run(tool, capture_output=True, text=True, check=False)
        self.assertEqual((found.returncode, found.stderr), (0, ""))

    def test_they_have_every_setting_of_the_program(self) -> None:
        for kind, stage in ((Fit, "fit"), (Loop, "loop"), (Train, "train"), (Finetune, "finetune")):
            resolved = tomllib.loads(_gaitfit.resolve_settings(stage, ['policy="p"'] if stage == "loop" else []))
            # What the program resolves can be read, written, and resolved again.
            known = kind.from_dict(resolved)
            self.assertEqual(tomllib.loads(known.to_toml()), resolved, stage)
            if stage != "loop":
                # A loop decides some settings of its fit and refuses them.
                chosen = {name: value for name, value in known.to_dict().items() if value != {}}
                self.assertEqual(tomllib.loads(_gaitfit.resolve_settings(stage, sets(chosen))), resolved, stage)

    def test_earlier_names_are_taken(self) -> None:
        from gaitfit.config import Size

        earlier = Size(environments=64)  # type: ignore[call-arg]
        self.assertEqual((earlier, earlier.num_envs), (Size(num_envs=64), 64))
        self.assertEqual(Train(train=earlier).to_dict(), {"train": {"environments": 64}})
        self.assertEqual(Train.from_dict({"train": {"environments": 64}}).train, earlier)
        self.assertEqual(in_file("train.num_envs"), "train.environments")
        for name in ("train.num_envs", "train.environments"):
            with self.assertRaisesRegex(gaitfit.GaitfitError, "train.num_envs is 0; it must be from 1"):
                gaitfit.train(settings={name: 0}, progress=False)

    def test_every_choice_is_one_of_the_program(self) -> None:
        for name, values, template in (
            ("costs", get_args(choices.Cost), 'costs=["{}"]'),
            ("allow", get_args(choices.FindingKind), 'allow=["{}"]'),
            ("kinds", get_args(choices.ParameterKind), 'parameter=[{{kind="{}"}}]'),
            ("numbers", get_args(choices.RobotNumber), 'number=[{{kind="{}"}}]'),
            ("per", get_args(choices.Sharing), 'parameter=[{{kind="delay", per="{}"}}]'),
            ("method", get_args(choices.Method), 'optimizer={{method="{}"}}'),
            ("bounds", get_args(choices.BoundHandling), 'optimizer={{bounds="{}"}}'),
            ("covariance", get_args(choices.CovarianceKind), 'optimizer={{covariance="{}"}}'),
            ("random", get_args(choices.RandomNumbers), 'optimizer={{random_numbers="{}"}}'),
            ("preset", get_args(choices.Preset), 'simulation={{preset="{}"}}'),
            ("base", get_args(choices.Base), 'base="{}"'),
            ("network", get_args(choices.NetworkName), 'network=[{{kind="{}"}}]'),
            ("start", get_args(choices.NetworkStart), 'network=[{{kind="resid_act", start="{}"}}]'),
        ):
            self.assertGreater(len(values), 1, name)
            for value in values:
                with self.subTest(name=name, value=value):
                    _gaitfit.resolve_settings("fit", [template.format(value)])


class Used(Case):
    def test_a_fit_of_typed_settings_has_the_bits_of_the_files(self) -> None:
        typed = replace(Fit.read(DEMO / "adapt.toml"), optimizer=Optimizer(generations=5, seeds=1, tolerance=0.005))
        settings = {"optimizer.generations": 5, "optimizer.seeds": 1}
        given = {"runs": self.folder, "progress": False}
        found = [
            gaitfit.fit(typed, name="typed", **given),
            gaitfit.fit(DEMO / "adapt.toml", name="file", settings=settings, **given),
        ]
        self.assertEqual(found[0].parameters, found[1].parameters)
        self.assertEqual(found[0].cost, found[1].cost)
        resumed = gaitfit.fit(typed, name="typed", resume=True, **given)
        self.assertEqual(resumed.parameters, found[0].parameters)

    def test_typed_settings_of_robots(self) -> None:
        quiet = Train(task=Task(noise={"joint_position": 0.0}, rewards={"height": 1.0}))
        self.assertIn("joint_position = 0.0", gaitfit.Robots(quiet, num_envs=2).task)
        with self.assertRaisesRegex(TypeError, r"config is a gaitfit\.config\.Fit; give a gaitfit\.config\.Train"):
            gaitfit.Robots(Fit(), num_envs=2)

    def test_wrong_values_name_the_setting(self) -> None:
        for call, error, words in (
            (lambda: Optimizer(generations="many"), TypeError, "generations of Optimizer is 'many'; it must be a whole number"),
            (lambda: Optimizer(generations=True), TypeError, "generations of Optimizer is True"),
            (lambda: Optimizer(tolerance="x"), TypeError, "tolerance of Optimizer is 'x'; it must be a number"),
            (lambda: Optimizer(covariance="fulll"), ValueError, "covariance of Optimizer is 'fulll'; it must be 'full' or"),
            (lambda: Simulation(preset=3), TypeError, "preset of Simulation is 3"),
            (lambda: Simulation(self_contact="all"), ValueError, "self_contact of Simulation is 'all'; it must be 'off' or"),
            (lambda: Fit(lenient="yes"), TypeError, "lenient of Fit is 'yes'; it must be True or False"),
            (lambda: Fit(costs=["wasss"]), ValueError, "costs of Fit is .*each 'wass' or"),
            (lambda: Fit(costs="was"), ValueError, "costs of Fit is .*each 'wass' or"),
            (lambda: Optimizer(generation=50), TypeError, "Optimizer has no setting 'generation'; did you mean 'generations'?"),
            (lambda: Fit(parameters=[3]), TypeError, r"parameters of Fit is \[3\]; .*each a gaitfit.config.Parameter"),
            (lambda: Fit(gains=config.Gains(kp="x")), TypeError, "kp of Gains is 'x'; it must be a number or a dict"),
            (lambda: Parameter("armatur"), ValueError, "kind of Parameter is 'armatur'"),
            (lambda: Parameter(), TypeError, "kind"),
            (lambda: Optimizer(generatoins=3), TypeError, "generatoins"),
            (lambda: Loop(controls=config.Controls(delay=(0.0, 0.1, 0.2))), TypeError, "delay of Controls .* 2 numbers"),
            (lambda: Fit.from_toml("[optimizer]\npopulaton = 3"), ValueError, "no setting optimizer.populaton; did you mean 'pop"),
            (lambda: Fit.from_toml("parameter = [{ per = 'all' }]"), ValueError, "parameter.0 needs kind"),
            (lambda: Fit.from_toml("optimizer = 3"), TypeError, "optimizer of Fit is 3"),
            (lambda: Fit.from_toml("\na = ="), ValueError, "line 2"),
            (lambda: Fit.read("nowhere.toml"), FileNotFoundError, "nowhere.toml"),
            (lambda: gaitfit.Robots(settings={"noise": {}}), ValueError, "an empty dict for noise"),
            (lambda: gaitfit.fit(Train(), progress=False), TypeError, r"give a gaitfit\.config\.Fit"),
            (lambda: gaitfit.fit(3, progress=False), TypeError, r"config is 3; .*or a gaitfit\.config\.Fit"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                call()
        with self.assertRaises(FrozenInstanceError):
            Fit().robot = "a.xml"  # type: ignore[misc]

    def test_one_cost_and_names_of_classes_are_taken(self) -> None:
        self.assertEqual(Fit(costs="wass"), Fit(costs=["wass"]))
        self.assertEqual(in_file("parameters"), "parameter")
        self.assertEqual(in_file("ppo.lambda_"), "ppo.lambda")
        found = sets({"parameters": [Parameter("delay", per="all")]})
        self.assertEqual(found, ['parameter=[{kind = "delay", per = "all"}]'])

    def test_help_lists_the_choices(self) -> None:
        self.assertIn("``group``, ``joint``, ``all``", Parameter.__doc__ or "")
        self.assertIn("foot_height", config.Task.__doc__ or "")
        self.assertIn("generations", str(inspect.signature(Optimizer)))

    def test_numbers_of_numpy_and_paths_are_taken(self) -> None:
        made = Fit(robot=DEMO / "go2.xml", optimizer=Optimizer(generations=np.int64(3), tolerance=np.float32(0.5)))
        self.assertEqual(Fit.from_toml(made.to_toml()).optimizer, Optimizer(generations=3, tolerance=0.5))
        tables = Fit(groups={"left hip": ["FL_hip"]}, numbers=[Number("base_mass")], prior={"a": config.Prior(value=1, deviation=2)})
        self.assertEqual(Fit.from_toml(tables.to_toml()).to_dict(), tables.to_dict())


if __name__ == "__main__":
    unittest.main()
