//! Reads and checks everything a fit needs, before anything is written.

use super::alternatives::alternatives;
use super::ignored::ignored;
use super::inputs::{self, Logs, Robot};
use super::log_set::LogSet;
use super::method::Method;
use super::replicas::Replicas;
use super::robots;
use super::setup::{Setup, with_springs};
use super::swing_correction;
use super::{known, swing};
use crate::air::logs as air_logs;
use crate::device::Devices;
use crate::gpu_ahead;
use crate::log::Log;
use crate::settings::{AdaptConfig, check};
use crate::walk::remedy::Remedies;
use crate::walk::rule_joints;
use crate::walk::self_contact;
use crate::walk::sized;
use crate::walk::swing::{SwingFindings, SwingNumber};
use crate::walk::walking::{self, rest_angles};
use crate::watch::Watch;
use crate::{Error, theta};
use gaitfit_adapt::fit::Method as Search;
use gaitfit_adapt::{Entry, ParameterRule, RobotRule, Theta, ThetaError};
use gaitfit_model::{Model, shown};
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use std::path::Path;

/// A prior so far beyond a bound, as a part of the range, is no scatter about the bound.
const BEYOND: f64 = 0.01;

impl Setup {
    /// See [`super::Opening::open`].
    pub(super) fn read_all(
        config: &AdaptConfig,
        config_path: &Path,
        threads: Option<usize>,
        devices: &Devices,
        given: Option<&Policy>,
        watch: &Watch<'_>,
    ) -> Result<Self, Error> {
        let given_config = config;
        let mut config = with_defaults(config, devices);
        // Settings that contradict each other are refused before any file is read.
        check::check(&config, config_path)?;
        let Robot { model, policy, base, known, mut files } = Robot::read(&config, config_path, given)?;
        let joints = crate::robot::joint_names(&model);
        let in_file = |error: ThetaError| Error::settings(format!("{}: {error}", config_path.display()));
        // Only the robot's file says which joints slide.
        let stated = &given_config.by_kind(&model).map_err(in_file)?;
        config = with_defaults(stated, devices);
        config.groups = config.groups(&joints).into_iter().collect();
        let robot_line = policy.as_ref().and_then(|policy| unnamed(&config.robot, policy, &model));
        let in_robot = |error: Error| with_robot(error, robot_line.as_deref(), config_path);
        let (mut rest, mut feet) = (vec![0.0; joints.len()], None);
        if let Some(policy) = &policy {
            rest = rest_angles(policy, &model).map_err(in_robot)?;
            feet = Some(walking::feet(&config, policy, &model).map_err(in_robot)?);
            // `stated` has what the user wrote. Only settings that the user left open may follow the robot's
            // size.
            set_walk_defaults(&mut config, stated, policy, &model, &joints, feet)?;
        }
        let mut theta = config.rules().theta(&config.groups(&joints), &joints, &rest).map_err(in_file)?;
        let (walker, robot, gpus) = (policy.clone(), model.clone(), devices.open()?);
        let mut method = inputs::method(&config, policy, model, &theta, &base, threads).map_err(in_robot)?;
        let mut warnings = remarks(&method, walker.as_ref(), &robot);
        if let Some((path, file)) = &known {
            warnings.extend(theta::doubts(file, path, method.model(), method.physics_step()));
            warnings.extend(known::replaced(file, path, &theta));
        }
        let logs = Logs::read(&config, config_path, &method)?;
        // Only the logs show which parts touch, so the simulator may have to be made anew.
        if let Some(touching) = touching(&config, &method, &robot, feet, &logs.fit) {
            warnings.extend(touching.notes);
            if touching.chosen.is_some() {
                config.simulation.self_contact = touching.chosen;
                method = inputs::method(&config, walker.clone(), robot.clone(), &theta, &base, threads)?;
            }
        }
        let method = method.on(gpus.clone());
        // The GPU's program is compiled while legs in the air are examined.
        let _ahead = method.walking().map(|walking| gpu_ahead::compile_ahead(walking, &theta, &base));
        files.extend(logs.files());
        warnings.extend(logs.warnings.iter().cloned());
        let swings = swings(&config, &method, walker.as_ref(), &robot, &theta, &base, &logs.fit, watch)?;
        let (numbers, notes) =
            what_logs_show(&mut config, swings.as_ref(), &method, &theta, &base, &joints, feet);
        warnings.extend(notes);
        // Built a second time, because remedies may have added parameters to the settings.
        theta = config.rules().theta(&config.groups(&joints), &joints, &rest).map_err(in_file)?;
        // The folder keeps them, as it keeps the defaults.
        config.prior = known::priors(&theta, &numbers, &config.prior);
        let theta = theta.with_priors(&config.prior, config.optimizer.prior_weight).map_err(in_file)?;
        let named =
            if config.odd_joints { with_springs(&config, &method, &method.joints())? } else { theta.clone() };
        warnings.extend(unused(stated, &named, &logs.validate)?);
        let falling = logs.falling;
        // Every set gets the falls of all logs, because all logs are of one robot.
        let several =
            LogSet::from_several_starts(&config, &method, &base, &logs.fit)?.map(|set| set.of_robot(falling));
        let fit = LogSet::new(&config, &method, &base, logs.fit)?.of_robot(falling);
        let other = |config: &AdaptConfig| {
            Ok(inputs::method(config, walker.clone(), robot.clone(), &theta, &base, threads)?
                .on(gpus.clone()))
        };
        let alternatives = alternatives(&config, &method, &other, &base, &fit.logs)?;
        let replicas = replicas(&config, &method, walker.as_ref(), &robot, &theta, &base, &fit.logs)?;
        let set = |logs| Ok(LogSet::new(&config, &method, &base, logs)?.of_robot(falling));
        let validate = logs.validate.into_iter().map(set).collect::<Result<Vec<_>, Error>>()?;
        let mut setup = Self {
            costs: several.as_ref().unwrap_or(&fit).costs(&config)?,
            options: check::options(&config, fit.reference.fall_rate(), falling.falls),
            notes: logs.notes,
            alternatives,
            replicas,
            config,
            base,
            method,
            theta,
            fit,
            several,
            validate,
            files,
            warnings,
            devices: devices.clone(),
            config_path: config_path.to_owned(),
            own_policy: given.is_some(),
            swings,
            shares: None,
            limit: None,
        };
        // Whether draws decide over falls is known only here: it depends on θ, the base robot and the starts.
        setup.options.falls.random = setup.has_draws();
        setup.warnings.extend(constant(&setup.fit));
        setup.warnings.extend(ignored(&setup));
        setup.check_odd_joints(&named)?;
        Ok(setup)
    }
}

/// Findings in `logs` without a simulation, if priors or further parameters come from them; corrected by simulated
/// robots if priors of `theta` do.
#[allow(clippy::too_many_arguments, reason = "all that a fit has read")]
fn swings(
    config: &AdaptConfig,
    method: &Method,
    policy: Option<&Policy>,
    model: &Model,
    theta: &Theta,
    base: &Candidate,
    logs: &[Log],
    watch: &Watch<'_>,
) -> Result<Option<SwingFindings>, Error> {
    if !config.swings && !config.effects {
        return Ok(None);
    }
    let mut swings = swing::findings(method, logs, watch);
    if watch.stop() {
        return Err(Error::interrupted_with_nothing("interrupted before the fit began"));
    }
    let is_corrected = config.swings && config.optimizer.replicates > 0;
    // Only a walking robot's policy can make simulated walks.
    if let (true, Some(findings), Some(policy)) = (is_corrected, &mut swings, policy) {
        let known = known::priors(theta, &swing::numbers_of(method, findings), &config.prior);
        // Simulated robots correct priors alone, so without a new prior they are not needed.
        if known.len() > config.prior.len() {
            let (threads, gpus) =
                method.walking().map_or((1, Vec::new()), |walking| (walking.threads, walking.gpus.clone()));
            let robot = swing_correction::Robot { config, policy, model, base, threads, gpus };
            swing_correction::correct(findings, &robot, logs, watch)?;
        }
    }
    Ok(swings)
}

/// `error` with the line that names the robot, if the settings lack it.
fn with_robot(error: Error, line: Option<&str>, config: &Path) -> Error {
    match line {
        Some(line) => Error::settings(format!("{}: {line}. Without it: {error}", config.display())),
        None => error,
    }
}

/// The values of parameters that legs in the air and a usual robot with this number of `feet` suggest, and a note. If the logs
/// show effects, their parameters are added to the settings.
fn what_logs_show(
    config: &mut AdaptConfig,
    swings: Option<&SwingFindings>,
    method: &Method,
    theta: &Theta,
    base: &Candidate,
    joints: &[String],
    feet: Option<usize>,
) -> (Vec<SwingNumber>, Option<String>) {
    // Priors and remedies are asked for apart: `swings` for the first, `effects` for the second.
    let priors = swings.filter(|_| config.swings);
    let mut numbers = priors.map_or_else(Vec::new, |findings| swing::numbers_of(method, findings));
    let mut note = None;
    if let Some(findings) = swings.filter(|_| config.effects) {
        let remedies = Remedies::new(findings, theta, base, joints);
        // Springs are found by `odd_joints` itself.
        let remedies = if config.odd_joints { remedies.without_springs() } else { remedies };
        remedies.extend(config, joints);
        // A remedy's parameter takes over a part of what an estimate assumed, so the estimate becomes less sure.
        remedies.widen_priors(&mut numbers);
        numbers.extend(remedies.single_numbers().iter().filter(|_| config.swings).cloned());
        note = remedies.note();
    }
    // Priors that no log gives.
    numbers.extend(feet.filter(|_| config.swings).into_iter().flat_map(sized::usual_priors));
    (numbers, note)
}

/// Gives the settings of a fit of walks the defaults that depend on the robot, which stands on so many `feet`.
fn set_walk_defaults(
    config: &mut AdaptConfig,
    stated: &AdaptConfig,
    policy: &Policy,
    model: &Model,
    joints: &[String],
    feet: Option<usize>,
) -> Result<(), Error> {
    rule_joints::limit(&mut config.parameter, &policy.interface, joints)?;
    feet.into_iter().for_each(|feet| sized::fit_to(config, stated, model, feet));
    config.simulation.timestep = walking::timestep(config, policy)?;
    Ok(())
}

/// Parts of a robot with two legs that touch in the logs, if the settings and the policy leave self-contact open.
fn touching(
    config: &AdaptConfig,
    method: &Method,
    robot: &Model,
    feet: Option<usize>,
    logs: &[Log],
) -> Option<self_contact::Touching> {
    let is_open = method.self_contact().is_off() && config.simulation.self_contact.is_none();
    (is_open && feet.is_some_and(sized::is_biped)).then(|| self_contact::in_logs(robot, logs))
}

/// Warnings about constant signals, because the costs leave them out.
fn constant(fit: &LogSet) -> impl Iterator<Item = String> {
    fit.reference.constant().into_iter().map(|(signal, column)| {
        format!("{signal} of {column} is constant in the logs and left out of the costs")
    })
}

/// The settings with the defaults that depend on others, which the folder keeps too.
fn with_defaults(config: &AdaptConfig, devices: &Devices) -> AdaptConfig {
    let mut config = config.clone();
    config.optimizer.seeds = config.optimizer.seed_count(devices.are_gpus());
    config.parameter.iter_mut().for_each(ParameterRule::resolve);
    config.number.iter_mut().for_each(RobotRule::resolve);
    config
}

/// Facts to know of the robot and its policy.
fn remarks(method: &Method, policy: Option<&Policy>, robot: &Model) -> Vec<String> {
    let mut remarks = crate::robot::remarks(method.model());
    if let Some(policy) = policy {
        remarks.extend(policy.notes.iter().cloned());
        remarks.extend(policy.interface.other_robot(robot));
    }
    remarks
}

/// The maker of logs of simulated robots, where a fit is corrected by such logs.
fn replicas(
    config: &AdaptConfig,
    method: &Method,
    policy: Option<&Policy>,
    robot: &Model,
    theta: &Theta,
    base: &Candidate,
    logs: &[Log],
) -> Result<Option<Replicas>, Error> {
    let (Method::Walk(walking), Some(policy)) = (method, policy) else { return Ok(None) };
    let needed = corrected(config);
    let devices = (walking.threads, walking.gpus.as_slice());
    let new = || Replicas::new(config, policy.clone(), robot, theta, base, devices, logs);
    needed.then(new).transpose()
}

/// A sentence that asks for the robot, if the settings name none and the policy states another one than the built-in Go2.
fn unnamed(robot: &str, policy: &Policy, model: &Model) -> Option<String> {
    let other = robot.is_empty() && policy.interface.other_robot(model).is_some();
    other.then(|| {
        format!(
            "add `robot = \"…\"`, the file of `{}`, for which the policy was trained",
            shown(&policy.interface.robot)
        )
    })
}

/// Whether fits of simulated logs, or simulated robots, may correct a fit of `config`.
fn corrected(config: &AdaptConfig) -> bool {
    let fits = config.optimizer.replicates > 0
        && config.optimizer.method != Search::CmaEs
        && config.costs.iter().any(|cost| cost.needs_imu());
    fits || config.costs.iter().any(|&cost| robots::applies(config, cost))
}

/// Settings that name something this run does not have, and priors outside bounds: harmless, or a slip of the pen.
fn unused(config: &AdaptConfig, theta: &Theta, validate: &[Vec<Log>]) -> Result<Vec<String>, Error> {
    let mut warnings = Vec::new();
    let fitted = |name: &String| theta.entries().iter().any(|entry| entry.name == *name);
    let known = config.truth.keys().map(|name| ("truth", name));
    for (table, name) in known.chain(config.published.keys().map(|name| ("published", name))) {
        if !fitted(name) {
            warnings.push(format!("[{table}] has `{name}`, which is not fitted"));
        }
    }
    for (name, prior) in &config.prior {
        let entry = theta.entries().iter().find(|entry| entry.name == *name);
        // Estimates of numbers that are 0 scatter about it, so a prior may be a little beyond.
        let beyond = |entry: &&Entry| {
            let room = BEYOND * (entry.upper - entry.lower);
            prior.value < entry.lower - room || prior.value > entry.upper + room
        };
        if let Some(Entry { lower, upper, .. }) = entry.filter(beyond) {
            warnings.push(format!(
                "[prior] has {name} = {}, outside its bounds {lower} to {upper}: the search begins at the nearer bound; widen \
                 the bounds or correct the prior",
                prior.value
            ));
        }
    }
    // A pattern that matches nothing may be a slip of the pen: its logs keep the gains that they state.
    for entry in &config.validate_gains {
        let mut used = false;
        for log in validate.iter().flatten() {
            used |= air_logs::matching(std::slice::from_ref(entry), &log.name, &log.path)?.is_some();
        }
        if !used {
            warnings.push(format!("validate_gains for {:?} matches no validation log", entry.files));
        }
    }
    Ok(warnings)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_adapt::Prior;

    #[test]
    fn a_prior_outside_its_bounds_is_named_and_scatter_about_a_bound_is_not() {
        let groups = [("knee".to_owned(), vec!["*".to_owned()])];
        let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups, &["knee".to_owned()]).unwrap();
        let said = |value: f64| {
            let prior = [("frictionloss_knee".to_owned(), Prior::new(value, 0.1))].into();
            unused(&AdaptConfig { prior, ..AdaptConfig::default() }, &theta, &[]).unwrap()
        };
        assert!(said(0.1).is_empty() && said(-0.001).is_empty());
        assert!(said(9.0)[0].contains("frictionloss_knee = 9, outside its bounds 0 to "), "{:?}", said(9.0));
    }
}
