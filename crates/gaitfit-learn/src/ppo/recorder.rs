//! One rollout in any simulator: the learner's actions out, what came of them in.

use gaitfit_policy::network::{Memory, Scratch};

use super::{Exploration, Learner, Samples};

/// State of an episode after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// It continues.
    #[default]
    No,
    /// It is over: no reward can follow.
    Terminated,
    /// It was cut off, for example when its time was up: it would have gone on, so the critic's value of the state
    /// reached stands for the rewards that follow.
    Truncated,
}

/// Fills [`Samples`] step by step. It knows nothing of the simulator:
///
/// ```text
/// recorder.begin();
/// for each step {
///     write the rows of recorder.observations()
///     recorder.act(&learner, number)
///     step the simulator with recorder.exchange(): actions in, rewards out
///     recorder.end(&learner, &ends, |rows| write the critic's observations of the states reached)
///     start new episodes where they ended
/// }
/// recorder.finish(&learner, |rows| write the critic's observations)
/// learner.update(&mut [recorder.samples], …)
/// ```
pub struct Recorder {
    /// The recorded batch; whole after [`Recorder::finish`].
    pub samples: Samples,
    exploration: Exploration,
    /// Step being recorded.
    step: usize,
    /// Memories of the actor and of the critic; empty before the first step and without recurrent layers.
    memories: [Memory; 2],
    critic_rows: Vec<f32>,
    values: Vec<f32>,
    scratch: Scratch,
}

impl Recorder {
    /// A recorder with room in `samples` ([`Samples::new`]); `exploration` draws for its environments.
    pub fn new(samples: Samples, exploration: Exploration) -> Self {
        let (critic_rows, values) = (Vec::new(), Vec::new());
        let memories = [Memory::default(), Memory::default()];
        Self { samples, exploration, step: 0, memories, critic_rows, values, scratch: Scratch::new() }
    }

    /// Starts a rollout over what was recorded before.
    pub fn begin(&mut self) {
        self.step = 0;
    }

    /// Rows of the present step for the actor's and the critic's observations, raw (the learner normalises them):
    /// `environments × observation` and `environments × critic_observation`.
    ///
    /// # Panics
    /// If all steps of the samples are recorded: an error of the caller.
    pub fn observations(&mut self) -> (&mut [f32], &mut [f32]) {
        let Samples { environments, widths, .. } = self.samples;
        let rows = self.step * environments..(self.step + 1) * environments;
        let range = |width: usize| rows.start * width..rows.end * width;
        let Samples { observation, critic_observation, .. } = &mut self.samples;
        (
            &mut observation[range(widths.observation)],
            &mut critic_observation[range(widths.critic_observation)],
        )
    }

    /// Draws the actions of the present step under the learner's policy, and foresees its values. `number`: of the
    /// step, used once in a training.
    ///
    /// # Panics
    /// If all steps of the samples are recorded, or the learner has rows of other widths: errors of the caller.
    pub fn act(&mut self, learner: &Learner, number: u32) {
        let Samples { environments, widths, .. } = self.samples;
        self.remember(learner, environments);
        let rows = self.step * environments..(self.step + 1) * environments;
        let range = |width: usize| rows.start * width..rows.end * width;
        let samples = &mut self.samples;
        let [actor_memory, critic_memory] = &mut self.memories;
        // The update computes the rollout again from here; later memories follow from the observations.
        if self.step == 0 {
            samples.actor_memory.clone_from(actor_memory);
            samples.critic_memory.clone_from(critic_memory);
        }
        let mean = &mut samples.mean[range(widths.action)];
        let seen = &samples.observation[range(widths.observation)];
        learner.means_with(environments, seen, actor_memory, mean, &mut self.scratch);
        let seen = &samples.critic_observation[range(widths.critic_observation)];
        let value = &mut samples.value[rows.clone()];
        learner.values_with(environments, seen, critic_memory, value, &mut self.scratch);
        let action = &mut samples.action[range(widths.action)];
        let log_probability = &mut samples.log_probability[rows.clone()];
        self.exploration.draw(learner.log_std(), number, mean, action, log_probability);
    }

    /// The present step's actions, `environments × action`, and where its rewards go; `environments`.
    pub fn exchange(&mut self) -> (&[f32], &mut [f32]) {
        let Samples { environments, widths, .. } = self.samples;
        let rows = self.step * environments..(self.step + 1) * environments;
        let Samples { action, reward, .. } = &mut self.samples;
        (&action[rows.start * widths.action..rows.end * widths.action], &mut reward[rows])
    }

    /// Closes the present step. `ends`: how each episode stands; `observe_critic` writes the critic's observations of
    /// the states reached, and is called if an episode was truncated: its last reward gets γ V of that state.
    ///
    /// # Panics
    /// If `ends` is not one an environment: an error of the caller.
    pub fn end(&mut self, learner: &Learner, ends: &[End], observe_critic: impl FnOnce(&mut [f32])) {
        let environments = self.samples.environments;
        assert_eq!(ends.len(), environments, "one end an environment");
        let rows = self.step * environments..(self.step + 1) * environments;
        // Both kinds of end stop the sum of advantages. A truncation differs only by the value that its reward gets
        // below.
        for (done, end) in self.samples.done[rows.clone()].iter_mut().zip(ends) {
            *done = if *end == End::No { 0.0 } else { 1.0 };
        }
        // Without an episode that was cut off the critic need not run.
        if ends.contains(&End::Truncated) {
            self.foresee(learner, observe_critic);
            let gamma = learner.settings().gamma as f32;
            let rewards = self.samples.reward[rows].iter_mut().zip(&self.values);
            for ((reward, value), _) in rewards.zip(ends).filter(|(_, end)| **end == End::Truncated) {
                *reward += gamma * value;
            }
        }
        // After the truncated states were valued: their memories must still be those of the old episode.
        for (index, _) in ends.iter().enumerate().filter(|(_, end)| **end != End::No) {
            self.memories.iter_mut().for_each(|memory| memory.begin(index));
        }
        self.step += 1;
    }

    /// Closes the rollout: `observe_critic` writes the critic's observations after the last step.
    pub fn finish(&mut self, learner: &Learner, observe_critic: impl FnOnce(&mut [f32])) {
        self.foresee(learner, observe_critic);
        self.samples.last_value.copy_from_slice(&self.values);
    }

    /// Memories of the learner's actor and critic for the `environments`, for a file.
    pub(crate) fn memories(&mut self, learner: &Learner, environments: usize) -> [Vec<f32>; 2] {
        self.remember(learner, environments);
        self.memories.each_ref().map(Memory::numbers)
    }

    /// Takes up what [`Recorder::memories`] gave; `false` for what is of another learner or other environments.
    pub(crate) fn set_memories(
        &mut self,
        learner: &Learner,
        environments: usize,
        numbers: &[Vec<f32>; 2],
    ) -> bool {
        self.memories = learner.blank_memories(environments);
        self.memories.iter_mut().zip(numbers).all(|(memory, numbers)| memory.set_numbers(numbers))
    }

    /// Appends what is remembered of each of the `environments`, a row an environment, to the actor's and the critic's.
    pub(crate) fn append_memories(
        &mut self,
        learner: &Learner,
        environments: usize,
        all: &mut [Vec<f32>; 2],
    ) {
        self.remember(learner, environments);
        for (memory, all) in self.memories.iter().zip(all) {
            (0..environments).for_each(|index| memory.append_row(index, all));
        }
    }

    /// Takes up such rows from the beginning of `rest`, which loses them; `false` for too few.
    pub(crate) fn take_memories(
        &mut self,
        learner: &Learner,
        environments: usize,
        rest: &mut [&[f32]; 2],
    ) -> bool {
        self.memories = learner.blank_memories(environments);
        // A row that does not fit is noted and the others are taken all the same, so that `rest` moves on by
        // whole rows.
        let mut fits = true;
        for (memory, rest) in self.memories.iter_mut().zip(rest) {
            let width = memory.width();
            for index in 0..environments {
                let (row, others) = rest.split_at(width.min(rest.len()));
                fits &= memory.set_row(index, row);
                *rest = others;
            }
        }
        fits
    }

    /// Before the first step all episodes begin.
    fn remember(&mut self, learner: &Learner, environments: usize) {
        if self.memories.iter().all(Memory::is_empty) {
            self.memories = learner.blank_memories(environments);
        }
    }

    /// Values of the states that `observe_critic` writes. The critic's memory stays before them: if an episode continues, the
    /// next step shows it the state.
    fn foresee(&mut self, learner: &Learner, observe_critic: impl FnOnce(&mut [f32])) {
        let Samples { environments, widths, .. } = self.samples;
        self.critic_rows.resize(environments * widths.critic_observation, 0.0);
        observe_critic(&mut self.critic_rows);
        self.values.resize(environments, 0.0);
        // A copy, because looking ahead must not advance the memory.
        let mut memory = self.memories[1].clone();
        learner.values_with(
            environments,
            &self.critic_rows,
            &mut memory,
            &mut self.values,
            &mut self.scratch,
        );
    }
}
