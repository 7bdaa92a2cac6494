//! What a robot's own sensors say of how policies walked on it: how well they turn as commanded, by the gyroscope. How fast
//! and where it walks no sensor of it says.

use crate::Error;
use crate::evaluate::of_few;
use gaitfit_log::{ReadOptions, Trajectory, csv_files, read_csv};
use gaitfit_view::Estimate;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A policy's walks on a robot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Walked {
    /// The policy.
    pub policy: String,
    /// Walks.
    pub walks: usize,
    /// Walks that something stopped: their logs end early.
    pub stopped: usize,
    /// Mean size of yaw rate minus command in a walk, rad/s, by the gyroscope: mean over the walks.
    pub yaw_rate_error: Estimate,
    /// The same of each walk. Walks of the same place in this list had the same commands.
    pub errors: Vec<f64>,
}

/// Note on what was not measured of these walks.
pub const NOT_MEASURED: &str = "How fast the robot walked and how far it drifted was not measured: that takes motion capture, a tape or `gaitfit drift`.";

impl Walked {
    /// Reads the logs in a folder, walks of `seconds`.
    ///
    /// # Errors
    /// A log that cannot be read, or has no gyroscope or commands.
    pub fn read(policy: &str, folder: &Path, seconds: f64) -> Result<Self, Error> {
        let mut errors = Vec::new();
        let mut stopped = 0;
        for path in csv_files(folder)? {
            let log = read_csv(&path, &ReadOptions::default())?;
            let Some(error) = yaw_rate_error(&log) else {
                return Err(Error::content(&path, "it has no commands, or no yaw rate (column `wz`)"));
            };
            errors.push(error);
            // A whole walk ends one control period before `seconds`, and a few rows may be left out.
            stopped += usize::from(log.time.last().is_some_and(|last| *last < seconds - 0.1));
        }
        let yaw_rate_error = of_few(&errors);
        Ok(Self { policy: policy.to_owned(), walks: errors.len(), stopped, yaw_rate_error, errors })
    }

    /// Mean of this policy's error minus that of another under the same commands, walk by walk.
    pub fn minus(&self, other: &Self) -> Estimate {
        // In pairs, because walks of one number had the same commands: what makes a command hard cancels.
        let pairs = self.errors.iter().zip(&other.errors);
        of_few(&pairs.map(|(own, other)| own - other).collect::<Vec<_>>())
    }

    /// In a sentence.
    pub fn sentence(&self) -> String {
        let Estimate { mean, ci95 } = self.yaw_rate_error;
        if self.walks == 0 {
            return format!("{}: no walks", self.policy);
        }
        let stopped = match self.stopped {
            0 => String::new(),
            stopped => format!(", {stopped} of them stopped early"),
        };
        format!(
            "{}: {}{stopped}, yaw rate off by {mean:.3}{} rad/s (gyroscope)",
            self.policy,
            gaitfit_model::counted(self.walks, "walk"),
            interval(ci95)
        )
    }
}

/// The half-width of an interval in words; one walk has none.
fn interval(ci95: f64) -> String {
    if ci95.is_nan() { String::new() } else { format!(" ± {ci95:.3}") }
}

/// Returns the results of all policies, a sentence each.
pub fn sentences(walked: &[Walked]) -> Vec<String> {
    let mut said: Vec<String> = walked.iter().map(Walked::sentence).collect();
    if let [first, .., last] = walked {
        let Estimate { mean, ci95 } = last.minus(first);
        // Where one of the two has no walks, there is nothing to compare.
        if !mean.is_nan() {
            said.push(format!(
                "{} minus {} under the same commands: {mean:+.3}{} rad/s",
                last.policy,
                first.policy,
                interval(ci95)
            ));
        }
    }
    said
}

fn yaw_rate_error(log: &Trajectory) -> Option<f64> {
    let command = log.command.as_ref()?;
    let rates = log.base.as_ref()?.angular_velocity.as_ref()?;
    // Rows of x, y, z: the command has the yaw rate last, and so has the gyroscope.
    let pairs = command.chunks_exact(3).zip(rates.chunks_exact(3));
    let (sum, rows) =
        pairs.fold((0.0, 0), |(sum, rows), (command, rate)| (sum + (rate[2] - command[2]).abs(), rows + 1));
    (rows > 0).then(|| sum / f64::from(rows))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use std::fmt::Write;

    #[test]
    fn yaw_rates_are_compared_with_commands_walk_by_walk() {
        let folder = tempfile::tempdir().unwrap();
        let head = "# rate_hz = 50.0\ntime,q_a,dq_a,vx_cmd,vy_cmd,wz_cmd,wx,wy,wz\n";
        for (number, (error, rows)) in [(0.1, 50), (0.3, 50), (0.2, 20)].into_iter().enumerate() {
            let mut text = head.to_owned();
            for row in 0..rows {
                let sign = if row % 2 == 0 { 1.0 } else { -1.0 };
                writeln!(text, "{},0,0,0,0,0.5,9,9,{}", f64::from(row) * 0.02, 0.5 + sign * error).unwrap();
            }
            std::fs::write(folder.path().join(format!("trajectory_0{number}.csv")), text).unwrap();
        }
        let walked = Walked::read("π₁", folder.path(), 1.0).unwrap();
        assert_eq!((walked.walks, walked.stopped), (3, 1));
        assert!((walked.yaw_rate_error.mean - 0.2).abs() < 1e-9, "{walked:?}");
        let other = Walked { errors: vec![0.0, 0.2, 0.1], policy: "π₀".to_owned(), ..walked.clone() };
        assert!((walked.minus(&other).mean - 0.1).abs() < 1e-9);
        let one = Walked { walks: 1, yaw_rate_error: of_few(&[0.2]), ..walked.clone() };
        assert!(one.sentence().contains("off by 0.200 rad/s"), "{}", one.sentence());
        let none =
            Walked { walks: 0, stopped: 0, yaw_rate_error: of_few(&[]), errors: vec![], ..walked.clone() };
        assert_eq!(sentences(&[other.clone(), none])[1..], ["π₁: no walks"]);
        let said = sentences(&[other, walked]);
        assert!(said[2].contains("π₁ minus π₀") && said[2].contains("+0.100"), "{said:?}");
        std::fs::write(folder.path().join("x.csv"), "time,q_a,dq_a\n0,0,0\n0.02,0,0\n").unwrap();
        assert!(Walked::read("π₁", folder.path(), 1.0).unwrap_err().to_string().contains("x.csv"));
    }
}
