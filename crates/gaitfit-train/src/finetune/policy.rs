//! The policy that fine-tuning trains further, and what its networks decide in the settings.

use crate::Error;
use crate::run::inputs;
use gaitfit_learn::ppo::{self, MemorySettings};
use gaitfit_policy::Policy;
use gaitfit_policy_files::weights;
use std::path::Path;

/// First updates that only the critic learns in, so that it knows the new simulator before the policy follows
/// it: with the policy's critic, and with a new one, which knows nothing yet.
const CRITIC_WARMUP: [u32; 2] = [5, 20];

/// Reads a policy, and its SHA-256 as the program writes it: weights and description count, in one file or two. Of a
/// policy without a checksum it is that of a file without one: the sum of a file of an earlier version stays the file's.
pub fn read(path: &Path) -> Result<(Policy, String), Error> {
    let policy = gaitfit_policy_files::read(path)?;
    let sealed = gaitfit_policy_files::unsealed(path)?.is_empty();
    let bytes = if sealed { weights::write(&policy)? } else { weights::plain(&policy)? };
    Ok((policy, inputs::hash(&bytes)))
}

/// Settles what the policy's networks decide.
///
/// # Errors
/// Networks asked for that are not the policy's.
pub fn settle(ppo: &mut ppo::Settings, policy: &Policy) -> Result<(), Error> {
    let defaults = ppo::Settings::default();
    let kept = |name: &str, asked: &[usize], usual: &[usize], own: &[usize]| {
        // A default is no wish: settings that nobody changed do not contradict the policy.
        if asked == own || asked == usual {
            return Ok(own.to_vec());
        }
        Err(Error::settings(format!(
            "`ppo.{name}` is {asked:?}, and the policy has {own:?}: fine-tuning keeps its networks, leave it out"
        )))
    };
    // Networks keep their shapes, because their weights are the start of the training.
    let actor = &policy.actor.shape;
    ppo.actor_hidden = kept("actor_hidden", &ppo.actor_hidden, &defaults.actor_hidden, &actor.hidden)?;
    if let Some(critic) = &policy.critic {
        let existing = &critic.shape.hidden;
        ppo.critic_hidden = kept("critic_hidden", &ppo.critic_hidden, &defaults.critic_hidden, existing)?;
    }
    if ppo.activation != defaults.activation && ppo.activation != actor.activation {
        return Err(Error::settings(format!(
            "`ppo.activation` is {:?}, and the policy has {:?}: fine-tuning keeps its networks, leave it out",
            ppo.activation, actor.activation
        )));
    }
    ppo.activation = actor.activation;
    settle_memory(ppo, policy)?;
    // A critic that begins anew needs longer until it may teach the actor.
    ppo.critic_warmup.get_or_insert(CRITIC_WARMUP[usize::from(policy.critic.is_none())]);
    Ok(())
}

/// The policy's memory counts; one of layers of several widths has no settings.
fn settle_memory(ppo: &mut ppo::Settings, policy: &Policy) -> Result<(), Error> {
    let words = |memory: &MemorySettings| {
        let MemorySettings { cell, width, layers } = *memory;
        format!("{layers} × {} of {width} units", cell.name())
    };
    let kept = policy.actor_memory().map(|memory| memory.shape()).map(|shape| MemorySettings {
        cell: shape.cell,
        width: shape.outputs(),
        layers: shape.hidden.len(),
    });
    // Settings that leave the memory open take the policy's.
    match (ppo.memory, kept) {
        (None, _) => {}
        (Some(asked), Some(kept)) if asked == kept => {}
        (Some(asked), kept) => {
            let kept = kept.as_ref().map_or_else(|| "none".to_owned(), words);
            return Err(Error::settings(format!(
                "`ppo.memory` is {}, and the policy has {kept}: fine-tuning keeps its networks, leave it out; \
                 a new policy with a memory is trained by `gaitfit train`",
                words(&asked)
            )));
        }
    }
    ppo.memory = kept;
    Ok(())
}
