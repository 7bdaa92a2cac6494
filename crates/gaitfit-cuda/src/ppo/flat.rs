//! A learner's numbers in the order of the GPU's arrays: both networks and the spread, and both memories apart.

use gaitfit_learn::ppo;

use super::prepared::memories;
use gaitfit_policy::network::RecurrentShape;

/// Parameters, and first and second moments of Adam behind each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Flat {
    /// Actor, critic, ln σ.
    pub parameters: Vec<f32>,
    /// Adam's first and second moments of the parameters, in the same order.
    pub moments: Vec<f32>,
    /// The actor's memory and the critic's, in the order of `RecurrentShape::parts`; empty without memories.
    pub memories: Vec<f32>,
    /// Adam's first and second moments of the memories, in the same order.
    pub memory_moments: Vec<f32>,
}

/// Sizes of actor, its memory, critic, its memory: the CPU's order, with the spread behind them.
fn sizes(learner: &ppo::Learner) -> [usize; 4] {
    let memories = memories(learner).map(|shapes| shapes.each_ref().map(RecurrentShape::parameters));
    let [actor_memory, critic_memory] = memories.unwrap_or([0; 2]);
    [learner.actor().parameters.len(), actor_memory, learner.critic().parameters.len(), critic_memory]
}

impl Flat {
    /// The state of a learner on the CPU.
    pub fn new(learner: &ppo::Learner) -> Self {
        let [actor, critic, log_std, first, second] = learner.tensors().map(|(_, numbers)| numbers);
        let sizes = sizes(learner);
        let apart = |moments: &[f32]| -> [Vec<f32>; 2] {
            let mut rest = moments;
            let parts = sizes.map(|size| {
                let (part, others) = rest.split_at(size);
                rest = others;
                part
            });
            // Networks and spread together, memories apart: the GPU has a kernel of Adam for each.
            [[parts[0], parts[2], rest].concat(), [parts[1], parts[3]].concat()]
        };
        let ([first, of_memories], [second, second_of_memories]) = (apart(first), apart(second));
        let memories = learner.memory_tensors();
        Self {
            parameters: [actor, critic, log_std].concat(),
            moments: [first, second].concat(),
            memories: memories.iter().flat_map(|(_, numbers)| numbers.iter().copied()).collect(),
            memory_moments: [of_memories, second_of_memories].concat(),
        }
    }

    /// The tensors of a learner of the same shapes, by their names; `networks`: sizes of actor and critic.
    pub(super) fn parts(
        &self,
        [actor, critic]: [usize; 2],
        learner: &ppo::Learner,
    ) -> Vec<(String, Vec<f32>)> {
        let Self { parameters, moments, memories, memory_moments } = self;
        let [_, actor_memory, ..] = sizes(learner);
        let (first, second) = moments.split_at(moments.len() / 2);
        let (memory_first, memory_second) = memory_moments.split_at(memory_moments.len() / 2);
        let together = |networks: &[f32], memories: &[f32]| {
            let (of_actor, of_critic) = memories.split_at(actor_memory.min(memories.len()));
            [
                &networks[..actor],
                of_actor,
                &networks[actor..actor + critic],
                of_critic,
                &networks[actor + critic..],
            ]
            .concat()
        };
        let mut parts = vec![
            ("actor".to_owned(), parameters[..actor].to_vec()),
            ("critic".to_owned(), parameters[actor..actor + critic].to_vec()),
            ("log_std".to_owned(), parameters[actor + critic..].to_vec()),
            ("adam.first".to_owned(), together(first, memory_first)),
            ("adam.second".to_owned(), together(second, memory_second)),
        ];
        let mut rest = &memories[..];
        for (name, numbers) in learner.memory_tensors() {
            let (part, others) = rest.split_at(numbers.len().min(rest.len()));
            parts.push((name, part.to_vec()));
            rest = others;
        }
        parts
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_learn::ppo::{MemorySettings, Settings, Widths, bench::synthetic};

    #[test]
    fn a_learner_comes_back_as_it_went() {
        let widths = Widths { observation: 7, critic_observation: 9, action: 3 };
        for memory in [None, Some(MemorySettings { width: 6, layers: 2, ..MemorySettings::default() })] {
            let hidden = vec![8];
            let settings = Settings {
                actor_hidden: hidden.clone(),
                critic_hidden: hidden,
                memory,
                ..Settings::default()
            };
            let mut learner = ppo::Learner::new(settings.clone(), widths, 5).unwrap();
            learner.update(&mut synthetic(&learner, 1, 16, 8, 1), 0, 1).unwrap();
            let flat = Flat::new(&learner);
            assert_eq!(flat.moments.len(), 2 * flat.parameters.len());
            assert_eq!(
                (flat.memory_moments.len(), flat.memories.is_empty()),
                (2 * flat.memories.len(), memory.is_none())
            );
            let sizes = [learner.actor().parameters.len(), learner.critic().parameters.len()];
            let parts = flat.parts(sizes, &learner);
            let mut other = ppo::Learner::new(settings, widths, 6).unwrap();
            let find =
                |name: &str| parts.iter().find(|(known, _)| known == name).map(|(_, numbers)| &numbers[..]);
            other.restore(find, &learner.scalars()).unwrap();
            assert!(
                other.tensors() == learner.tensors() && other.memory_tensors() == learner.memory_tensors()
            );
        }
    }
}
