//! A number with its standard error, and what such errors are made of.

use serde::{Deserialize, Serialize};

/// Samples nearer than this are not independent, s.
pub const BLOCK_S: f64 = 0.5;
/// Standard deviation of normal numbers, divided by the median of their absolute values (Rousseeuw and Croux 1993).
pub const MEDIAN_TO_DEVIATION: f64 = 1.4826;
/// A number that is less than this many errors from 0 is none.
const SURE: f64 = 4.0;

/// A number and its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Standard error.
    pub error: f64,
}

impl Estimate {
    /// Two standard errors below and above.
    pub fn interval(&self) -> [f64; 2] {
        [self.value - 2.0 * self.error, self.value + 2.0 * self.error]
    }

    /// Whether the interval holds `value`.
    pub fn holds(&self, value: f64) -> bool {
        let [low, high] = self.interval();
        (low..=high).contains(&value)
    }

    /// Whether it is further from 0 than its errors and than `worth`.
    pub fn matters(&self, worth: f64) -> bool {
        self.value.abs() > worth && self.value.abs() > SURE * self.error
    }
}
