//! A model compiled for stepping: links with one hinge each, contact shapes in link frames, row constants.
//!
//! Every hinge becomes a link whose frame sits at the hinge's anchor, with the hinge along one of its axes.
//! Bodies without a joint are welded into the link that carries them. Link 0 is the root: the floating base,
//! or the world. Link `i` moves with joint `i − 1`; parents come before children.

use std::ops::Range;

use gaitfit_model::{Body, ContactPair, Joint, Model, Root, Shape};

use crate::vec3::*;
use crate::{PhysicsError, Real, Settings};

/// Smallest and largest impedance (MuJoCo's `mjMINIMP`, `mjMAXIMP`).
const IMPEDANCE: [f64; 2] = [0.0001, 0.9999];
/// Largest power of an impedance curve: beyond it single precision overflows.
const MAX_POWER: f64 = 8.0;
/// Smallest positive number MuJoCo divides by (`mjMINVAL`).
pub(crate) const TINY: f64 = 1e-15;

/// Axis of a link frame that its hinge turns about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

/// Impedance as a function of violation (MuJoCo, "Solver parameters"): d(x) = dmin + y(x)·(dmax − dmin).
#[derive(Clone, Debug)]
pub(crate) struct Impedance<K> {
    pub dmin: K,
    pub rise: K,
    pub per_width: K,
    pub midpoint: K,
    /// Whole part of the power.
    pub power: u32,
    /// Binary digits of the power's fraction, the highest bit for a half.
    pub fraction: u64,
    /// 1 / midpoint^(power − 1).
    pub low: K,
    /// 1 / (1 − midpoint)^(power − 1).
    pub high: K,
}

/// Spring and damper of a constraint's reference acceleration: aref = −b·v − k·d·(pos − margin).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference<K> {
    pub k: K,
    pub b: K,
}

/// A joint limit.
#[derive(Clone, Debug)]
pub(crate) struct Limit<K> {
    pub lower: K,
    pub upper: K,
    pub margin: K,
    pub impedance: Impedance<K>,
    pub reference: Reference<K>,
}

/// One hinge and what it carries.
#[derive(Clone, Debug)]
pub(crate) struct Link<K> {
    pub parent: usize,
    /// Anchor in the parent's frame, m.
    pub offset: [K; 3],
    /// Constant turn from the parent's frame at joint angle zero; `None` for the identity.
    pub turn: Option<[[K; 3]; 3]>,
    pub axis: Axis,
    pub reference_angle: K,
    pub limit: Option<Limit<K>>,
    /// D·invweight of the friction-loss row, and its damping.
    pub friction_weight: K,
    pub friction_b: K,
    pub stiffness: K,
    pub springref: K,
    /// Whether the joint has a spring.
    pub sprung: bool,
    /// Contact pairs of this link, and its place in `Tree::touching` if it has any.
    pub pairs: Range<usize>,
    pub touching: Option<usize>,
}

/// Up to three links in a row, eliminated together. Several segments may hang on one node; a node is the root
/// or the last link of a segment that carries others.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    /// First link; the others follow it directly.
    pub first: usize,
    /// Links, 1 to 3.
    pub len: usize,
    /// Node it hangs on.
    pub parent: usize,
    /// Node that its last link is, if it carries segments.
    pub node: Option<usize>,
    /// Contact pairs of its links.
    pub pairs: Range<usize>,
}

/// Most links in a segment.
pub(crate) const SEGMENT: usize = 3;

/// A contact shape in its link's frame.
#[derive(Clone, Debug)]
pub(crate) enum LinkShape<K> {
    Sphere,
    /// Unit axis.
    Capsule {
        axis: [K; 3],
        half_length: K,
    },
    /// Unit axis, unit x axis.
    Cylinder {
        axis: [K; 3],
        x_axis: [K; 3],
        half_length: K,
    },
    /// Half edges.
    Box {
        edges: [[K; 3]; 3],
    },
}

/// A static plane in world axes.
#[derive(Clone, Debug)]
pub(crate) struct GroundPlane<K> {
    /// Unit normal and MuJoCo's two tangents.
    pub frame: [[K; 3]; 3],
    /// Distance of the plane from the world's origin along the normal, m.
    pub offset: K,
}

/// A shape that may touch a plane.
#[derive(Clone, Debug)]
pub(crate) struct Pair<K> {
    /// Index of the pair in `Model::pairs`.
    pub model_pair: usize,
    /// Place of the first point among the points with spin.
    pub spin: usize,
    /// Place of the pair's link in its segment.
    pub member: usize,
    pub plane: usize,
    pub shape: LinkShape<K>,
    pub center: [K; 3],
    pub radius: K,
    /// Radius of a sphere about `center` that holds the shape, plus the margin.
    pub reach: K,
    pub condim: usize,
    pub friction: [K; 5],
    /// Whether the contact frame may be taken as the world's axes (normal z).
    pub aligned: bool,
    pub margin: K,
    pub impedance: Impedance<K>,
    pub reference: Reference<K>,
    /// Damping of the friction dimensions (elliptic cones).
    pub friction_b: K,
    pub points: Range<usize>,
}

/// A compiled robot with the constants of one step. Made once; shared by all environments.
#[derive(Clone, Debug)]
pub struct Tree<K> {
    pub(crate) floating: bool,
    pub(crate) root_rotation: [[K; 3]; 3],
    pub(crate) root_position: [K; 3],
    pub(crate) gravity: [K; 3],
    pub(crate) links: Vec<Link<K>>,
    /// Parents before children.
    pub(crate) segments: Vec<Segment>,
    /// Link of each node; node 0 is the root.
    pub(crate) nodes: Vec<usize>,
    pub(crate) planes: Vec<GroundPlane<K>>,
    pub(crate) pairs: Vec<Pair<K>>,
    pub(crate) points: usize,
    /// Points with spin.
    pub(crate) spins: usize,
    /// Links with contact pairs, and the segment of each (none for the root).
    pub(crate) touching: Vec<(usize, Option<usize>)>,
    pub(crate) impratio: f64,
    pub(crate) elliptic: bool,
    pub(crate) settings: Settings,
}

impl<K> Tree<K> {
    /// Hinge joints.
    pub fn joints(&self) -> usize {
        self.links.len() - 1
    }

    /// Length of `qpos` in MuJoCo's layout.
    pub fn nq(&self) -> usize {
        self.joints() + if self.floating { 7 } else { 0 }
    }

    /// Length of `qvel` in MuJoCo's layout.
    pub fn nv(&self) -> usize {
        self.joints() + if self.floating { 6 } else { 0 }
    }

    /// Settings it was compiled with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
}

/// Where a body sits in its link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seat {
    pub link: usize,
    pub rotation: M3<f64>,
    pub position: V3<f64>,
}

/// A joint's link: parent link, anchor, turn, axis.
pub(crate) type Hinge = (usize, V3<f64>, M3<f64>, Axis);

pub(crate) const IDENTITY: M3<f64> = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub(crate) fn transpose(m: &M3<f64>) -> M3<f64> {
    [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]]
}

pub(crate) fn mat_mul(a: &M3<f64>, b: &M3<f64>) -> M3<f64> {
    let t = transpose(b);
    each3!(i => each3!(j => dot(a[i], t[j])))
}

/// The axis to turn about, and the rotation whose columns are a frame with that axis along it.
fn axis_frame(axis: V3<f64>) -> (Axis, M3<f64>) {
    for (index, name) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
        if (axis[index] - 1.0).abs() < 1e-14 {
            return (name, IDENTITY);
        }
    }
    // z along the axis, x across it.
    let smallest = if axis[0].abs() <= axis[1].abs() && axis[0].abs() <= axis[2].abs() {
        [1.0, 0.0, 0.0]
    } else if axis[1].abs() <= axis[2].abs() {
        [0.0, 1.0, 0.0]
    } else {
        [0.0, 0.0, 1.0]
    };
    let x = unit(cross(smallest, axis));
    let y = cross(axis, x);
    (Axis::Z, transpose(&[x, y, axis]))
}

pub(crate) fn unit(v: V3<f64>) -> V3<f64> {
    scale(1.0 / dot(v, v).sqrt(), v)
}

/// Seats of all bodies, and each joint's link constants (parent, anchor, turn, axis).
pub(crate) fn seats(model: &Model) -> (Vec<Seat>, Vec<Hinge>) {
    let mut seats: Vec<Seat> = Vec::with_capacity(model.bodies.len());
    let mut hinges = Vec::with_capacity(model.joints.len());
    for (index, body) in model.bodies.iter().enumerate() {
        let pose = quat_matrix(&body.quat);
        let mut seat = match body.parent {
            Some(parent) => {
                let p: Seat = seats[parent];
                Seat {
                    link: p.link,
                    rotation: mat_mul(&p.rotation, &pose),
                    position: add(p.position, rotate(&p.rotation, body.pos)),
                }
            }
            // The floating base is link 0 itself; a fixed root hangs in the world, which is link 0.
            None if model.root == Root::Floating => Seat { link: 0, rotation: IDENTITY, position: [0.0; 3] },
            None => Seat { link: 0, rotation: pose, position: body.pos },
        };
        for joint in model.joints.iter().filter(|joint| joint.body == index) {
            let anchor = add(seat.position, rotate(&seat.rotation, joint.pos));
            let (axis, frame) = axis_frame(joint.axis);
            hinges.push((seat.link, anchor, mat_mul(&seat.rotation, &frame), axis));
            // The body as the new link sees it.
            let back = transpose(&frame);
            seat =
                Seat { link: hinges.len(), rotation: back, position: scale(-1.0, rotate(&back, joint.pos)) };
        }
        seats.push(seat);
    }
    (seats, hinges)
}

fn impedance<K>(solimp: &[f64; 5], k: impl Fn(f64) -> K, object: &str) -> Result<Impedance<K>, PhysicsError> {
    let clamp = |x: f64| x.clamp(IMPEDANCE[0], IMPEDANCE[1]);
    let (dmin, dmax, width) = (clamp(solimp[0]), clamp(solimp[1]), solimp[2].max(0.0));
    let (midpoint, power) = (clamp(solimp[3]), solimp[4].max(1.0));
    if dmin == dmax || width <= TINY {
        let flat = 0.5 * (dmin + dmax);
        return Ok(Impedance {
            dmin: k(flat),
            rise: k(0.0),
            per_width: k(0.0),
            midpoint: k(0.5),
            power: 1,
            fraction: 0,
            low: k(1.0),
            high: k(1.0),
        });
    }
    if !(1.0..=MAX_POWER).contains(&power) {
        return Err(PhysicsError::ImpedancePower { object: object.to_owned(), power });
    }
    Ok(Impedance {
        dmin: k(dmin),
        rise: k(dmax - dmin),
        per_width: k(1.0 / width),
        midpoint: k(midpoint),
        power: power as u32,
        fraction: (power.fract() * 2f64.powi(64)) as u64,
        low: k(1.0 / midpoint.powf(power - 1.0)),
        high: k(1.0 / (1.0 - midpoint).powf(power - 1.0)),
    })
}

/// Impedance at zero violation, as friction loss has it.
fn impedance_at_zero(solimp: &[f64; 5]) -> f64 {
    let clamp = |x: f64| x.clamp(IMPEDANCE[0], IMPEDANCE[1]);
    let (dmin, dmax) = (clamp(solimp[0]), clamp(solimp[1]));
    if solimp[2] <= TINY { 0.5 * (dmin + dmax) } else { dmin }
}

/// Stiffness and damping of MuJoCo's two reference formats.
fn reference(solref: &[f64; 2], dmax: f64, timestep: f64) -> (f64, f64) {
    let dmax = dmax.clamp(IMPEDANCE[0], IMPEDANCE[1]);
    // A mixed format is replaced by the default, as MuJoCo does.
    let solref = if (solref[0] > 0.0) != (solref[1] > 0.0) { [0.02, 1.0] } else { *solref };
    if solref[0] > 0.0 {
        let (time, ratio) = (solref[0].max(2.0 * timestep), solref[1]);
        (1.0 / (dmax * dmax * time * time * ratio * ratio).max(TINY), 2.0 / (dmax * time).max(TINY))
    } else {
        (-solref[0] / (dmax * dmax).max(TINY), -solref[1] / dmax.max(TINY))
    }
}

/// Compiles `model` for the scalar `T`.
///
/// # Errors
/// Names the joint or geom whose numbers the step cannot honour.
pub fn compile<T: Real>(model: &Model, settings: &Settings) -> Result<Tree<T::K>, PhysicsError> {
    if !(settings.timestep.is_finite() && settings.timestep > 0.0) {
        return Err(PhysicsError::Value {
            object: "settings".to_owned(),
            quantity: "the timestep",
            value: settings.timestep,
            must: "positive and finite",
        });
    }
    let k = |x: f64| T::constant(x);
    let k3 = |v: V3<f64>| [k(v[0]), k(v[1]), k(v[2])];
    let (seats, hinges) = seats(model);
    let floating = model.root == Root::Floating;

    let mut pairs = Vec::new();
    let mut points = 0;
    let planes = model.planes.iter().map(|plane| ground_plane(&plane.pos, &plane.quat)).collect::<Vec<_>>();
    let mut ranges = Vec::with_capacity(hinges.len() + 1);
    for link in 0..=hinges.len() {
        let first = pairs.len();
        for (index, pair) in model.pairs.iter().enumerate() {
            let seat = seats[model.geoms[pair.geom].body];
            if seat.link == link && (link > 0 || floating) {
                let pair = compile_pair::<T>(model, index, pair, &seat, &planes, settings, points)?;
                points = pair.points.end;
                pairs.push(pair);
            }
        }
        ranges.push(first..pairs.len());
    }

    let mut links: Vec<Link<T::K>> = Vec::with_capacity(hinges.len() + 1);
    links.push(root_link::<T>());
    for (index, ((parent, anchor, turn, axis), joint)) in hinges.iter().zip(&model.joints).enumerate() {
        let identity = turn.iter().flatten().zip(IDENTITY.iter().flatten()).all(|(a, b)| a == b);
        links.push(Link {
            parent: *parent,
            offset: k3(*anchor),
            turn: if identity { None } else { Some([k3(turn[0]), k3(turn[1]), k3(turn[2])]) },
            axis: *axis,
            reference_angle: k(joint.reference),
            limit: compile_limit::<T>(joint, settings)?,
            friction_weight: {
                let d = impedance_at_zero(&joint.solimp_friction);
                k(d / (1.0 - d))
            },
            friction_b: k(reference(&joint.solref_friction, joint.solimp_friction[1], settings.timestep).1),
            stiffness: k(joint.stiffness),
            springref: k(joint.springref),
            sprung: joint.stiffness != 0.0,
            pairs: ranges[index + 1].clone(),
            touching: None,
        });
    }
    links[0].pairs = ranges[0].clone();
    let (segments, nodes) = segment(&links);
    let mut touching = Vec::new();
    let mut spins = 0;
    for (index, link) in links.iter_mut().enumerate().filter(|(_, link)| !link.pairs.is_empty()) {
        let home = segments.iter().position(|s| (s.first..s.first + s.len).contains(&index));
        link.touching = Some(touching.len());
        touching.push((index, home));
        for pair in &mut pairs[link.pairs.clone()] {
            pair.member = home.map_or(0, |home| index - segments[home].first);
            if pair.condim > 3 {
                pair.spin = spins;
                spins += pair.points.len();
            }
        }
    }
    Ok(Tree {
        floating,
        root_rotation: [k3(IDENTITY[0]), k3(IDENTITY[1]), k3(IDENTITY[2])],
        root_position: k3(if floating { [0.0; 3] } else { model.bodies[0].pos }),
        gravity: k3(model.options.gravity),
        links,
        segments,
        nodes,
        planes: planes
            .iter()
            .map(|(frame, offset)| GroundPlane {
                frame: [k3(frame[0]), k3(frame[1]), k3(frame[2])],
                offset: k(*offset),
            })
            .collect(),
        pairs,
        points,
        spins,
        touching,
        impratio: model.options.impratio,
        elliptic: settings.cone == gaitfit_model::Cone::Elliptic,
        settings: *settings,
    })
}

/// Segments, parents first, and the link of each node.
fn segment<K>(links: &[Link<K>]) -> (Vec<Segment>, Vec<usize>) {
    let mut children = vec![0; links.len()];
    for link in &links[1..] {
        children[link.parent] += 1;
    }
    let mut segments: Vec<Segment> = Vec::new();
    let mut nodes = vec![0];
    // Segment of each link.
    let mut home = vec![usize::MAX; links.len()];
    for i in 1..links.len() {
        let parent = links[i].parent;
        let continues = parent > 0 && children[parent] == 1 && segments[home[parent]].len < SEGMENT;
        if continues {
            home[i] = home[parent];
            let segment = &mut segments[home[i]];
            segment.len += 1;
            segment.pairs.end = links[i].pairs.end;
            continue;
        }
        let node = nodes.iter().position(|&link| link == parent).unwrap_or_else(|| {
            segments[home[parent]].node = Some(nodes.len());
            nodes.push(parent);
            nodes.len() - 1
        });
        home[i] = segments.len();
        segments.push(Segment { first: i, len: 1, parent: node, node: None, pairs: links[i].pairs.clone() });
    }
    (segments, nodes)
}

fn root_link<T: Real>() -> Link<T::K> {
    let zero = T::constant(0.0);
    Link {
        parent: 0,
        offset: [zero; 3],
        turn: None,
        axis: Axis::Z,
        reference_angle: zero,
        limit: None,
        friction_weight: zero,
        friction_b: zero,
        stiffness: zero,
        springref: zero,
        sprung: false,
        pairs: 0..0,
        touching: None,
    }
}

fn compile_limit<T: Real>(joint: &Joint, settings: &Settings) -> Result<Option<Limit<T::K>>, PhysicsError> {
    let Some([lower, upper]) = joint.range else { return Ok(None) };
    if upper - lower < 2.0 * joint.margin {
        return Err(PhysicsError::NarrowRange { joint: joint.name.clone() });
    }
    let (k, b) = reference(&joint.solref_limit, joint.solimp_limit[1], settings.timestep);
    Ok(Some(Limit {
        lower: T::constant(lower),
        upper: T::constant(upper),
        margin: T::constant(joint.margin),
        impedance: impedance(&joint.solimp_limit, T::constant, &format!("limit of joint `{}`", joint.name))?,
        reference: Reference { k: T::constant(k), b: T::constant(b) },
    }))
}

/// Normal and tangents as MuJoCo makes a contact frame from a normal alone, and the plane's offset.
fn ground_plane(pos: &[f64; 3], quat: &[f64; 4]) -> (M3<f64>, f64) {
    let r = quat_matrix(quat);
    let normal = [r[0][2], r[1][2], r[2][2]];
    let guess = if normal[1].abs() < 0.5 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let t1 = unit(axpy(-dot(normal, guess), normal, guess));
    ([normal, t1, cross(normal, t1)], dot(normal, *pos))
}

fn compile_pair<T: Real>(
    model: &Model,
    index: usize,
    pair: &ContactPair,
    seat: &Seat,
    planes: &[(M3<f64>, f64)],
    settings: &Settings,
    first_point: usize,
) -> Result<Pair<T::K>, PhysicsError> {
    let k = |x: f64| T::constant(x);
    let k3 = |v: V3<f64>| [k(v[0]), k(v[1]), k(v[2])];
    let geom = &model.geoms[pair.geom];
    if !matches!(pair.condim, 1 | 3 | 4 | 6) {
        return Err(PhysicsError::ContactDimension { geom: geom.name.clone(), condim: pair.condim });
    }
    let rotation = mat_mul(&seat.rotation, &quat_matrix(&geom.quat));
    let column = |j: usize| [rotation[0][j], rotation[1][j], rotation[2][j]];
    let (shape, radius, reach, count) = match geom.shape {
        Shape::Sphere { radius } => (LinkShape::Sphere, radius, radius, 1),
        Shape::Capsule { radius, half_length } => (
            LinkShape::Capsule { axis: k3(column(2)), half_length: k(half_length) },
            radius,
            radius + half_length,
            2,
        ),
        Shape::Cylinder { radius, half_length } => (
            LinkShape::Cylinder { axis: k3(column(2)), x_axis: k3(column(0)), half_length: k(half_length) },
            radius,
            radius.hypot(half_length),
            4,
        ),
        Shape::Box { half_size: [a, b, c] } => (
            LinkShape::Box {
                edges: [k3(scale(a, column(0))), k3(scale(b, column(1))), k3(scale(c, column(2)))],
            },
            0.0,
            (a * a + b * b + c * c).sqrt(),
            4,
        ),
    };
    let name = format!("contact of geom `{}`", geom.name);
    let dmax = pair.solimp[1];
    let (stiffness, damping) = reference(&pair.solref, dmax, settings.timestep);
    let elliptic = settings.cone == gaitfit_model::Cone::Elliptic;
    // A pyramid's edges mix normal and tangent, so they have one reference.
    let own = elliptic && pair.solreffriction != [0.0; 2];
    let friction_ref = if own { pair.solreffriction } else { pair.solref };
    let isotropic = pair.friction[0] == pair.friction[1];
    let level = planes[pair.plane].0[0] == [0.0, 0.0, 1.0];
    // A capsule turns the tangents with its axis, which a pyramid or an anisotropic ellipse can tell.
    let turned = matches!(geom.shape, Shape::Capsule { .. }) && !(elliptic && isotropic);
    Ok(Pair {
        model_pair: index,
        spin: 0,
        member: 0,
        plane: pair.plane,
        shape,
        center: k3(add(seat.position, rotate(&seat.rotation, geom.pos))),
        radius: k(radius),
        reach: k(reach + pair.margin),
        condim: usize::from(pair.condim),
        friction: pair.friction.map(k),
        aligned: level && (pair.condim == 1 || (pair.condim == 3 && !turned)),
        margin: k(pair.margin),
        impedance: impedance(&pair.solimp, k, &name)?,
        reference: Reference { k: k(stiffness), b: k(damping) },
        friction_b: k(reference(&friction_ref, dmax, settings.timestep).1),
        points: first_point..first_point + count,
    })
}

/// Body inertia about its centre of mass, body axes.
pub(crate) fn body_inertia(body: &Body) -> Sym3<f64> {
    let diagonal = [body.inertia[0], body.inertia[1], body.inertia[2], 0.0, 0.0, 0.0];
    sym_rotate(&quat_matrix(&body.iquat), &diagonal)
}
