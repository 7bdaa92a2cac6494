//! This machine's processor: blocks of lanes, of the instruction set of the replay or batch.

mod along;
mod replay;
mod tile;

use gaitfit_physics::{Params, Parts, Robot, with_lanes};

use super::{Cancel, ConsumeSignals, Engine};
use crate::SimError;
use crate::batch::Batch;
use crate::candidate::{JointNetworks, modifications};
use crate::replay::{Direction, Replay};
use crate::tile::Tile;
use tile::{LaneRobots, Shared};

/// This machine's processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cpu {
    /// Threads of a replay. A tile is advanced by the thread that calls it.
    pub threads: usize,
}

impl Engine for Cpu {
    fn name(&self) -> String {
        "cpu".to_owned()
    }

    fn replay(
        &self,
        replay: &Replay,
        candidates: &[Robot],
        consume: &ConsumeSignals<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimError> {
        with_lanes!(replay.isa(), T => replay::run::<T>(replay, candidates, self.threads, consume, cancel))
    }

    fn replay_along(
        &self,
        replay: &Replay,
        directions: &[Direction],
        consume: &ConsumeSignals<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimError> {
        with_lanes!(replay.isa(), T => along::run::<T>(replay, directions, self.threads, consume, cancel))
    }

    fn tile<'a>(
        &self,
        batch: &'a Batch,
        robots: &[Params<f64>],
        networks: &[JointNetworks],
    ) -> Result<Tile<'a>, SimError> {
        if robots.is_empty() {
            let must = "at least one";
            return Err(SimError::Option {
                option: "the number of a tile's robots",
                value: "0".to_owned(),
                must,
            });
        }
        // The history of targets is only as long as the batch's longest delay.
        let delay = robots.iter().flat_map(|robot| &robot.joints).fold(0.0f64, |max, j| max.max(j.delay));
        if delay > batch.options().max_delay {
            let must = "at most the batch's max_delay";
            return Err(SimError::Option { option: "a robot's delay", value: delay.to_string(), must });
        }
        batch.check_imu_delay(robots)?;
        // All robots of a tile take the same step. A part is in it if any of them needs it.
        let modifications = modifications::<f32>(batch.model(), networks, Parts::from_params(robots))?;
        let shared = Shared {
            tree: &batch.tree,
            taps: batch.taps,
            substeps: batch.options().substeps,
            tracked: &batch.tracked,
            modifications,
        };
        Ok(with_lanes!(batch.isa(), T => Tile::new(Box::new(LaneRobots::<T>::new(robots, shared)))))
    }
}
