//! How often the robot falls.

use crate::log::Log;

/// Falls of the robot and the time in which it could have fallen. Logs are of several lengths, and those that a fall
/// ends early are left out, so falls are counted by time and not by logs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Falling {
    /// Falls of a robot that stood before.
    pub falls: usize,
    /// Time on its feet, s.
    pub seconds: f64,
}

impl Falling {
    /// The sum for two sets of logs of one robot.
    pub fn and(self, other: Self) -> Self {
        Self { falls: self.falls + other.falls, seconds: self.seconds + other.seconds }
    }

    /// The share of `logs` in which the robot would be expected to fall if it walked them again, 0 to 1: in a time t it
    /// falls with probability 1 − exp(−λ t), where λ is the number of its falls in a second.
    pub fn rate(&self, logs: &[Log]) -> f64 {
        // Without time on its feet a robot has no rate; the quotient below would be infinite.
        if self.falls == 0 || self.seconds <= 0.0 || logs.is_empty() {
            return 0.0;
        }
        let each_second = self.falls as f64 / self.seconds;
        let fallen = |log: &Log| 1.0 - (-each_second * log.trajectory.duration()).exp();
        logs.iter().map(fallen).sum::<f64>() / logs.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_log::Trajectory;

    fn log(seconds: f64) -> Log {
        let trajectory =
            Trajectory::of_joints(Vec::new(), 50.0, vec![1.0, 1.0 + seconds], Vec::new(), Vec::new());
        Log {
            name: String::new(),
            path: "log.csv".into(),
            sidecars: Vec::new(),
            joints: Vec::new(),
            trajectory,
            mounting: None,
            filled: Vec::new(),
        }
    }

    #[test]
    fn longer_logs_see_more_falls_and_none_more_than_one() {
        let falling = Falling { falls: 2, seconds: 20.0 }.and(Falling { falls: 3, seconds: 30.0 });
        assert_eq!(falling, Falling { falls: 5, seconds: 50.0 });
        // A tenth of a fall each second.
        let expected = |seconds: f64| 1.0 - (-0.1 * seconds).exp();
        let mean = 0.5 * (expected(4.0) + expected(60.0));
        assert!((falling.rate(&[log(4.0), log(60.0)]) - mean).abs() < 1e-12);
        assert!(falling.rate(&[log(600.0)]) <= 1.0);
        assert_eq!((falling.rate(&[]), Falling::default().rate(&[log(4.0)])), (0.0, 0.0));
    }
}
