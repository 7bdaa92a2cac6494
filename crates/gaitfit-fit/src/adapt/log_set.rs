//! Logs, what simulates them, and what they are compared with.

use super::method::Method;
use crate::Error;
use crate::log::Log;
use crate::settings::AdaptConfig;
use crate::walk::falling::Falling;
use gaitfit_adapt::SharedSimulator;
use gaitfit_adapt::cost::{Cost, CostError, Recorded, Reference};
use gaitfit_sim::Candidate;
use std::sync::Arc;

/// Logs that are simulated and compared together.
pub struct LogSet {
    /// The logs.
    pub logs: Vec<Log>,
    /// Simulates them.
    pub simulator: Box<SharedSimulator>,
    /// Their measured side.
    pub reference: Arc<Reference>,
    /// Falls of their robot, and its time on its feet.
    pub falling: Falling,
}

impl LogSet {
    /// `logs` as `method` simulates them; θ changes `base`.
    pub fn new(
        config: &AdaptConfig,
        method: &Method,
        base: &Candidate,
        logs: Vec<Log>,
    ) -> Result<Self, Error> {
        let simulator = method.simulator(base.clone(), &logs)?;
        Self::simulated_by(simulator, config, method, logs)
    }

    /// The logs of a search that simulates each log from several starts (`simulation.starts`): `logs`, and as many copies of each
    /// as there are further starts; `None` if each log is simulated once.
    pub(super) fn from_several_starts(
        config: &AdaptConfig,
        method: &Method,
        base: &Candidate,
        logs: &[Log],
    ) -> Result<Option<Self>, Error> {
        let starts = config.starts();
        if starts < 2 {
            return Ok(None);
        }
        // All logs come once before any comes again: the simulator starts the first `logs.len()` where their
        // robots did.
        let copies = vec![logs; starts].concat();
        let simulator = method.searched(config, base.clone(), logs)?;
        Self::simulated_by(simulator, config, method, copies).map(Some)
    }

    fn simulated_by(
        simulator: Box<SharedSimulator>,
        config: &AdaptConfig,
        method: &Method,
        logs: Vec<Log>,
    ) -> Result<Self, Error> {
        let joints = method.joints();
        let skip = method.samples(config.skip_seconds(), &logs);
        if let Some(short) = logs.iter().find(|log| log.trajectory.len() <= skip) {
            return Err(Error::settings(format!(
                "`simulation.skip_seconds` is {} s, and leaves nothing of {}, which lasts {:.2} s; lower it",
                config.skip_seconds(),
                short.name,
                short.trajectory.duration()
            )));
        }
        let recorded =
            |(number, log): (usize, &Log)| Recorded::from_trajectory(&log.trajectory, &joints, number);
        let reference = || -> Result<Reference, CostError> {
            let recorded = logs.iter().enumerate().map(recorded).collect::<Result<Vec<_>, _>>()?;
            // The angle of a wheel depends on how far it has rolled, so it is not compared.
            Ok(Reference::new(joints.clone(), &recorded, skip)?.without_angles(wheels(&logs)))
        };
        let reference = reference().map_err(|error| incomparable(&logs, &error))?;
        Ok(Self { logs, simulator, reference: Arc::new(reference), falling: Falling::default() })
    }

    /// The same logs, compared in the scaling of `other` and with the falls of its robot.
    pub fn scaled_as(self, other: &Self) -> Self {
        let reference = Arc::unwrap_or_clone(self.reference).scaled_as(&other.reference);
        Self { reference: Arc::new(reference), ..self }.of_robot(other.falling)
    }

    /// The same logs of a robot that falls as often as `falling` says; see [`Reference::with_fall_rate`].
    pub fn of_robot(self, falling: Falling) -> Self {
        let reference = Arc::unwrap_or_clone(self.reference).with_fall_rate(falling.rate(&self.logs));
        Self { reference: Arc::new(reference), falling, ..self }
    }

    /// Joints with velocity targets, such as wheels: their angles are not compared.
    pub fn wheels(&self) -> &[String] {
        wheels(&self.logs)
    }

    /// The configuration's costs against these logs.
    pub fn costs(&self, config: &AdaptConfig) -> Result<Vec<Box<dyn Cost>>, Error> {
        let build =
            |kind: &gaitfit_adapt::cost::CostKind| kind.build(&self.reference, self.simulator.as_ref());
        let costs = config.costs.iter().map(build).collect::<Result<_, _>>();
        costs.map_err(|error| incomparable(&self.logs, &error))
    }
}

/// Joints of `logs` with velocity targets. All logs are of one policy.
fn wheels(logs: &[Log]) -> &[String] {
    logs.first().map_or(&[], |log| &log.trajectory.velocity_joints)
}

/// Max logs that a message names.
const MAX_NAMED: usize = 4;

/// Why `logs` cannot be compared with a simulation: the log that is to blame, or else all of them, by name.
fn incomparable(logs: &[Log], error: &CostError) -> Error {
    let name = |log: &Log| log.name.clone();
    let named = match error.recording().and_then(|number| logs.get(number)) {
        Some(log) => name(log),
        None => {
            let more = if logs.len() > MAX_NAMED { ", …" } else { "" };
            let named: Vec<String> = logs.iter().take(MAX_NAMED).map(name).collect();
            format!("{}{more}", named.join(", "))
        }
    };
    Error::failed(format!("{named}: {error}."))
}
