//! Which geoms may touch which planes, with what parameters, in the order of MuJoCo's contacts.
//!
//! MuJoCo 4 sums margins and gaps; the other parameters come from the geom of higher priority, or are
//! mixed: larger condim, element-wise larger friction, `solref` and `solimp` weighted by `solmix`
//! (MuJoCo documentation, Computation, "Contact parameters"). Contacts come out sorted by body pair;
//! within one, explicit pairs first, then by geom.

use std::collections::HashSet;

use crate::attributes::Context;
use crate::error::ModelError;
use crate::model::ContactPair;
use crate::spec::{GeomKind, GeomSpec, MAX_PAIRS, Spec, Surface};

/// MuJoCo's floor for friction coefficients (`mjMINMU`).
const MIN_FRICTION: f64 = 1e-5;
/// Below this a `solmix` counts as zero (`mjMINVAL`).
const MIN_SOLMIX: f64 = 1e-15;

/// A pair before geoms and planes got their places in the model: numbers in file order.
pub(crate) struct Candidate {
    /// File number of the geom.
    pub geom: usize,
    /// File number of the plane.
    pub plane: usize,
    pub parameters: ContactPair,
}

/// Geoms of a file with their body, numbered as MuJoCo numbers them: body by body.
pub(crate) fn numbered(spec: &Spec) -> Vec<(usize, &GeomSpec)> {
    spec.bodies.iter().enumerate().flat_map(|(b, body)| body.geoms.iter().map(move |g| (b, g))).collect()
}

/// All geom–plane pairs. `welds[b]` is the body that body `b` moves with (0: the world); `robot[b]`
/// says whether body `b` belongs to the robot.
///
/// # Errors
/// [`ModelError::TooLarge`] for more pairs than any robot has.
pub(crate) fn candidates(
    ctx: &Context,
    spec: &Spec,
    welds: &[usize],
    robot: &[bool],
) -> Result<Vec<Candidate>, ModelError> {
    if spec.disabled.contact {
        return Ok(Vec::new());
    }
    let geoms = numbered(spec);
    let is_plane = |g: usize| geoms[g].1.kind == GeomKind::Plane && welds[geoms[g].0] == 0;
    let touches = |g: usize| {
        let (body, geom) = geoms[g];
        robot[body] && welds[body] != 0 && matches!(geom.kind, GeomKind::Solid(_))
    };
    let mut found = Vec::new();
    let mut explicit = HashSet::new();
    for (number, pair) in spec.pairs.iter().enumerate() {
        let [a, b] = pair.geoms;
        explicit.insert((a.min(b), a.max(b)));
        let (plane, geom) = if is_plane(a) { (a, b) } else { (b, a) };
        if is_plane(plane) && touches(geom) {
            let mut parameters = pair.parameters.clone();
            parameters.friction = parameters.friction.map(|f| f.max(MIN_FRICTION));
            let bodies = (geoms[plane].0.min(geoms[geom].0), geoms[plane].0.max(geoms[geom].0));
            found.push(((bodies, 0, number, 0), Candidate { geom, plane, parameters }));
        }
    }
    let excluded: HashSet<(usize, usize)> = spec.excludes.iter().copied().collect();
    let planes: Vec<usize> = (0..geoms.len()).filter(|&g| is_plane(g)).collect();
    for geom in (0..geoms.len()).filter(|&g| touches(g)) {
        for &plane in &planes {
            let bodies = (geoms[plane].0.min(geoms[geom].0), geoms[plane].0.max(geoms[geom].0));
            let (first, second) = (&geoms[plane].1.surface, &geoms[geom].1.surface);
            if !first.may_touch(second)
                || excluded.contains(&bodies)
                || explicit.contains(&(plane.min(geom), plane.max(geom)))
            {
                continue;
            }
            if found.len() >= MAX_PAIRS {
                return Err(ctx.too_many(geoms[geom].1.at, "geom-plane pairs", MAX_PAIRS));
            }
            let parameters = mix(first, second);
            found.push(((bodies, 1, plane, geom), Candidate { geom, plane, parameters }));
        }
    }
    found.sort_by_key(|(key, _)| *key);
    Ok(found.into_iter().map(|(_, candidate)| candidate).collect())
}

/// Contact parameters of two surfaces, the plane's first (the order matters to the last bit only).
fn mix(first: &Surface, second: &Surface) -> ContactPair {
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
    let [slide, spin, roll] = friction.map(|f| f.max(MIN_FRICTION));
    ContactPair {
        geom: 0,
        plane: 0,
        condim,
        friction: [slide, slide, spin, roll, roll],
        solref,
        solreffriction: [0.0; 2],
        solimp,
        margin: first.margin + second.margin,
        gap: first.gap + second.gap,
    }
}

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
