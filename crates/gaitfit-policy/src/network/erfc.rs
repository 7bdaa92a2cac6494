//! erfc(z) = (a₁ t + a₂ t² + … + a₅ t⁵) e^(−z²) with t = 1 / (1 + p z), for z ≥ 0: Abramowitz and Stegun (1964), 7.1.26, within
//! 1.5e-7.

/// p.
pub(crate) const P: f64 = 0.327_591_1;
/// a₅ to a₁, in the order of Horner's scheme.
pub(crate) const COEFFICIENTS: [f64; 5] =
    [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
