//! All rules of a configuration.

use gaitfit_model::Model;
use gaitfit_model::patterns::covered;

use super::{NetworkRule, ParameterRule, RobotRule, Theta, ThetaError};
use serde::{Deserialize, Serialize};

/// The rules of a configuration, a list a kind of modification.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Rules {
    /// Parameters of joints.
    pub parameter: Vec<ParameterRule>,
    /// Networks of joints.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub network: Vec<NetworkRule>,
    /// Numbers of the robot as a whole.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub robot: Vec<RobotRule>,
}

impl Rules {
    /// Fills in defaults where rules are silent.
    pub fn resolve(&mut self) {
        self.parameter.iter_mut().for_each(ParameterRule::resolve);
        self.robot.iter_mut().for_each(RobotRule::resolve);
    }

    /// The rules for the hinges and the slides of `model`: a rule that covers both becomes two.
    ///
    /// # Errors
    /// As [`ParameterRule::by_kind`]; networks of slides.
    pub fn by_kind(self, model: &Model) -> Result<Self, ThetaError> {
        self.check_networks(model)?;
        let parts = self.parameter.iter().map(|rule| rule.by_kind(model, false));
        let parameter = parts.collect::<Result<Vec<_>, _>>()?.concat();
        Ok(Self { parameter, ..self })
    }

    /// Refuses networks that cover a slide of `model`.
    ///
    /// # Errors
    /// [`ThetaError::SlidingNetwork`].
    pub fn check_networks(&self, model: &Model) -> Result<(), ThetaError> {
        let names: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
        for rule in &self.network {
            // Patterns that do not fit are refused with the networks.
            let places = covered(&rule.joints, &model.name, &names).unwrap_or_default();
            if let Some(slide) = places.into_iter().find(|&place| !model.joints[place].kind.is_hinge()) {
                return Err(ThetaError::SlidingNetwork { joint: model.joints[slide].name.clone() });
            }
        }
        Ok(())
    }

    /// θ for a robot with these `joints`; parameters first, then networks, then the robot's numbers. `groups` are names
    /// with joint patterns; `rest` are the networks' rest angles (the policy's default pose), rad, one a joint, not
    /// looked at without networks.
    ///
    /// # Errors
    /// As the rules' own `modification` and [`Theta::new`].
    pub fn theta(
        &self,
        groups: &[(String, Vec<String>)],
        joints: &[String],
        rest: &[f64],
    ) -> Result<Theta, ThetaError> {
        let parameters = self.parameter.iter().map(|rule| rule.modification(groups, joints));
        let networks = self.network.iter().map(|rule| rule.modification(groups, joints, rest));
        let robot = self.robot.iter().map(RobotRule::modification);
        Theta::new(parameters.chain(networks).chain(robot).collect::<Result<_, _>>()?)
    }
}
