//! Which part of the policy's command space the data cover.

use gaitfit_learn::task::CommandSettings;
use serde::Serialize;

/// Cells of an axis's histogram.
const BINS: usize = 8;
/// Data that a cell needs to count as covered, s.
const COVERED_S: f64 = 0.2;
/// Empty cells in a row that are a gap worth naming: a quarter of the range. Sixteen random commands leave one of
/// that width in one session of eight.
const GAP: usize = 2;
/// Cells an axis of the coarse grid over all three.
const COARSE: usize = 3;
/// Share of the coarse cells below which combined commands are missing. Driving along one axis at a time visits 7 of
/// 27.
const MIN_SHARE: f64 = 0.3;
/// If a larger share of the data is outside the range, the result mentions it.
const OUTSIDE: f64 = 0.05;

/// One axis of the command space.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// `vx`, `vy` or `yaw rate`.
    pub name: &'static str,
    /// m/s or rad/s.
    pub unit: &'static str,
    /// Range of the policy's training.
    pub range: [f64; 2],
    /// Seconds of data in each of equally wide cells of the range.
    pub seconds: Vec<f64>,
    /// Parts of the range, a quarter wide or wider, without data.
    pub uncovered: Vec<[f64; 2]>,
    /// Share of the data outside the range.
    pub outside: f64,
}

/// How much of the command space the data cover.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Axes whose range is not one number.
    pub axes: Vec<Axis>,
    /// Share of the cells of a 3 × 3 × 3 grid over the ranges that hold data.
    pub share: f64,
}

impl Coverage {
    /// The coverage of `commands` (vx, vy, yaw rate), each of which lasts `dt` seconds.
    pub fn new<'a>(
        commands: impl Iterator<Item = &'a [f64]> + Clone,
        dt: f64,
        settings: &CommandSettings,
    ) -> Self {
        let ranges = [settings.x, settings.y, settings.yaw];
        let names = [("vx", "m/s"), ("vy", "m/s"), ("yaw rate", "rad/s")];
        // A range of one number cannot be left uncovered, and has no cells.
        let wide: Vec<usize> = (0..3).filter(|&k| ranges[k][1] > ranges[k][0]).collect();
        let axis = |&k: &usize| {
            let values = commands.clone().filter_map(move |row| row.get(k).copied());
            Axis::new(names[k], ranges[k], values, dt)
        };
        let axes = wide.iter().map(axis).collect();
        let cells = COARSE.pow(wide.len() as u32);
        let mut seconds = vec![0.0; cells];
        // Places on all axes are the digits of the cell's number.
        for row in commands.clone() {
            let mut cell = 0;
            let mut inside = true;
            for &k in &wide {
                match place(row[k], ranges[k], COARSE) {
                    Some(place) => cell = COARSE * cell + place,
                    None => inside = false,
                }
            }
            if inside {
                seconds[cell] += dt;
            }
        }
        let visited = seconds.iter().filter(|&&seconds| seconds >= COVERED_S).count();
        Self { axes, share: visited as f64 / cells as f64 }
    }

    /// The missing ranges, each as a part of a sentence: `no data with vx below -0.5 m/s`.
    pub fn uncovered(&self) -> Vec<String> {
        self.axes.iter().flat_map(Axis::missing).collect()
    }

    /// Reasons not to trust a fit in the whole command space.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let missing = self.uncovered();
        // Missing combinations of commands are named only if every range alone is covered.
        if !missing.is_empty() {
            warnings.push(format!(
                "the logs do not cover the policy's commands: {}; the fit is unchecked there: record these next time",
                missing.join(", ")
            ));
        } else if self.share < MIN_SHARE {
            warnings.push(format!(
                "the logs cover {:.0} % of the combinations of vx, vy and yaw rate; command several at once next time",
                100.0 * self.share
            ));
        }
        for axis in &self.axes {
            if axis.outside > OUTSIDE {
                warnings.push(format!(
                    "{:.0} % of the data have a command of {} outside [{}, {}] {}, for which the policy was not \
                     trained",
                    100.0 * axis.outside,
                    axis.name,
                    axis.range[0],
                    axis.range[1],
                    axis.unit
                ));
            }
        }
        warnings
    }
}

impl Axis {
    fn new(
        (name, unit): (&'static str, &'static str),
        range: [f64; 2],
        values: impl Iterator<Item = f64>,
        dt: f64,
    ) -> Self {
        let mut seconds = vec![0.0; BINS];
        let (mut outside, mut all) = (0usize, 0usize);
        for value in values {
            all += 1;
            match place(value, range, BINS) {
                Some(bin) => seconds[bin] += dt,
                None => outside += 1,
            }
        }
        let edge = |bin: usize| range[0] + (range[1] - range[0]) * bin as f64 / BINS as f64;
        let mut uncovered = Vec::new();
        let mut start = None;
        // One place behind the last bin, to end a gap that reaches to the edge of the range.
        for bin in 0..=BINS {
            let empty = seconds.get(bin).is_some_and(|&seconds| seconds < COVERED_S);
            match (empty, start) {
                (true, None) => start = Some(bin),
                (false, Some(from)) => {
                    if bin - from >= GAP {
                        uncovered.push([edge(from), edge(bin)]);
                    }
                    start = None;
                }
                _ => {}
            }
        }
        Self { name, unit, range, seconds, uncovered, outside: outside as f64 / all.max(1) as f64 }
    }

    fn missing(&self) -> impl Iterator<Item = String> + '_ {
        let number = |value: f64| format!("{}", (100.0 * value).round() / 100.0);
        self.uncovered.iter().map(move |&[low, high]| {
            let (name, unit) = (self.name, self.unit);
            match (low <= self.range[0], high >= self.range[1]) {
                (true, true) => {
                    format!("no data with {name} from {} to {} {unit}", number(low), number(high))
                }
                (true, false) => format!("no data with {name} below {} {unit}", number(high)),
                (false, true) => format!("no data with {name} above {} {unit}", number(low)),
                (false, false) => {
                    format!("no data with {name} between {} and {} {unit}", number(low), number(high))
                }
            }
        })
    }
}

/// The cell of the range, cut into `cells` of equal width, in which `value` lies; `None` if it lies outside. The ends
/// have a small tolerance.
fn place(value: f64, [low, high]: [f64; 2], cells: usize) -> Option<usize> {
    let along = (value - low) / (high - low);
    // Commands at an end of the range may be rounded beyond it. They count for the outermost cell.
    (-1e-6..=1.0 + 1e-6).contains(&along).then(|| ((along * cells as f64).max(0.0) as usize).min(cells - 1))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn settings() -> CommandSettings {
        CommandSettings {
            x: [-1.0, 1.0],
            y: [-0.5, 0.5],
            yaw: [-1.0, 1.0],
            ..gaitfit_learn::task::TaskSettings::default().command
        }
    }

    fn coverage(commands: &[[f64; 3]], seconds: f64) -> Coverage {
        Coverage::new(commands.iter().map(<[f64; 3]>::as_slice), seconds, &settings())
    }

    #[test]
    fn a_full_grid_is_covered() {
        let steps: Vec<f64> = (0..8).map(|k| -0.9 + 1.8 * f64::from(k) / 7.0).collect();
        let mut commands = Vec::new();
        for &x in &steps {
            for &y in &steps {
                commands.extend(steps.iter().map(|&yaw| [x, 0.5 * y, yaw]));
            }
        }
        let coverage = coverage(&commands, 0.2);
        assert!(coverage.warnings().is_empty(), "{:?}", coverage.warnings());
        assert_eq!(coverage.share, 1.0);
        assert!((coverage.axes[0].seconds.iter().sum::<f64>() - 512.0 * 0.2).abs() < 1e-9);
    }

    #[test]
    fn what_is_missing_is_named() {
        // vx from -0.4 on, vy all, yaw rate at both ends only.
        let commands: Vec<[f64; 3]> = (0..400)
            .map(|k| {
                let along = f64::from(k) / 399.0;
                let turn = if k % 2 == 0 { 0.9 - 0.3 * along } else { -0.9 + 0.3 * along };
                [-0.4 + 1.4 * along, along - 0.5, turn]
            })
            .collect();
        let missing = coverage(&commands, 0.1).uncovered();
        assert_eq!(
            missing,
            ["no data with vx below -0.5 m/s", "no data with yaw rate between -0.5 and 0.5 rad/s"]
        );
    }

    #[test]
    fn one_axis_at_a_time_is_not_all() {
        let along = |k: i32| -1.0 + 2.0 * f64::from(k) / 80.0;
        let commands: Vec<[f64; 3]> = (0..=80)
            .flat_map(|k| [[along(k), 0.0, 0.0], [0.0, 0.5 * along(k), 0.0], [0.0, 0.0, along(k)]])
            .collect();
        let coverage = coverage(&commands, 0.1);
        assert!(coverage.uncovered().is_empty());
        assert_eq!(coverage.share, 7.0 / 27.0);
        assert!(coverage.warnings()[0].contains("26 % of the combinations"));
    }

    #[test]
    fn commands_beyond_the_training_are_told() {
        let commands: Vec<[f64; 3]> = (0..100).map(|k| [if k < 20 { 3.0 } else { 0.0 }, 0.0, 0.0]).collect();
        let coverage = coverage(&commands, 0.1);
        assert_eq!(coverage.axes[0].outside, 0.2);
        let warnings = coverage.warnings();
        assert!(
            warnings.iter().any(|text| text.contains("20 % of the data have a command of vx outside")),
            "{warnings:?}"
        );
        // A range of one number is no axis.
        let still = CommandSettings { y: [0.0, 0.0], ..settings() };
        assert_eq!(Coverage::new(commands.iter().map(<[f64; 3]>::as_slice), 0.1, &still).axes.len(), 2);
    }
}
