//! A first task for a robot: what its file says about feet, legs, pose and gains, and what is guessed from sizes.
//!
//! The built-in velocity task walks on the Go2. Here it is carried over to another robot by dynamic similarity: lengths go
//! with the leg length l, speeds with √(g l), times with √(l/g), torques with m g l (McN. Alexander 1984, "The gaits of
//! bipedal and quadrupedal animals": walks of equal Froude number v²/(g l) are alike).

mod anatomy;
#[cfg(test)]
mod biped_test;
mod feet;
mod gains;
mod level;
mod mended;
#[cfg(test)]
mod mended_test;
mod motors;
#[cfg(test)]
mod odd_test;
mod pose;
mod rotors;
mod shape;
mod sizes;
#[cfg(test)]
mod slides_test;
mod stance;
mod text;
mod twin;

use crate::settings::{Configuration, TrainConfig};
use gaitfit_learn::task::{Task, TaskError, TaskSettings};
use gaitfit_model::{Cone, Model, Root, shown};
use gaitfit_physics::Preset;
use gaitfit_sim::Candidate;
use serde::Serialize;

use anatomy::Anatomy;
pub use anatomy::path;
pub use gains::servo;
use gains::{Gains, Source};
pub use mended::{Preparation, Prepared, prepare};
use pose::Pose;
use rotors::Rotors;
use sizes::Sizes;

/// Why no task is found for a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InitError {
    /// The base is fixed.
    #[error("{robot} is fixed to the world; a walking robot needs a free base (in MJCF a <freejoint/>)")]
    Clamped {
        /// The robot.
        robot: String,
    },
    /// Nothing can touch the ground.
    #[error("no geom of {robot} may touch the ground, so it has no feet: {why}")]
    NoContact {
        /// The robot.
        robot: String,
        /// Why, or what to do.
        why: String,
    },
    /// No leg ends in a foot.
    #[error(
        "no legs are found in {robot}: no last link of it reaches near the ground; write the task by hand, `gaitfit config \
         train` prints one"
    )]
    NoLegs {
        /// The robot.
        robot: String,
    },
    /// More legs than a task may have feet.
    #[error(
        "{robot} has {legs} legs, and a task may have {max} feet; write the task by hand for some of them"
    )]
    ManyLegs {
        /// The robot.
        robot: String,
        /// How many there are.
        legs: usize,
        /// How many there may be.
        max: usize,
    },
    /// No joint of the legs can be moved.
    #[error(
        "no joint of {robot}'s legs can be moved: each follows another joint or has no motor; a policy needs joints that it can move"
    )]
    Limp {
        /// The robot.
        robot: String,
    },
    /// What reaches lowest cannot touch the ground.
    #[error(
        "no legs are found in {robot}: its last links ({links}) have no geom that collides with the ground; give the feet \
         spheres, capsules, boxes or cylinders that do (contype, conaffinity)"
    )]
    Ghosts {
        /// The robot.
        robot: String,
        /// Some of its last links.
        links: String,
    },
    /// The robot cannot be simulated.
    #[error("{0}")]
    Robot(String),
    /// What was written cannot be read.
    #[error("gaitfit cannot make a task for {robot}: {why}")]
    Task {
        /// The robot.
        robot: String,
        /// What is wrong with it.
        why: String,
    },
}

/// Line for a robot whose file asks for elliptic cones: those take the solver three times as many steps.
const CONE: &str = "cone = \"pyramidal\"              # the file's elliptic cones take longer in training\n";

/// Max number of couplings that are printed.
const NAMED_COUPLINGS: usize = 2;

/// Number of randomised robots that are made of what is written, as a training would make them.
const VARIED: usize = 64;

/// Something that was found or guessed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Guess {
    /// Subject of the guess, one word.
    pub what: &'static str,
    /// The result, and how it was found.
    pub found: String,
}

/// A first task for a robot, and what `init` knows of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// All settings of the task.
    pub settings: TaskSettings,
    /// Results and guesses, most important first.
    pub guesses: Vec<Guess>,
    /// Whether the robot file has elliptic cones.
    elliptic: bool,
    /// The tables `[train]`, `[ppo]` and `[task]` of a configuration, with comments.
    text: String,
    /// Legs and gait.
    anatomy: Anatomy,
    /// Rotor inertia where the robot's own file has none.
    rotors: Option<Rotors>,
    /// Joints of the stance, rad, of slides m; model order.
    angles: Vec<f64>,
}

impl Look {
    /// A page of the stance and the gait. `model`: the robot that this is a look at.
    pub fn stance(&self, model: &Model) -> gaitfit_view::replay::Replay {
        stance::stance(model, &self.anatomy, &self.angles, self.settings.height)
    }

    /// A configuration of a training. `robot`: the file as the configuration names it; `lenient`: how it was read.
    pub fn configuration(&self, robot: &str, lenient: bool) -> String {
        let mut text = String::from(
            "# Written by `gaitfit init`: check what its comments call a guess.\n\
             # Train with `gaitfit train FILE`; `gaitfit config train` prints all other settings.\n\n",
        );
        text.push_str(&format!("robot = {}\n", text::quoted(robot)));
        if lenient {
            text.push_str(
                "lenient = true                  # drop what the engine cannot simulate in the robot file\n",
            );
        }
        if self.elliptic {
            text.push_str(CONE);
        }
        text.push_str(&self.text);
        text
    }

    /// Returns this with another number of iterations in the configuration.
    #[must_use]
    pub fn with_iterations(&self, iterations: u32) -> Self {
        Self { text: text::with_iterations(&self.text, iterations), ..self.clone() }
    }
}

/// Looks at a robot.
///
/// # Errors
/// A robot that cannot walk, or in which no legs are found.
pub fn look(model: &Model) -> Result<Look, InitError> {
    look_with(model, Source::Likely, None)
}

/// Other guesses at the gains of a robot whose policy did not learn to walk: the gains of the file's position actuators, then
/// softer and stiffer gains by size. The result has neither the first guess nor guesses that cannot be simulated.
pub fn other_guesses(model: &Model, first: &Look) -> Vec<Look> {
    // 0.6 is about 1/1.6: as far to the soft side as to the stiff one.
    let sources = [Source::Servos, Source::Size(1.0), Source::Size(0.6), Source::Size(1.6)];
    let mut looks: Vec<Look> = Vec::new();
    for look in sources.iter().filter_map(|&source| look_with(model, source, first.rotors).ok()) {
        // Gains and scales are part of the policy's settings. Equal ones would train the same policy twice.
        let same = |other: &Look| other.settings.policy == look.settings.policy;
        if !same(first) && !looks.iter().any(same) {
            looks.push(look);
        }
    }
    looks
}

/// The pose in which a robot stands, its legs, and its sizes.
fn stand(model: &Model) -> Result<(Pose, Anatomy, Sizes), InitError> {
    let robot = || shown(&model.name);
    if model.root != Root::Floating {
        return Err(InitError::Clamped { robot: robot() });
    }
    let (start, anatomy) = first_look(model)?;
    let pose = pose::standing(model, start, &anatomy);
    // Feet are looked for once more in the pose that was found: the lowest geoms may be others.
    let anatomy = Anatomy::find(model, &pose.angles)?;
    if anatomy.acting().is_empty() {
        return Err(InitError::Limp { robot: robot() });
    }
    let sizes = Sizes::new(model, &anatomy, &pose.angles);
    Ok((pose, anatomy, sizes))
}

/// Rotor inertia of a robot whose legs have none in its file.
fn rotors(model: &Model) -> Result<Option<Rotors>, InitError> {
    let (_, anatomy, sizes) = stand(model)?;
    Ok(Rotors::guess(model, &anatomy, &sizes))
}

/// `written`: the rotors that `init` wrote into the robot's file.
fn look_with(model: &Model, source: Source, written: Option<Rotors>) -> Result<Look, InitError> {
    let robot = || shown(&model.name);
    let (pose, anatomy, sizes) = stand(model)?;
    let gains = Gains::new(model, &anatomy, &pose.angles, &sizes, source, written)?;
    let text = text::task(model, &anatomy, &pose, &sizes, &gains);
    let settings = read(&text).map_err(|why| InitError::Task { robot: robot(), why })?;
    // A training might refuse a robot of odd sizes: that is reported now.
    let refused = |error: TaskError| InitError::Task { robot: robot(), why: error.to_string() };
    let task = Task::new(model, &settings, Preset::Fast).map_err(refused)?;
    task.robots(&[Candidate::nominal(model)], 0, 0, VARIED).map_err(refused)?;
    let elliptic = model.options.cone == Cone::Elliptic;
    let guesses = guesses(model, &anatomy, &pose, &sizes, &gains);
    Ok(Look { settings, guesses, elliptic, text, anatomy, rotors: gains.rotors, angles: pose.angles })
}

/// The pose from which the stance is sought, and the legs in it: a keyframe's, unless the robot as the file draws it has more
/// legs on the ground. Some keyframes have joints of another sign.
fn first_look(model: &Model) -> Result<(Pose, Anatomy), InitError> {
    let start = pose::start(model);
    let anatomy = Anatomy::find(model, &start.angles);
    if start.keyframe.is_some() {
        let drawn = Pose { angles: pose::drawn(model), keyframe: None };
        let legs =
            |anatomy: &Result<Anatomy, InitError>| anatomy.as_ref().map_or(0, |anatomy| anatomy.legs.len());
        let other = Anatomy::find(model, &drawn.angles);
        if legs(&other) > legs(&anatomy) {
            return other.map(|anatomy| (drawn, anatomy));
        }
    }
    anatomy.map(|anatomy| (start, anatomy))
}

/// The task of a configuration that names no robot: as another robot than the Go2 has it.
fn read(text: &str) -> Result<TaskSettings, String> {
    let mut table = toml::de::DeTable::parse(text).map_err(|error| error.to_string())?.into_inner();
    TrainConfig::complete(&mut table);
    let table = toml::Spanned::new(0..0, table);
    let config = <TrainConfig as serde::Deserialize>::deserialize(toml::de::Deserializer::from(table));
    config.map_err(|error| error.to_string())?.task.own_settings()
}

fn guesses(model: &Model, anatomy: &Anatomy, pose: &Pose, sizes: &Sizes, gains: &Gains) -> Vec<Guess> {
    let mut guesses = Vec::new();
    let mut say = |what: &'static str, text: String| guesses.push(Guess { what, found: text });
    let legs = &anatomy.legs;
    let feet: Vec<String> = legs.iter().map(|leg| shown(&leg.foot)).collect();
    let links = anatomy.links(model).map(|links| format!(", {links}")).unwrap_or_default();
    say("feet", format!("{}{links}: {}", feet.join(", "), anatomy.how()));
    say("gait", anatomy.gait_in_words());
    say("pose", pose.how(sizes));
    say(
        "size",
        format!(
            "{:.1} kg, legs of {:.2} m, base at {:.2} m{}",
            sizes.mass,
            sizes.leg,
            sizes.height,
            sizes.doubt.as_ref().map(|doubt| format!("; {doubt}")).unwrap_or_default()
        ),
    );
    // Held, coupled and passive joints are named below, each kind with its reason.
    let others = model.joints.len() - anatomy.acting().len();
    let names = |joints: &[usize]| {
        joints.iter().map(|&joint| shown(&model.joints[joint].name)).collect::<Vec<_>>().join(", ")
    };
    if !anatomy.wheels.is_empty() {
        let wheels = names(&anatomy.wheels);
        say(
            "wheels",
            format!("{wheels}: they roll; the policy gives them velocities. Steps are not paid for"),
        );
    }
    let couplings = model.couplings_in_words();
    if !couplings.is_empty() {
        let more = couplings.len().saturating_sub(NAMED_COUPLINGS);
        let more = if more > 0 { format!("; {more} more") } else { String::new() };
        let named = &couplings[..couplings.len().min(NAMED_COUPLINGS)];
        say(
            "coupled",
            format!("{}{more} (x: the other joint's distance from its reference)", named.join("; ")),
        );
    }
    // Joints that follow others are passive too, but they are named as coupled above.
    let limp: Vec<usize> =
        anatomy.passive.iter().copied().filter(|&joint| !model.only_follows(joint)).collect();
    if !limp.is_empty() {
        let limp = names(&limp);
        say(
            "passive",
            format!("{limp}: without motors in the file; they move under their springs and limits"),
        );
    }
    let held = others - anatomy.passive.len();
    if held > 0 {
        say(
            "joints",
            format!("the policy moves the {} of the legs, {held} others are held", anatomy.moved.len()),
        );
    }
    say("gains", gains.how.clone());
    if model.options.cone == Cone::Elliptic {
        say(
            "contacts",
            "pyramidal friction cones, as the file's elliptic ones take longer in training".to_owned(),
        );
    }
    for doubt in &gains.doubts {
        say("gains", doubt.clone());
    }
    for doubt in motors::placeholders(model, anatomy, sizes) {
        say("limits", doubt);
    }
    say(
        "commands",
        format!(
            "up to {:?} m/s forward, {:?} m/s sideways{}, {:?} rad/s; Froude number v/√(g l) = {:.2}",
            sizes.forward,
            sizes.sideways,
            sizes.never_aside.map(|why| format!(" ({why})")).unwrap_or_default(),
            sizes.turning,
            sizes.forward / (sizes.gravity * sizes.leg).sqrt()
        ),
    );
    guesses
}
