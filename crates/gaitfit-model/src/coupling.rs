//! Joints that follow another one: MJCF `<equality><joint>`, URDF `<mimic>`.
//!
//! The engine solves a chain of up to three joints at once ([`MAX_SPAN`]). Couplings within such a chain are simulated. A
//! mending reading locks the other followers, a lenient one drops their couplings, a strict one refuses them.

use std::collections::HashMap;
use std::ops::RangeInclusive;

use crate::attributes::{Attributes, Context};
use crate::defaults::Defaults;
use crate::error::ModelError;
use crate::locked::{Lock, Locked, lock};
use crate::model::{Coupling, Model};
use crate::shown::{shown, shown_number};
use crate::spec::{BodySpec, MAX_JOINTS, SOLIMP, SOLREF, Spec};
use crate::xml::{At, Element};

/// Max number of neighbouring joints of a chain that couplings may connect.
pub const MAX_SPAN: usize = 3;

impl Model {
    /// Whether joint `index` follows another one or is held by a coupling.
    pub fn follows(&self, index: usize) -> bool {
        self.couplings.iter().any(|coupling| coupling.follower == index)
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

    /// The same, except for the joints `stated`, by index.
    pub fn couple_others(&self, positions: &mut [f64], stated: &[usize]) {
        // A leader may follow another joint.
        for _ in 0..MAX_SPAN {
            for coupling in self.couplings.iter().filter(|coupling| !stated.contains(&coupling.follower)) {
                let reference = |joint: usize| self.joints[joint].reference;
                let moved = coupling.leader.map_or(0.0, |leader| positions[leader] - reference(leader));
                positions[coupling.follower] = reference(coupling.follower) + coupling.follow(moved);
            }
        }
    }

    /// Neighbouring joints that couplings connect, as ranges of indices.
    pub fn coupled_spans(&self) -> Vec<RangeInclusive<usize>> {
        spans(self.couplings.iter().map(|coupling| (coupling.follower, coupling.leader)))
    }
}

/// The ranges of joints that `pairs` of follower and leader connect.
fn spans(pairs: impl Iterator<Item = Pair>) -> Vec<RangeInclusive<usize>> {
    let mut spans: Vec<RangeInclusive<usize>> = Vec::new();
    for (follower, leader) in pairs {
        let leader = leader.unwrap_or(follower);
        let mut span = follower.min(leader)..=follower.max(leader);
        spans.retain(|other| {
            let apart = other.end() < span.start() || span.end() < other.start();
            if !apart {
                span = *other.start().min(span.start())..=*other.end().max(span.end());
            }
            apart
        });
        spans.push(span);
    }
    spans
}

/// Largest coefficient of a coupling: no gear of a robot moves one joint so much faster than another.
const MAX_COEFFICIENT: f64 = 1e4;
/// Max number of couplings of a file.
const MAX_COUPLINGS: usize = 4 * MAX_JOINTS;

/// A coupling of a file: joints by name, since locked joints may leave.
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
        a.prefix(ctx, "solref", &mut self.solref)?;
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

    /// A lock of the follower, where its leader's reference would put it.
    fn into_lock(self) -> Lock {
        let leader = shown(self.leader.as_deref().unwrap_or_default());
        let how = format!(
            "it follows \"{leader}\", which is too far from it (couplings work within {MAX_SPAN} neighbouring joints of a chain), \
             so it is locked"
        );
        Lock { at: self.at, joint: self.follower, position: self.parameters.polynomial[0], how }
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
        if !form.inactive {
            all.push(NamedCoupling::new(element.at, follower, leader, polynomial, &form));
        }
    }
    Ok(all)
}

/// Finds the joints of `couplings` among those of `bodies`, by their order in the file. What cannot be simulated is refused; a
/// mending reading locks it, a lenient one leaves it out.
///
/// # Errors
/// A joint that does not exist, or a coefficient beyond bounds; in a strict reading, joints too far apart, and joints that
/// follow each other.
pub(crate) fn resolve(
    ctx: &mut Context,
    couplings: Vec<NamedCoupling>,
    bodies: &mut [BodySpec],
) -> Result<(Vec<Coupling>, Locked), ModelError> {
    let chain = Chain::new(bodies);
    let mut kept: Vec<(NamedCoupling, Pair)> = Vec::new();
    let mut locked: Vec<NamedCoupling> = Vec::new();
    for coupling in couplings {
        let name = shown(&coupling.follower);
        if let Some(large) = coupling.parameters.polynomial.iter().find(|c| c.abs() > MAX_COEFFICIENT) {
            let what = format!(
                "joint \"{name}\" follows another one with a coefficient of {}",
                shown_number(*large)
            );
            return Err(ctx.invalid(coupling.at, what, format!("give at most {MAX_COEFFICIENT}")));
        }
        let pair = match chain.find(&coupling) {
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
        let other = shown(coupling.leader.as_deref().unwrap_or_default());
        if leads_back(pair, &kept) {
            let what = format!("joint \"{name}\" follows \"{other}\", which follows it");
            ctx.refuse(coupling.at, what, "neither leads", "remove one of the couplings")?;
            continue;
        }
        let connected = spans(kept.iter().map(|(_, pair)| *pair).chain([pair]));
        if connected.iter().all(|span| chain.is_simulated(span)) {
            kept.push((coupling, pair));
        } else if ctx.mend && !ctx.lenient {
            locked.push(coupling);
        } else {
            ctx.refuse(
                coupling.at,
                format!("joint \"{name}\", which follows \"{other}\""),
                format!("couplings are simulated among {MAX_SPAN} neighbouring joints of one chain"),
                "remove the coupling and fix the joint, or let `gaitfit init` write a mended file",
            )?;
        }
    }
    lock_followers(&mut kept, &mut locked);
    let locks: Vec<Lock> = locked.into_iter().map(NamedCoupling::into_lock).collect();
    let lost = lock(ctx, &locks, bodies);
    let chain = Chain::new(bodies);
    let numbered = kept.into_iter().filter_map(|(coupling, _)| {
        let (follower, leader) = chain.find(&coupling).ok()?;
        Some(Coupling { follower, leader, ..coupling.parameters })
    });
    Ok((numbered.collect(), lost))
}

/// Whether the leader of a pair follows its follower, perhaps over others.
fn leads_back((follower, leader): Pair, kept: &[(NamedCoupling, Pair)]) -> bool {
    let mut seen = vec![follower];
    let mut next: Vec<usize> = leader.into_iter().collect();
    while let Some(joint) = next.pop() {
        if joint == follower {
            return true;
        }
        if !seen.contains(&joint) {
            seen.push(joint);
            next.extend(kept.iter().filter(|(_, pair)| pair.0 == joint).filter_map(|(_, pair)| pair.1));
        }
    }
    false
}

/// What follows a locked joint does not move either: it is locked where the other one's position puts it.
fn lock_followers(kept: &mut Vec<(NamedCoupling, Pair)>, locked: &mut Vec<NamedCoupling>) {
    let position = |name: &str, locked: &[NamedCoupling]| {
        let other = locked.iter().find(|other| other.follower == name)?;
        Some(other.parameters.polynomial[0])
    };
    let fixed = |coupling: &NamedCoupling, locked: &[NamedCoupling]| {
        let leader = coupling.leader.as_deref().and_then(|name| position(name, locked));
        leader.map(|at| coupling.parameters.follow(at)).or_else(|| position(&coupling.follower, locked))
    };
    while let Some((place, at)) =
        kept.iter().enumerate().find_map(|(place, (coupling, _))| Some((place, fixed(coupling, locked)?)))
    {
        let (mut coupling, _) = kept.remove(place);
        coupling.parameters.polynomial[0] = at;
        locked.push(coupling);
    }
}

/// The couplings of the robot that a file's content becomes; `joint_numbers`: the model's joints, by those of `spec`.
pub(crate) fn of_robot(spec: &Spec, joint_numbers: &[Option<usize>]) -> Vec<Coupling> {
    let all = spec.couplings.iter().filter_map(|coupling| {
        let follower = joint_numbers[coupling.follower]?;
        let leader = match coupling.leader {
            Some(leader) => Some(joint_numbers[leader]?),
            None => None,
        };
        Some(Coupling { follower, leader, ..coupling.clone() })
    });
    all.collect()
}

/// Follower and leader, by their numbers.
type Pair = (usize, Option<usize>);

/// A file's joints in order, each with the joint that carries it.
struct Chain {
    numbers: HashMap<String, usize>,
    parents: Vec<Option<usize>>,
}

impl Chain {
    fn new(bodies: &[BodySpec]) -> Self {
        let (mut numbers, mut parents) = (HashMap::new(), Vec::new());
        // The last joint of each body, or that of the body that carries it.
        let mut last: Vec<Option<usize>> = Vec::with_capacity(bodies.len());
        for (index, body) in bodies.iter().enumerate() {
            let mut carrier = if index == 0 { None } else { last[body.parent] };
            for (joint, _) in &body.joints {
                let number = parents.len();
                parents.push(carrier);
                carrier = Some(number);
                numbers.entry(joint.name.clone()).or_insert(number);
            }
            last.push(carrier);
        }
        Self { numbers, parents }
    }

    /// Follower and leader of a coupling, or the name of the one that does not exist.
    fn find<'n>(&self, coupling: &'n NamedCoupling) -> Result<Pair, &'n str> {
        let joint = |name: &'n String| self.numbers.get(name).copied().ok_or(name.as_str());
        Ok((joint(&coupling.follower)?, coupling.leader.as_ref().map(joint).transpose()?))
    }

    /// Whether the joints of a span form one chain without branches.
    fn is_simulated(&self, span: &RangeInclusive<usize>) -> bool {
        let children =
            |joint: usize| self.parents.iter().filter(move |parent| **parent == Some(joint)).count();
        let links = *span.start() + 1..=*span.end();
        span.end() - span.start() < MAX_SPAN
            && links
                .into_iter()
                .all(|joint| self.parents[joint] == Some(joint - 1) && children(joint - 1) == 1)
    }
}
