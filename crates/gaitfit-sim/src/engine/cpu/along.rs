//! The derivatives of a replay, in blocks of lanes over threads: each lane takes a direction of its own.

use gaitfit_physics::{Differentiable, Dual, Params, Parts, Robot, State};

use super::replay::{Block, Lane, Recorder, full, jobs, params};
use crate::engine::{Cancel, ConsumeSignals};
use crate::replay::{Direction, Replay};
use crate::{SimError, pool};

/// See [`crate::engine::Engine::replay_along`].
pub(super) fn run<T: Differentiable>(
    replay: &Replay,
    directions: &[Direction],
    threads: usize,
    consume: &ConsumeSignals<'_>,
    cancel: &Cancel<'_>,
) -> Result<(), SimError> {
    if let Some(wrong) = directions.iter().find(|one| !(one.distance > 0.0 && one.distance.is_finite())) {
        let value = wrong.distance.to_string();
        return Err(SimError::Option { option: "a direction's distance", value, must: "positive" });
    }
    let robots: Vec<Robot> = directions.iter().map(|direction| direction.robot.clone()).collect();
    let here = params(replay, &robots)?;
    // What lies beside is not simulated, and may be beyond the longest delay.
    let beside = |robot: &Robot| robot.params(&replay.model);
    let ahead = directions.iter().map(|one| beside(&one.ahead)).collect::<Result<Vec<_>, _>>()?;
    let behind = directions.iter().map(|one| beside(&one.behind)).collect::<Result<Vec<_>, _>>()?;
    let jobs = jobs(replay, directions.len());
    let width = T::LANES;
    let blocks: Vec<&[(usize, usize)]> = jobs.chunks(width).collect();
    pool::for_each(
        blocks.len(),
        threads,
        || (Block::<Dual<T>>::new(&replay.tree, replay.taps), Recorder::new(replay, width)),
        |(block, recorder), index| {
            let (mut lanes, mut rates) = (Vec::new(), Vec::new());
            for &(at, recording) in blocks[index] {
                let direction = &directions[at];
                let lane = |robot, params| Lane::new(replay, recording, robot, params);
                let (up, down) = (lane(&direction.ahead, &ahead[at]), lane(&direction.behind, &behind[at]));
                lanes.push(lane(&direction.robot, &here[at]));
                rates.push(up.rate(&down, direction.distance));
            }
            // The recorder adds encoder biases; to derivatives it adds those of the biases.
            recorder.begin(replay, &rates);
            let rate = Params::<T>::in_lanes(&full(&rates, width));
            let values = Params::<T>::in_lanes(&full(&lanes, width));
            let packed = Params::along(&values, &rate);
            // The angle at the start is what the encoder read, less its bias.
            let seed = |state: &mut State<Dual<T>>| {
                for (angle, joint) in state.qpos.iter_mut().zip(&rate.joints) {
                    angle.tangent = -joint.encoder_bias;
                }
            };
            let record = |sample: usize, state: &State<Dual<T>>, beyond: &[Dual<T>]| {
                let beyond: Vec<T> = beyond.iter().map(|number| number.tangent).collect();
                let numbers = |j: usize| [state.qpos[j], state.qvel[j], state.qacc[j]];
                recorder.record(sample, &beyond, |j| numbers(j).map(|number| number.tangent));
            };
            let parts_of = |lanes: &[Lane]| Parts::from_params(lanes.iter().map(|lane| &lane.params));
            // A direction may change a lag of 0, so the filter is there too. Gears are there only if the robot has them.
            let parts =
                Parts { filter: parts_of(&lanes).filter || parts_of(&rates).filter, ..parts_of(&lanes) };
            if !block.run(replay, &lanes, (&packed, parts), seed, record, cancel) {
                return;
            }
            for (slopes, &(direction, recording)) in recorder.signals.iter().zip(blocks[index]) {
                consume(direction, recording, slopes);
            }
        },
    );
    Ok(())
}
