"""Fits of simulators that are written in Python."""

import dataclasses
import unittest
from itertools import count

import numpy as np

import gaitfit
from gaitfit import Log, Parameter

from .common import DEMO, ROOT, Case

SAMPLES = 300
PARAMETERS = [Parameter("damping", 0.0, 1.0, unit="1/s"), Parameter("friction", 0.0, 0.5, unit="rad/s²")]


def pendulum(candidates: np.ndarray) -> list[dict[str, np.ndarray]]:
    """A swinging pendulum with damping and dry friction, all candidates at once."""
    damping, friction = candidates.T
    angle, speed = np.full(len(candidates), 1.5), np.zeros(len(candidates))
    angles, speeds = [], []
    for _ in range(SAMPLES):
        angles.append(angle.copy())
        speeds.append(speed.copy())
        speed += 0.01 * (-9.81 * np.sin(angle) - damping * speed - friction * np.tanh(100.0 * speed))
        angle += 0.01 * speed
    shape = (len(candidates), SAMPLES, 1)
    return [{"position": np.array(angles).T.reshape(shape), "velocity": np.array(speeds).T.reshape(shape)}]


def recorded() -> Log:
    found = pendulum(np.array([[0.3, 0.12]]))[0]
    return Log(found["position"][0], found["velocity"][0], joints=["swing"])


def fit(simulate=pendulum, logs=None, parameters=PARAMETERS, **more):
    arguments = {"generations": 60, "progress": False, **more}
    return gaitfit.fit_simulator(simulate, recorded() if logs is None else logs, parameters, **arguments)


class OwnSimulator(Case):
    def test_every_cost_finds_the_truth(self) -> None:
        for cost in ("wass", "matcho"):
            with self.subTest(cost):
                found = fit(cost=cost, seeds=[1, 2], intervals=True)
                self.assertAlmostEqual(found.values["damping"], 0.3, delta=1e-3)
                self.assertAlmostEqual(found.values["friction"], 0.12, delta=1e-3)
                self.assertEqual([run["seed"] for run in found.document["runs"]], [1, 2])
                self.assertLess(found.spread["damping"], 1e-2)
                lower, upper = found.intervals["damping"]
                self.assertTrue(lower <= found.values["damping"] <= upper and upper - lower < 0.1, found.intervals)
                self.assertEqual(found.at_bound, [])
                self.assertEqual([row["name"] for row in found.rows()], ["damping", "friction"])

    def test_a_fit_that_is_stopped_goes_on_to_the_same_bits(self) -> None:
        whole = fit(generations=20, seeds=[3, 4])
        calls = count()

        def fails(candidates: np.ndarray) -> list[dict[str, np.ndarray]]:
            if next(calls) == 11:
                raise ZeroDivisionError("the simulator broke")
            return pendulum(candidates)

        checkpoint = self.folder / "fit.json"
        with self.assertRaisesRegex(ZeroDivisionError, "the simulator broke"):
            fit(fails, generations=20, seeds=[3, 4], checkpoint=checkpoint)
        resumed = fit(generations=20, seeds=[3, 4], checkpoint=checkpoint)
        self.assertEqual(resumed.document, whole.document)
        # The same arguments, and the simulator is not asked again.
        self.assertEqual(fit(fails, generations=20, seeds=[3, 4], checkpoint=checkpoint).document, whole.document)
        own = recorded()
        other = dataclasses.replace(own, position=np.asarray(own.position) + 1e-12)
        for arguments, words in (
            ({"logs": other}, "its logs are others"),
            ({"logs": dataclasses.replace(own, joints=["sway"])}, "its joints are swing, and this fit's are sway"),
            ({"parameters": [dataclasses.replace(PARAMETERS[0], upper=3.5), *PARAMETERS[1:]]}, "the upper bound of"),
            ({"parameters": [dataclasses.replace(PARAMETERS[0], start=0.7), *PARAMETERS[1:]]}, "the start of"),
            ({"cost": "matcho"}, "it minimises wass, and this fit minimises matcho"),
            ({"skip": 1}, "the first 0 samples"),
            ({"seeds": [3, 5]}, "`seeds` was"),
            ({"tolerance": 0.5}, "`tolerance` was"),
            ({"generations": 19}, "the limit is 19 now"),
        ):
            with self.subTest(words), self.assertRaisesRegex(gaitfit.GaitfitError, words):
                fit(**{"generations": 20, "seeds": [3, 4], "checkpoint": checkpoint, **arguments})
        longer = fit(generations=30, seeds=[3, 4], checkpoint=checkpoint)
        self.assertEqual(longer.document, fit(generations=30, seeds=[3, 4]).document)
        checkpoint.write_text("{}")
        with self.assertRaisesRegex(gaitfit.GaitfitError, "fit.json"):
            fit(checkpoint=checkpoint)

    def test_candidates_that_diverge_are_ranked_last(self) -> None:
        def half(candidates: np.ndarray) -> list[dict[str, np.ndarray]]:
            found = pendulum(candidates)
            found[0]["position"][candidates[:, 0] > 0.5] = np.nan
            return found

        found = fit(half)
        self.assertAlmostEqual(found.values["damping"], 0.3, delta=1e-3)
        self.assertGreater(sum(run["diverged"] for run in found.document["runs"]), 0)

        def none(candidates: np.ndarray) -> list[dict[str, np.ndarray]]:
            return [{name: values * np.nan for name, values in pendulum(candidates)[0].items()}]

        with self.assertRaisesRegex(gaitfit.GaitfitError, "diverge"):
            fit(none)

    def test_wrong_signals_are_refused(self) -> None:
        def of(change):
            return lambda candidates: change(pendulum(candidates))

        for simulate, error, words in (
            (of(lambda found: found * 2), ValueError, "returned 2 recordings; there are 1 logs"),
            (of(lambda found: []), ValueError, "returned 0 recordings"),
            (of(lambda found: None), TypeError, "returned a NoneType"),
            (of(lambda found: found[0]["position"]), TypeError, "needed: a dict of arrays"),
            (of(lambda found: [{"position": found[0]["position"]}]), ValueError, "no 'velocity'"),
            (of(lambda found: [{**found[0], "position": found[0]["position"][:, 1:]}]), ValueError, r"\[6, 299, 1\]"),
            (of(lambda found: [{**found[0], "velocity": found[0]["velocity"][0]}]), ValueError, "shape"),
            (of(lambda found: [{**found[0], "position": "far"}]), TypeError, "texts stand"),
            (lambda: None, TypeError, "argument"),
            (None, TypeError, "simulate is None"),
        ):
            with self.subTest(words), self.assertRaisesRegex(error, words):
                fit(simulate)

    def test_wrong_logs_and_settings_are_refused(self) -> None:
        log = recorded()
        for position, velocity in ((log.position, log.velocity[1:]), (log.position[:, 0], log.velocity)):
            with self.assertRaisesRegex(ValueError, "samples × joints"):
                Log(position, velocity, joints=["swing"])
        broken = log.position.copy()
        broken[7] = np.nan
        for arguments, error, words in (
            ({"logs": []}, (ValueError, gaitfit.GaitfitError), "."),
            ({"logs": Log(broken, log.velocity, joints=["swing"])}, ValueError, "."),
            ({"logs": Log(log.position, log.velocity)}, ValueError, "do not name their joints"),
            ({"logs": log[0:0]}, ValueError, "."),
            ({"parameters": []}, (ValueError, gaitfit.GaitfitError), "."),
            ({"parameters": [Parameter("a", 1.0, 0.0)]}, (ValueError, gaitfit.GaitfitError), "a"),
            ({"parameters": [Parameter("a", 0.0, float("nan"))]}, (ValueError, gaitfit.GaitfitError), "a"),
            ({"parameters": [Parameter("a", 0.0, 1.0, deviation=0.0)]}, (ValueError, gaitfit.GaitfitError), "."),
            ({"cost": "matchr1"}, (ValueError, gaitfit.GaitfitError), "."),
            ({"cost": "least"}, ValueError, "there is no cost `least`"),
            ({"seeds": []}, (ValueError, gaitfit.GaitfitError), "."),
            ({"generations": 0}, ValueError, "generations"),
            ({"skip": 300}, ValueError, "."),
            ({"population": 1}, (ValueError, gaitfit.GaitfitError), "."),
        ):
            with self.subTest(str(arguments)), self.assertRaisesRegex(error, words):
                fit(**arguments)


class Mujoco(Case):
    def test_official_mujoco_fits_the_clamped_demo(self) -> None:
        """The demo's logs are of MuJoCo at 4 kHz with noise; its fit is within 2 % of the truth."""
        try:
            from gaitfit.mujoco import ClampedRobot
        except ImportError as missing:
            self.skipTest(str(missing))
        truth = {"delay": 0.007}
        for field, values in (
            ("frictionloss", (0.21, 0.17, 0.62)),
            ("armature", (0.015, 0.019, 0.047)),
            ("damping", (0.19, 0.22, 0.31)),
        ):
            truth |= {f"{field}:*_{kind}": value for kind, value in zip(("hip", "thigh", "calf"), values)}
        upper = {"frictionloss": 1.5, "armature": 0.2, "damping": 1.0, "delay": 0.02}
        parameters = [Parameter(name, 0.0, upper[name.partition(":")[0]]) for name in truth]
        log = gaitfit.read_log(DEMO / "fit.csv")[:300]
        robot = ClampedRobot(ROOT / "assets" / "go2.xml", log, parameters)
        self.assertEqual(robot.joints, log.joints)
        found = gaitfit.fit_simulator(robot, log, parameters, cost="matcho", tolerance=2e-3, progress=False)
        off = {name: found.values[name] / value - 1.0 for name, value in truth.items()}
        print({name: f"{100 * share:+.2f} %" for name, share in off.items()}, found.document["runs"][0]["generations"])
        self.assertLess(max(map(abs, off.values())), 0.02, off)

    def test_wrong_parameters_are_refused(self) -> None:
        try:
            from gaitfit.mujoco import ClampedRobot
        except ImportError as missing:
            self.skipTest(str(missing))
        log = gaitfit.read_log(DEMO / "fit.csv")[:20]
        for name, words in (("mass", "none of delay"), ("armature:*_knee", "takes no joint")):
            with self.subTest(name), self.assertRaisesRegex(ValueError, words):
                ClampedRobot(ROOT / "assets" / "go2.xml", log, [Parameter(name, 0.0, 1.0)])
        with self.assertRaisesRegex(ValueError, "no multiple of the timestep"):
            ClampedRobot(ROOT / "assets" / "go2.xml", log, [], timestep=0.003)
        with self.assertRaisesRegex(ValueError, "needs target"):
            ClampedRobot(ROOT / "assets" / "go2.xml", Log(log.position, log.velocity), [])

    def test_mujoco_warp_simulates_the_same(self) -> None:
        try:
            from gaitfit.mujoco import ClampedRobot as Official
            from gaitfit.mujoco_warp import ClampedRobot
        except ImportError as missing:
            self.skipTest(str(missing))
        log = gaitfit.read_log(DEMO / "fit.csv")[:40]
        kinds = {"frictionloss": 1.5, "armature": 0.2, "damping": 1.0, "delay": 0.02}
        parameters = [Parameter(name, 0.0, upper) for name, upper in kinds.items()]
        candidates = np.array([[0.0, 0.1, 0.0, 0.007], [0.3, 0.02, 0.2, 0.0], [1.0, 0.005, 0.4, 0.015]])
        model = ROOT / "assets" / "go2.xml"
        found, wanted = (
            one(model, log, parameters, timestep=0.00125)(candidates)[0] for one in (ClampedRobot, Official)
        )
        self.assertGreater(np.ptp(wanted["position"], axis=0).max(), 0.05, "the candidates differ")
        for name, most in (("position", 1e-4), ("velocity", 1e-3)):
            off = np.abs(found[name] - wanted[name]).max()
            print(f"{name} off by {off:.1e}")
            self.assertLess(off, most, name)


if __name__ == "__main__":
    unittest.main()
