//! Whether the parts of a policy fit each other.

use crate::error::invalid;
use crate::network::{MOST_PARAMETERS, Network, Normaliser};
use crate::{Policy, PolicyError, Term};

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
        self.check_network("actor", &self.actor, "observation", &interface.observation)?;
        if self.actor.shape.outputs != joints {
            return Err(invalid(format!(
                "the interface names {joints} joints, the actor gives {} actions; they must be as many, in the \
                 same order",
                self.actor.shape.outputs
            )));
        }
        if self.log_std.len() != joints {
            let found = self.log_std.len();
            return Err(invalid(format!(
                "log_std has {found} numbers for {joints} joints; give one a joint"
            )));
        }
        finite("log_std", &self.log_std)?;
        if let Some(critic) = &self.critic {
            self.check_network("critic", critic, "critic_observation", &interface.critic_observation)?;
            if critic.shape.outputs != 1 {
                let found = critic.shape.outputs;
                return Err(invalid(format!("the critic has {found} outputs; it must give one value")));
            }
        } else if self.critic_normaliser.is_some() {
            return Err(invalid("there is a critic_normaliser, but no critic; leave it out"));
        }
        check_normaliser("normaliser", self.normaliser.as_ref(), self.actor.shape.inputs)?;
        let critic_inputs = self.critic.as_ref().map_or(0, |critic| critic.shape.inputs);
        check_normaliser("critic_normaliser", self.critic_normaliser.as_ref(), critic_inputs)
    }

    fn check_network(
        &self,
        name: &str,
        network: &Network,
        observation: &str,
        terms: &[Term],
    ) -> Result<(), PolicyError> {
        network.shape.check()?;
        let expected = checked_parameters(network)
            .filter(|&count| count <= MOST_PARAMETERS)
            .ok_or_else(|| invalid(format!("the {name} has more than {MOST_PARAMETERS} parameters")))?;
        if network.parameters.len() != expected {
            let (shape, found) = (&network.shape, network.parameters.len());
            return Err(invalid(format!("the {name} ({shape}) has {found} parameters, it needs {expected}")));
        }
        let taken = network.shape.inputs;
        let layout = self.interface.describe(terms);
        if terms.is_empty() {
            return Err(invalid(format!("{observation} has no terms, the {name} takes {taken} numbers")));
        }
        if self.interface.width(terms) != taken {
            return Err(invalid(format!("{observation} is {layout}, the {name} takes {taken}")));
        }
        finite(name, &network.parameters)
    }
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
