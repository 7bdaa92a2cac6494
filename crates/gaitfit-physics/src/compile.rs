//! From a [`Model`] to a [`Tree`].

use std::ops::{Range, RangeInclusive};

use gaitfit_model::{ContactPair, Ground, Joint, JointKind, Model, Root, Shape};

use crate::coupling;
use crate::obstacles::Obstacles;
use crate::seat::{IDENTITY, Mount, Seat, mat_mul, seats, unit};
use crate::self_contact;
use crate::softness::{impedance, impedance_at_zero, reference};
use crate::tree::*;
use crate::vec3::*;
use crate::{PhysicsError, Real, Settings};

/// Share of an obstacle's reach for rounding.
const SLACK: f64 = 1e-3;

/// Longest emulated step, in steps: beyond it dampers would push.
const MAX_EMULATED: f64 = 2.0;

/// Compiles `model` for the scalar `T`.
///
/// # Errors
/// Names the joint or geom whose numbers the step cannot honour.
pub fn compile<T: Real>(model: &Model, settings: &Settings) -> Result<Tree<T::K>, PhysicsError> {
    compile_with::<T>(model, settings, true)
}

/// As [`compile`]; without `on_ground` the tree has no contacts with the ground, whose height fields take long.
///
/// # Errors
/// As there.
pub(crate) fn compile_with<T: Real>(
    model: &Model,
    settings: &Settings,
    on_ground: bool,
) -> Result<Tree<T::K>, PhysicsError> {
    check_steps(settings)?;
    let k = |x: f64| T::constant(x);
    let k3 = |v: V3<f64>| [k(v[0]), k(v[1]), k(v[2])];
    // Bodies without joints are welded: `seats` names each body's link, `mounts` places each link on its
    // parent.
    let (seats, mounts) = seats(model);
    let floating = model.root == Root::Floating;

    let mut pairs = Vec::new();
    let mut points = 0;
    let obstacles = if on_ground { Obstacles::compile::<T>(model)? } else { Obstacles::none() };
    let contacts = if on_ground { &model.pairs[..] } else { &[] };
    let planes = model.planes.iter().map(|plane| ground_plane(&plane.pos, &plane.quat)).collect::<Vec<_>>();
    let ground = Grounds { planes: &planes, obstacles: &obstacles };
    let mut ranges = Vec::with_capacity(mounts.len() + 1);
    // Pairs go by link, so that a link's pairs are a range. `Robot::params` lists their inverse inertias in
    // this order.
    for link in 0..=mounts.len() {
        let first = pairs.len();
        for (index, pair) in contacts.iter().enumerate() {
            let seat = seats[model.geoms[pair.geom].body];
            // Geoms on a fixed root cannot move towards the ground.
            if seat.link == link && (link > 0 || floating) {
                let pair = compile_pair::<T>(model, index, pair, &seat, &ground, settings, points)?;
                points = pair.points.end;
                pairs.push(pair);
            }
        }
        ranges.push(first..pairs.len());
    }

    let mut links: Vec<Link<T::K>> = Vec::with_capacity(mounts.len() + 1);
    links.push(root_link::<T>());
    for (number, (mount, joint)) in mounts.iter().zip(&model.joints).enumerate() {
        links.push(compile_link::<T>(mount, joint, settings, ranges[number + 1].clone())?);
    }
    links[0].pairs = ranges[0].clone();
    // Before the segments: the joints of a near coupling must come into one of them.
    let spans = coupling::Spans::new(model, &links);
    let (mut segments, nodes) = segment(&links, &spans.near);
    let couplings = coupling::compile::<T>(model, settings, &spans, &mut segments)?;
    // Couplings are sorted by segment; those beyond the last segment's range are distant.
    let first_distant = segments.last().map_or(0, |segment| segment.couplings.end);
    let (mut touching, spins) = touching(&mut links, &segments, &mut pairs);
    let self_contact = self_contact::compile::<T>(
        model,
        settings,
        &seats,
        &mut links,
        &segments,
        &mut touching,
        (&couplings, first_distant),
    )?;
    let free = model.free_joint.filter(|_| floating).map(|free| compile_free::<T>(&free, settings));
    Ok(Tree {
        floating,
        free,
        root_position: k3(if floating { [0.0; 3] } else { model.bodies[0].pos }),
        gravity: k3(model.options.gravity),
        links,
        segments,
        couplings,
        nodes,
        planes: planes
            .iter()
            .map(|(frame, offset)| GroundPlane {
                frame: [k3(frame[0]), k3(frame[1]), k3(frame[2])],
                offset: k(*offset),
            })
            .collect(),
        blocks: obstacles.blocks,
        fields: obstacles.fields,
        pairs,
        points,
        spins,
        touching,
        self_contact,
        impratio: model.options.impratio,
        elliptic: settings.cone == gaitfit_model::Cone::Elliptic,
        velocity_targets: (0..mounts.len()).map(|joint| model.velocity_targets.contains(&joint)).collect(),
        settings: *settings,
    })
}

/// Refuses steps that cannot be simulated.
fn check_steps(settings: &Settings) -> Result<(), PhysicsError> {
    if !(settings.timestep.is_finite() && settings.timestep > 0.0) {
        return Err(PhysicsError::Value {
            object: "settings".to_owned(),
            quantity: "the timestep",
            value: settings.timestep,
            must: "positive and finite",
        });
    }
    if let Some(step) = settings.emulated_step
        && !(0.0..=MAX_EMULATED * settings.timestep).contains(&step)
    {
        return Err(PhysicsError::Value {
            object: "settings".to_owned(),
            quantity: "the emulated step",
            value: step,
            must: "from 0 to twice the timestep",
        });
    }
    Ok(())
}

/// The link below one joint; `pairs` are its contacts.
fn compile_link<T: Real>(
    (parent, anchor, turn, axis): &Mount,
    joint: &Joint,
    settings: &Settings,
    pairs: Range<usize>,
) -> Result<Link<T::K>, PhysicsError> {
    let k = |x: f64| T::constant(x);
    let k3 = |v: V3<f64>| [k(v[0]), k(v[1]), k(v[2])];
    // A link without a turn saves the step a product of matrices.
    let identity = turn.iter().flatten().zip(IDENTITY.iter().flatten()).all(|(a, b)| a == b);
    // MuJoCo's D is d / ((1 − d) · invweight). The inverse weight is the robot's own and enters in each step.
    let friction_impedance = impedance_at_zero(&joint.solimp_friction);
    let (_, friction_b, gain) = reference(&joint.solref_friction, joint.solimp_friction[1], settings);
    Ok(Link {
        parent: *parent,
        offset: k3(*anchor),
        turn: if identity { None } else { Some([k3(turn[0]), k3(turn[1]), k3(turn[2])]) },
        axis: *axis,
        kind: joint.kind,
        reference: k(joint.reference),
        limit: compile_limit::<T>(joint, settings)?,
        friction_weight: k(friction_impedance / (1.0 - friction_impedance) * gain),
        friction_b: k(friction_b),
        stiffness: k(joint.stiffness),
        springref: k(joint.springref),
        has_spring: joint.stiffness != 0.0,
        pairs,
        touching: None,
    })
}

/// Dry friction, damping and rotor inertia of a floating base.
fn compile_free<T: Real>(free: &gaitfit_model::FreeJoint, settings: &Settings) -> FreeJoint<T::K> {
    let k = |x: f64| T::constant(x);
    let impedance = impedance_at_zero(&free.solimp_friction);
    let (_, friction_b, gain) = reference(&free.solref_friction, free.solimp_friction[1], settings);
    FreeJoint {
        armature: k(free.armature),
        damping: k(free.damping),
        frictionloss: k(free.frictionloss),
        friction_weight: k(impedance / (1.0 - impedance) * gain),
        friction_b: k(friction_b),
    }
}

/// Numbers the links that may touch something, each with its segment, and the points whose friction also turns.
fn touching<K>(
    links: &mut [Link<K>],
    segments: &[Segment],
    pairs: &mut [Pair<K>],
) -> (Vec<(usize, Option<usize>)>, usize) {
    let mut touching = Vec::new();
    let mut spins = 0;
    for (index, link) in links.iter_mut().enumerate().filter(|(_, link)| !link.pairs.is_empty()) {
        let home = segments.iter().position(|s| (s.first..s.first + s.len).contains(&index));
        link.touching = Some(touching.len());
        touching.push((index, home));
        for pair in &mut pairs[link.pairs.clone()] {
            // The root belongs to no segment: its pairs act on node 0 itself.
            pair.member = home.map_or(0, |home| index - segments[home].first);
            pair.node = home.map_or(0, |home| segments[home].parent);
            if pair.condim > 3 {
                pair.spin = spins;
                spins += pair.points.len();
            }
        }
    }
    (touching, spins)
}

/// Segments, parents first, and the link of each node. The joints of a span of `coupled` come into one segment.
fn segment<K>(links: &[Link<K>], coupled: &[RangeInclusive<usize>]) -> (Vec<Segment>, Vec<usize>) {
    // Links of the span that begins with link `i`.
    let span = |i: usize| {
        let begins = coupled.iter().find(|span| *span.start() + 1 == i);
        begins.map_or(1, |span| span.end() - span.start() + 1)
    };
    let mut children = vec![0; links.len()];
    for link in &links[1..] {
        children[link.parent] += 1;
    }
    let mut segments: Vec<Segment> = Vec::new();
    // The root is always the first node.
    let mut nodes = vec![0];
    // Segment of each link.
    let mut home = vec![usize::MAX; links.len()];
    for i in 1..links.len() {
        let parent = links[i].parent;
        // A segment goes on along a chain without branches while there is room for the whole span.
        // Bodies stand depth first, so the only child of a link has the next number.
        let continues =
            parent > 0 && children[parent] == 1 && segments[home[parent]].len + span(i) <= SEGMENT;
        if continues {
            home[i] = home[parent];
            let segment = &mut segments[home[i]];
            segment.len += 1;
            segment.pairs.end = links[i].pairs.end;
            continue;
        }
        // The parent becomes a node when the first segment hangs on it.
        let node = nodes.iter().position(|&link| link == parent).unwrap_or_else(|| {
            segments[home[parent]].node = Some(nodes.len());
            nodes.push(parent);
            nodes.len() - 1
        });
        home[i] = segments.len();
        let pairs = links[i].pairs.clone();
        segments.push(Segment { first: i, len: 1, parent: node, node: None, pairs, couplings: 0..0 });
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
        kind: JointKind::Hinge,
        reference: zero,
        limit: None,
        friction_weight: zero,
        friction_b: zero,
        stiffness: zero,
        springref: zero,
        has_spring: false,
        pairs: 0..0,
        touching: None,
    }
}

fn compile_limit<T: Real>(joint: &Joint, settings: &Settings) -> Result<Option<Limit<T::K>>, PhysicsError> {
    let Some([lower, upper]) = joint.range else { return Ok(None) };
    // The step has one limit row a joint, so both limits must never be active at once.
    if upper - lower < 2.0 * joint.margin {
        return Err(PhysicsError::NarrowRange { joint: joint.name.clone() });
    }
    let (k, b, gain) = reference(&joint.solref_limit, joint.solimp_limit[1], settings);
    Ok(Some(Limit {
        lower: T::constant(lower),
        upper: T::constant(upper),
        margin: T::constant(joint.margin),
        impedance: impedance(&joint.solimp_limit, T::constant, &format!("limit of joint `{}`", joint.name))?,
        reference: Reference { k: T::constant(k), b: T::constant(b), gain: T::constant(gain) },
    }))
}

/// Normal and tangents as MuJoCo makes a contact frame from a normal alone, and the plane's offset.
fn ground_plane(pos: &[f64; 3], quat: &[f64; 4]) -> (M3<f64>, f64) {
    let r = quat_matrix(quat);
    let normal = [r[0][2], r[1][2], r[2][2]];
    // The first tangent by Gram–Schmidt from y, or from z where the normal is near y (`mju_makeFrame`).
    let guess = if normal[1].abs() < 0.5 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let t1 = unit(axpy(-dot(normal, guess), normal, guess));
    ([normal, t1, cross(normal, t1)], dot(normal, *pos))
}

/// What pairs may touch: frames and offsets of planes, and the obstacles.
struct Grounds<'a, K> {
    planes: &'a [(M3<f64>, f64)],
    obstacles: &'a Obstacles<K>,
}

fn compile_pair<T: Real>(
    model: &Model,
    index: usize,
    pair: &ContactPair,
    seat: &Seat,
    ground: &Grounds<'_, T::K>,
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
    // `count` is the number of points that MuJoCo gives the shape on a plane.
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
    let (stiffness, damping, gain) = reference(&pair.solref, dmax, settings);
    let elliptic = settings.cone == gaitfit_model::Cone::Elliptic;
    // A pyramid's edges mix normal and tangent, so they have one reference.
    let separate = elliptic && pair.solreffriction != [0.0; 2];
    // MuJoCo reads zeros as the reference of the normal.
    let friction_ref = if separate { pair.solreffriction } else { pair.solref };
    let isotropic = pair.friction[0] == pair.friction[1];
    let touched = match pair.ground {
        Ground::Plane(plane) => Touched::Plane(plane),
        Ground::Obstacle { obstacle } => ground.obstacles.touched(model, geom, obstacle)?,
    };
    // Where the normal is the world's z, rows need no turn into the contact's frame.
    let level = matches!(touched, Touched::Plane(plane) if ground.planes[plane].0[0] == [0.0, 0.0, 1.0]);
    // A capsule turns the tangents with its axis, which a pyramid or an anisotropic ellipse can tell.
    let turned = matches!(geom.shape, Shape::Capsule { .. }) && !(elliptic && isotropic);
    Ok(Pair {
        model_pair: index,
        spin: 0,
        member: 0,
        node: 0,
        touched,
        shape,
        center: k3(add(seat.position, rotate(&seat.rotation, geom.pos))),
        radius: k(radius),
        // The bound on the distance from an obstacle may round otherwise than the distance.
        reach: k((reach + pair.margin) * if matches!(touched, Touched::Plane(_)) { 1.0 } else { 1.0 + SLACK }),
        condim: usize::from(pair.condim),
        friction: pair.friction.map(k),
        aligned: level && (pair.condim == 1 || (pair.condim == 3 && !turned)),
        margin: k(pair.margin),
        impedance: impedance(&pair.solimp, k, &name)?,
        // A point's row is computed from 1/D, so it takes the reciprocal of the gain.
        reference: Reference { k: k(stiffness), b: k(damping), gain: k(1.0 / gain) },
        friction_b: k(reference(&friction_ref, dmax, settings).1),
        points: first_point..first_point + count,
    })
}
