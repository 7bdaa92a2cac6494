//! The pooled distribution cost.

use super::wasserstein1::{key, sort_keys, wasserstein1_keys};
use super::{
    Accumulator, Breakdown, Compared, Cost, CostError, LOST, Pieces, Reference, Signal, Weights, pieces,
};
use crate::Signals;
use std::sync::Arc;

/// The paper's cost: for each of joint position, joint velocity and action the mean over joints of the exact 1-D
/// Wasserstein-1 distance between the pooled samples of the two sides, in the reference's fixed scaling; the groups
/// are summed, each with its weight. Neither clocks nor sample counts of the two sides need agree.
///
/// Samples after a fall are not pooled: they would resemble parts of the log in which the robot stands still or lies. The
/// share m of samples lost counts as off by the robot's whole range, (1 − m)·W₁ + m·2, so that an earlier fall
/// costs more. The share that the robot itself would lose to its falls ([`Reference::with_fall_rate`]) is free and is not in m:
/// true values must not cost more than those of a robot that is too steady.
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

    fn pieces(&self) -> Option<Pieces<'_>> {
        Some(Pieces::Distances(Compared { reference: &self.reference, weights: self.weights }))
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
            // A fall takes the same samples of every signal, so they are counted once for all.
            lost = counted.lost;
            for (joint, pool) in joints.iter_mut().enumerate() {
                // Samples are kept as integers of the same order, which the radix sort takes as they are.
                pool.extend(counted.matrix.iter().skip(joint).step_by(width).map(|value| key(*value)));
            }
        }
        self.lost += lost;
        Ok(())
    }

    fn distances(&mut self) -> Result<Breakdown, CostError> {
        let Self { cost, pools, lost, scratch } = self;
        // All pools of a candidate have the same length.
        let kept = pools.first().and_then(|(_, joints)| joints.first()).map_or(0, Vec::len);
        // Neither a sample nor a loss: no recording was added.
        if kept == 0 && *lost == 0 {
            return Err(CostError::Missing(0));
        }
        let reference = &cost.reference;
        Ok(pieces::distances(reference, &cost.weights, [*lost, kept], |signal, column| {
            let pool =
                pools.iter_mut().find(|(of, _)| *of == signal).and_then(|(_, all)| all.get_mut(column));
            let dimension = reference.dimensions(signal).and_then(|all| all.get(column));
            let (Some(pool), Some(dimension)) = (pool, dimension) else { return f64::NAN };
            // Sorted only now: a pool is complete when its last recording is there.
            sort_keys(pool, scratch);
            wasserstein1_keys(pool, dimension.sorted())
        }))
    }
}

impl Accumulator for Pools<'_> {
    /// Any number of recordings of any length may be pooled; `recording` serves error messages only.
    fn add(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        // The accumulator is used again, and half a candidate must not stay in its pools.
        self.pool(recording, simulated).inspect_err(|_| self.clear())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        let result = self.distances();
        self.clear();
        result
    }
}
