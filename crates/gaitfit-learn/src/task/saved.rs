//! A tile's state for checkpoints.

use gaitfit_policy::observation::Past;

use super::feet::Foot;
use super::terrain::Way;
use super::{Environment, TaskError};

/// A tile's state for a checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Everything that is a real number.
    pub numbers: Vec<f32>,
    /// Steps since each environment's episode began.
    pub steps: Vec<u32>,
}

impl Environment<'_> {
    /// Everything that changes from step to step.
    pub fn save(&mut self) -> Saved {
        let mut numbers = self.tile.save();
        numbers.extend(self.command.iter().flatten());
        numbers.extend(self.last_action.rows());
        numbers.extend(&self.turned);
        numbers.extend(self.feet.iter().flat_map(Foot::numbers));
        numbers.extend(self.ways.iter().flat_map(Way::numbers));
        numbers.extend(self.past.iter().flat_map(Past::numbers));
        Saved { numbers, steps: self.steps.clone() }
    }

    /// Takes up a saved state of the same tile.
    ///
    /// # Errors
    /// A state of another task, robot or batch.
    pub fn restore(&mut self, saved: &Saved) -> Result<(), TaskError> {
        let past: usize = self.past.iter().map(Past::size).sum();
        // A way has three numbers, see `Way::numbers`.
        let ways = 3 * self.ways.len();
        let width = 3 * self.command.len()
            + self.last_action.rows().len()
            + self.turned.len()
            + Foot::NUMBERS * self.feet.len()
            + ways
            + past;
        let foreign = TaskError::Setting {
            setting: "checkpoint".to_owned(),
            what: "is of another task, robot or number of environments".to_owned(),
        };
        // The simulator's numbers come first and are as many as the others leave. It checks their count
        // itself.
        let Some(split) = saved.numbers.len().checked_sub(width) else { return Err(foreign) };
        // No episode of this task grows older than that, unless a function of the caller lets it go on. That bound is far from
        // where steps would overflow.
        let longest = if self.task.user_terms.is_some() { u32::MAX / 2 } else { self.task.episode_steps() };
        if saved.steps.len() != self.steps.len() || saved.steps.iter().any(|&steps| steps > longest) {
            return Err(foreign);
        }
        let (tile, rest) = saved.numbers.split_at(split);
        let (commands, rest) = rest.split_at(3 * self.command.len());
        let (actions, rest) = rest.split_at(self.last_action.rows().len());
        let (turned, rest) = rest.split_at(self.turned.len());
        let (feet, rest) = rest.split_at(Foot::NUMBERS * self.feet.len());
        let (ways, past) = rest.split_at(ways);
        // All checks come before the first change. The simulator makes none if it refuses its own numbers.
        let Some(ways) = self.saved_ways(ways) else { return Err(foreign) };
        self.tile.restore(tile)?;
        // From here on nothing can fail.
        for (command, saved) in self.command.iter_mut().zip(commands.chunks_exact(3)) {
            command.copy_from_slice(saved);
        }
        self.last_action.take(actions);
        self.turned.copy_from_slice(turned);
        self.ways = ways;
        let (actor, critic) = past.split_at(self.past[0].size());
        self.past[0].restore(actor);
        self.past[1].restore(critic);
        for (foot, saved) in self.feet.iter_mut().zip(feet.as_chunks::<{ Foot::NUMBERS }>().0) {
            *foot = Foot::from_numbers(saved);
            // Numbers have the height on flat ground.
            foot.height -= self.task.walker.ground_under(foot.place);
        }
        self.steps.copy_from_slice(&saved.steps);
        self.tile.observe(&mut self.motion);
        Ok(())
    }
}
