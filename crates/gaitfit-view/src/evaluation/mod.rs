//! The page of an evaluated policy: means with their intervals, distributions of errors, drift, and the gait.

mod data;

pub use data::{Drift, EvaluationReport, Histogram, Measure};
