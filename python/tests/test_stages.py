"""The stages: the same numbers as the program's, progress, results, and wrong arguments."""

import json
import pickle
import subprocess
import unittest

import numpy as np

import gaitfit

from .common import DEMO, PROGRAM, ROOT, Case

SETTINGS = {"optimizer.generations": 8, "optimizer.seeds": 2}
POLICY = "assets/go2-walk.safetensors"


class Stages(Case):
    def fit(self, **more: object) -> gaitfit.FitResult:
        arguments = {"runs": self.folder, "settings": SETTINGS, "progress": False, "name": "fit", **more}
        return gaitfit.fit(DEMO / "adapt.toml", **arguments)

    def test_a_fit_has_the_programs_bits(self) -> None:
        found = self.fit()
        sets = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}")]
        output = subprocess.run(
            [PROGRAM, "adapt", DEMO / "adapt.toml", "--name", "program", "--json", "--device", "cpu"]
            + [*sets, "--set", f"runs={json.dumps(str(self.folder))}"],
            capture_output=True,
            text=True,
            cwd=ROOT,
            check=False,
        )
        # A search that was cut short is exit code 3.
        self.assertEqual(output.returncode, 3, output.stderr)
        program = json.loads(output.stdout)
        self.assertEqual(len(found.parameters), 10)
        for ours, theirs in zip(found.to_dict()["parameters"], program["parameters"], strict=True):
            self.assertEqual(ours, theirs)
        self.assertEqual(found.cost, program["cost"])
        ours, theirs = (next(self.folder.glob(f"{name}*/theta.toml")).read_text() for name in ("fit", "program"))
        self.assertEqual(ours.replace('"fit"', '"program"'), theirs)

    def test_progress_comes_as_it_happens_and_may_stop_the_fit(self) -> None:
        events = []
        whole = self.fit(progress=events.append, name="whole")
        begun = next(event for event in events if event.kind == "begin")
        self.assertEqual((begun.what, begun.done, begun.total), ("generation", 0, 8))
        generations = events[events.index(begun) + 1 : next(at for at, event in enumerate(events) if event.kind == "end")]
        steps = [event for event in generations if event.kind == "step"]
        self.assertEqual([(event.done, event.total) for event in steps], [(done, 8) for done in range(1, 9)])
        lines = [json.loads(line) for line in (whole.run_folder / "metrics.jsonl").read_text().splitlines()]
        for event in steps:
            line = next(line for line in lines if (line["generation"], line["seed"]) == (event.done, 2))
            for name in ("best_so_far", "mean", "sigma"):
                self.assertEqual(event.metrics[f"{line['cost']}/seed-2/{name}"], line[name])

        def stop(event: gaitfit.Event) -> None:
            if event.kind == "step" and event.done == 3:
                raise RuntimeError("enough")

        with self.assertRaisesRegex(RuntimeError, "enough"):
            self.fit(progress=stop, name="stopped")
        resumed = self.fit(name="stopped", resume=True)
        self.assertEqual(resumed.parameters, whole.parameters)
        with self.assertRaisesRegex(gaitfit.Stopped, "progress function returned False.*resume=True continues"):
            self.fit(progress=[events.append, lambda event: event.done < 5], name="declined", resume="auto")
        resumed = self.fit(name="declined", resume="auto")
        self.assertEqual(resumed.parameters, whole.parameters)
        self.assertEqual(resumed.run_folder, self.folder / "declined")

    def test_wrong_arguments_have_the_programs_messages(self) -> None:
        for arguments, error, words in (
            ({"settings": {"optimizer.generation": 3}}, gaitfit.GaitfitError, r'^settings\["optimizer.generation"\]=3: unknown'),
            ({"settings": {"optimizer.generations": "three"}}, gaitfit.GaitfitError, "generations"),
            ({"settings": {"optimizer.generations": object()}}, TypeError, "a setting cannot be"),
            ({"logs": ["nowhere.csv"]}, FileNotFoundError, "nowhere.csv"),
            ({"robot": "nowhere.xml"}, FileNotFoundError, "nowhere.xml"),
            ({"costs": "was"}, ValueError, "costs has 'was'; did you mean 'wass'"),
            ({"device": "gpu"}, ValueError, 'device is "gpu"; it must be cpu'),
            ({"threads": 0}, ValueError, "at least 1"),
            ({"name": "a/b"}, gaitfit.GaitfitError, "a/b"),
            ({"progress": 3}, TypeError, "progress"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                self.fit(**arguments)
        for call in (
            lambda: gaitfit.fit("nothing.toml", progress=False),
            lambda: gaitfit.validate("nothing.toml", DEMO / "validate.csv"),
            lambda: gaitfit.evaluate("nothing.toml", progress=False),
            lambda: gaitfit.evaluate(POLICY, theta="nothing.toml", progress=False),
            lambda: gaitfit.load_policy("nothing.toml"),
            lambda: gaitfit.Interface.read("nothing.toml"),
            lambda: gaitfit.read_log("nothing.toml"),
        ):
            with self.assertRaisesRegex(FileNotFoundError, "nothing.toml"):
                call()
        with self.assertRaisesRegex(gaitfit.GaitfitError, "resume=True") as raised:
            self.fit(resume=True, name="absent")
        self.assertNotIn("--", str(raised.exception))

    def test_wrong_numbers_are_said_before_anything_begins(self) -> None:
        policy, out = "assets/go2-walk.safetensors", self.folder / "logs"
        for call, error, words in (
            (lambda: gaitfit.evaluate(policy, drift=-1), ValueError, "drift is -1; it must be at least 0"),
            (lambda: gaitfit.evaluate(policy, trajectories=0), ValueError, "trajectories is 0"),
            (lambda: gaitfit.evaluate(policy, seed=1.5), TypeError, "seed is 1.5"),
            (lambda: gaitfit.collect(policy, out, log_shift=3), TypeError, "log_shift is 3; give two numbers"),
            (lambda: gaitfit.collect(policy, out, log_shift=(1, 2, 3)), TypeError, "give two numbers"),
            (lambda: gaitfit.train(seeds=[-1]), ValueError, "a seed is -1"),
            (lambda: gaitfit.train(seeds=3), TypeError, "seeds is 3; give a list"),
            (lambda: gaitfit.train(threads=-1), ValueError, "threads is -1"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                call()
        self.assertFalse(out.exists())

    def test_a_policy_is_evaluated_and_its_logs_collected(self) -> None:
        found = gaitfit.evaluate(POLICY, trajectories=8, seconds=1.0, drift=0, progress=False)
        self.assertIsNotNone(found.verdict)
        logs = gaitfit.collect(POLICY, self.folder / "logs", trajectories=2, seconds=1.0, progress=False)
        self.assertEqual((logs.trajectories, len(logs.files)), (2, 2))
        log = gaitfit.read_log(logs.files[0])
        self.assertEqual((log.position.shape, log.action.shape, log.command.shape[1]), ((50, 12), (50, 12), 3))
        self.assertEqual(list(log.columns())[:2], ["time", "q_FL_hip_joint"])
        with self.assertRaisesRegex(gaitfit.GaitfitError, "holds CSV files already"):
            gaitfit.collect(POLICY, self.folder / "logs", trajectories=2, seconds=1.0, progress=False)
        with self.assertRaisesRegex(ValueError, "at least 1"):
            gaitfit.evaluate(POLICY, trajectories=0)
        for wrong in ({"trajectories": -1}, {"seconds": float("nan")}, {"preset": "slow"}, {"spring": "x"}, {"terrain": "moon"}):
            with self.subTest(str(wrong)), self.assertRaises((ValueError, OverflowError, gaitfit.GaitfitError)):
                gaitfit.evaluate(POLICY, progress=False, **wrong)

    def test_a_log_is_arrays(self) -> None:
        log = gaitfit.read_log(DEMO / "fit.csv")
        self.assertEqual((log.position.shape, log.target.shape, log.dt), ((1800, 12), (1800, 12), 0.005))
        np.testing.assert_array_equal(log.kp, np.tile([20.0, 20.0, 40.0], 4))
        self.assertIsNone(log.action)
        cut = log[200:800]
        self.assertEqual((cut.position.shape, cut.time[0]), ((600, 12), 1.0))
        with self.assertRaises(TypeError):
            log[3]


if __name__ == "__main__":
    unittest.main()
