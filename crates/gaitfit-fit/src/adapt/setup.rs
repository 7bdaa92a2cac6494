//! Everything a fit needs.

use super::alternatives::Alternatives;
use super::limit::Limit;
use super::log_set::LogSet;
use super::method::Method;
use super::replicas::Replicas;
use super::share::Shares;
use crate::Error;
use crate::device::Devices;
use crate::settings::{AdaptConfig, Base};
use crate::walk::logs::LogNotes;
use crate::walk::swing::SwingFindings;
use crate::walk::walking::rest_angles;
use gaitfit_adapt::cost::Cost;
use gaitfit_adapt::fit::FitOptions;
use gaitfit_adapt::{JointParameter, ParameterRule, RobotNumber, Sharing, Theta};
use gaitfit_sim::Candidate;
use std::path::PathBuf;

/// Everything a fit needs.
pub struct Setup {
    /// The settings, with every default of what is fitted.
    pub config: AdaptConfig,
    /// The robot that θ changes.
    pub base: Candidate,
    /// The method by which the logs are simulated.
    pub method: Method,
    /// The fitted parameters.
    pub theta: Theta,
    /// The logs that are fitted.
    pub fit: LogSet,
    /// The same logs from several starts, where the search compares them so.
    pub several: Option<LogSet>,
    /// The logs that are not, in sets that are compared together: logs of a clamped robot one by one, as they may
    /// differ in sample rate.
    pub validate: Vec<LogSet>,
    /// Notes on the walking logs that are fitted.
    pub notes: Option<LogNotes>,
    /// The costs, in the configuration's order.
    pub costs: Vec<Box<dyn Cost>>,
    /// Simulators of the same logs that could stand in for the fit's, and how they differ: they show how far its errors
    /// move what a fit of least squares finds.
    pub alternatives: Alternatives,
    /// The robot as it makes logs, where fits of simulated ones correct that of the real ones.
    pub replicas: Option<Replicas>,
    /// Optimiser settings.
    pub options: FitOptions,
    /// Every file that was read.
    pub files: Vec<PathBuf>,
    /// Things to know before trusting the result.
    pub warnings: Vec<String>,
    /// The devices that simulate.
    pub devices: Devices,
    /// File of the settings, from which relative paths may start.
    pub config_path: PathBuf,
    /// Whether the caller gave the policy, so that it is in no file.
    pub own_policy: bool,
    /// Findings in the fitted logs without a simulation, if priors or further parameters come from them.
    pub swings: Option<SwingFindings>,
    /// The workers that simulate besides this process, if there are some.
    pub shares: Option<Shares>,
    /// Limit on the duration of the whole fit; without one it takes as long as it needs.
    pub limit: Option<Limit>,
}

impl Setup {
    /// Refuses a comparison of joints by costs that least squares are not for; `named`: θ with a spring on every joint.
    pub(super) fn check_odd_joints(&self, named: &Theta) -> Result<(), Error> {
        let (cost, search) = (self.costs[0].as_ref(), self.options.method);
        if !self.config.odd_joints || search.least_squares(cost, named).map_err(Error::settings)? {
            return Ok(());
        }
        Err(Error::settings(format!(
            "{}: `odd_joints` compares joints by least squares, which {} is not for: take \"matchr1\", or \
             \"matcho\" with optimizer.method = \"least-squares\"",
            self.config_path.display(),
            cost.name()
        )))
    }

    /// The logs that the costs compare.
    pub(crate) fn searched(&self) -> &LogSet {
        self.several.as_ref().unwrap_or(&self.fit)
    }

    /// The fitted parameters, and a spring on each of `joints`.
    pub(super) fn with_springs(&self, joints: &[String]) -> Result<Theta, Error> {
        with_springs(&self.config, &self.method, joints)
    }

    /// Whether simulations of the same values differ by their draws: of torque noise, or of the starts.
    pub(super) fn has_draws(&self) -> bool {
        let noise = RobotNumber::TorqueNoise.name();
        let fitted = self.theta.entries().iter().any(|entry| entry.kind == noise);
        fitted || self.base.torque_noise != 0.0 || self.several.is_some()
    }

    /// Whether simulated samples can be compared with the log's one by one: those of a replay always, those of a walk
    /// where the fit does so too.
    pub fn aligned(&self) -> bool {
        aligned(&self.config)
    }
}

/// See [`Setup::with_springs`].
pub(super) fn with_springs(config: &AdaptConfig, method: &Method, joints: &[String]) -> Result<Theta, Error> {
    let model = method.model();
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let (rest, wheels) = match method.walking() {
        Some(walking) => {
            (rest_angles(&walking.policy, model)?, walking.policy.interface.velocity_joints.as_slice())
        }
        // A clamped robot's angles are counted from 0.
        None => (vec![0.0; names.len()], &[][..]),
    };
    // The angle of a wheel has no place of rest that a spring could pull to.
    let joints: Vec<String> = joints.iter().filter(|joint| !wheels.contains(joint)).cloned().collect();
    // Stiffness and torque together: a spring with its rest angle unknown.
    let mut rules = config.rules();
    rules.parameter.extend([JointParameter::Stiffness, JointParameter::SpringTorque].map(|kind| {
        ParameterRule { per: Sharing::Joint, joints: joints.to_vec(), ..ParameterRule::new(kind) }
    }));
    rules
        .by_kind(model)
        .and_then(|mut rules| {
            rules.resolve();
            rules.theta(&config.groups(&names), &names, &rest)
        })
        .and_then(|theta| theta.with_priors(&config.prior, config.optimizer.prior_weight))
        .map_err(|error| Error::settings(format!("`odd_joints` puts a spring on every joint: {error}")))
}

/// See [`Setup::aligned`].
pub(super) fn aligned(config: &AdaptConfig) -> bool {
    let runs_freely = config.costs.first().is_some_and(|cost| !cost.needs_imu());
    config.base == Base::Fixed || runs_freely && config.costs.iter().any(|cost| cost.is_aligned())
}
