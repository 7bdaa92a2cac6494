//! The pooled distribution cost.

use super::wasserstein1::{key, sort_keys, wasserstein1_keys};
use super::{Accumulator, Breakdown, Cost, CostError, GroupCost, Signal, Simulated, Target, Weights};
use std::sync::Arc;

/// The paper's cost: for each of joint position, joint velocity and action the mean over joints of the exact 1-D
/// Wasserstein-1 distance between the pooled samples of the two sides, in the target's fixed scaling; the groups
/// are summed, each with its weight. Neither clocks nor sample counts of the two sides need agree.
///
/// W₁ is homogeneous and blind to a common shift, so samples are sorted unscaled and the distance is multiplied by
/// the scale.
#[derive(Clone, Debug)]
pub struct Wass {
    target: Arc<Target>,
    weights: Weights,
}

impl Wass {
    /// The cost against `target`.
    ///
    /// # Errors
    /// As [`Weights::check`].
    pub fn new(target: Arc<Target>, weights: Weights) -> Result<Self, CostError> {
        weights.check(&target)?;
        Ok(Self { target, weights })
    }
}

impl Cost for Wass {
    fn name(&self) -> &'static str {
        "wass"
    }

    fn begin(&self) -> Box<dyn Accumulator + '_> {
        let pools = Signal::ALL
            .into_iter()
            .filter(|signal| self.weights.get(*signal) > 0.0)
            .map(|signal| (signal, vec![Vec::new(); self.target.joints().len()]))
            .collect();
        Box::new(Pools { cost: self, pools, scratch: Vec::new() })
    }
}

/// The simulated samples of one candidate, one pool of sort keys a dimension.
struct Pools<'a> {
    cost: &'a Wass,
    pools: Vec<(Signal, Vec<Vec<u32>>)>,
    scratch: Vec<u32>,
}

impl Pools<'_> {
    fn clear(&mut self) {
        for (_, joints) in &mut self.pools {
            joints.iter_mut().for_each(Vec::clear);
        }
    }

    fn pool(&mut self, recording: usize, simulated: Simulated<'_>) -> Result<(), CostError> {
        let target = &self.cost.target;
        let width = target.joints().len();
        for (signal, joints) in &mut self.pools {
            let matrix = target.checked(*signal, recording, simulated.get(*signal))?;
            for (joint, pool) in joints.iter_mut().enumerate() {
                pool.extend(matrix.iter().skip(joint).step_by(width).map(|value| key(*value)));
            }
        }
        Ok(())
    }

    fn distances(&mut self) -> Result<Breakdown, CostError> {
        let mut groups = Vec::with_capacity(self.pools.len());
        for (signal, joints) in &mut self.pools {
            let dimensions = self.cost.target.dimensions(*signal).unwrap_or_default();
            let mut per_joint = Vec::with_capacity(joints.len());
            for (pool, dimension) in joints.iter_mut().zip(dimensions) {
                if pool.is_empty() {
                    return Err(CostError::Missing(0));
                }
                per_joint.push(dimension.scale.map(|scale| {
                    sort_keys(pool, &mut self.scratch);
                    scale * wasserstein1_keys(pool, &dimension.sorted)
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
    fn add(&mut self, recording: usize, simulated: Simulated<'_>) -> Result<(), CostError> {
        self.pool(recording, simulated).inspect_err(|_| self.clear())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        let result = self.distances();
        self.clear();
        result
    }
}
