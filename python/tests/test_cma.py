"""CMA-ES alone: against the package cmaes, its states, and wrong arguments."""

import copy
import math
import pickle
import unittest

import cmaes
import numpy as np

import gaitfit

from .common import Case


def rosenbrock(x: np.ndarray) -> np.ndarray:
    return np.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)


class Search(Case):
    def test_the_distribution_moves_as_that_of_cmaes(self) -> None:
        """Told the same candidates and costs, both have the same mean and the same deviations, generation by generation."""
        start, deviation = np.array([-1.0, 2.0, 0.5, 1.5, -0.5]), np.full(5, 0.7)
        for covariance, other in (
            ("full", cmaes.CMA(mean=start, sigma=0.7, population_size=10)),
            ("separable", cmaes.SepCMA(mean=start, sigma=0.7, population_size=10)),
        ):
            ours = gaitfit.CMA(start, deviation, seed=3, population=10, covariance=covariance)
            for generation in range(40):
                candidates = ours.ask()
                self.assertEqual(candidates.shape, (10, 5))
                costs = rosenbrock(candidates)
                ours.tell(costs)
                other.ask()
                other.tell(list(zip(candidates, costs)))
                self.assertEqual(ours.generation, generation + 1)
                np.testing.assert_allclose(ours.mean, other.mean, rtol=1e-7, atol=1e-9)
                spread = other._sigma * np.sqrt(np.diag(other._C) if covariance == "full" else other._C)
                np.testing.assert_allclose(ours.deviations, spread, rtol=1e-7)

    def test_it_finds_a_minimum_and_says_why_it_stops(self) -> None:
        search = gaitfit.CMA([-1.0, 2.0], [0.5, 0.5], seed=1)
        self.assertIsNone(search.best)
        while search.stop is None:
            search.tell(rosenbrock(search.ask()))
        np.testing.assert_allclose(search.best, [1.0, 1.0], atol=1e-5)
        self.assertLess(search.best_cost, 1e-9)
        self.assertIsInstance(search.stop, str)
        self.assertEqual(search.evaluations, search.generation * 6)

    def test_a_search_goes_on_from_its_state_and_through_pickle(self) -> None:
        arguments = {"seed": 5, "lower": [-2, -2, -2], "upper": [2, 2, 2], "bounds": "reflect"}
        search = gaitfit.CMA([0, 0, 0], [1, 1, 1], **arguments)
        for _ in range(7):
            search.tell(rosenbrock(search.ask()))
        asked = search.ask()
        copies = [
            gaitfit.CMA([0, 0, 0], [1, 1, 1], **arguments, state=search.state),
            pickle.loads(pickle.dumps(search)),
            copy.deepcopy(search),
        ]
        for other in copies:
            np.testing.assert_array_equal(other.ask(), asked)
            self.assertTrue((np.abs(other.ask()) <= 2.0).all())
        for _ in range(5):
            for one in (search, *copies):
                one.tell(rosenbrock(one.ask()))
        for other in copies:
            self.assertEqual(other.state, search.state)

    def test_a_state_of_another_search_is_refused(self) -> None:
        arguments = {"start": [0.0, 0.0], "deviation": [1.0, 1.0], "seed": 2, "lower": [-3.0, -3.0], "upper": [3.0, 3.0]}
        search = gaitfit.CMA(**arguments)
        search.tell(rosenbrock(search.ask()))
        for other, words in (
            ({"start": [0.0, 0.1]}, "another start"),
            ({"deviation": [1.0, 2.0]}, "other deviations"),
            ({"upper": [3.0, 4.0]}, "other bounds"),
            ({"seed": 3}, "seed 2, the settings say 3"),
            ({"bounds": "reflect"}, "draws outside the bounds"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                gaitfit.CMA(**{**arguments, **other}, state=search.state)
        again = gaitfit.CMA(**arguments, state=search.state)
        np.testing.assert_array_equal(again.ask(), search.ask())

    def test_candidates_that_failed_cost_infinity(self) -> None:
        search = gaitfit.CMA([3.0, 3.0], [1.0, 1.0], seed=2)
        for _ in range(60):
            candidates = search.ask()
            costs = np.sum(candidates**2, axis=1)
            costs[::3] = math.inf
            search.tell(costs)
        self.assertLess(search.best_cost, 1e-3)

    def test_wrong_arguments_are_refused(self) -> None:
        for arguments, words in (
            (([], []), "."),
            (([1.0, 2.0], [1.0]), "."),
            (([[1.0]], [1.0]), r"array of shape \(1, 1\)"),
            (([math.nan], [1.0]), "."),
            (([1.0], [-1.0]), "."),
            (([1.0], [math.inf]), "."),
        ):
            with self.subTest(str(arguments)), self.assertRaisesRegex(ValueError, words):
                gaitfit.CMA(*arguments)
        for wrong in (
            {"bounds": "clip"},
            {"covariance": "diagonal"},
            {"lower": [2.0], "upper": [1.0]},
            {"lower": [0.0, 0.0]},
            {"population": 1},
            {"state": "{}"},
            {"state": "not JSON"},
        ):
            with self.subTest(str(wrong)), self.assertRaises(ValueError):
                gaitfit.CMA([1.0], [1.0], **wrong)
        for wrong in ({"population": -3}, {"seed": -1}):
            with self.subTest(str(wrong)), self.assertRaises((ValueError, OverflowError)):
                gaitfit.CMA([1.0], [1.0], **wrong)

    def test_wrong_costs_are_refused_and_nothing_is_lost(self) -> None:
        search = gaitfit.CMA([1.0, 1.0], [1.0, 1.0])
        with self.assertRaisesRegex(ValueError, "without ask"):
            search.tell([1.0] * 6)
        asked = search.ask()
        for wrong in ([1.0], np.zeros((6, 1)), ["a"] * 6):
            with self.subTest(str(wrong)), self.assertRaises((ValueError, TypeError)):
                search.tell(wrong)
        search.tell([math.nan, 1.0, 2.0, 3.0, 4.0, 5.0])
        self.assertEqual(search.generation, 1)
        np.testing.assert_array_equal(search.best, asked[1])


if __name__ == "__main__":
    unittest.main()
