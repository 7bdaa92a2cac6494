//! Contact between parts of the robot: the pairs that may touch, by the robot file and by a setting.
//!
//! MuJoCo's filters decide for the file's own list: contact bits, explicit pairs, excluded bodies, and no contact between
//! a body and the one that carries it (MuJoCo documentation, Computation, "Selection").

mod distance;
mod error;
mod rod;

use std::collections::BTreeSet;

use globset::{Glob, GlobMatcher};
use serde::{Deserialize, Serialize};

use crate::contact::{mix, numbered};
use crate::kinematics::{Frame, rest_frames};
use crate::model::{ContactPair, Dropped, Geom, Model, Shape};
use crate::shown::shown;
use crate::spec::{GeomKind, Spec, Surface};

pub use error::SelfContactError;

// Every physics step looks at each pair, so their number bounds the time of a step.
/// Max number of pairs.
const MAX_PAIRS: usize = 512;
/// Max number of names in a list of a message.
const MAX_NAMES: usize = 6;

/// The setting for contact between parts of the robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub enum SelfContact {
    /// No pairs.
    #[default]
    Off,
    /// Pairs that the robot file lets touch.
    File,
    /// The last moving part of every limb, with those of other limbs.
    Limbs,
    /// Pairs of names or patterns of geoms or bodies.
    Pairs(Vec<[String; 2]>),
}

/// As a configuration has it.
#[derive(Clone, Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Word(String),
    Pairs(Vec<[String; 2]>),
    #[serde(skip_serializing)]
    Other(serde::de::IgnoredAny),
}

impl TryFrom<Written> for SelfContact {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        Ok(match written {
            Written::Word(word) if word == "off" => SelfContact::Off,
            Written::Word(word) if word == "file" => SelfContact::File,
            Written::Word(word) if word == "limbs" => SelfContact::Limbs,
            Written::Pairs(pairs) => SelfContact::Pairs(pairs),
            _ => {
                let words =
                    r#""off", "file", "limbs", or pairs of geoms or bodies such as [["*_foot", "*_foot"]]"#;
                return Err(format!("`self_contact` is {words}"));
            }
        })
    }
}

impl From<SelfContact> for Written {
    fn from(chosen: SelfContact) -> Self {
        match chosen {
            SelfContact::Off => Written::Word("off".to_owned()),
            SelfContact::File => Written::Word("file".to_owned()),
            SelfContact::Limbs => Written::Word("limbs".to_owned()),
            SelfContact::Pairs(pairs) => Written::Pairs(pairs),
        }
    }
}

impl SelfContact {
    /// These pairs, by the names of their geoms.
    pub fn named<'a>(pairs: impl IntoIterator<Item = &'a SelfPair>) -> Self {
        // A name may hold letters that mean something else in a pattern.
        let names = |pair: &SelfPair| [0, 1].map(|side| globset::escape(&pair.geoms[side].name));
        SelfContact::Pairs(pairs.into_iter().map(names).collect())
    }

    /// Whether no own parts touch each other.
    pub fn is_off(&self) -> bool {
        *self == SelfContact::Off
    }
}

/// Two geoms of the robot that may touch each other, with MuJoCo's contact parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SelfPair {
    /// The geoms, in the order of MuJoCo's geom types.
    pub geoms: [Geom; 2],
    /// Contact dimension: 1, 3, 4 or 6.
    pub condim: u8,
    /// Friction: tangential ×2, torsional, rolling ×2.
    pub friction: [f64; 5],
    /// Reference.
    pub solref: [f64; 2],
    /// Reference of the friction dimensions (elliptic cones; zeros: same as `solref`).
    pub solreffriction: [f64; 2],
    /// Impedance.
    pub solimp: [f64; 5],
    /// Distance below which the contact's constraint is active, m.
    pub margin: f64,
}

/// A file's rules for contacts between the robot's own shapes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    parts: Vec<Part>,
    /// Explicit pairs, by part.
    pairs: Vec<([usize; 2], ContactPair)>,
    /// Pairs of bodies that never touch.
    excluded: BTreeSet<(usize, usize)>,
    /// Whether a body may touch the one that carries it.
    neighbours: bool,
    /// Whether the file switches contacts off.
    off: bool,
}

/// One shape of the robot.
#[derive(Clone, Debug, PartialEq)]
struct Part {
    geom: Geom,
    /// A shape that does not collide here: its name.
    other: Option<&'static str>,
    body: String,
    surface: Surface,
    /// Topmost body that it moves with, the one that this hangs on, and whether that moves (in bodies of the file).
    weld: usize,
    parent: usize,
    /// Whether nothing that moves hangs on it.
    last: bool,
}

impl Parts {
    /// The shapes of the robot whose bodies are `robot`; `welds[b]` is the body that body `b` moves with.
    pub(crate) fn new(spec: &Spec, welds: &[usize], robot: &[bool]) -> Self {
        let root = robot.iter().position(|member| *member).unwrap_or(0);
        let mut numbers = Vec::new();
        let mut parts = Vec::new();
        // The body that carries a moving one; parts that are welded between the two do not count.
        let carrier = |weld: usize| welds[spec.bodies[weld].parent];
        for (body, geom) in numbered(spec) {
            let (shape, other) = match geom.kind {
                GeomKind::Solid(shape) => (shape, None),
                // The sphere is a stand-in: `other` says that the shape itself does not collide.
                GeomKind::Other(kind) => (Shape::Sphere { radius: 0.0 }, Some(kind)),
                _ => (Shape::Sphere { radius: 0.0 }, Some("plane")),
            };
            // Planes and height fields are ground, not parts of a robot.
            if !robot[body] || other == Some("plane") {
                numbers.push(None);
                continue;
            }
            numbers.push(Some(parts.len()));
            let weld = welds[body];
            let moving_body = body - root;
            parts.push(Part {
                geom: Geom {
                    name: geom.name.clone(),
                    body: moving_body,
                    shape,
                    pos: geom.pos,
                    quat: geom.quat,
                },
                other,
                body: spec.bodies[body].name.clone(),
                surface: geom.surface,
                weld,
                parent: carrier(weld),
                // No body that moves is carried by this one.
                last: !(0..welds.len()).any(|b| welds[b] == b && b != weld && robot[b] && carrier(b) == weld),
            });
        }
        let pairs = spec.pairs.iter().filter_map(|pair| {
            // A geom that is not a part of the robot, such as the floor, has no number: its pairs are left out here.
            let [a, b] = pair.geoms.map(|geom| numbers.get(geom).copied().flatten());
            Some(([a?.min(b?), a?.max(b?)], pair.parameters.clone()))
        });
        let excluded = spec.excludes.iter().filter(|(a, b)| robot[*a] && robot[*b]);
        Self {
            pairs: pairs.collect(),
            // By the robot's own numbers, as its geoms have them.
            excluded: excluded.map(|(a, b)| (a - root, b - root)).collect(),
            neighbours: spec.disabled.filterparent,
            off: spec.disabled.contact,
            parts,
        }
    }

    /// Whether MuJoCo's filter of bodies lets two parts touch.
    fn apart(&self, a: usize, b: usize) -> bool {
        let (first, second) = (&self.parts[a], &self.parts[b]);
        // As in MuJoCo the world is no neighbour: what hangs on it may touch what is fixed to it.
        let carried = first.weld != 0
            && second.weld != 0
            && (first.parent == second.weld || second.parent == first.weld);
        let bodies = (first.geom.body.min(second.geom.body), first.geom.body.max(second.geom.body));
        first.weld != second.weld && (!carried || self.neighbours) && !self.excluded.contains(&bodies)
    }

    /// Pairs that the file lets touch.
    fn of_file(&self) -> BTreeSet<[usize; 2]> {
        let mut pairs = BTreeSet::new();
        if self.off {
            return pairs;
        }
        // An explicit pair counts whatever the contact bits and filters say.
        pairs.extend(self.pairs.iter().map(|(parts, _)| *parts));
        for a in 0..self.parts.len() {
            for b in a + 1..self.parts.len() {
                if self.parts[a].surface.may_touch(&self.parts[b].surface) && self.apart(a, b) {
                    pairs.insert([a, b]);
                }
            }
        }
        pairs
    }

    /// Pairs of the last moving parts of limbs.
    fn of_limbs(&self) -> BTreeSet<[usize; 2]> {
        let last = |&p: &usize| self.parts[p].last && !self.parts[p].surface.is_visual();
        let last: Vec<usize> = (0..self.parts.len()).filter(last).collect();
        let pairs = last.iter().enumerate().flat_map(|(k, &a)| last[k + 1..].iter().map(move |&b| [a, b]));
        pairs.filter(|&[a, b]| self.apart(a, b)).collect()
    }

    /// Parts that a name or pattern covers: geoms, or the colliding geoms of bodies.
    fn named(&self, name: &str, robot: &str) -> Result<Vec<usize>, SelfContactError> {
        let glob = match Glob::new(name) {
            Ok(glob) => glob.compile_matcher(),
            Err(error) => {
                let reason = error.kind().to_string();
                return Err(SelfContactError::Syntax { pattern: name.to_owned(), reason });
            }
        };
        // A body stands for its parts that collide; a geom is meant by its own name whether it collides or
        // not.
        let covers = |glob: &GlobMatcher, part: &Part| {
            glob.is_match(&part.geom.name) || (glob.is_match(&part.body) && !part.surface.is_visual())
        };
        let covered: Vec<usize> = (0..self.parts.len()).filter(|&p| covers(&glob, &self.parts[p])).collect();
        if covered.is_empty() {
            return Err(self.unknown(name, robot));
        }
        Ok(covered)
    }

    fn unknown(&self, name: &str, robot: &str) -> SelfContactError {
        let names: BTreeSet<&str> =
            self.parts.iter().flat_map(|part| [part.geom.name.as_str(), part.body.as_str()]).collect();
        let mut scored: Vec<(f64, &str)> =
            names.into_iter().map(|other| (strsim::sorensen_dice(name, other), other)).collect();
        // The sort is stable: names that are equally near stay in alphabetical order.
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        let nearest: Vec<String> = scored.iter().take(MAX_NAMES).map(|(_, name)| shown(name)).collect();
        let (name, robot) = (name.to_owned(), robot.to_owned());
        SelfContactError::Unknown { name, robot, nearest: nearest.join(", ") }
    }

    /// The pair of two parts with its contact parameters; else why it is not computed. `frames`: those of the robot's bodies at
    /// rest.
    fn pair(&self, a: usize, b: usize, frames: &[Frame]) -> Result<Computed, String> {
        let (first, second) = (&self.parts[a], &self.parts[b]);
        let words = |part: &Part| {
            format!("{} ({})", shown(&part.geom.name), part.other.unwrap_or(part.geom.shape.name()))
        };
        let words = || [first, second].map(words).join(" with ");
        if first.other.is_some() || second.other.is_some() {
            return Err(words());
        }
        let order = |geom: &Geom| match geom.shape {
            Shape::Sphere { .. } => 0,
            Shape::Capsule { .. } => 1,
            Shape::Cylinder { .. } => 2,
            Shape::Box { .. } => 3,
        };
        let mut geoms = [first.geom.clone(), second.geom.clone()];
        // A pair that is not computed as it is gets rods in place of its boxes and cylinders.
        let as_rods = !computed(&geoms[0].shape, &geoms[1].shape);
        if as_rods {
            geoms = rod::in_place_of_both(&geoms, frames);
        }
        if !computed(&geoms[0].shape, &geoms[1].shape) {
            return Err(words());
        }
        // MuJoCo orders the geoms of a contact by type, which sets the sign of its normal.
        geoms.sort_by_key(order);
        // An explicit pair has parameters of its own; other pairs mix those of their geoms.
        let explicit = self.pairs.iter().find(|(parts, _)| *parts == [a, b]);
        let contact = match explicit {
            Some((_, contact)) => contact.clone(),
            None => mix(&first.surface, &second.surface),
        };
        let pair = SelfPair {
            geoms,
            condim: contact.condim,
            friction: contact.friction.map(crate::contact::at_least),
            solref: contact.solref,
            solreffriction: contact.solreffriction,
            solimp: contact.solimp,
            margin: contact.margin,
        };
        Ok(Computed { pair, simplified: as_rods.then(words) })
    }
}

/// A pair whose contact is computed.
struct Computed {
    pair: SelfPair,
    /// Names of the two parts, if a rod stands for one of them.
    simplified: Option<String>,
}

/// Whether the contact of two shapes is computed.
fn computed(a: &Shape, b: &Shape) -> bool {
    use Shape::{Box, Capsule, Sphere};
    matches!(
        (a, b),
        (Sphere { .. }, Sphere { .. } | Capsule { .. } | Box { .. })
            | (Capsule { .. } | Box { .. }, Sphere { .. })
            | (Capsule { .. }, Capsule { .. })
    )
}

impl Model {
    /// The robot with own parts that touch each other, and in words what of it is simplified or left out.
    ///
    /// # Errors
    /// Names of nothing, and nothing left of what is asked for.
    pub fn touching_itself(&self, chosen: &SelfContact) -> Result<(Model, Vec<String>), SelfContactError> {
        let parts = &self.parts;
        let mut wanted = BTreeSet::new();
        let mut left_out = Vec::new();
        let what = match chosen {
            SelfContact::Off => String::new(),
            SelfContact::File => {
                wanted = parts.of_file();
                "what the robot file lets touch".to_owned()
            }
            SelfContact::Limbs => {
                wanted = parts.of_limbs();
                "the ends of limbs".to_owned()
            }
            SelfContact::Pairs(pairs) => {
                for [one, other] in pairs {
                    let (first, second) = (parts.named(one, &self.name)?, parts.named(other, &self.name)?);
                    // In ascending order, as the file's rules have them.
                    let all = first.iter().flat_map(|&a| second.iter().map(move |&b| [a.min(b), a.max(b)]));
                    let apart: BTreeSet<[usize; 2]> = all.filter(|&[a, b]| parts.apart(a, b)).collect();
                    if apart.is_empty() {
                        let what = format!("{one} with {other}");
                        let why = "they are one part, or one carries the other, or the file excludes them"
                            .to_owned();
                        return Err(SelfContactError::Nothing { what, why });
                    }
                    wanted.extend(apart);
                }
                "the pairs".to_owned()
            }
        };
        let mut model = self.clone();
        // An earlier choice is replaced.
        model.self_pairs.clear();
        let (mut others, mut simplified) = (Vec::new(), Vec::new());
        // All joints are at their references here. This decides once which edge of a box faces the other part.
        let frames = rest_frames(self);
        let contacts: Vec<Result<Computed, String>> =
            wanted.into_iter().map(|[a, b]| parts.pair(a, b, &frames)).collect();
        // Each pair costs time. Rods stand for other shapes where a pair is named, or where nothing else could touch.
        let is_named = matches!(chosen, SelfContact::Pairs(_));
        let exact = !is_named && contacts.iter().flatten().any(|one| one.simplified.is_none());
        for contact in contacts {
            match contact {
                Ok(Computed { simplified: Some(words), .. }) if exact => others.push(words),
                Ok(contact) if model.self_pairs.len() < MAX_PAIRS => {
                    model.self_pairs.push(contact.pair);
                    simplified.extend(contact.simplified);
                }
                Ok(_) => return Err(SelfContactError::TooMany),
                Err(words) => others.push(words),
            }
        }
        if !simplified.is_empty() {
            left_out.push(format!(
                "self_contact: rods stand for the boxes and cylinders of {} pairs ({}): a box has the edge that faces the \
                 other part",
                simplified.len(),
                some(&simplified)
            ));
        }
        if !others.is_empty() {
            let shapes = match exact {
                true => {
                    "spheres touch spheres, capsules and boxes, and capsules touch capsules; rods stand for other boxes and \
                     cylinders if self_contact names the pair"
                }
                false => "meshes, ellipsoids and short cylinders touch only the ground",
            };
            let (count, words) = (others.len(), some(&others));
            left_out.push(format!("self_contact: {count} pairs are left out ({words}): {shapes}"));
            model.dropped.push(Dropped {
                what: format!("the contact of {count} pairs of its own parts ({words})"),
                why: shapes.to_owned(),
                line: 0,
                column: 0,
                harmless: false,
            });
        }
        if model.self_pairs.is_empty() && !chosen.is_off() {
            // Where nothing is left, the last reason that was noted says why.
            let why = left_out.pop().unwrap_or_else(|| "it lets none of its own parts touch".to_owned());
            return Err(SelfContactError::Nothing { what, why });
        }
        Ok((model, left_out))
    }

    /// All pairs that the file lets touch and whose contact can be computed, also those with rods for other shapes; none if they are
    /// too many.
    pub fn self_pairs_of_file(&self) -> Vec<SelfPair> {
        let frames = rest_frames(self);
        let pairs = self.parts.of_file();
        let pairs = pairs.into_iter().filter_map(|[a, b]| Some(self.parts.pair(a, b, &frames).ok()?.pair));
        // One more than may be shows that there are too many.
        let pairs: Vec<SelfPair> = pairs.take(MAX_PAIRS + 1).collect();
        if pairs.len() > MAX_PAIRS { Vec::new() } else { pairs }
    }

    /// How many pairs of own parts the file lets touch, and of how many of them the contact is computed.
    pub fn self_contact_of_file(&self) -> (usize, usize) {
        let known = self.touching_itself(&SelfContact::File).map_or(0, |(model, _)| model.self_pairs.len());
        (self.parts.of_file().len(), known)
    }
}

/// The first of some names, and whether there are more.
fn some(names: &[String]) -> String {
    let more = if names.len() > MAX_NAMES { ", ..." } else { "" };
    format!("{}{more}", names[..names.len().min(MAX_NAMES)].join(", "))
}
