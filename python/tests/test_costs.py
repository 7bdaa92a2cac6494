"""Costs against SciPy."""

import unittest

import numpy as np
from scipy.stats import wasserstein_distance

import gaitfit

from .common import Case


class Costs(Case):
    def test_distances_are_scipys(self) -> None:
        rng = np.random.default_rng(1)
        for first, second, width in ((1, 1, 1), (1, 50, 2), (300, 300, 12), (1800, 777, 3)):
            a = rng.normal(size=(first, width)).astype(np.float32)
            b = rng.normal(0.3, 2.0, size=(second, width))
            found = gaitfit.costs.wasserstein(a, b)
            self.assertEqual(found.shape, (width,))
            for column in range(width):
                expected = wasserstein_distance(a[:, column].astype(np.float64), b[:, column])
                self.assertAlmostEqual(found[column], expected, delta=1e-12 * max(1.0, expected))

    def test_one_dimension_is_a_number(self) -> None:
        found = gaitfit.costs.wasserstein([0.0, 1.0], [5.0, 6.0])
        self.assertIsInstance(found, float)
        self.assertEqual(found, 5.0)

    def test_doubles_keep_their_digits_and_both_ways_agree(self) -> None:
        large = 1e9 + np.arange(3.0)
        self.assertEqual(gaitfit.costs.wasserstein(large, large + 1.0), 1.0)
        rng = np.random.default_rng(3)
        a, b = rng.normal(1.0, 1e-9, size=301), rng.normal(1.0, 1e-9, size=500)
        found = gaitfit.costs.wasserstein(a, b)
        self.assertGreater(found, 0.0)
        self.assertEqual(found, gaitfit.costs.wasserstein(b, a))
        self.assertAlmostEqual(found, wasserstein_distance(a, b), delta=1e-15)

    def test_any_memory_layout(self) -> None:
        values = np.random.default_rng(2).normal(size=(40, 6))
        other = np.asfortranarray(values + 1.0)
        np.testing.assert_allclose(gaitfit.costs.wasserstein(values[::2, ::3], other[::2, ::3]), 1.0, rtol=1e-6)
        self.assertEqual(gaitfit.costs.wasserstein(values[:, 0].astype(">f8"), values[:, 0]) < 1e-7, True)

    def test_wrong_arrays_are_refused(self) -> None:
        wasserstein = gaitfit.costs.wasserstein
        for a, b, words in (
            (np.zeros((4, 2)), np.zeros((4, 3)), "a has 2 columns and b has 3"),
            (np.zeros(4), np.zeros((4, 1)), "a has 1 axes and b has 2"),
            (np.zeros((4, 1, 1)), np.zeros((4, 1, 1)), "both need one, or both two"),
            (np.zeros(0), np.zeros(3), "no samples"),
            ([0.0, np.nan], [0.0, 1.0], "not finite"),
            ([0.0, 1.0], [np.inf, 1.0], "not finite"),
        ):
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                wasserstein(a, b)
        with self.assertRaises((TypeError, ValueError)):
            wasserstein(["a", "b"], [0.0, 1.0])
        with self.assertRaises(TypeError):
            wasserstein([0.0, 1.0])


if __name__ == "__main__":
    unittest.main()
