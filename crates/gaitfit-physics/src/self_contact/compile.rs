//! From a model's self-contact pairs to those of a tree.

use gaitfit_model::{Geom, Model, Root, SelfPair, Shape};

use crate::seat::{Seat, mat_mul};
use crate::self_contact::{
    Form, MAX_POINTS, SelfContactJoint, SelfContactPair, SelfContactShape, SelfContacts, Sparsity,
};
use crate::softness::{impedance, reference};
use crate::tree::{Coupling, Link, Reference, Segment};
use crate::vec3::*;
use crate::{PhysicsError, Real, Settings};

/// Share of a pair's reach for rounding.
const SLACK: f64 = 1e-3;

/// Compiles the self-contact pairs of `model`. `links` get their place among those that touch. The last argument: all couplings
/// of the tree, and the number of the first distant one.
///
/// # Errors
/// Names the geom whose numbers the step cannot honour.
pub(crate) fn compile<T: Real>(
    model: &Model,
    settings: &Settings,
    seats: &[Seat],
    links: &mut [Link<T::K>],
    segments: &[Segment],
    touching: &mut Vec<(usize, Option<usize>)>,
    (couplings, first_distant): (&[Coupling<T::K>], usize),
) -> Result<SelfContacts<T::K>, PhysicsError> {
    let mut contacts = SelfContacts {
        pairs: Vec::new(),
        joints: Vec::new(),
        homes: Vec::new(),
        ground_links: Vec::new(),
        points: 0,
        rows: 0,
        weights: 0,
        couplings: first_distant..couplings.len(),
        sparsity: Sparsity::default(),
    };
    if model.self_pairs.is_empty() && contacts.couplings.is_empty() {
        return Ok(contacts);
    }
    let home = |link: usize| segments.iter().position(|s| (s.first..s.first + s.len).contains(&link));
    for link in 1..links.len() {
        // Every link but the root is in a segment, so the 0 is never taken.
        let segment = home(link).unwrap_or(0);
        contacts.homes.push((segment, link - segments[segment].first));
    }
    for (number, link) in links.iter().enumerate() {
        contacts.ground_links.extend(link.pairs.clone().map(|_| number));
    }
    for pair in &model.self_pairs {
        let ends = [0, 1].map(|side| seats[pair.geoms[side].body]);
        for seat in &ends {
            // A link that touches the ground has its place already.
            if links[seat.link].touching.is_none() {
                links[seat.link].touching = Some(touching.len());
                touching.push((seat.link, home(seat.link).filter(|_| seat.link > 0)));
            }
        }
        let shapes = [0, 1].map(|side| {
            // The loop above has given both links a place.
            let pose = links[ends[side].link].touching.unwrap_or(0);
            shape::<T>(&pair.geoms[side], &ends[side], pose)
        });
        let moved = carriers(links, ends.map(|seat| seat.link));
        let pair = compile_pair::<T>(pair, settings, shapes, moved.len(), &contacts)?;
        contacts.joints.extend(moved);
        contacts.points = pair.points.end;
        contacts.rows += pair.points.len() * pair.dims * pair.joints.len();
        contacts.weights += pair.points.len() * pair.dims * pair.dims;
        contacts.pairs.push(pair);
    }
    let distant = &couplings[first_distant..];
    let of_pair = |pair: &SelfContactPair<T::K>| {
        contacts.joints[pair.joints.clone()].iter().map(|joint| joint.joint).collect()
    };
    let of_coupling =
        |coupling: &Coupling<T::K>| coupling.leader.into_iter().chain([coupling.follower]).collect();
    let of_contacts = contacts.pairs.iter().map(of_pair);
    let coupled: Vec<Vec<usize>> = of_contacts.chain(distant.iter().map(of_coupling)).collect();
    // Joint i − 1 moves link i, and the root has no joint.
    let parents: Vec<Option<usize>> = links[1..].iter().map(|link| link.parent.checked_sub(1)).collect();
    contacts.sparsity = Sparsity::new(&parents, model.root == Root::Floating, &coupled);
    Ok(contacts)
}

/// Joints that carry one of two links alone, in rising order.
fn carriers<K>(links: &[Link<K>], ends: [usize; 2]) -> Vec<SelfContactJoint> {
    let chain = |mut link: usize| {
        let mut chain = Vec::new();
        while link > 0 {
            chain.push(link);
            link = links[link].parent;
        }
        chain
    };
    let [first, second] = ends.map(chain);
    // A joint that carries both links moves them as one, so the contact does not feel it.
    let alone = |link: &usize, other: &[usize]| !other.contains(link);
    let ours = first
        .iter()
        .filter(|link| alone(link, &second))
        .map(|link| SelfContactJoint { joint: link - 1, second: false });
    let theirs = second
        .iter()
        .filter(|link| alone(link, &first))
        .map(|link| SelfContactJoint { joint: link - 1, second: true });
    let mut joints: Vec<SelfContactJoint> = ours.chain(theirs).collect();
    joints.sort_by_key(|contacts| contacts.joint);
    joints
}

fn shape<T: Real>(geom: &Geom, seat: &Seat, pose: usize) -> SelfContactShape<T::K> {
    let k = |x: f64| T::constant(x);
    let k3 = |v: V3<f64>| [k(v[0]), k(v[1]), k(v[2])];
    let rotation = mat_mul(&seat.rotation, &quat_matrix(&geom.quat));
    let column = |j: usize| [rotation[0][j], rotation[1][j], rotation[2][j]];
    let (form, radius) = match geom.shape {
        Shape::Sphere { radius } => (Form::Ball, radius),
        // A capsule lies along its own z axis.
        Shape::Capsule { radius, half_length } => (Form::Rod(k3(scale(half_length, column(2)))), radius),
        // `compile_pair` refuses cylinders, so this form is never used.
        Shape::Cylinder { radius, .. } => (Form::Ball, radius),
        Shape::Box { half_size } => {
            (Form::Block([k3(column(0)), k3(column(1)), k3(column(2))], k3(half_size)), 0.0)
        }
    };
    let center = k3(add(seat.position, rotate(&seat.rotation, geom.pos)));
    SelfContactShape { pose, center, radius: k(radius), form }
}

/// Radius of the ball about a shape's centre that holds it, m.
fn extent(shape: &Shape) -> f64 {
    match shape {
        Shape::Sphere { radius } => *radius,
        Shape::Capsule { radius, half_length } => radius + half_length,
        Shape::Cylinder { radius, half_length } => radius.hypot(*half_length),
        Shape::Box { half_size: [a, b, c] } => (a * a + b * b + c * c).sqrt(),
    }
}

fn compile_pair<T: Real>(
    pair: &SelfPair,
    settings: &Settings,
    shapes: [SelfContactShape<T::K>; 2],
    joints: usize,
    contacts: &SelfContacts<T::K>,
) -> Result<SelfContactPair<T::K>, PhysicsError> {
    let k = |x: f64| T::constant(x);
    let [first, second] = &pair.geoms;
    let count = match (&first.shape, &second.shape) {
        (Shape::Sphere { .. }, Shape::Sphere { .. } | Shape::Capsule { .. } | Shape::Box { .. }) => 1,
        // Parallel capsules touch in two points. Others leave the second one far away.
        (Shape::Capsule { .. }, Shape::Capsule { .. }) => MAX_POINTS,
        _ => {
            let [geom, other] = [first, second].map(|geom| format!("{} `{}`", geom.shape.name(), geom.name));
            return Err(PhysicsError::SelfContactShapes { geom, other });
        }
    };
    if !matches!(pair.condim, 1 | 3 | 4 | 6) {
        return Err(PhysicsError::ContactDimension { geom: first.name.clone(), condim: pair.condim });
    }
    let name = format!("contact of geoms `{}` and `{}`", first.name, second.name);
    let dmax = pair.solimp[1];
    let (stiffness, damping, gain) = reference(&pair.solref, dmax, settings);
    let elliptic = settings.cone == gaitfit_model::Cone::Elliptic;
    let separate = elliptic && pair.solreffriction != [0.0; 2];
    // MuJoCo reads zeros as the reference of the normal.
    let friction_ref = if separate { pair.solreffriction } else { pair.solref };
    // A negative margin makes contacts later, but the shapes' own reach is bound enough.
    let reach = (extent(&first.shape) + extent(&second.shape) + pair.margin.max(0.0)) * (1.0 + SLACK);
    Ok(SelfContactPair {
        shapes,
        // The square saves a root for each pair in each step.
        reach2: k(reach * reach),
        condim: usize::from(pair.condim),
        friction: pair.friction.map(k),
        margin: k(pair.margin),
        impedance: impedance(&pair.solimp, k, &name)?,
        reference: Reference { k: k(stiffness), b: k(damping), gain: k(1.0 / gain) },
        friction_b: k(reference(&friction_ref, dmax, settings).1),
        points: contacts.points..contacts.points + count,
        dims: if pair.condim > 3 { 6 } else { 3 },
        joints: contacts.joints.len()..contacts.joints.len() + joints,
        rows: contacts.rows,
        weights: contacts.weights,
    })
}
