//! The learner in a rollout: what actor and critic remember, and what they make of observations.

use super::learner::Learner;
use crate::runtime::{Argument, Buffer, CudaError, Stream};

impl Learner {
    /// Memories of the actor and the critic in each environment, a row an environment as
    /// [`gaitfit_policy::network::Memory::append_row`] gives it; empty without memories.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn memories(&self) -> Result<[Vec<f32>; 2], CudaError> {
        Ok([self.read_f32("actor_memory")?, self.read_f32("critic_memory")?])
    }

    /// Takes up what [`Learner::memories`] of a learner of the same sizes gave.
    ///
    /// # Errors
    /// A failure of the GPU; another length.
    pub fn set_memories(&mut self, [actor, critic]: &[Vec<f32>; 2]) -> Result<(), CudaError> {
        self.write("actor_memory", actor)?;
        self.write("critic_memory", critic)
    }

    /// Starts the work that fills `mean` and `value` of the rows `from .. from + rows` of the samples from their
    /// observations: step s of a rollout is rows s · environments and on. It can be recorded in a graph.
    ///
    /// # Errors
    /// [`CudaError::Length`] for rows that are not there, [`CudaError::Launch`].
    pub fn foresee(&self, stream: &Stream, from: usize, rows: usize) -> Result<(), CudaError> {
        let expected = self.batch.rows();
        let environments = self.batch.environments;
        let remember = self.plan.remember(from / environments.max(1));
        // Memories take whole steps.
        let whole = remember.is_empty() || (rows == environments && from.is_multiple_of(environments));
        match self.plan.foresee(from, rows) {
            Some(launch) if whole && from.saturating_add(rows) <= expected => {
                remember.iter().try_for_each(|launch| self.start(stream, launch))?;
                self.start(stream, &launch)
            }
            _ => Err(CudaError::Length {
                buffer: "samples".into(),
                expected,
                found: from.saturating_add(rows),
            }),
        }
    }

    /// Starts the work that fills `value`, `rows`, from critic's observations, `rows × critic_observation`, that are not of
    /// the samples: first those of all environments now, then of episodes that were cut off, for which `remembered` has what
    /// the critic remembered of each before. It can be recorded in a graph.
    ///
    /// # Errors
    /// [`CudaError::Length`], [`CudaError::Launch`].
    pub fn foresee_values(
        &self,
        stream: &Stream,
        rows: usize,
        critic_observation: &Buffer<f32>,
        remembered: &Buffer<f32>,
        value: &Buffer<f32>,
    ) -> Result<(), CudaError> {
        let expected = rows * self.widths.critic_observation;
        let short = critic_observation.len() < expected || value.len() < rows;
        let environments = self.batch.environments;
        if self.plan.remember_tail(0).is_some() && !short {
            // The first part begins with what is remembered now, the others with what was remembered before their
            // cuts.
            for part in 0..rows / environments.max(1) {
                let Some((launches, seen, before)) = self.plan.remember_tail(part) else { continue };
                for (number, launch) in launches.iter().enumerate() {
                    let seen = (number == 0).then(|| (seen, critic_observation.into()));
                    let before = before.filter(|_| part > 0).map(|before| (before, remembered.into()));
                    let others: Vec<(usize, Argument)> = seen.into_iter().chain(before).collect();
                    self.start_with(stream, launch, &others)?;
                }
                if let Some((launch, [_, out])) = self.plan.foresee_values(part * environments, environments)
                {
                    self.start_with(stream, &launch, &[(out, value.into())])?;
                }
            }
            return Ok(());
        }
        match self.plan.foresee_values(0, rows) {
            Some((launch, [seen, out])) if !short => {
                self.start_with(stream, &launch, &[(seen, critic_observation.into()), (out, value.into())])
            }
            _ => Err(CudaError::Length {
                buffer: critic_observation.name().into(),
                expected,
                found: critic_observation.len(),
            }),
        }
    }

    /// Starts what memories forget after step `step` of a rollout that cuts off `cuts` episodes of an environment at most.
    /// `cut`: where they were cut; `remembered`: where what the critic then remembered goes. It can be recorded in a graph.
    ///
    /// # Errors
    /// [`CudaError::Launch`].
    pub fn forget(
        &self,
        stream: &Stream,
        (step, cuts): (usize, usize),
        cut: Argument,
        remembered: Argument,
    ) -> Result<(), CudaError> {
        match self.plan.forget(step, cuts) {
            Some((launch, [at, to])) => self.start_with(stream, &launch, &[(at, cut), (to, remembered)]),
            None => Ok(()),
        }
    }
}
