//! Whether the parts of a policy fit each other.

use crate::error::invalid;
use crate::network::{Activation, MAX_PARAMETERS, Network, Normaliser, Recurrent};
use crate::{Encoder, Front, Policy, PolicyError, Term};

impl Policy {
    /// Checks the interface, then every network, normaliser and number against it.
    ///
    /// # Errors
    /// The first mismatch, for example `observation is 45 numbers (3 base_angular_velocity + …), the actor
    /// takes 48`.
    pub fn check(&self) -> Result<(), PolicyError> {
        self.interface.check()?;
        let interface = &self.interface;
        let joints = interface.joints.len();
        // What stands first sees the observation; the actor sees what it gives.
        let (seer, observed) = match &self.front {
            None => ("actor", self.actor.shape.inputs),
            Some(front) => (front.name(), front.inputs()),
        };
        // The actor itself comes first: its widths are compared below.
        check_network("actor", &self.actor)?;
        self.check_width(seer, observed, "observation", &interface.observation)?;
        if let Some(front) = &self.front {
            check_front(front, &self.actor)?;
        }
        if self.actor.shape.outputs != joints {
            return Err(invalid(format!(
                "joints names {joints} joints, the actor gives {} actions; they must be as many, in the \
                 same order",
                self.actor.shape.outputs
            )));
        }
        if self.log_std.len() != joints {
            let count = self.log_std.len();
            return Err(invalid(format!(
                "log_std has {count} numbers for {joints} joints; give one a joint"
            )));
        }
        finite("log_std", &self.log_std)?;
        // All parts of a critic are optional, but none may stand without the critic itself.
        if let Some(critic) = &self.critic {
            check_network("critic", critic)?;
            let terms = &interface.critic_observation;
            if let Some(memory) = &self.critic_memory {
                check_recurrent("critic's memory", memory)?;
                check_given("critic's memory", memory.outputs(), "critic", critic)?;
                self.check_width("critic's memory", memory.inputs(), "critic_observation", terms)?;
            } else {
                self.check_width("critic", critic.shape.inputs, "critic_observation", terms)?;
            }
            if critic.shape.outputs != 1 {
                let outputs = critic.shape.outputs;
                return Err(invalid(format!("the critic has {outputs} outputs; it must give one value")));
            }
        } else if self.critic_normaliser.is_some() {
            return Err(invalid("there is a critic_normaliser, but no critic; leave it out"));
        } else if self.critic_memory.is_some() {
            return Err(invalid("there is a critic_memory, but no critic; leave it out"));
        }
        check_normaliser("normaliser", self.normaliser.as_ref(), observed)?;
        // The normaliser stands before the critic's memory, if there is one.
        let behind = self.critic_memory.as_ref().map(Recurrent::inputs);
        // Without a critic there is no normaliser for it (checked above), so the 0 is not compared with anything.
        let critic_inputs = behind.or(self.critic.as_ref().map(|critic| critic.shape.inputs)).unwrap_or(0);
        check_normaliser("critic_normaliser", self.critic_normaliser.as_ref(), critic_inputs)
    }

    fn check_width(
        &self,
        name: &str,
        taken: usize,
        observation: &str,
        terms: &[Term],
    ) -> Result<(), PolicyError> {
        let layout = self.interface.describe(terms);
        if terms.is_empty() {
            return Err(invalid(format!("{observation} has no terms, the {name} takes {taken} numbers")));
        }
        if self.interface.width(terms) != taken {
            return Err(invalid(format!("{observation} is {layout}, the {name} takes {taken}")));
        }
        Ok(())
    }
}

/// Checks a network's sizes and numbers.
fn check_network(name: &str, network: &Network) -> Result<(), PolicyError> {
    network.shape.check()?;
    // Sizes come from files: their product may overflow.
    let expected = checked_parameters(network)
        .filter(|&count| count <= MAX_PARAMETERS)
        .ok_or_else(|| invalid(format!("the {name} has more than {MAX_PARAMETERS} parameters")))?;
    if network.parameters.len() != expected {
        let (shape, count) = (&network.shape, network.parameters.len());
        return Err(invalid(format!("the {name} ({shape}) has {count} parameters, it needs {expected}")));
    }
    network.check()?;
    let sound = |activation: &Activation| activation.is_sound();
    if !sound(&network.shape.activation) || !network.output.as_ref().is_none_or(sound) {
        return Err(invalid(format!("the {name} has an activation whose parameter is out of range")));
    }
    for norm in network.norms.iter().flatten() {
        finite(name, &norm.weight)?;
        finite(name, &norm.bias)?;
    }
    finite(name, &network.parameters)
}

/// Checks what stands before the actor.
fn check_front(front: &Front, actor: &Network) -> Result<(), PolicyError> {
    let name = front.name();
    match front {
        Front::Recurrent(recurrent) => check_recurrent(name, recurrent)?,
        Front::Encoder(Encoder { network, passed, .. }) => {
            // Its width is not compared with the observation's here: `check` has done so for every front.
            check_network(name, network)?;
            if let Some(place) = passed.iter().find(|&&place| place >= network.shape.inputs) {
                let width = network.shape.inputs;
                return Err(invalid(format!("the actor sees number {place} of an observation of {width}")));
            }
        }
        Front::Function(_) | Front::Graph(_) => {}
    }
    check_given(name, front.outputs(), "actor", actor)
}

/// Checks that a network takes what stands before it gives.
fn check_given(name: &str, given: usize, behind: &str, network: &Network) -> Result<(), PolicyError> {
    let taken = network.shape.inputs;
    if given != taken {
        return Err(invalid(format!("the {name} gives {given} numbers, the {behind} takes {taken}")));
    }
    Ok(())
}

/// Checks recurrent layers' sizes and numbers.
fn check_recurrent(name: &str, recurrent: &Recurrent) -> Result<(), PolicyError> {
    if let Some(mistake) = recurrent.mistake() {
        return Err(invalid(format!("the {name} does not fit together: {mistake}")));
    }
    recurrent.parameters().try_for_each(|values| finite(name, values))
}

/// [`crate::network::Shape::parameters`] that does not overflow.
fn checked_parameters(network: &Network) -> Option<usize> {
    let shape = &network.shape;
    let mut inputs = shape.inputs;
    let mut count = 0_usize;
    for &outputs in shape.hidden.iter().chain([&shape.outputs]) {
        count = count.checked_add(inputs.checked_mul(outputs)?)?.checked_add(outputs)?;
        inputs = outputs;
    }
    Some(count)
}

fn finite(name: &str, values: &[f32]) -> Result<(), PolicyError> {
    match values.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(bad) => Err(invalid(format!("the {name} holds {bad}; a policy's numbers must be finite"))),
    }
}

fn check_normaliser(name: &str, normaliser: Option<&Normaliser>, width: usize) -> Result<(), PolicyError> {
    let Some(normaliser) = normaliser else { return Ok(()) };
    let (mean, variance) = (normaliser.mean.len(), normaliser.variance.len());
    if mean != width || variance != width {
        return Err(invalid(format!(
            "{name} has {mean} means and {variance} variances, its network takes {width} numbers"
        )));
    }
    // A variance of 0 is allowed: a constant is added before the root is divided by.
    let good = normaliser.mean.iter().all(|mean| mean.is_finite())
        && normaliser.variance.iter().all(|variance| variance.is_finite() && *variance >= 0.0)
        && normaliser.count.is_finite()
        && normaliser.count >= 0.0;
    if good {
        Ok(())
    } else {
        Err(invalid(format!(
            "{name} must hold finite means, and variances and a count that are not negative"
        )))
    }
}
