//! Which geoms may touch which planes and obstacles, with what parameters, in the order of MuJoCo's contacts.
//!
//! MuJoCo 4 sums margins and gaps; the other parameters come from the geom of higher priority, or are
//! mixed: larger condim, element-wise larger friction, `solref` and `solimp` weighted by `solmix`
//! (MuJoCo documentation, Computation, "Contact parameters"). Contacts come out sorted by body pair;
//! within one, explicit pairs first, then by geom.

use std::collections::HashSet;

use crate::attributes::Context;
use crate::error::ModelError;
use crate::model::{ContactPair, Shape};
use crate::shown::shown;
use crate::spec::{GeomKind, GeomSpec, MAX_PAIRS, Spec, Surface};
use crate::terrain::Ground;
use crate::xml::At;

/// MuJoCo's floor for friction coefficients (`mjMINMU`).
pub const MIN_FRICTION: f64 = 1e-5;
/// Below this a `solmix` counts as zero (`mjMINVAL`).
const MIN_SOLMIX: f64 = 1e-15;

/// MuJoCo's floor for friction coefficients, applied.
pub(crate) fn at_least(friction: f64) -> f64 {
    friction.max(MIN_FRICTION)
}

/// A pair before geoms, planes and obstacles got their places in the model: numbers in file order.
pub(crate) struct Candidate {
    /// File number of the geom.
    pub geom: usize,
    /// File number of the plane or obstacle.
    pub ground: usize,
    pub parameters: ContactPair,
}

/// Geoms of a file with their body, numbered as MuJoCo numbers them: body by body.
pub(crate) fn numbered(spec: &Spec) -> Vec<(usize, &GeomSpec)> {
    spec.bodies.iter().enumerate().flat_map(|(b, body)| body.geoms.iter().map(move |g| (b, g))).collect()
}

/// All pairs of a geom and a plane or obstacle. `welds[b]` is the body that body `b` moves with (0: the world); `robot[b]`
/// says whether body `b` belongs to the robot.
///
/// # Errors
/// [`ModelError::TooLarge`] for more pairs than any robot has; [`ModelError::Unsupported`] for shapes whose contact with an
/// obstacle is not computed.
pub(crate) fn candidates(
    ctx: &mut Context,
    spec: &Spec,
    welds: &[usize],
    robot: &[bool],
) -> Result<Vec<Candidate>, ModelError> {
    if spec.disabled.contact {
        return Ok(Vec::new());
    }
    let geoms = numbered(spec);
    let is_ground = |g: usize| {
        let (body, geom) = geoms[g];
        match geom.kind {
            GeomKind::Plane => welds[body] == 0,
            // A box of the robot itself is a geom of it, even where it is fixed to the world.
            GeomKind::Field(_) | GeomKind::Solid(Shape::Box { .. }) => welds[body] == 0 && !robot[body],
            _ => false,
        }
    };
    // A part of the robot that is fixed to the world cannot come closer to the ground.
    let touches = |g: usize| {
        let (body, geom) = geoms[g];
        robot[body] && welds[body] != 0 && matches!(geom.kind, GeomKind::Solid(_))
    };
    let mut candidates = Vec::new();
    let mut explicit = HashSet::new();
    let mut refused = HashSet::new();
    for (number, pair) in spec.pairs.iter().enumerate() {
        let [a, b] = pair.geoms;
        // An explicit pair stands in the place of the one that the contact bits would make.
        explicit.insert((a.min(b), a.max(b)));
        // The file may name the ground first or second.
        let (ground, geom) = if is_ground(a) { (a, b) } else { (b, a) };
        if is_ground(ground) && touches(geom) && computed(ctx, geoms[geom].1, geoms[ground].1, &mut refused)?
        {
            let mut parameters = pair.parameters.clone();
            parameters.friction = parameters.friction.map(|f| f.max(MIN_FRICTION));
            let bodies = (geoms[ground].0.min(geoms[geom].0), geoms[ground].0.max(geoms[geom].0));
            // The key sorts as MuJoCo does: by body pair, then explicit pairs (0), then others (1) by geom.
            candidates.push(((bodies, 0, number, 0), Candidate { geom, ground, parameters }));
        }
    }
    let excluded: HashSet<(usize, usize)> = spec.excludes.iter().copied().collect();
    let grounds: Vec<usize> = (0..geoms.len()).filter(|&g| is_ground(g)).collect();
    // Then all pairs that the contact bits allow and nothing rules out.
    for geom in (0..geoms.len()).filter(|&g| touches(g)) {
        for &ground in &grounds {
            let bodies = (geoms[ground].0.min(geoms[geom].0), geoms[ground].0.max(geoms[geom].0));
            let (first, second) = (&geoms[ground].1.surface, &geoms[geom].1.surface);
            if !first.may_touch(second)
                || excluded.contains(&bodies)
                || explicit.contains(&(ground.min(geom), ground.max(geom)))
                || !computed(ctx, geoms[geom].1, geoms[ground].1, &mut refused)?
            {
                continue;
            }
            if candidates.len() >= MAX_PAIRS {
                return Err(ctx.too_many(geoms[geom].1.at, "pairs of geoms and ground", MAX_PAIRS));
            }
            let parameters = mix(first, second);
            candidates.push(((bodies, 1, ground, geom), Candidate { geom, ground, parameters }));
        }
    }
    candidates.sort_by_key(|(key, _)| *key);
    Ok(candidates.into_iter().map(|(_, candidate)| candidate).collect())
}

/// Whether the contact of a geom with a plane or obstacle is computed. It is refused where it is not, once a geom (its
/// place is in `refused` then).
fn computed(
    ctx: &mut Context,
    geom: &GeomSpec,
    ground: &GeomSpec,
    refused: &mut HashSet<At>,
) -> Result<bool, ModelError> {
    let GeomKind::Solid(shape) = geom.kind else { return Ok(false) };
    // Planes touch every solid; boxes and height fields touch round shapes only.
    let round = matches!(shape, Shape::Sphere { .. } | Shape::Capsule { .. });
    if ground.kind == GeomKind::Plane || round {
        return Ok(true);
    }
    if refused.insert(geom.at) {
        ctx.refuse(
            geom.at,
            format!("contact of geom \"{}\" ({}) with obstacles", shown(&geom.name), shape.name()),
            format!(
                "only spheres and capsules touch boxes and height fields here, such as \"{}\"",
                shown(&ground.name)
            ),
            "use spheres or capsules there, or a flat floor",
        )?;
    }
    Ok(false)
}

/// Contact parameters of two surfaces, the plane's first (the order matters to the last bit only).
pub(crate) fn mix(first: &Surface, second: &Surface) -> ContactPair {
    let (condim, friction, solref, solimp) = if first.priority != second.priority {
        let s = if first.priority > second.priority { first } else { second };
        (s.condim, s.friction, s.solref, s.solimp)
    } else {
        let weight = solmix_weight(first.solmix, second.solmix);
        let blend = |a: f64, b: f64| weight * a + (1.0 - weight) * b;
        let mut friction = first.friction;
        for (f, other) in friction.iter_mut().zip(second.friction) {
            *f = f.max(other);
        }
        let mut solref = first.solref;
        // Direct (negative) references cannot be averaged with time constants: MuJoCo takes the lower.
        let standard = first.solref[0] > 0.0 && second.solref[0] > 0.0;
        for (r, other) in solref.iter_mut().zip(second.solref) {
            *r = if standard { blend(*r, other) } else { r.min(other) };
        }
        let mut solimp = first.solimp;
        for (p, other) in solimp.iter_mut().zip(second.solimp) {
            *p = blend(*p, other);
        }
        (first.condim.max(second.condim), friction, solref, solimp)
    };
    // A geom has three coefficients, a contact five: two directions slide and two roll.
    let [slide, spin, roll] = friction.map(|f| f.max(MIN_FRICTION));
    ContactPair {
        geom: 0,
        ground: Ground::Plane(0),
        condim,
        friction: [slide, slide, spin, roll, roll],
        solref,
        solreffriction: [0.0; 2],
        solimp,
        margin: first.margin + second.margin,
        gap: first.gap + second.gap,
    }
}

/// Weight of the first surface's `solref` and `solimp`, as MuJoCo's `mj_contactParam` has it.
fn solmix_weight(first: f64, second: f64) -> f64 {
    match (first >= MIN_SOLMIX, second >= MIN_SOLMIX) {
        (true, true) => first / (first + second),
        (false, false) => 0.5,
        (false, true) => 0.0,
        (true, false) => 1.0,
    }
}

/// Geom pairs of the robot with itself that MuJoCo would test and this engine does not.
pub(crate) fn self_collisions(spec: &Spec, welds: &[usize], robot: &[bool]) -> usize {
    if spec.disabled.contact {
        return 0;
    }
    let geoms: Vec<(usize, usize, &Surface)> = numbered(spec)
        .into_iter()
        .enumerate()
        .filter(|(_, (body, geom))| robot[*body] && geom.kind != GeomKind::Plane)
        .map(|(number, (body, geom))| (number, body, &geom.surface))
        .collect();
    let parent_weld = |body: usize| welds[spec.bodies[welds[body]].parent];
    let excluded: HashSet<(usize, usize)> = spec.excludes.iter().copied().collect();
    // Explicit pairs count whatever bits and filters say.
    let mut count = spec
        .pairs
        .iter()
        .filter(|p| p.geoms.iter().all(|g| geoms.iter().any(|(number, ..)| number == g)))
        .count();
    let explicit: HashSet<[usize; 2]> =
        spec.pairs.iter().map(|p| [p.geoms[0].min(p.geoms[1]), p.geoms[0].max(p.geoms[1])]).collect();
    for (i, &(first, a, surface)) in geoms.iter().enumerate() {
        for &(second, b, other) in &geoms[i + 1..] {
            let (wa, wb) = (welds[a], welds[b]);
            // MuJoCo does not test a body against its parent, unless the parent is the world or `filterparent` is
            // off.
            let neighbours = wa != 0 && wb != 0 && (parent_weld(a) == wb || parent_weld(b) == wa);
            if wa != wb
                && (!neighbours || spec.disabled.filterparent)
                && surface.may_touch(other)
                && !excluded.contains(&(a.min(b), a.max(b)))
                && !explicit.contains(&[first.min(second), first.max(second)])
            {
                count += 1;
            }
        }
    }
    count
}
