//! A robot that hangs in the air: its joints, gains, limits, and the pose about which it moves.

use super::settings::{ChirpSettings, Turns};
use gaitfit_adapt::{JointParameter, ParameterRule, Sharing, Theta};
use gaitfit_fit::air::choices;
use gaitfit_log::{Gains, PerJoint, Trajectory};
use gaitfit_model::patterns::{covered, table};
use gaitfit_model::{JointKind, Model, shown, shown_number, significant};
use gaitfit_settings::settings::{self, AdaptConfig};
use gaitfit_settings::{Error, robot};
use gaitfit_sim::Recording;
use indexmap::IndexMap;

/// Speed limit of joints whose file states none, rad/s: walking robots have 10 to 45.
const SPEED: f64 = 10.0;
/// How far joints without a range may go from the middle of their motion, in amplitudes. Less the default margin, a
/// motion may overshoot its target by a third.
const ROOM: f64 = 1.5;
/// Upper bounds of the search where no configuration states them, for a robot with the Go2's motors: kg·m²,
/// N·m·s/rad, s. They are narrower than those of `gaitfit new`, because the chirp must be safe on every robot within
/// them.
const ARMATURE: f64 = 0.1;
const DAMPING: f64 = 1.0;
const DELAY: f64 = 0.02;
/// Source of the gains of the built-in robot.
const BUILT_IN: &str = "the gains of the built-in task";
/// Max number of names that a message lists; it counts the others.
const LISTED: usize = 4;

/// Said of a robot that its file fixes in a world that it may touch.
const IN_A_WORLD: &str = "the file fixes the robot and has a ground: the chirp is simulated without it, so see that the robot \
                          touches nothing; a fit of the log has the file's ground";

/// A clamped robot, ready to move.
pub(super) struct Body {
    /// The robot, with nothing that it could touch.
    pub model: Model,
    /// Joint names.
    pub names: Vec<String>,
    /// N·m/rad and N·m·s/rad, one a joint.
    pub gains: Gains,
    /// Middle of the motion, rad.
    pub centre: Vec<f64>,
    /// Turn in which each joint moves; `None`: it is held.
    pub turn: Vec<Option<usize>>,
    /// rad; rad/s; N·m.
    pub range: Vec<[f64; 2]>,
    pub velocity: Vec<f64>,
    pub torque: Vec<f64>,
    /// The fit: its parameters and their bounds.
    pub config: AdaptConfig,
    /// Sources of gains and limits, a sentence each.
    pub notes: Vec<String>,
}

impl Body {
    /// Reads the robot, and the fit's configuration if there is one.
    pub fn read(settings: &ChirpSettings) -> Result<Self, Error> {
        let mut notes = Vec::new();
        let mut model = robot::read(&settings.robot, settings.lenient, robot::Hold::Clamped)?;
        // The same robot with its free base: only such a robot has a stance and a task of its own.
        let floating = robot::read(&settings.robot, settings.lenient, robot::Hold::File)?;
        let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
        if names.is_empty() {
            return Err(Error::failed(format!("{} has no joints to move", shown(&model.name))));
        }
        // Its log is written at the end. A name that a log cannot hold is refused now, before the simulations.
        gaitfit_log::check_names(Some(&model.name), &names)
            .map_err(|error| Error::content(&settings.robot, error))?;
        // Only a robot that its file fixes, such as an arm on a table, still has that file's world.
        if !model.pairs.is_empty() {
            notes.push(IN_A_WORLD.to_owned());
            model = model.in_the_air();
        }
        let named = |error| Error::settings(format!("`joints` (--joints): {error}"));
        let moved = match settings.joints.as_slice() {
            [] => hinges(&model, &mut notes)?,
            patterns => covered(patterns, &model.name, &names).map_err(named)?,
        };
        if let Some(slide) =
            moved.iter().map(|&joint| &model.joints[joint]).find(|joint| !joint.kind.is_hinge())
        {
            return Err(Error::settings(format!(
                "`joints` (--joints): joint {} is a slide, and chirps move only hinges; leave it out",
                shown(&slide.name)
            )));
        }
        if let Some(&follower) = moved.iter().find(|&&joint| model.follows(joint)) {
            return Err(Error::settings(format!(
                "`joints` (--joints): joint {} follows another joint; leave it out",
                shown(&model.joints[follower].name)
            )));
        }
        let fit = settings.fit.as_deref();
        let given: Option<AdaptConfig> = fit.map(|path| settings::load(Some(path), &[])).transpose()?;
        // The built-in robot has a task already.
        let looked = if robot::is_go2(&floating) { None } else { gaitfit_world::init::look(&floating).ok() };
        let source = looked.as_ref().and_then(|look| look.guesses.iter().find(|guess| guess.what == "gains"));
        let source = source.map(|guess| guess.found.clone());
        let task = match looked {
            Some(look) => Some(look.settings),
            None => robot::is_go2(&floating).then(Default::default),
        };
        let task = task.as_ref();
        let gains = gains(
            settings,
            given.as_ref(),
            task.zip(source.as_deref().or(Some(BUILT_IN))),
            &model,
            &names,
            &mut notes,
        )?;
        let turn = turns(&model, &moved, settings.turns);
        let mut body = Self {
            range: Vec::new(),
            centre: Vec::new(),
            velocity: Vec::new(),
            torque: torques(settings, &model, &moved)?,
            config: given
                .unwrap_or_else(|| usual(settings, &model))
                .by_kind(&model)
                .map_err(|error| Error::settings(format!("what is fitted: {error}")))?,
            gains,
            turn,
            names,
            model,
            notes,
        };
        // A robot whose joints are in no groups gets a number for each joint.
        // The user's own configuration stays as it is.
        if settings.fit.is_none() && body.theta().is_err() {
            for rule in body.config.parameter.iter_mut().filter(|rule| rule.per == Sharing::Group) {
                rule.per = Sharing::Joint;
            }
        }
        body.speeds(settings);
        body.pose(settings, task)?;
        Ok(body)
    }

    /// The parameters of the fit on this robot.
    pub fn theta(&self) -> Result<Theta, Error> {
        theta(&self.config, &self.names)
    }

    /// The chirp as the simulator replays it.
    pub fn recording(&self, rate: f64, target: Vec<f64>) -> Recording {
        Recording {
            dt: 1.0 / rate,
            q0: self.centre.clone(),
            dq0: vec![0.0; self.names.len()],
            target,
            kp: self.gains.kp.clone(),
            kd: self.gains.kd.clone(),
        }
    }

    /// A log of the chirp; `signals`: positions and velocities.
    pub fn trajectory(&self, rate: f64, targets: &[f64], signals: [Vec<f64>; 2]) -> Trajectory {
        let [position, velocity] = signals;
        Trajectory {
            source: None,
            robot: Some(self.model.name.clone()),
            joints: self.names.clone(),
            time: (0..targets.len() / self.names.len()).map(|sample| sample as f64 / rate).collect(),
            rate_hz: rate,
            position,
            velocity,
            target: Some(targets.to_vec()),
            action: None,
            command: None,
            motion: None,
            base: None,
            gains: Some(self.gains.clone()),
            lead: None,
            simulated_step: None,
            velocity_joints: Vec::new(),
            fell: false,
        }
    }

    /// Speed limits.
    fn speeds(&mut self, settings: &ChirpSettings) {
        let mut bare = Vec::new();
        for (joint, name) in self.model.joints.iter().zip(&self.names) {
            // `velocity_limit` is in rad/s, so it does not hold for slides.
            let given = settings.velocity_limit.filter(|_| joint.kind.is_hinge());
            let limit = match (joint.velocity_limit, given) {
                // A given limit can only be stricter than the file's.
                (Some(own), Some(given)) => own.min(given),
                (own, given) => own.or(given).unwrap_or_else(|| {
                    if joint.kind.is_hinge() {
                        bare.push(name.clone());
                    }
                    SPEED
                }),
            };
            self.velocity.push(limit);
        }
        if !bare.is_empty() {
            self.notes.push(format!(
                "the robot file has no speed limit of {}: {SPEED} rad/s was taken; --velocity-limit gives another",
                listed(&bare)
            ));
        }
    }

    /// The middle of the motion and where joints may be.
    fn pose(
        &mut self,
        settings: &ChirpSettings,
        task: Option<&gaitfit_learn::task::TaskSettings>,
    ) -> Result<(), Error> {
        let robot = self.model.name.clone();
        let given: IndexMap<String, f64> = settings.pose.iter().cloned().collect();
        let given = table(&given, &robot, &self.names)
            .map_err(|error| Error::settings(format!("`pose` (--pose): {error}")))?;
        let usual = task.and_then(|task| table(&task.policy.default_pose, &robot, &self.names).ok());
        let mut bare = Vec::new();
        for (at, joint) in self.model.joints.iter().enumerate() {
            let moves = self.turn[at].is_some();
            let usual = usual.as_ref().and_then(|pose| pose[at]).unwrap_or(joint.reference);
            // Without a range the amplitude itself must bound the motion.
            let Some([low, high]) = joint.range else {
                let centre = given[at].unwrap_or(usual);
                if moves {
                    bare.push(joint.name.clone());
                }
                let room = ROOM * settings.amplitude;
                self.range.push([centre - room, centre + room]);
                self.centre.push(centre);
                continue;
            };
            let free = settings.margin * 0.5 * (high - low);
            let (min, max) = (low + free, high - free);
            let centre = match given[at] {
                Some(angle) if (min..=max).contains(&angle) => angle,
                Some(angle) => {
                    return Err(Error::settings(format!(
                        "`pose` (--pose) has {} at {} {}; within its range and the margin it may be from {} to {}",
                        shown(&joint.name),
                        shown_number(angle),
                        joint.kind.unit("rad"),
                        shown_number(min),
                        shown_number(max)
                    )));
                }
                None => {
                    // The stance may lie near a limit: the middle moves away from it, so that the amplitude fits on
                    // both sides.
                    let room = settings.amplitude.min(0.5 * (max - min)).max(0.0);
                    usual.max(min + room).min(max - room)
                }
            };
            self.range.push([low, high]);
            self.centre.push(centre);
        }
        if !bare.is_empty() {
            self.notes.push(format!(
                "the robot file has no range of {}: within {} rad of the middle was taken",
                listed(&bare),
                significant(ROOM * settings.amplitude, 4)
            ));
        }
        Ok(())
    }
}

/// Parameters of the joints that `config` fits.
fn theta(config: &AdaptConfig, names: &[String]) -> Result<Theta, Error> {
    let mut rules = config.rules();
    (rules.network, rules.robot) = Default::default();
    rules.resolve();
    rules
        .theta(&config.groups(names), names, &vec![0.0; names.len()])
        .map_err(|error| Error::settings(format!("what is fitted: {error}")))
}

/// Some names, and how many more there are.
fn listed(names: &[String]) -> String {
    gaitfit_model::listed(names.iter().map(|name| shown(name)), LISTED)
}

/// Gains from the first of: the settings, the fit's configuration, the robot's task (with its source), and the
/// position actuators of the file.
fn gains(
    settings: &ChirpSettings,
    fit: Option<&AdaptConfig>,
    task: Option<(&gaitfit_learn::task::TaskSettings, &str)>,
    model: &Model,
    names: &[String],
    notes: &mut Vec<String>,
) -> Result<Gains, Error> {
    let resolved = |kp: &PerJoint, kd: &PerJoint| {
        let resolved = |what: &str, gain: &PerJoint| gain.resolve(what, names).map_err(Error::settings);
        Ok(Gains { kp: resolved("kp (--kp)", kp)?, kd: resolved("kd (--kd)", kd)? })
    };
    if let (Some(kp), Some(kd)) = (&settings.kp, &settings.kd) {
        return resolved(kp, kd);
    }
    if let Some((kp, kd)) = fit.and_then(|fit| fit.gains.kp.as_ref().zip(fit.gains.kd.as_ref())) {
        notes.push("gains are those of the fit's configuration".to_owned());
        return resolved(kp, kd);
    }
    let joints: Vec<usize> = (0..names.len()).collect();
    if let Some((policy, source)) = task.map(|(task, source)| (&task.policy, source)) {
        let resolved = |gain: &gaitfit_learn::task::JointNumber, what| gain.of_joints(model, &joints, what);
        if let (Ok(kp), Ok(kd)) = (resolved(&policy.kp, "kp"), resolved(&policy.kd, "kd")) {
            notes.push(format!(
                "gains are those that `gaitfit init` computes ({source}); give your robot's own with --kp and --kd"
            ));
            return Ok(Gains { kp, kd });
        }
    }
    let servos: Option<Vec<[f64; 2]>> =
        joints.iter().map(|&joint| gaitfit_world::init::servo(model, joint)).collect();
    match servos {
        Some(servos) => {
            notes.push(
                "gains are those of the file's position actuators; --kp and --kd give others".to_owned(),
            );
            let column = |k: usize| servos.iter().map(|one| one[k]).collect();
            Ok(Gains { kp: column(0), kd: column(1) })
        }
        None => Err(Error::settings(format!(
            "no gains of {} are known: give `kp` (--kp) and `kd` (--kd), a number or a table such as \
             '{{ \"*\" = 40, \"*_hip\" = 20 }}'",
            shown(&model.name)
        ))),
    }
}

/// Torque limits; every moving joint needs one.
fn torques(settings: &ChirpSettings, model: &Model, moved: &[usize]) -> Result<Vec<f64>, Error> {
    let mut limits = Vec::new();
    let mut bare = Vec::new();
    for (at, joint) in model.joints.iter().enumerate() {
        // `torque_limit` is in N·m, so it does not hold for slides.
        let given = settings.torque_limit.filter(|_| joint.kind.is_hinge());
        let limit = match (model.effort(at), given) {
            (Some(own), Some(given)) => own.min(given),
            (own, given) => own.or(given).unwrap_or(f64::INFINITY),
        };
        if limit.is_infinite() && moved.contains(&at) {
            bare.push(joint.name.clone());
        }
        limits.push(limit);
    }
    if bare.is_empty() {
        return Ok(limits);
    }
    Err(Error::settings(format!(
        "the robot file has no torque limit of {}, so the chirp's torques would have no bound: give `torque_limit` \
         (--torque-limit), N·m",
        listed(&bare)
    )))
}

/// Turn in which each joint moves; `None` for joints that are held.
fn turns(model: &Model, moved: &[usize], turns: Turns) -> Vec<Option<usize>> {
    // Joints of one limb move in one turn; turns follow the order of the limbs' first joints.
    let mut slots = vec![None; model.joints.len()];
    let mut limbs: Vec<usize> = Vec::new();
    for (order, &joint) in moved.iter().enumerate() {
        slots[joint] = Some(match turns {
            Turns::All => 0,
            Turns::Joints => order,
            Turns::Limbs => {
                let limb = limb(model, model.joints[joint].body);
                limbs.iter().position(|one| *one == limb).unwrap_or_else(|| {
                    limbs.push(limb);
                    limbs.len() - 1
                })
            }
        });
    }
    slots
}

/// The joints that chirps turn if none are named: all hinges that do not follow others.
fn hinges(model: &Model, notes: &mut Vec<String>) -> Result<Vec<usize>, Error> {
    let names = |joints: Vec<usize>| -> Vec<String> {
        joints.into_iter().map(|joint| model.joints[joint].name.clone()).collect()
    };
    let (hinges, slides): (Vec<usize>, Vec<usize>) =
        (0..model.joints.len()).partition(|&joint| model.joints[joint].kind.is_hinge());
    // A follower moves with the joint that it follows, and takes no target.
    let (followers, free): (Vec<usize>, Vec<usize>) =
        hinges.into_iter().partition(|&joint| model.follows(joint));
    if free.is_empty() {
        return Err(Error::settings(
            "chirps move only hinges that do not follow other joints, and this robot has none",
        ));
    }
    if !slides.is_empty() {
        notes.push(format!("chirps move only hinges; these slides are held: {}", listed(&names(slides))));
    }
    if !followers.is_empty() {
        let followers = listed(&names(followers));
        notes.push(format!("chirps do not move joints that follow others: {followers}"));
    }
    Ok(free)
}

/// The body next to the root from which `body` hangs.
fn limb(model: &Model, body: usize) -> usize {
    let above = |body: &usize| model.bodies[*body].parent.filter(|&parent| parent != 0);
    std::iter::successors(Some(body), above).last().unwrap_or(body)
}

/// The fit's configuration where the user gives none.
fn usual(settings: &ChirpSettings, model: &Model) -> AdaptConfig {
    let scale = choices::motor_scale(model);
    let joints = if !settings.joints.is_empty() {
        settings.joints.clone()
    } else if model.has_slides() || !model.couplings.is_empty() {
        let moved = |joint: &usize| model.joints[*joint].kind.is_hinge() && !model.follows(*joint);
        (0..model.joints.len()).filter(moved).map(|joint| model.joints[joint].name.clone()).collect()
    } else {
        vec!["*".to_owned()]
    };
    let rule = |kind: JointParameter, per: Sharing, upper: f64| ParameterRule {
        per,
        joints: joints.clone(),
        upper: Some(upper),
        ..ParameterRule::new(kind)
    };
    let friction = choices::max_friction(model, JointKind::Hinge);
    // At least twice the file's value: the robot of the file lies within the bounds.
    let armature =
        (ARMATURE * scale).max(choices::twice_file(model, JointKind::Hinge, |joint| joint.armature));
    let damping = (DAMPING * scale).max(choices::twice_file(model, JointKind::Hinge, |joint| joint.damping));
    AdaptConfig {
        parameter: vec![
            rule(JointParameter::FrictionLoss, Sharing::Group, friction),
            rule(JointParameter::Armature, Sharing::Group, armature),
            rule(JointParameter::Damping, Sharing::Group, damping),
            ParameterRule {
                name: Some("delay".to_owned()),
                ..rule(JointParameter::Delay, Sharing::All, DELAY)
            },
        ],
        simulation: gaitfit_settings::settings::SimulationConfig {
            timestep: choices::STEP_S,
            ..Default::default()
        },
        ..AdaptConfig::default()
    }
}
