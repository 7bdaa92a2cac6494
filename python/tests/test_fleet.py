"""A fleet: the distribution of numbers over robots, against values worked by hand, simulated truths and REML."""

import json
import math
import tempfile
import unittest
from dataclasses import replace

import numpy as np

import gaitfit
from gaitfit._given import sets
from gaitfit._hierarchy import Hierarchy, normal
from gaitfit.config import Fit
from gaitfit.results import FittedParameter, Prior
from gaitfit.results._read import fit_result

from .common import DEMO, Case

Z95 = 1.959963984540054
SHORT = {"optimizer.seeds": 1, "optimizer.generations": 4, "simulation.timestep": 0.005}


def parameter(name: str, value: float, error: float, **more: object) -> FittedParameter:
    """An estimate with its standard error."""
    bounds = {"lower": 0.0, "upper": 10.0, **more}
    interval = (value - Z95 * error, value + Z95 * error)
    return FittedParameter(name, value, "N·m", start=1.0, at_bound=False, **{"interval": interval, **bounds})


class Arithmetic(unittest.TestCase):
    def test_the_normal_distribution(self) -> None:
        for x in (-40.0, -3.0, -1.0, -1e-3, 0.0, 0.5, 1.96, 8.0):
            self.assertAlmostEqual(float(normal(np.array(x))), 0.5 * math.erfc(-x / math.sqrt(2.0)), delta=1e-7)

    def test_the_scatter_is_that_of_the_restricted_likelihood(self) -> None:
        """With equal errors the restricted likelihood's maximum is known: the sample variance less the squared error."""
        rng = np.random.default_rng(3)
        values, error = rng.normal(2.0, 0.5, 200), 0.3
        hierarchy = Hierarchy.of(values, np.full(200, error))
        self.assertAlmostEqual(hierarchy.scatter(0.5), math.sqrt(np.var(values, ddof=1) - error**2), delta=0.01)
        self.assertAlmostEqual(float(hierarchy.center().mean), np.mean(values), delta=1e-9)

    def test_an_estimate_is_the_product_of_two_normal_densities(self) -> None:
        """With many robots mean and scatter are known, and the product is the textbook's."""
        rng = np.random.default_rng(4)
        hierarchy = Hierarchy.of(rng.normal(1.0, 0.2, 4000), np.full(4000, 1e-4))
        mixture, share = hierarchy.with_estimate(1.3, 0.1)
        own = 0.2**2 / (0.2**2 + 0.1**2)
        self.assertAlmostEqual(share, own, delta=0.01)
        self.assertAlmostEqual(float(mixture.mean), own * 1.3 + (1 - own) * 1.0, delta=0.01)
        half = 0.5 * float(mixture.quantile(0.975) - mixture.quantile(0.025))
        self.assertAlmostEqual(half, Z95 * 0.1 * math.sqrt(own), delta=0.003)

    def test_intervals_hold_for_few_and_many_robots(self) -> None:
        for robots, tries in ((4, 60), (20, 30), (100, 10)):
            rng = np.random.default_rng(robots)
            inside, alone, shrunk = [], 0.0, 0.0
            for _ in range(tries):
                errors = rng.uniform(0.1, 0.4, robots)
                truth = rng.normal(0.0, 0.2, robots)
                values = rng.normal(truth, errors)
                mixture, _ = Hierarchy.of(values, errors).members(values, errors)
                inside.append(np.mean((mixture.quantile(0.025) < truth) & (truth < mixture.quantile(0.975))))
                alone += np.mean((values - truth) ** 2) / tries
                shrunk += np.mean((mixture.mean - truth) ** 2) / tries
            with self.subTest(robots=robots):
                self.assertGreater(np.mean(inside), 0.91)
                self.assertLess(np.mean(inside), 0.99)
                # Errors of the same size as the scatter: half of the variance goes.
                self.assertLess(shrunk, 0.7 * alone)

    def test_robots_that_agree_have_hardly_any_scatter(self) -> None:
        hierarchy = Hierarchy.of(np.ones(30), np.full(30, 0.1))
        self.assertLess(hierarchy.scatter(0.5), 0.03)
        mixture, share = hierarchy.with_estimate(1.1, 0.1)
        self.assertLess(share, 0.1)
        self.assertGreater(float(mixture.quantile(0.975) - mixture.quantile(0.025)), 0.03)


class Fleets(Case):
    """Fleets of results: one short fit, with other numbers in it."""

    @classmethod
    def setUpClass(cls) -> None:
        super().setUpClass()
        rng = np.random.default_rng(5)
        cls.truth = np.exp(rng.normal(math.log(0.5), 0.2, 30))
        cls.errors = rng.uniform(0.05, 0.15, 30)
        cls.alone = np.abs(rng.normal(cls.truth, cls.errors))
        cls.bias = rng.normal(0.0, 0.02, 30)

    def results(self, count: int = 30) -> dict[str, gaitfit.FitResult]:
        if not hasattr(self, "template"):
            runs = self.enterClassContext(tempfile.TemporaryDirectory())
            type(self).template = gaitfit.fit(DEMO / "adapt.toml", settings=SHORT, runs=runs, progress=False)
        found = {}
        for at in range(count):
            numbers = [
                parameter("frictionloss", self.alone[at], self.errors[at]),
                parameter("bias", self.bias[at], 0.01, lower=-0.1, upper=0.1),
                parameter(f"mass_{at % 2}", 1.0, 0.1),
            ]
            named = type(self.template.parameters)({one.name: one for one in numbers})
            found[f"robot-{at}"] = replace(self.template, parameters=named)
        return found

    def test_a_fleet_comes_closer_to_the_truth(self) -> None:
        fleet = gaitfit.fleet(self.results())
        friction, bias = fleet.numbers["frictionloss"], fleet.numbers["bias"]
        self.assertEqual((friction.scale, bias.scale), ("relative", "absolute"))
        self.assertAlmostEqual(friction.scatter, 0.2, delta=0.06)
        self.assertLess(friction.scatter_interval[0], 0.2)
        self.assertGreater(friction.scatter_interval[1], 0.2)
        self.assertAlmostEqual(friction.center / 0.5, 1.0, delta=0.1)
        self.assertAlmostEqual(bias.scatter, 0.02, delta=0.01)
        self.assertEqual(list(fleet.left_out), ["mass_0", "mass_1"])
        values = np.array([one["frictionloss"].value for one in fleet.robots.values()])
        self.assertLess(np.sqrt(np.mean((values - self.truth) ** 2)), 0.9 * np.sqrt(np.mean((self.alone - self.truth) ** 2)))
        self.assertEqual(len(fleet.rows()), 60)
        try:
            import matplotlib

            matplotlib.use("Agg")
        except ImportError:
            return
        axes = fleet.plot().axes[0]
        self.assertEqual([label.get_text() for label in axes.get_yticklabels()], ["frictionloss"])
        self.assertEqual(len(axes.lines[1].get_xdata()), 30)
        self.assertRegex(fleet.headline, "^2 numbers of 30 robots")

    def test_several_fits_of_a_robot_calibrate_the_intervals(self) -> None:
        """Intervals that are five times as wide as the estimates scatter hide the robots' scatter, unless fits are repeated."""
        template = next(iter(self.results(1).values()))
        rng, kind = np.random.default_rng(6), type(template.parameters)

        def fit(truth: float) -> gaitfit.FitResult:
            value = truth * math.exp(rng.normal(0.0, 0.05))
            return replace(template, parameters=kind({"frictionloss": parameter("frictionloss", value, 0.25 * value)}))

        twice = [[fit(truth), fit(truth)] for truth in self.truth]
        fleet, blind = gaitfit.fleet(twice), gaitfit.fleet([one for one, _ in twice])
        number = fleet.numbers["frictionloss"]
        self.assertAlmostEqual(number.calibration, 0.2, delta=0.06)
        self.assertEqual(blind.numbers["frictionloss"].calibration, 1.0)
        self.assertLess(blind.numbers["frictionloss"].scatter, 0.1)
        self.assertAlmostEqual(number.scatter, 0.2, delta=0.05)
        one = fleet.robots["go2-demo"]["frictionloss"]
        first = [two.parameters["frictionloss"].value for two in twice[0]]
        self.assertAlmostEqual(one.alone, math.sqrt(first[0] * first[1]), delta=0.02)
        self.assertAlmostEqual(one.alone_error / one.alone, 0.05 / math.sqrt(2.0), delta=0.012)
        another = fleet.estimate(twice[0][0])["frictionloss"]
        self.assertAlmostEqual(another.alone_error / another.alone, 0.05, delta=0.015)
        # Two fits of another robot say as much as two of the fleet's.
        both = fleet.estimate(twice[0])["frictionloss"]
        self.assertAlmostEqual(both.alone, one.alone, delta=1e-9)
        self.assertAlmostEqual(both.alone_error, one.alone_error, delta=1e-9)
        with self.assertRaisesRegex(ValueError, "of an empty list"):
            fleet.estimate([])
        with self.assertRaisesRegex(ValueError, "has no fit"):
            gaitfit.fleet({"a": twice[0], "b": twice[1], "c": twice[2], "d": []})

    def test_it_is_read_again(self) -> None:
        fleet = gaitfit.fleet(self.results())
        again = gaitfit.load(fleet.write(self.folder / "fleet.json"))
        self.assertEqual(again, fleet)
        json.loads(fleet.to_json())
        one = next(iter(self.results().values()))
        assert isinstance(again, gaitfit.Fleet)
        self.assertEqual(again.estimate(one), fleet.estimate(one))

    def test_another_robot_is_between_its_logs_and_the_fleet(self) -> None:
        results = self.results()
        last = results.pop("robot-29")
        fleet = gaitfit.fleet(results)
        high = replace(last, parameters=type(last.parameters)({"frictionloss": parameter("frictionloss", 0.8, 0.16)}))
        one = fleet.estimate(high)["frictionloss"]
        # Scatter and error are both 20 %: half each.
        self.assertAlmostEqual(one.own_share, 0.5, delta=0.15)
        self.assertTrue(0.5 < one.value < 0.75, one.value)
        self.assertTrue(one.interval[0] < one.value < one.interval[1])
        self.assertLess(one.interval[1] - one.interval[0], 0.9 * 2 * Z95 * 0.16)
        self.assertAlmostEqual(one.away, math.log(0.8 / fleet.numbers["frictionloss"].center) / math.hypot(0.2, 0.2), delta=0.4)

    def test_a_prior_is_not_used_twice(self) -> None:
        results = self.results()
        last = results.pop("robot-29")
        fleet = gaitfit.fleet(results)
        prior = fleet.prior["frictionloss"]
        self.assertAlmostEqual((prior.deviation or 0.0) / (prior.value or 1.0), 0.2, delta=0.07)
        both = (sets({"prior": {"frictionloss": prior}}), Fit(prior={"frictionloss": prior}).to_dict()["prior"])
        self.assertEqual(both[0], [f"prior={{frictionloss = {{value = {prior.value!r}, deviation = {prior.deviation!r}}}}}"])
        self.assertEqual(both[1], {"frictionloss": {"value": prior.value, "deviation": prior.deviation}})
        used = parameter("frictionloss", 0.5, 0.1, prior=Prior(prior.value, prior.deviation))
        with self.assertRaisesRegex(ValueError, "count twice"):
            fleet.estimate(replace(last, parameters=type(last.parameters)({"frictionloss": used})))

    def test_theta_has_the_estimates(self) -> None:
        """The demo's own fit, its numbers as they are, with robots around them."""
        results = self.results(6)
        template = self.template
        for robot, factor in zip(results, (0.8, 0.9, 1.0, 1.1, 1.2, 1.3)):
            moved = {name: parameter(name, factor * one.value, 0.3 * one.value) for name, one in template.parameters.items()}
            results[robot] = replace(template, parameters=type(template.parameters)(moved), run_folder=self.folder / robot)
        fleet = gaitfit.fleet(results)
        file = fleet.write_theta(template, self.folder / "theta.toml")
        estimates = fleet.estimate(template)
        document = json.loads(gaitfit._gaitfit.read_toml(file.read_text(encoding="utf-8")))
        for saved in document["parameter"]:
            self.assertEqual(saved["value"], estimates[saved["name"]].value)
        # The program reads it.
        checked = gaitfit.validate(file, DEMO / "validate.csv", config=template.run_folder / "config.toml")
        self.assertIsNotNone(checked.rmse_rad)

    def test_wrong_fleets_are_refused(self) -> None:
        results = self.results(6)
        with self.assertRaisesRegex(ValueError, "at least 4"):
            gaitfit.fleet(list(results.values())[:3])
        with self.assertRaisesRegex(TypeError, "robot-0 has a int"):
            gaitfit.fleet({**results, "robot-0": 3})
        none = replace(results["robot-0"], parameters=type(self.template.parameters)({}))
        with self.assertRaisesRegex(ValueError, "no number in common"):
            gaitfit.fleet({**results, "robot-0": none})
        with self.assertRaisesRegex(ValueError, "no number in common; the fleet has frictionloss"):
            gaitfit.fleet(results).estimate(none)
        blank = parameter("frictionloss", 0.5, 0.1, interval=None)
        other = replace(none, parameters=type(none.parameters)({"frictionloss": blank}))
        with self.assertRaisesRegex(ValueError, "frictionloss of the robot robot-0 has no interval"):
            gaitfit.fleet({**results, "robot-0": other})
        with self.assertRaises(FileNotFoundError):
            gaitfit.fleet([self.folder / "nowhere"] * 4)


if __name__ == "__main__":
    unittest.main()
