//! Joints that follow another one: MJCF `<equality><joint>`, URDF `<mimic>`.
//!
//! All of them are simulated, but for joints that follow each other in a ring: there nothing leads. A strict reading refuses
//! the ring's last coupling, other readings drop it.

use std::collections::HashMap;

use crate::attributes::{Attributes, Context};
use crate::defaults::Defaults;
use crate::error::ModelError;
use crate::model::{Coupling, Model};
use crate::shown::{shown, shown_number};
use crate::spec::{BodySpec, MAX_JOINTS, SOLIMP, SOLREF, Spec};
use crate::xml::{At, Element};

impl Model {
    /// Whether joint `index` follows another one or is held by a coupling.
    pub fn follows(&self, index: usize) -> bool {
        self.couplings.iter().any(|coupling| coupling.follower == index)
    }

    /// Whether a coupling acts on joint `index`: it follows another one, leads one, or is held.
    pub fn is_coupled(&self, index: usize) -> bool {
        self.couplings.iter().any(|coupling| coupling.follower == index || coupling.leader == Some(index))
    }

    /// Whether joint `index` has a motor. In a file without actuators all joints have one: the PD controller drives them.
    pub fn is_driven(&self, index: usize) -> bool {
        self.actuators.is_empty() || self.actuators.iter().any(|actuator| actuator.joint == index)
    }

    /// Whether joint `index` follows another one, or is held, and has no motor of its own.
    pub fn only_follows(&self, index: usize) -> bool {
        self.follows(index) && !self.actuators.iter().any(|actuator| actuator.joint == index)
    }

    /// The couplings in words: `tip follows knuckle: 0.1 + 0.9 x`.
    pub fn couplings_in_words(&self) -> Vec<String> {
        let name = |joint: usize| shown(&self.joints[joint].name);
        let words = |coupling: &Coupling| {
            let mut sum = String::new();
            for (k, c) in coupling.polynomial.iter().enumerate().filter(|(_, c)| **c != 0.0) {
                let sign = match (sum.is_empty(), *c < 0.0) {
                    (true, true) => "-",
                    (true, false) => "",
                    (false, true) => " - ",
                    (false, false) => " + ",
                };
                let power = match k {
                    0 => String::new(),
                    1 => "x".to_owned(),
                    k => format!("x^{k}"),
                };
                let size = c.abs();
                let factor = if size == 1.0 && k > 0 { String::new() } else { format!("{size}") };
                let space = if factor.is_empty() || power.is_empty() { "" } else { " " };
                sum.push_str(&format!("{sign}{factor}{space}{power}"));
            }
            let sum = if sum.is_empty() { "0".to_owned() } else { sum };
            let follower = name(coupling.follower);
            match coupling.leader {
                Some(leader) => format!("{follower} follows {}: {sum}", name(leader)),
                None => format!("{follower} is held at {}", coupling.polynomial[0]),
            }
        };
        self.couplings.iter().map(words).collect()
    }

    /// Moves the joints that follow others to where their leaders put them; `positions`: of all joints, rad or m.
    pub fn couple(&self, positions: &mut [f64]) {
        self.couple_others(positions, &[]);
    }

    /// Gives the joints that follow others the velocities that their leaders have there, by the couplings' slopes; `positions` and
    /// `velocities`: of all joints, rad or m, rad/s or m/s.
    pub fn couple_velocities(&self, positions: &[f64], velocities: &mut [f64]) {
        // As many turns as there are couplings settle the longest chain, as in `couple_others`.
        for _ in 0..self.couplings.len() {
            for coupling in &self.couplings {
                let velocity = |leader: usize| {
                    coupling.slope(positions[leader] - self.joints[leader].reference) * velocities[leader]
                };
                velocities[coupling.follower] = coupling.leader.map_or(0.0, velocity);
            }
        }
    }

    /// As [`Model::couple`], except for the joints `stated`, by index.
    pub fn couple_others(&self, positions: &mut [f64], stated: &[usize]) {
        // A leader may follow another joint, whose coupling may come later.
        // As many turns as there are couplings settle the longest chain, so this ends also where joints
        // follow in a ring.
        for _ in 0..self.couplings.len() {
            let mut moves = false;
            for coupling in self.couplings.iter().filter(|coupling| !stated.contains(&coupling.follower)) {
                let reference = |joint: usize| self.joints[joint].reference;
                // A joint that is held has no leader: x is 0, and c₀ alone counts.
                let moved = coupling.leader.map_or(0.0, |leader| positions[leader] - reference(leader));
                let position = reference(coupling.follower) + coupling.follow(moved);
                moves |= position != positions[coupling.follower];
                positions[coupling.follower] = position;
            }
            if !moves {
                return;
            }
        }
    }
}

/// Largest coefficient of a coupling of two hinges or two slides: no gear of a robot moves one joint so much faster
/// than another, and simulations of such couplings diverge.
const MAX_COEFFICIENT: f64 = 1e3;
/// Largest coefficient of a coupling of a hinge and a slide: a screw turns by thousands of radians a metre.
const MAX_SCREW: f64 = 1e4;
/// Max number of couplings of a file.
const MAX_COUPLINGS: usize = 4 * MAX_JOINTS;

/// A coupling of a file: its joints by name, because the file may state it before them.
pub(crate) struct NamedCoupling {
    at: At,
    follower: String,
    leader: Option<String>,
    /// Its joints are not set yet.
    parameters: Coupling,
}

/// Parameters of `<equality>` by default.
#[derive(Clone, Debug)]
pub(crate) struct CouplingForm {
    solref: [f64; 2],
    solimp: [f64; 5],
    inactive: bool,
}

impl Default for CouplingForm {
    fn default() -> Self {
        Self { solref: SOLREF, solimp: SOLIMP, inactive: false }
    }
}

impl CouplingForm {
    /// Reads an element's attributes over the present values.
    pub fn apply(&mut self, ctx: &Context, a: &mut Attributes) -> Result<(), ModelError> {
        a.reference(ctx, "solref", &mut self.solref)?;
        a.prefix(ctx, "solimp", &mut self.solimp)?;
        if let Some(active) = a.boolean(ctx, "active")? {
            self.inactive = !active;
        }
        Ok(())
    }
}

impl NamedCoupling {
    fn new(at: At, follower: &str, leader: Option<&str>, polynomial: [f64; 5], form: &CouplingForm) -> Self {
        let CouplingForm { solref, solimp, .. } = *form;
        let parameters = Coupling { follower: 0, leader: None, polynomial, solref, solimp };
        Self { at, follower: follower.to_owned(), leader: leader.map(str::to_owned), parameters }
    }

    /// Its follower and its leader by their numbers, or the name of the one that does not exist.
    fn find<'n>(&'n self, numbers: &HashMap<&str, usize>) -> Result<(usize, Option<usize>), &'n str> {
        let joint = |name: &'n String| numbers.get(name.as_str()).copied().ok_or(name.as_str());
        Ok((joint(&self.follower)?, self.leader.as_ref().map(joint).transpose()?))
    }

    /// A `<mimic>` of URDF, with MuJoCo's usual softness.
    pub fn mimic(at: At, follower: &str, leader: &str, offset: f64, factor: f64) -> Self {
        let polynomial = [offset, factor, 0.0, 0.0, 0.0];
        Self::new(at, follower, Some(leader), polynomial, &CouplingForm::default())
    }
}

/// Reads the couplings of `<equality>` sections.
///
/// # Errors
/// Attributes that cannot be read.
pub(crate) fn read_couplings<'e>(
    ctx: &mut Context,
    sections: impl Iterator<Item = &'e Element>,
    defaults: &Defaults,
) -> Result<Vec<NamedCoupling>, ModelError> {
    let mut all = Vec::new();
    for element in sections.flat_map(|section| &section.children).filter(|child| child.name == "joint") {
        if all.len() >= MAX_COUPLINGS {
            return Err(ctx.too_many(element.at, "couplings", MAX_COUPLINGS));
        }
        let mut a = Attributes::new(element);
        a.ignore(&["name"]);
        let class = match a.text("class") {
            Some(name) => defaults.find(ctx, a.at("class"), name)?,
            None => 0,
        };
        let mut form = defaults.class(class).coupling.clone();
        form.apply(ctx, &mut a)?;
        // MuJoCo's default: the follower moves as its leader does.
        let mut polynomial = [0.0, 1.0, 0.0, 0.0, 0.0];
        a.prefix(ctx, "polycoef", &mut polynomial)?;
        let Some(follower) = a.text("joint1").filter(|name| !name.is_empty()) else {
            return Err(ctx.invalid(
                element.at,
                "<joint> of <equality> without joint1",
                "add joint1=\"...\"",
            ));
        };
        let leader = a.text("joint2").filter(|name| !name.is_empty());
        a.finish(ctx)?;
        // MuJoCo can switch an inactive one on while it runs; here nothing does.
        if !form.inactive {
            all.push(NamedCoupling::new(element.at, follower, leader, polynomial, &form));
        }
    }
    Ok(all)
}

/// Finds the joints of `couplings` among those of `bodies`, by their order in the file.
///
/// # Errors
/// A joint that does not exist, or a coefficient beyond bounds; in a strict reading, joints that follow each other.
pub(crate) fn resolve(
    ctx: &mut Context,
    couplings: Vec<NamedCoupling>,
    bodies: &[BodySpec],
) -> Result<Vec<Coupling>, ModelError> {
    let mut numbers: HashMap<&str, usize> = HashMap::new();
    for (number, (joint, _)) in bodies.iter().flat_map(|body| &body.joints).enumerate() {
        // Names used twice are refused later; until then the first one counts, as in other look-ups.
        numbers.entry(&joint.name).or_insert(number);
    }
    let joints = bodies.iter().flat_map(|body| &body.joints);
    let hinges: Vec<bool> = joints.map(|(joint, _)| joint.kind.is_hinge()).collect();
    let mut kept: Vec<Coupling> = Vec::new();
    for coupling in couplings {
        let name = shown(&coupling.follower);
        let (follower, leader) = match coupling.find(&numbers) {
            Ok(pair) => pair,
            Err(missing) => {
                let what = format!("coupling of joint \"{name}\"");
                let why = format!("no hinge or slide is called \"{}\"", shown(missing));
                if !ctx.drops() {
                    return Err(ctx.invalid(coupling.at, format!("{what}: {why}"), "name an existing joint"));
                }
                ctx.refuse(coupling.at, what, why, "name an existing joint")?;
                continue;
            }
        };
        let is_screw = leader.is_some_and(|leader| hinges[leader] != hinges[follower]);
        let max = if is_screw { MAX_SCREW } else { MAX_COEFFICIENT };
        if let Some(large) = coupling.parameters.polynomial.iter().find(|c| c.abs() > max) {
            let what = format!(
                "joint \"{name}\" follows another one with a coefficient of {}",
                shown_number(*large)
            );
            return Err(ctx.invalid(coupling.at, what, format!("give at most {max}")));
        }
        // Couplings are taken up in file order, so the one that closes a ring is the one that is refused.
        if leads_back(follower, leader, &kept) {
            let other = shown(coupling.leader.as_deref().unwrap_or_default());
            let (what, remedy) = match leader == Some(follower) {
                true => (format!("joint \"{name}\" follows itself"), "remove the coupling"),
                false => (
                    format!("joint \"{name}\" follows \"{other}\", which follows it"),
                    "remove one of the couplings",
                ),
            };
            ctx.refuse(coupling.at, what, "nothing leads", remedy)?;
            continue;
        }
        kept.push(Coupling { follower, leader, ..coupling.parameters });
    }
    Ok(kept)
}

/// Whether `leader` follows `follower`, perhaps over others.
fn leads_back(follower: usize, leader: Option<usize>, kept: &[Coupling]) -> bool {
    let mut seen = vec![follower];
    let mut next: Vec<usize> = leader.into_iter().collect();
    while let Some(joint) = next.pop() {
        if joint == follower {
            return true;
        }
        // A joint may be reached on several ways, and is followed once.
        if !seen.contains(&joint) {
            seen.push(joint);
            let leaders = kept.iter().filter(|coupling| coupling.follower == joint);
            next.extend(leaders.filter_map(|coupling| coupling.leader));
        }
    }
    false
}

/// The couplings of the robot that a file's content becomes; `joint_numbers`: the model's joints, by those of `spec`.
pub(crate) fn of_robot(spec: &Spec, joint_numbers: &[Option<usize>]) -> Vec<Coupling> {
    // A follower on a dropped body takes its coupling with it.
    let all = spec.couplings.iter().filter_map(|coupling| {
        let follower = joint_numbers[coupling.follower]?;
        // A coupling goes with its leader if that belongs to a body that was dropped.
        let leader = match coupling.leader {
            Some(leader) => Some(joint_numbers[leader]?),
            None => None,
        };
        Some(Coupling { follower, leader, ..coupling.clone() })
    });
    all.collect()
}
