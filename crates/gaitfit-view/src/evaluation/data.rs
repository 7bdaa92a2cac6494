//! Content of the report of an evaluation, filled in by whoever ran it.

use crate::gait::GaitPicture;
use crate::replay::Replay;
use crate::{Doubt, Drift, Link, Setting};

/// Everything the page shows of one evaluated policy.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluationReport {
    /// Heading, e.g. the policy's file name.
    pub title: String,
    /// Robot and simulator, e.g. `go2, nominal` or `go2, fitted (theta.toml)`.
    pub robot: String,
    /// Time at which the evaluation ended, as it is to be printed.
    pub created: String,
    /// Wall-clock time, s.
    pub wall_seconds: f64,
    /// Doubts about the result.
    pub doubts: Vec<Doubt>,
    /// The result in a sentence; empty: the numbers alone, or a doubt, say it.
    pub verdict: String,
    /// Trajectories with random commands.
    pub trajectories: u64,
    /// Length of each, s.
    pub seconds: f64,
    /// Measures of the trajectories.
    pub measures: Vec<Measure>,
    /// Constant-command trials, one a command.
    pub drift: Vec<Drift>,
    /// Uneven ground, kind by kind, level by level.
    pub ground: Vec<Ground>,
    /// The robot at work; at most 6,000 frames are kept. One that cannot be drawn is left out with a warning that says
    /// why.
    pub replay: Option<Replay>,
    /// The gait under one command.
    pub gait: Option<GaitPicture>,
    /// Command of the gait, for its caption; may be empty.
    pub gait_caption: String,
    /// Files beside the report to look at.
    pub links: Vec<Link>,
    /// Warnings that the reader must know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Resolved settings, in the order to print them.
    pub settings: Vec<Setting>,
    /// Versions, hashes, hardware.
    pub versions: Vec<Setting>,
}

/// A mean over trajectories.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// Name, as it is to be printed.
    pub name: String,
    /// Its unit; empty when it has none.
    pub unit: String,
    /// The mean.
    pub mean: f64,
    /// Half-width of the mean's 95 % confidence interval.
    pub ci95: f64,
    /// Decimals of both; none: as many as the interval says.
    pub decimals: Option<usize>,
    /// Whether it stands in large print.
    pub headline: bool,
    /// The most it may be.
    pub limit: Option<f64>,
    /// Distribution over trajectories; empty for rates.
    pub histogram: Option<Histogram>,
}

/// Counts between edges.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Ascending; one more than counts. What lies beyond the ends is counted in the first and the last bin.
    pub edges: Vec<f64>,
    /// Trajectories between each two edges.
    pub counts: Vec<u64>,
}

/// Robots that cross one level of one kind of uneven ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Ground {
    /// Kind of ground.
    pub name: String,
    /// Level.
    pub level: u32,
    /// Measure of the level, such as a height or a slope, as it is to be printed.
    pub difficulty: String,
    /// Robots.
    pub robots: u32,
    /// Share that crossed it without a fall, 0 to 1.
    pub crossed: f64,
    /// Share that fell, 0 to 1.
    pub falls: f64,
    /// Mean speed from where they started, m/s.
    pub speed: f64,
}

impl Default for Measure {
    fn default() -> Self {
        Measure {
            name: String::new(),
            unit: String::new(),
            mean: f64::NAN,
            ci95: f64::NAN,
            decimals: None,
            headline: false,
            limit: None,
            histogram: None,
        }
    }
}

impl Default for Ground {
    fn default() -> Self {
        Ground {
            name: String::new(),
            level: 0,
            difficulty: String::new(),
            robots: 0,
            crossed: f64::NAN,
            falls: f64::NAN,
            speed: f64::NAN,
        }
    }
}
