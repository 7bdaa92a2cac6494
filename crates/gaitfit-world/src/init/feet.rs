//! Shapes for feet that are meshes, and for feet of which a file shows nothing.

use super::anatomy::{NEAR_GROUND, height_above, path};
use super::pose;
use super::shape::{Fitted, around, foot, wheel};
use gaitfit_model::kinematics::{Frame, body_frames, lowest_point};
use gaitfit_model::rotation::{Vec3, add, dot, inverse, product, rotate, rotate_back, sub};
use gaitfit_model::{ContactPair, Form, Geom, Ground, Model, Outline, listed, shown};

/// A hinge with a range beyond this turns as a wheel does, rad: two turns.
const WHEEL_RANGE: f64 = 4.0 * std::f64::consts::PI;
/// A link without mass and shape at the end of a leg, farther than this from its joint, is where the foot is, m.
const MARKER: f64 = 0.03;
/// Max number of a limb's or the base's shapes that are read.
const MAX_SHAPES: usize = 64;
/// The base's box is a little smaller than what it stands for.
const BASE_SHARE: f64 = 0.9;

/// A shape that was added to the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Added {
    /// Name of the geom.
    pub geom: String,
    /// Its shape, and the geometry that it was fitted to.
    pub how: String,
    /// Whether it is a guess without a mesh.
    pub guess: bool,
    /// Whether it is a foot.
    pub foot: bool,
}

/// Bodies that move together at the end of a limb.
struct Limb {
    bodies: Vec<usize>,
    /// Joints from the base to it.
    path: Vec<usize>,
}

/// Gives last links near the ground a shape that touches it: those without one, or all of them if `anew` is set. The
/// base gets a box if none of its shapes collides.
/// Feet are fitted as the file draws the robot, where soles lie flat, unless its
/// stance has more legs on the ground.
pub fn fit_feet(model: &mut Model, anew: bool) -> Vec<Added> {
    // `reduce` below keeps the first of equals: the drawn pose wins unless the other has more legs on the ground.
    let mut poses = vec![pose::drawn(model), pose::start(model).angles];
    poses.dedup();
    let fitted = poses.iter().map(|angles| {
        let mut model = model.clone();
        let (legs, added) = fit_in(&mut model, angles, anew);
        (legs, added, model)
    });
    let best = fitted.reduce(|best, other| if other.0 > best.0 { other } else { best });
    let Some((_, added, fitted)) = best else { return Vec::new() };
    *model = fitted;
    added
}

/// [`fit_feet`] in one pose, `angles` (rad, model order); returns the number of legs too.
fn fit_in(model: &mut Model, angles: &[f64], anew: bool) -> (usize, Vec<Added>) {
    let frames = body_frames(model, &Frame::WORLD, angles);
    let limbs = limbs(model);
    let touching = |model: &Model, limb: &Limb| -> Vec<usize> {
        let geoms = model.pairs.iter().map(|pair| pair.geom);
        geoms.filter(|&geom| limb.bodies.contains(&model.geoms[geom].body)).collect()
    };
    // Points of each limb are from its own geoms, else from its outlines, else from the box that its inertia suggests.
    let sights: Vec<(f64, Option<Sight>)> = limbs
        .iter()
        .map(|limb| {
            let geoms = touching(model, limb);
            let lowest = |geom: &usize| lowest_point(&model.geoms[*geom], &frames[model.geoms[*geom].body]);
            if !geoms.is_empty() && !anew {
                return (geoms.iter().map(lowest).fold(f64::INFINITY, f64::min), None);
            }
            let sight = Sight::new(model, limb, &frames);
            (sight.as_ref().map_or(f64::INFINITY, Sight::lowest), sight)
        })
        .collect();
    // The lowest point of all limbs is on the ground; limbs that end well above it are arms.
    let ground = sights.iter().map(|(lowest, _)| *lowest).fold(f64::INFINITY, f64::min);
    if !ground.is_finite() {
        return (0, Vec::new());
    }
    let height = height_above(model, &frames, ground);
    let near = |lowest: f64| lowest <= ground + NEAR_GROUND * height;
    let legs = sights.iter().filter(|(lowest, _)| near(*lowest)).count();
    let mut added = Vec::new();
    for (limb, (lowest, sight)) in limbs.iter().zip(&sights) {
        // Limbs with a foot of their own have no sight, and keep it.
        let Some(sight) = sight.as_ref().filter(|_| near(*lowest)) else { continue };
        let length = leg_length(model, limb, &frames, *lowest);
        let Some((fitted, body)) = sight.fit(model, limb, &frames, length, legs <= 2) else { continue };
        // Removed only now: a limb that nothing can be fitted to keeps its old geoms.
        if anew {
            remove(model, &touching(model, limb));
        }
        let what = describe(&fitted);
        let geom = add_geom(model, body, &frames[body], &fitted, "foot");
        let how = format!("{what}, {}", sight.source);
        added.push(Added { geom, how, guess: sight.guess, foot: true });
    }
    // Last, as it needs to know where the ground is.
    added.extend(base_box(model, &frames, ground, height));
    (legs, added)
}

/// The last links of a robot, with all that is fixed to them.
fn limbs(model: &Model) -> Vec<Limb> {
    let paths: Vec<Vec<usize>> = (0..model.bodies.len()).map(|body| path(model, body)).collect();
    let mut limbs: Vec<Limb> = Vec::new();
    for (body, path) in paths.iter().enumerate() {
        let longer = |other: &Vec<usize>| other.len() > path.len() && other.starts_with(path);
        if path.is_empty() || paths.iter().any(longer) {
            continue;
        }
        match limbs.iter_mut().find(|limb| limb.path == *path) {
            Some(limb) => limb.bodies.push(body),
            None => limbs.push(Limb { bodies: vec![body], path: path.clone() }),
        }
    }
    limbs
}

/// Points of a limb's surface, in world axes, with the body of each.
struct Sight {
    points: Vec<(usize, Vec3)>,
    /// Source of the points, in words.
    source: String,
    guess: bool,
}

impl Sight {
    /// The shapes that collide, else those that are seen, else a box of the links' inertia.
    fn new(model: &Model, limb: &Limb, frames: &[Frame]) -> Option<Self> {
        let outlines = |colliding: bool| {
            let of_limb = |outline: &&Outline| limb.bodies.contains(&outline.body);
            let outlines = model.outlines.iter().filter(of_limb);
            outlines.filter(move |outline| outline.colliding == colliding).take(MAX_SHAPES)
        };
        // The first reason is kept: the message names one file, not sixty.
        let mut missing: Option<String> = None;
        // Shapes that collide come first: the file means them to touch.
        for colliding in [true, false] {
            let mut points = Vec::new();
            let mut names: Vec<String> = Vec::new();
            for outline in outlines(colliding) {
                match outline.points() {
                    Ok(vertices) => {
                        points.extend(
                            vertices
                                .into_iter()
                                .map(|point| (outline.body, frames[outline.body].point(point))),
                        );
                        names.push(match &outline.form {
                            Form::Mesh(mesh) => {
                                let name =
                                    mesh.file.file_name().map(|name| name.to_string_lossy().into_owned());
                                shown(&name.unwrap_or_default())
                            }
                            Form::Solid(shape) => format!("its {}", shape.name()),
                        });
                    }
                    Err(error) => missing = missing.or(Some(error.to_string())),
                }
            }
            if !points.is_empty() {
                names.dedup();
                let seen = if colliding { "" } else { " (which is only seen)" };
                let source = format!("fitted to {}{seen}", listed(&names, 3));
                return Some(Self { points, source, guess: false });
            }
        }
        // Without a shape that the file at least names, nothing says that the limb is to touch.
        let missing = missing?;
        let mut points: Vec<(usize, Vec3)> = Vec::new();
        for &body in &limb.bodies {
            let link = &model.bodies[body];
            let from_parent = dot(link.pos, link.pos).sqrt();
            if link.mass > 0.0 {
                points.extend(inertia_box(link).map(|corner| (body, frames[body].point(corner))));
            } else if path(model, body).len() == limb.path.len() && from_parent > MARKER {
                points.push((body, frames[body].position));
            }
        }
        let source = format!("a guess from the link's inertia: {missing}");
        (!points.is_empty()).then_some(Self { points, source, guess: true })
    }

    fn lowest(&self) -> f64 {
        self.points.iter().map(|(_, point)| point[2]).fold(f64::INFINITY, f64::min)
    }

    /// A shape for the limb's end and the body that it is fixed to: that of its lowest point.
    fn fit(
        &self,
        model: &Model,
        limb: &Limb,
        frames: &[Frame],
        leg: f64,
        soles: bool,
    ) -> Option<(Fitted, usize)> {
        let (body, _) = *self.points.iter().min_by(|(_, a), (_, b)| a[2].total_cmp(&b[2]))?;
        let points: Vec<Vec3> = self.points.iter().map(|(_, point)| *point).collect();
        let last = &model.joints[*limb.path.last()?];
        // A joint without limits may be a wheel's. Its points decide below.
        let turns = last.kind.is_hinge() && last.range.is_none_or(|[low, high]| high - low > WHEEL_RANGE);
        // A box guessed from inertia shows nothing of a wheel's rim.
        if turns && !self.guess {
            let frame = &frames[last.body];
            let axis = rotate(frame.quaternion, last.axis);
            if let Some(wheel) = wheel(&points, frame.point(last.pos), axis) {
                return Some((wheel, last.body));
            }
        }
        // The foot's own mesh, without the shank that it is fixed to.
        let of_body: Vec<Vec3> =
            self.points.iter().filter(|(other, _)| *other == body).map(|(_, point)| *point).collect();
        foot(&of_body, leg, soles).or_else(|| foot(&points, leg, soles)).map(|foot| (foot, body))
    }
}

/// Corners of the box that has a link's mass and principal moments, in its frame.
fn inertia_box(link: &gaitfit_model::Body) -> [Vec3; 8] {
    let [a, b, c] = link.inertia;
    // A solid box of sides 2s has m (s_j² + s_k²) / 3 about axis i.
    let half = [b + c - a, a + c - b, a + b - c].map(|sum| (1.5 * sum.max(0.0) / link.mass).sqrt());
    std::array::from_fn(|corner| {
        let inner = std::array::from_fn(|k| if corner >> k & 1 == 0 { -half[k] } else { half[k] });
        add(link.ipos, rotate(link.iquat, inner))
    })
}

/// From the limb's first joint to its lowest point, m.
fn leg_length(model: &Model, limb: &Limb, frames: &[Frame], lowest: f64) -> f64 {
    let top = limb.path.iter().map(|&joint| {
        let hinge = &model.joints[joint];
        frames[hinge.body].point(hinge.pos)[2]
    });
    // Sizes of feet are shares of this length, so it must not be zero.
    (top.fold(f64::NEG_INFINITY, f64::max) - lowest).max(0.02)
}

/// A box for a base of which nothing collides, if it is well above the feet.
fn base_box(model: &mut Model, frames: &[Frame], ground: f64, height: f64) -> Option<Added> {
    let base: Vec<usize> = (0..model.bodies.len()).filter(|&body| path(model, body).is_empty()).collect();
    // Whatever collides there already shows a fall.
    if model.geoms.iter().any(|geom| base.contains(&geom.body)) {
        return None;
    }
    let outlines = model.outlines.iter().filter(|outline| base.contains(&outline.body));
    let in_base = |outline: &Outline| -> Option<Vec<Vec3>> {
        let points = outline.points().ok()?;
        let to_base = |point: Vec3| frames[outline.body].point(point);
        Some(points.into_iter().map(to_base).collect())
    };
    let points: Vec<Vec3> = outlines.take(MAX_SHAPES).filter_map(in_base).flatten().collect();
    let mut fitted = around(&points)?;
    if let gaitfit_model::Shape::Box { half_size } = &mut fitted.shape {
        *half_size = half_size.map(|half| BASE_SHARE * half);
        if fitted.pos[2] - half_size[2] < ground + NEAR_GROUND * height {
            return None;
        }
    }
    let what = describe(&fitted);
    let geom = add_geom(model, 0, &frames[0], &fitted, "base");
    let how = format!("{what} around the base's meshes, to know a fall by");
    Some(Added { geom, how, guess: false, foot: false })
}

/// Takes geoms and their pairs away.
fn remove(model: &mut Model, geoms: &[usize]) {
    let mut places = Vec::with_capacity(model.geoms.len());
    let mut kept = 0;
    for geom in 0..model.geoms.len() {
        let stays = !geoms.contains(&geom);
        places.push(stays.then_some(kept));
        kept += usize::from(stays);
    }
    // `retain` visits the geoms in order, so a count is each one's old place.
    let mut place = 0;
    model.geoms.retain(|_| {
        place += 1;
        places[place - 1].is_some()
    });
    // Pairs name geoms by their place, which has moved.
    model.pairs.retain_mut(|pair| match places[pair.geom] {
        Some(new) => {
            pair.geom = new;
            true
        }
        None => false,
    });
}

/// Adds a shape, given in world axes, to a body, and lets it touch all planes as the robot's other geoms do, or with MuJoCo's
/// defaults. Its name is the link's with `end` behind it.
fn add_geom(model: &mut Model, body: usize, frame: &Frame, fitted: &Fitted, end: &str) -> String {
    let link = &model.bodies[body].name;
    // Exporters append `_link` to names of links; a foot's name needs no such ending.
    let stem = link.strip_suffix("_link").unwrap_or(link);
    let mut name = match stem.to_lowercase().ends_with(end) {
        true => stem.to_owned(),
        false => format!("{stem}_{end}"),
    };
    // Names must be unique in the file that is written.
    while model.geoms.iter().any(|geom| geom.name == name) {
        name.push('_');
    }
    model.geoms.push(Geom {
        name: name.clone(),
        body,
        shape: fitted.shape,
        pos: rotate_back(frame.quaternion, sub(fitted.pos, frame.position)),
        quat: product(inverse(frame.quaternion), fitted.quat),
    });
    let geom = model.geoms.len() - 1;
    for plane in 0..model.planes.len() {
        let ground = Ground::Plane(plane);
        // Friction and solver settings are like those of the robot's other geoms on this plane.
        let like = model.pairs.iter().find(|pair| pair.ground == ground).cloned();
        model.pairs.push(ContactPair { geom, ..like.unwrap_or_else(|| usual_pair(ground)) });
    }
    name
}

/// MuJoCo's default contact of two geoms.
fn usual_pair(ground: Ground) -> ContactPair {
    ContactPair {
        geom: 0,
        ground,
        condim: 3,
        // Two sliding, one torsional, two rolling coefficients: MuJoCo's `friction` is "1 0.005 0.0001".
        friction: [1.0, 1.0, 0.005, 1e-4, 1e-4],
        solref: [0.02, 1.0],
        solreffriction: [0.0; 2],
        solimp: [0.9, 0.95, 0.001, 0.5, 2.0],
        margin: 0.0,
        gap: 0.0,
    }
}

fn describe(fitted: &Fitted) -> String {
    use gaitfit_model::Shape;
    let millimetres = |metres: f64| format!("{:.0}", 1e3 * metres);
    let size = match fitted.shape {
        Shape::Sphere { radius } => format!("radius {}", millimetres(radius)),
        Shape::Capsule { radius, half_length } | Shape::Cylinder { radius, half_length } => {
            format!("radius {}, length {}", millimetres(radius), millimetres(2.0 * half_length))
        }
        Shape::Box { half_size: [x, y, z] } => {
            format!("{} × {} × {}", millimetres(2.0 * x), millimetres(2.0 * y), millimetres(2.0 * z))
        }
    };
    format!("a {} ({size} mm)", fitted.what)
}
