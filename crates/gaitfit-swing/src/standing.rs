//! What standing feet say of the inertial unit: how it is tilted.

use crate::SwingError;
use crate::feet::Ground;
use crate::torques::Drag;
use crate::walk::Walk;
use gaitfit_log::{Estimate, Trajectory};
use gaitfit_model::rotation::{Quat, Vec3, axis_angle, cross, product, quat_of, rotate_back, sub, up};
use gaitfit_model::{Model, Root};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Feet that stand this much count.
pub(crate) const STANDS: f64 = 0.5;
/// Delay of targets for forces at the feet, s. A real Go2 shows 5 to 6 ms (docs/results/swings.md).
const DELAY_S: f64 = 0.005;
/// Samples nearer than this are not independent, s.
const BLOCK_S: f64 = 1.0;
/// A tilt worth correcting, rad.
const TILT: f64 = 0.005;
/// Fewer feet do not show a tilt: the feet of a biped roll over their edges while both touch the ground.
pub(crate) const MIN_FEET: usize = 3;
/// Rounds in which a tilt is taken out and looked at again.
const ROUNDS: usize = 3;

/// Findings about the inertial unit from feet that stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Turn of the orientation about the base's x and y axes against the plane of the standing feet, rad: the unit
    /// is tilted, or the floor is.
    pub tilt: Option<[Estimate; 2]>,
}

impl Standing {
    /// Examines logs of one robot on level ground. The result does not depend on the number of `threads`.
    ///
    /// # Errors
    /// Logs without what is needed, see [`SwingError`].
    pub fn new(model: &Model, logs: &[&Trajectory], threads: usize) -> Result<Self, SwingError> {
        if model.root == Root::Fixed {
            return Ok(Self::default());
        }
        let mut standing = Self { tilt: tilt(model, logs, threads)? };
        // Which feet stand is judged by their heights too, so a first look sees a part of the tilt.
        for _ in 1..ROUNDS {
            // Nothing is taken out, so the next look would see the same.
            if standing.taken_out() == [0.0; 2] {
                break;
            }
            let level: Vec<Trajectory> = logs.iter().map(|log| standing.corrected(log).0).collect();
            let left = tilt(model, &level.iter().collect::<Vec<_>>(), threads)?;
            let Some(left) = left else { break };
            standing = standing.with_left(left);
        }
        Ok(standing)
    }

    /// The whole tilt, if logs corrected by this one still show the tilt `left`.
    #[must_use]
    pub fn with_left(&self, left: [Estimate; 2]) -> Self {
        let taken_out = self.taken_out();
        let whole = |axis: usize| Estimate { value: left[axis].value + taken_out[axis], ..left[axis] };
        Self { tilt: Some([whole(0), whole(1)]) }
    }

    /// The tilt that [`Self::corrected`] takes out of a log, rad.
    fn taken_out(&self) -> [f64; 2] {
        let matters = |axis: Estimate| if axis.matters(TILT) { axis.value } else { 0.0 };
        self.tilt.map_or([0.0; 2], |tilt| tilt.map(matters))
    }

    /// The log with an orientation that is level where feet stand level, and what was changed, in a sentence. What does not
    /// matter stays.
    pub fn corrected(&self, log: &Trajectory) -> (Trajectory, Vec<String>) {
        let mut better = log.clone();
        let mut said = Vec::new();
        let [roll, pitch] = self.taken_out();
        if [roll, pitch] != [0.0; 2]
            && let Some(quaternions) = better.base.as_mut().and_then(|base| base.quaternion.as_mut())
        {
            let angle = roll.hypot(pitch);
            // The base is turned about the same axis by the opposite angle.
            let level = axis_angle([-roll / angle, -pitch / angle, 0.0], angle);
            for quaternion in quaternions.chunks_exact_mut(4) {
                let turned = product(quat_of(quaternion), level);
                quaternion.copy_from_slice(&turned);
            }
            said.push(format!(
                "the orientation is {:.2}° of roll and {:.2}° of pitch off where feet stand; the base is turned back by that \
                 (if the floor slopes, it is the floor)",
                roll.to_degrees(),
                pitch.to_degrees()
            ));
        }
        (better, said)
    }
}

/// The tilt that the heights of feet which stand together show.
fn tilt(model: &Model, logs: &[&Trajectory], threads: usize) -> Result<Option<[Estimate; 2]>, SwingError> {
    let mut equations = Blocks::<2>::default();
    let drag = vec![Drag::default(); model.joints.len()];
    let walks = gaitfit_pool::map(logs.len(), threads, |log| {
        let walk = Walk::new(model, logs[log])?;
        let ground = Ground::new(model, &walk, DELAY_S, &drag, None);
        Ok((walk, ground))
    });
    for (number, walk) in walks.into_iter().enumerate() {
        let (walk, ground) = walk?;
        let feet = ground.feet.first().map_or(0, Vec::len);
        // Two feet span no plane.
        if feet < MIN_FEET {
            return Ok(None);
        }
        for point in (0..walk.points()).filter(|&point| walk.valid[point]) {
            // The log's number in the upper half keeps blocks of different logs apart.
            let block = ((number as u64) << 32) + (point as f64 * walk.step / BLOCK_S) as u64;
            let turn = walk.quaternion[point];
            let feet: Vec<_> = ground.feet[point].iter().filter(|foot| foot.stands > STANDS).collect();
            // All pairs: on a level floor two standing feet are equally high, and a tilt shows as lever times
            // angle.
            for (k, one) in feet.iter().enumerate() {
                for other in &feet[k + 1..] {
                    let between = sub(one.point, other.point);
                    equations.add(block, tilt_lever(turn, between), between[2]);
                }
            }
        }
    }
    Ok(equations.estimate())
}

/// How the height of one foot above another changes with a tilt of the IMU about the base's x and y axes, m/rad. With the true
/// orientation turned by e in the base, height + e·(between × up) = 0. `between`: from one to the other, m, world axes.
pub(crate) fn tilt_lever(turn: Quat, between: Vec3) -> [f64; 2] {
    let [x, y, _] = cross(rotate_back(turn, between), up(turn));
    [x, y]
}

/// Normal equations of N unknowns by blocks of time.
struct Blocks<const N: usize>(BTreeMap<u64, (SMatrix<f64, N, N>, SVector<f64, N>)>);

impl<const N: usize> Default for Blocks<N> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<const N: usize> Blocks<N> {
    /// One equation: row·unknowns = value.
    fn add(&mut self, block: u64, row: [f64; N], value: f64) {
        if row.iter().all(|x| x.is_finite()) && value.is_finite() {
            let row = SVector::from(row);
            let sums = self.0.entry(block).or_insert_with(|| (SMatrix::zeros(), SVector::zeros()));
            sums.0 += row * row.transpose();
            sums.1 += row * value;
        }
    }

    /// Least squares, with errors by the scatter of blocks. `None` where the equations do not say enough.
    fn estimate(&self) -> Option<[Estimate; N]> {
        if self.0.len() < 4 {
            return None;
        }
        let normal = self.0.values().fold(SMatrix::<f64, N, N>::zeros(), |sum, block| sum + block.0);
        let right = self.0.values().fold(SVector::<f64, N>::zeros(), |sum, block| sum + block.1);
        // A direction that nothing excites has no pivot.
        let floor = SMatrix::<f64, N, N>::from_diagonal(&normal.diagonal().map(|x| 1e-9 * x + 1e-15));
        let inverse = (normal + floor).try_inverse()?;
        let values = inverse * right;
        let mut meat = SMatrix::<f64, N, N>::zeros();
        for (block, sums) in self.0.values() {
            let score = sums - block * values;
            meat += score * score.transpose();
        }
        let blocks = self.0.len() as f64;
        let covariance = inverse * meat * inverse * (blocks / (blocks - 1.0));
        let estimate = |k: usize| Estimate { value: values[k], error: covariance[(k, k)].max(0.0).sqrt() };
        values.iter().all(|value| value.is_finite()).then(|| std::array::from_fn(estimate))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_seen_through_noise() {
        let mut blocks = Blocks::<2>::default();
        for k in 0..1000u64 {
            let x = (k as f64 * 0.37).sin();
            let noise = 0.1 * (k as f64 * 12.9898).sin();
            blocks.add(k / 50, [1.0, x], 0.3 - 0.7 * x + noise);
        }
        let estimates = blocks.estimate().unwrap_or([Estimate { value: f64::NAN, error: 0.0 }; 2]);
        for (estimate, truth) in estimates.iter().zip([0.3, -0.7]) {
            assert!((estimate.value - truth).abs() < 3.0 * estimate.error + 1e-6, "{estimate:?}");
            assert!(estimate.error < 0.02, "{estimate:?}");
        }
    }
}
