//! The task as commented TOML.

use super::anatomy::Anatomy;
use super::gains::Gains;
use super::pose::Pose;
use super::sizes::{Sizes, digits, tidy};
use gaitfit_learn::task::reward::TERMS;
use gaitfit_model::{JointKind, Model};
use std::fmt::Write as _;

/// Iterations of a training on two legs, which takes longer than one on four.
const BIPED_ITERATIONS: u32 = 2000;
/// Share of zero commands of a robot on two legs. With the built-in share, three of five trainings of a G1 drifted when they were
/// to stand.
const BIPED_STANDING: f64 = 0.15;

/// Largest share of the base's own mass that randomisation takes away.
const MIN_SHARE: f64 = 0.5;

/// Head of the table of the task.
const TASK: &str = "\n[task]";

/// A basic string of TOML, which may be a key too: its escapes are those of JSON.
pub fn quoted(text: &str) -> String {
    serde_json::Value::String(text.to_owned()).to_string()
}

fn list(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

/// A setting with a comment.
fn line(text: &mut String, setting: &str, value: impl std::fmt::Display, comment: &str) {
    let setting = format!("{setting} = {value}");
    let _ = match comment {
        "" => writeln!(text, "{setting}"),
        _ => writeln!(text, "{setting:<32} # {comment}"),
    };
}

/// Numbers of joints: one for all, or a table with the most common one first.
fn numbers(text: &mut String, model: &Model, joints: &[usize], name: &str, values: &[f64], comment: &str) {
    let count = |value: f64| joints.iter().filter(|&&joint| values[joint] == value).count();
    let common = joints.iter().map(|&joint| values[joint]).max_by_key(|&value| count(value));
    let common = common.unwrap_or_default();
    let _ = writeln!(
        text,
        // Filled up with spaces to the column in which other comments begin.
        "\n[task.policy.{name}]{}# {comment}",
        " ".repeat(18_usize.saturating_sub(name.len()))
    );
    let _ = writeln!(text, "\"*\" = {common:?}");
    for &joint in joints.iter().filter(|&&joint| values[joint] != common) {
        let _ = writeln!(text, "{} = {:?}", quoted(&model.joints[joint].name), values[joint]);
    }
}

/// The tables that [`task`] wrote, but with this number of iterations.
pub fn with_iterations(tables: &str, iterations: u32) -> String {
    // If there is a `[train]`, it comes first and has only its iterations.
    let rest = tables.find(TASK).map_or(tables, |begin| &tables[begin..]);
    let mut text = String::from("\n[train]\n");
    line(&mut text, "iterations", iterations, "fewer did not teach it to walk");
    text + rest
}

/// The tables of a configuration that are the robot's.
pub fn task(model: &Model, anatomy: &Anatomy, pose: &Pose, sizes: &Sizes, gains: &Gains) -> String {
    let mut text = String::new();
    if anatomy.biped() {
        let _ = writeln!(text, "\n[train]");
        line(&mut text, "iterations", BIPED_ITERATIONS, "two legs take longer than four");
    }
    let _ = writeln!(text, "{TASK}");
    let comment = "settings that are absent here are those of this built-in task";
    line(&mut text, "base", quoted("velocity"), comment);
    // The built-in task has 4 steps of 5 ms in a control period.
    if gains.substeps != 4 {
        let comment = "physics steps between actions: gains and damping need short ones";
        line(&mut text, "substeps", gains.substeps, comment);
    }
    feet_and_gait(&mut text, model, anatomy);
    own_parts(&mut text, model);
    lengths_and_speeds(&mut text, anatomy, sizes);

    joints_and_clock(&mut text, model, anatomy, sizes);
    actuation(&mut text, model, anatomy, gains);
    default_pose(&mut text, model, anatomy, pose, sizes);
    commands(&mut text, anatomy, sizes);
    falls_and_draws(&mut text, model, anatomy, sizes, gains);
    if model.has_slides() {
        for_slides(&mut text);
    }
    rewards(&mut text, model, anatomy, sizes);
    text
}

/// Writes the feet, and which of them move together.
fn feet_and_gait(text: &mut String, model: &Model, anatomy: &Anatomy) {
    let feet = list(anatomy.legs.iter().map(|leg| quoted(&leg.foot)));
    let links = anatomy.links(model).map(|links| format!(" ({links})")).unwrap_or_default();
    let comment = format!("{}{links}; a geom, or a body with all its geoms", anatomy.how());
    line(text, "feet", feet, &comment);
    let group = |group: &Vec<usize>| list(group.iter().map(|&leg| quoted(&anatomy.legs[leg].foot)));
    line(text, "gait", list(anatomy.gait.iter().map(group)), "feet that move together; forward is x");
}

/// Writes the base's height, what a step is like, and how exactly commands are to be followed.
fn lengths_and_speeds(text: &mut String, anatomy: &Anatomy, sizes: &Sizes) {
    line(text, "height", float(digits(sizes.height, 3)), "m, of the base in the default pose");
    let lift = if anatomy.biped() { 0.1 } else { 0.26 };
    let swing = format!("m, of a foot's centre in mid-swing: {lift} leg lengths above the ground");
    line(text, "swing_height", float(tidy(sizes.foot + lift * sizes.leg)), &swing);
    let swing_seconds = 1.43 * pendulum_seconds(sizes);
    line(text, "swing_seconds", float(tidy(swing_seconds)), "s off the ground in a step: 1.43 √(l/g)");
    let width = if anatomy.biped() { 0.7 } else { 0.5 } * sizes.forward.max(sizes.sideways);
    line(text, "tracking_width", float(tidy(width)), "m/s: exp(-error^2 / width^2)");
    line(text, "yaw_tracking_width", float(tidy(0.5 * sizes.turning)), "rad/s");
}

/// The time scale of a leg that swings, √(l/g), s.
fn pendulum_seconds(sizes: &Sizes) -> f64 {
    (sizes.leg / sizes.gravity).sqrt()
}

/// Begins the table of the policy, if its settings differ from the built-in ones: the joints that act, and what a policy on two
/// legs observes.
fn joints_and_clock(text: &mut String, model: &Model, anatomy: &Anatomy, sizes: &Sizes) {
    let acting = anatomy.acting();
    let some = acting.len() < model.joints.len();
    let (biped, wheels) = (anatomy.biped(), &anatomy.wheels);
    let names = |joints: &[usize]| list(joints.iter().map(|&joint| quoted(&model.joints[joint].name)));
    if some || biped || !wheels.is_empty() {
        let _ = writeln!(text, "\n[task.policy]");
    }
    if some {
        let comment = "those of the legs with motors; others are held, follow another joint, or turn freely";
        line(text, "joints", names(&acting), comment);
    }
    if !wheels.is_empty() {
        let comment = "wheels: their targets are velocities, rad/s";
        line(text, "velocity_joints", names(wheels), comment);
    }
    if biped {
        let frequency = 0.35 / pendulum_seconds(sizes);
        let comment = "Hz, of the clock that the policy observes";
        line(text, "gait_frequency", float(tidy(frequency)), comment);
        text.push_str(&biped_observations());
    }
}

/// Writes how actions become torques: scales of actions and gains.
fn actuation(text: &mut String, model: &Model, anatomy: &Anatomy, gains: &Gains) {
    let acting = anatomy.acting();
    let joints: Vec<usize> = (0..model.joints.len()).collect();
    let rolls = if anatomy.wheels.is_empty() { "" } else { "; wheels: rad/s" };
    let comment = format!("{} per unit action{rolls}", model.units("rad"));
    numbers(text, model, &acting, "action_scale", &gains.scale, &comment);
    let comment = format!("{}: {}", model.units("N·m/rad"), gains.how);
    numbers(text, model, &joints, "kp", &gains.kp, &comment);
    let guessed = if gains.how.contains("(a guess)") { " (a guess)" } else { "" };
    let comment = format!("{}{guessed}", model.units("N·m·s/rad"));
    numbers(text, model, &joints, "kd", &gains.kd, &comment);
}

/// Writes the angles of the default pose. Wheels have none.
fn default_pose(text: &mut String, model: &Model, anatomy: &Anatomy, pose: &Pose, sizes: &Sizes) {
    let how = pose.how(sizes);
    let _ = writeln!(text, "\n[task.policy.default_pose]       # {}: {how}", model.units("rad"));
    let stated = model.joints.iter().zip(&pose.angles).enumerate();
    for (index, (joint, angle)) in stated.filter(|(index, _)| !model.only_follows(*index)) {
        let angle = if anatomy.wheels.contains(&index) { 0.0 } else { digits(round(*angle), 4) };
        let _ = writeln!(text, "{} = {angle:?}", quoted(&joint.name));
    }
}

/// Writes the ranges of commands.
fn commands(text: &mut String, anatomy: &Anatomy, sizes: &Sizes) {
    let scale = if anatomy.biped() { "half of it on two legs" } else { "leg length l" };
    let _ =
        writeln!(text, "\n[task.command]                   # Froude number v/√(g l) of the Go2's, {scale}");
    // A subtraction, because the negative of 0 would be written as -0.0.
    let range = |max: f64| format!("[{:?}, {max:?}]", 0.0 - max);
    line(text, "x", range(sizes.forward), "m/s forward");
    let why = sizes.never_aside.map(|why| format!(": {why}")).unwrap_or_default();
    line(text, "y", range(sizes.sideways), &format!("m/s left{why}"));
    line(text, "yaw", range(sizes.turning), "rad/s");
    if anatomy.biped() {
        line(text, "standing", BIPED_STANDING, "share of zero commands: two legs drift more easily");
    }
}

/// Settings that are one number for all joints: small enough for slides, whose unit is m.
fn for_slides(text: &mut String) {
    // The three numbers below are those of the built-in task, for hinges.
    let like = |value: f64| float(tidy(JointKind::Slide.like("rad", value)));
    let _ = writeln!(text, "\n[task.start]");
    line(text, "joint_position", like(0.1), "half range: rad for hinges, m for slides");
    let _ = writeln!(text, "\n[task.noise]");
    line(text, "joint_position", like(0.01), "half range: rad for hinges, m for slides");
    line(text, "joint_velocity", like(1.5), "half range: rad/s for hinges, m/s for slides");
}

/// Writes the limits of a fall, the randomisation and the pushes.
fn falls_and_draws(text: &mut String, model: &Model, anatomy: &Anatomy, sizes: &Sizes, gains: &Gains) {
    let _ = writeln!(text, "\n[task.fall]");
    let contacts = list(anatomy.base_geoms.iter().map(|&geom| quoted(&model.geoms[geom].name)));
    line(text, "contacts", contacts, "geoms of the base: they must not touch the ground");
    // The Go2's lowest base is 0.12 m, a share of 0.4 of its 0.30 m.
    let share = if anatomy.biped() { 0.6 } else { 0.4 };
    line(text, "height", float(tidy(sizes.height - (1.0 - share) * sizes.tall())), "m, lowest base");
    // That of the built-in task: an angle needs no scaling.
    line(text, "tilt", 60.0, "degrees");

    let _ = writeln!(text, "\n[task.randomisation]");
    let mass = sizes.mass / super::sizes::GO2_MASS;
    // Some files have a base of little mass that the rest is fixed to: more than it has cannot be taken away.
    let base_mass = model.bodies.first().map_or(0.0, |base| base.mass);
    let min = -mass.min(MIN_SHARE * base_mass);
    // The Go2's −1 to 3 kg, in proportion to the robot's mass.
    line(text, "base_mass", format!("[{:?}, {:?}]", tidy(min), tidy(3.0 * mass)), "kg added");
    line(text, "base_com", float(tidy(0.02 * sizes.length())), "m, half range along each axis");
    if let Some(rotors) = gains.rotors {
        let [min, max] = rotors.added();
        let comment = match rotors.in_file {
            true => "kg·m² added to what `init` wrote into the file (a guess)",
            false => "kg·m² added: the file has no rotor inertia (a guess)",
        };
        line(text, "armature", format!("[{min:?}, {max:?}]"), comment);
    }
    let _ = writeln!(text, "\n[task.push]");
    // The Go2's 0.5 m/s; speeds go with √l.
    line(text, "velocity", float(tidy(0.5 * sizes.length().sqrt())), "m/s");
}

/// Writes, as a comment, the self-contact that the file permits: it is off unless a task asks for it.
fn own_parts(text: &mut String, model: &Model) {
    let (all, known) = model.self_contact_of_file();
    if known > 0 {
        let comment =
            format!("self-contact: {known} of the {all} pairs that the file permits can be simulated");
        line(text, "# self_contact", quoted("file"), &comment);
    }
}

fn float(value: f64) -> String {
    format!("{value:?}")
}

/// No angle is known better than this, rad, and no length, m.
fn round(angle: f64) -> f64 {
    (angle * 1e4).round() / 1e4
}

/// The built-in weights in the robot's units: a term that is a square of a speed goes with 1/(g l), of a torque with
/// 1/(m g l)², of an angular acceleration with (l/g)², and sums over joints with their number.
fn rewards(text: &mut String, model: &Model, anatomy: &Anatomy, sizes: &Sizes) {
    let (length, torque) = (sizes.length(), sizes.torque());
    // A slide's force goes with m g.
    let slides = anatomy.acting().iter().filter(|&&joint| !model.joints[joint].kind.is_hinge()).count();
    // Squares of torques and forces are summed over all joints, so the unit is their mean square.
    let share = slides as f64 / anatomy.acting().len().max(1) as f64;
    let torque = torque * (1.0 - share + share / (sizes.leg * sizes.leg)).sqrt();
    // The built-in weights are for sums over the Go2's 12 joints.
    let joints = 12.0 / anatomy.acting().len().max(1) as f64;
    let stands = anatomy.stands_on_soles();
    if stands {
        let _ = writeln!(text, "\n[task.terms]");
        let _ = writeln!(text, "# Steps by the clock while walking, both feet on the ground while standing.");
        let _ = writeln!(text, "steps = {}", quoted(&steps_or_stands()));
    }
    let _ = writeln!(text, "\n[task.rewards]                   # the built-in weights in this robot's units");
    let scaled: &[(&str, f64, f64)] = if anatomy.biped() {
        &[
            ("track_linear_velocity", 6.0, 1.0),
            ("track_yaw_rate", 3.0, 1.0),
            ("vertical_velocity", -1.0, 1.0 / length),
            ("roll_pitch_rate", -0.05, length),
            ("posture", -4.0, 1.0),
            ("height", 2.0, 1.0),
            ("upright", 2.0, 1.0),
            ("torque", -2e-4, joints / (torque * torque)),
            ("joint_acceleration", -2.5e-7, joints * length * length),
            ("action_rate", -0.01, joints),
            ("air_time", 0.0, 1.0),
            ("gait", 0.0, 1.0),
            ("step_clock", if stands { 0.0 } else { 3.0 }, 1.0),
            ("steps", if stands { 3.0 } else { 0.0 }, 1.0),
            ("swing_height", 2.0, 1.0),
            ("foot_slip", -0.5, 1.0 / length),
            ("stand_still", if stands { -1.0 } else { 0.0 }, joints),
            ("joint_deviation", -0.2, joints),
            ("fall", -5.0, 1.0),
        ]
    } else {
        &[
            ("vertical_velocity", -2.0, 1.0 / length),
            ("roll_pitch_rate", -0.05, length),
            ("torque", -2e-4, joints / (torque * torque)),
            ("joint_acceleration", -5e-7, joints * length * length),
            ("action_rate", -0.04, joints),
            ("foot_slip", -0.1, 1.0 / length),
            ("stand_still", -1.0, joints),
        ]
    };
    let rolls = !anatomy.wheels.is_empty();
    let left_out = |name: &str| name == "steps" && !stands || rolls && OF_STEPS.contains(&name);
    for (name, weight, factor) in scaled.iter().filter(|(name, ..)| !left_out(name)) {
        let _ = writeln!(text, "{name} = {:?}", tidy(weight * factor));
    }
    for (index, name) in OF_STEPS.iter().enumerate().filter(|_| rolls) {
        line(text, name, float(0.0), if index == 0 { "wheels roll: steps are not paid for" } else { "" });
    }
}

/// A term for robots that can stand on their soles: `step_clock` while they walk, feet on the ground while they stand. Robots that
/// step on the spot drift: five of five trainings of a G1 did.
fn steps_or_stands() -> String {
    let clock = TERMS.iter().find(|term| term.name == "step_clock").map_or("0", |term| term.text);
    format!("select(walking, {clock}, 2 * mean(contact) - 1)")
}

/// Reward terms that pay for steps, or fine a foot that moves on the ground.
const OF_STEPS: [&str; 5] = ["gait", "air_time", "swing_height", "step_clock", "foot_slip"];

/// Observations of a policy on two legs: a clock tells which foot is to be up.
const BIPED_TERMS: &str = "\
    { quantity = \"base_angular_velocity\", scale = [0.25] },
    { quantity = \"projected_gravity\" },
    { quantity = \"command\" },
    { quantity = \"joint_position\" },
    { quantity = \"joint_velocity\", scale = [0.05] },
    { quantity = \"last_action\" },
    { quantity = \"gait_phase\" },
]
";

/// The observations of a policy on two legs; its critic sees how fast the base moves too.
fn biped_observations() -> String {
    let critic = "    { quantity = \"base_linear_velocity\" },\n";
    format!("observation = [\n    {BIPED_TERMS}critic_observation = [\n{critic}    {BIPED_TERMS}")
}
