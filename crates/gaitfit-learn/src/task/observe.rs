//! Observations of the policy and its critic on a tile of robots.

use gaitfit_policy::observation::{Layout, Past, Sensed};
use gaitfit_random::{Purpose, Stream, fill_block_rows};

use super::sensor_noise::{self, SensorNoise};
use super::{Environment, Task};

impl Environment<'_> {
    /// Writes the actor's observations, with noise and errors of the sensors; one row an environment.
    pub fn observe(&self, step: u32, rows: &mut [f32]) {
        let Task { settings, walker, .. } = self.task;
        let blocks =
            sensor_noise::blocks(&settings.noise, &walker.interface.observation, walker.joints.len());
        let mut words = vec![[0; 4]; self.count() * blocks.len()];
        let stream = Stream::new(self.seed, Purpose::OBSERVATION_NOISE).step(step);
        fill_block_rows(stream, self.first, &blocks, &mut words);
        self.write_observations(&walker.observation, &self.past[0], Some((&words, blocks.len())), rows);
    }

    /// Writes the critic's observations, one row an environment: without noise and without errors of sensors, except
    /// encoder biases.
    pub fn observe_critic(&self, rows: &mut [f32]) {
        self.write_observations(&self.task.walker.critic_observation, &self.past[1], None, rows);
    }

    /// Keeps the rows that were observed at `step`, for those of the next.
    pub(super) fn remember(&mut self, step: u32) {
        let walker = &self.task.walker;
        // Without past frames nothing is kept, and the rows need not be computed twice.
        let [actor, critic] = [&self.past[0], &self.past[1]].map(Past::is_kept);
        if actor {
            let mut rows = vec![0.0; self.count() * walker.observation.width()];
            self.observe(step, &mut rows);
            self.past[0].take(&rows);
        }
        if critic {
            let mut rows = vec![0.0; self.count() * walker.critic_observation.width()];
            self.observe_critic(&mut rows);
            self.past[1].take(&rows);
        }
    }

    /// `noise`: the words of every environment's blocks, and how many blocks each has.
    fn write_observations(
        &self,
        layout: &Layout,
        past: &Past,
        noise: Option<(&[[u32; 4]], usize)>,
        rows: &mut [f32],
    ) {
        let Task { settings, walker, .. } = self.task;
        let mut sensed = Sensed::new(walker.joints.len());
        // A critic without an observation has rows of no width, which chunks refuse.
        for (index, row) in rows.chunks_exact_mut(layout.width().max(1)).enumerate() {
            match noise {
                Some(_) => walker.sense(&self.motion, index, self.imu(index), &mut sensed),
                None => walker.sense_without_errors(&self.motion, index, &mut sensed),
            }
            sensed.command = self.command[index];
            sensed.last_action.copy_from_slice(self.last_action.row(index));
            sensed.clock = self.clock(index);
            sensed.motion = self.motion_place(index);
            match noise {
                Some((words, blocks)) => {
                    let words = &words[index * blocks..(index + 1) * blocks];
                    let mut noise = SensorNoise::new(&settings.noise, words);
                    let corrupt = |quantity, values: &mut [f32]| noise.add(quantity, values);
                    layout.write(&sensed, past.row(index), corrupt, row);
                }
                None => layout.write(&sensed, past.row(index), |_, _| (), row),
            }
        }
    }
}
