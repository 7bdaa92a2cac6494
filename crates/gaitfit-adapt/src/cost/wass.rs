//! The pooled distribution cost.

use super::wasserstein1::{key, sort_keys, wasserstein1_keys};
use super::{Accumulator, Breakdown, Cost, CostError, GroupCost, LOST, Reference, Signal, Weights};
use crate::Signals;
use std::sync::Arc;

/// The paper's cost: for each of joint position, joint velocity and action the mean over joints of the exact 1-D
/// Wasserstein-1 distance between the pooled samples of the two sides, in the reference's fixed scaling; the groups
/// are summed, each with its weight. Neither clocks nor sample counts of the two sides need agree.
///
/// Samples after a fall are not pooled: they would resemble whatever the log has of standing still or lying. The
/// share m of samples lost counts as off by the robot's whole range, (1 − m)·W₁ + m·2, so that falling earlier
/// costs more.
///
/// W₁ is homogeneous and blind to a common shift, so samples are sorted unscaled and the distance is multiplied by
/// the scale.
#[derive(Clone, Debug)]
pub struct Wass {
    reference: Arc<Reference>,
    weights: Weights,
}

impl Wass {
    /// The cost against `reference`.
    ///
    /// # Errors
    /// As [`Weights::check`].
    pub fn new(reference: Arc<Reference>, weights: Weights) -> Result<Self, CostError> {
        weights.check(&reference)?;
        Ok(Self { reference, weights })
    }
}

impl Cost for Wass {
    fn name(&self) -> &str {
        "wass"
    }

    fn lost(&self) -> f64 {
        LOST * self.weights.sum()
    }

    fn subset(&self, recordings: &[usize]) -> Option<Box<dyn Cost>> {
        Some(Box::new(Self { reference: Arc::new(self.reference.subset(recordings)), ..self.clone() }))
    }

    fn begin(&self) -> Box<dyn Accumulator + '_> {
        let pools = self
            .weights
            .signals()
            .map(|signal| (signal, vec![Vec::new(); signal.width(self.reference.joints().len())]))
            .collect();
        Box::new(Pools { cost: self, pools, lost: 0, scratch: Vec::new() })
    }
}

/// The simulated samples of one candidate, one pool of sort keys a dimension.
struct Pools<'a> {
    cost: &'a Wass,
    pools: Vec<(Signal, Vec<Vec<u32>>)>,
    /// Samples lost to falls.
    lost: usize,
    scratch: Vec<u32>,
}

impl Pools<'_> {
    fn clear(&mut self) {
        self.lost = 0;
        for (_, joints) in &mut self.pools {
            joints.iter_mut().for_each(Vec::clear);
        }
    }

    fn pool(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        let reference = &self.cost.reference;
        let mut lost = 0;
        for (signal, joints) in &mut self.pools {
            let width = joints.len();
            let counted = reference.checked(*signal, recording, &simulated)?;
            lost = counted.lost;
            for (joint, pool) in joints.iter_mut().enumerate() {
                pool.extend(counted.matrix.iter().skip(joint).step_by(width).map(|value| key(*value)));
            }
        }
        self.lost += lost;
        Ok(())
    }

    fn distances(&mut self) -> Result<Breakdown, CostError> {
        let mut groups = Vec::with_capacity(self.pools.len());
        for (signal, joints) in &mut self.pools {
            let dimensions = self.cost.reference.dimensions(*signal).unwrap_or_default();
            let mut per_joint = Vec::with_capacity(joints.len());
            for (pool, dimension) in joints.iter_mut().zip(dimensions) {
                if pool.is_empty() && self.lost == 0 {
                    return Err(CostError::Missing(0));
                }
                let lost = self.lost as f64 / (self.lost + pool.len()) as f64;
                per_joint.push(dimension.scale.map(|scale| {
                    if pool.is_empty() {
                        return LOST;
                    }
                    sort_keys(pool, &mut self.scratch);
                    let distance = scale * wasserstein1_keys(pool, &dimension.sorted);
                    if self.lost == 0 { distance } else { (1.0 - lost) * distance + lost * LOST }
                }));
            }
            let count = per_joint.iter().flatten().count();
            let value = per_joint.iter().flatten().sum::<f64>() / count as f64;
            groups.push(GroupCost {
                signal: *signal,
                weight: self.cost.weights.get(*signal),
                value,
                per_joint,
            });
        }
        Ok(Breakdown::new(groups))
    }
}

impl Accumulator for Pools<'_> {
    /// Any number of recordings of any length may be pooled; `recording` serves error messages only.
    fn add(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        self.pool(recording, simulated).inspect_err(|_| self.clear())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        let result = self.distances();
        self.clear();
        result
    }
}
