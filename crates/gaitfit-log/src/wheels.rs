//! Makes the angles of wheels continuous.

use crate::Trajectory;
use std::f64::consts::TAU;

impl Trajectory {
    /// Makes the angles of joints with velocity targets continuous. A robot may report them within one turn, or count turns since
    /// it was switched on. The first angle is moved to within half a turn of 0. Each later angle is moved by whole turns to
    /// agree with the measured velocity.
    pub fn unwrap_wheels(&mut self) {
        let width = self.joints.len();
        for joint in (0..width).filter(|&joint| self.has_velocity_target(joint)).collect::<Vec<_>>() {
            let mut before: Option<[f64; 3]> = None;
            for (row, &time) in self.time.iter().enumerate() {
                let (angle, speed) =
                    (&mut self.position[row * width + joint], self.velocity[row * width + joint]);
                // The trapezoidal rule: a wheel may turn by more than half a turn from row to row.
                let expected = before.map_or(0.0, |[t, q, dq]| q + 0.5 * (time - t) * (dq + speed));
                let turns = ((expected - *angle) / TAU).round();
                if turns.is_finite() && turns != 0.0 {
                    *angle += turns * TAU;
                }
                // After a lost reading the last known row stays the reference.
                if angle.is_finite() && speed.is_finite() {
                    before = Some([time, *angle, speed]);
                }
            }
        }
    }
}
