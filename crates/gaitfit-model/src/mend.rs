//! What a mending reading makes of parts that a strict one refuses: links without mass get one, impossible inertias become
//! possible. Every change is listed.

use crate::attributes::Context;
use crate::inertia::{Inertial, MIN_MASS, Solid, combine};
use crate::mesh::Measure;
use crate::model::Shape;
use crate::orientation::compose;
use crate::outline::{Form, MAX_OUTLINES, MeshFile, Outline};
use crate::rotation::{Quat, Vec3};
use crate::shown::{shown, shown_number};
use crate::spec::{BodySpec, GeomKind, GeomSpec, Spec};
use crate::xml::{At, Element};

/// Density of links that state no mass, kg/m³: MuJoCo's default, water.
const DENSITY: f64 = 1000.0;
/// Mass of a link for which the file gives no mass, as a share of the robot's, and radius of the ball that
/// replaces it, m.
const DUMMY_SHARE: f64 = 1e-3;
const DUMMY_RADIUS: f64 = 0.02;

/// A geom's mass or density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Weight {
    /// kg.
    Mass(f64),
    /// kg/m³.
    Density(f64),
}

/// Mass and inertia of a solid in its own frame, brought to the frame in which it has this pose.
fn moved(part: Inertial, pos: Vec3, quat: Quat) -> Inertial {
    let (pos, quat) = compose((pos, quat), (part.pos, part.quat));
    Inertial { pos, quat, ..part }
}

/// Mass and inertia of a mesh in its own frame; `None` where it cannot be read or encloses nothing.
fn of_mesh(mesh: &MeshFile, weight: Weight) -> Option<Inertial> {
    let measure = Measure::new(&mesh.read().ok()?)?;
    let mass = match weight {
        Weight::Mass(mass) => mass,
        Weight::Density(density) => density * measure.volume,
    };
    // A stated mass is spread evenly over the volume.
    let density = mass / measure.volume;
    let inertia = measure.moments.map(|moment| density * moment);
    (mass.is_finite() && mass > 0.0).then_some(Inertial {
        mass,
        pos: measure.centre,
        quat: measure.axes,
        inertia,
    })
}

/// Mass and inertia of a geom that is a mesh, in its body's frame; `None` of another one, or in a reading that does not mend.
pub(crate) fn weigh(geom: &GeomSpec, weight: Weight) -> Option<Inertial> {
    of_mesh(geom.mesh.as_ref()?, weight).map(|part| moved(part, geom.pos, geom.quat))
}

fn of_shape(shape: Shape) -> Inertial {
    let solid = match shape {
        Shape::Sphere { radius } => Solid::Sphere { radius },
        Shape::Capsule { radius, half_length } => Solid::Capsule { radius, half_length },
        Shape::Cylinder { radius, half_length } => Solid::Cylinder { radius, half_length },
        Shape::Box { half_size } => Solid::Box { half_size },
    };
    let mass = DENSITY * solid.volume();
    Inertial { mass, inertia: solid.inertia(mass), ..crate::inertia::MASSLESS }
}

/// A mended inertia that cannot be: its moments become their mean, as in MuJoCo's `balanceinertia`. `None` in a reading that
/// does not mend, and of one that has no mean.
pub(crate) fn balance(ctx: &mut Context, at: At, label: &str, inertial: Inertial) -> Option<Inertial> {
    // A negative moment would make the mean too small, or negative too.
    let mean = inertial.inertia.iter().map(|moment| moment.max(0.0)).sum::<f64>() / 3.0;
    if !(ctx.mend && mean.is_finite() && inertial.mass.is_finite() && inertial.mass >= 0.0) {
        return None;
    }
    let rounded = |value: f64| shown_number(format!("{value:.2e}").parse().unwrap_or(value));
    let moments = inertial.inertia.map(rounded).join(", ");
    ctx.note(
        at,
        format!("inertia of {label}"),
        format!(
            "no body has the principal moments [{moments}]; their mean {} stands for each",
            rounded(mean)
        ),
    );
    Some(Inertial { inertia: [mean; 3], ..inertial })
}

/// Gives moving links without mass or inertia those of their shapes at a density, or those of a small ball.
pub(crate) fn fill_masses(ctx: &mut Context, spec: &mut Spec, welds: &[usize], member: &[bool]) {
    // Before any mass is added: the share is that of the file's robot.
    let total: f64 = spec.bodies.iter().map(|body| body.inertial.mass).sum();
    for index in 1..spec.bodies.len() {
        if welds[index] != index || !member[index] {
            continue;
        }
        let parts = || (index..welds.len()).filter(|&body| welds[body] == index);
        let mass: f64 = parts().map(|body| spec.bodies[body].inertial.mass).sum();
        let turns = parts().any(|body| spec.bodies[body].inertial.inertia.iter().any(|i| *i >= MIN_MASS));
        if mass >= MIN_MASS && turns {
            continue;
        }
        // Links that are fixed to it have shapes, too.
        let of_shapes: Vec<(usize, Inertial)> = parts()
            .filter(|_| mass < MIN_MASS)
            .map(|part| (part, combine(&shapes(&spec.bodies[part]))))
            .filter(|(_, inertial)| inertial.mass >= MIN_MASS)
            .collect();
        for (part, inertial) in &of_shapes {
            let kilograms = shown_number(format!("{:.2e}", inertial.mass).parse().unwrap_or(inertial.mass));
            let scaled =
                if spec.total_mass.is_some() { ", before `settotalmass` scales all masses" } else { "" };
            let how = format!("its shapes weigh {kilograms} kg at {DENSITY} kg/m³{scaled}");
            fill(ctx, &mut spec.bodies[*part], *inertial, &how);
        }
        if !of_shapes.is_empty() {
            continue;
        }
        let body = &mut spec.bodies[index];
        let (inertial, how) = if mass >= MIN_MASS {
            // A point mass: a ball around it.
            let inertia = [0.4 * body.inertial.mass.max(mass) * DUMMY_RADIUS * DUMMY_RADIUS; 3];
            (Inertial { inertia, ..body.inertial }, format!("that of a ball of {DUMMY_RADIUS} m"))
        } else {
            // Where nothing of the file has a mass there is no share to take: 1 kg will do.
            let mass = if total > 0.0 { DUMMY_SHARE * total } else { 1.0 };
            // A solid ball has 2/5 m r².
            let inertia = [0.4 * mass * DUMMY_RADIUS * DUMMY_RADIUS; 3];
            let how = format!("a ball of {DUMMY_RADIUS} m with {DUMMY_SHARE} of the robot's mass");
            (Inertial { mass, inertia, ..crate::inertia::MASSLESS }, how)
        };
        fill(ctx, body, inertial, &how);
    }
}

fn fill(ctx: &mut Context, body: &mut BodySpec, inertial: Inertial, how: &str) {
    let what = format!("inertia of body \"{}\"", shown(&body.name));
    ctx.note(body.at, what, format!("it moves without mass or inertia in the file; {how} (a guess)"));
    body.inertial = inertial;
}

/// Masses of a body's shapes at the usual density: of those that collide, else of those that are seen.
fn shapes(body: &BodySpec) -> Vec<Inertial> {
    let solids = body.geoms.iter().filter_map(|geom| match geom.kind {
        GeomKind::Solid(shape) => Some(moved(of_shape(shape), geom.pos, geom.quat)),
        _ => weigh(geom, Weight::Density(DENSITY)),
    });
    let mut parts: Vec<Inertial> = solids.collect();
    // Shapes that are only seen count where the link has none that collides.
    for colliding in [true, false] {
        if parts.is_empty() {
            let outlines = body.outlines.iter().filter(|outline| outline.colliding == colliding);
            parts.extend(outlines.filter_map(|outline| {
                let part = match &outline.form {
                    Form::Solid(shape) => Some(of_shape(*shape)),
                    Form::Mesh(mesh) => of_mesh(mesh, Weight::Density(DENSITY)),
                };
                part.map(|part| moved(part, outline.pos, outline.quat))
            }));
        }
    }
    parts
}

/// Shapes of the robot's bodies beside the geoms that are simulated.
pub(crate) fn outlines(spec: &Spec, member: &[bool]) -> Vec<Outline> {
    let root = member.iter().position(|member| *member).unwrap_or(0);
    let members = spec.bodies.iter().enumerate().filter(|(index, _)| member[*index]);
    let all =
        members.flat_map(|(index, body)| of_body(body).map(move |one| Outline { body: index - root, ..one }));
    all.take(MAX_OUTLINES).collect()
}

/// [`outlines`] of one body, without its number.
pub(crate) fn of_body(body: &BodySpec) -> impl Iterator<Item = Outline> {
    let meshes = body.geoms.iter().filter_map(|geom| {
        // Simple shapes that do not collide are no feet: their file could have said so.
        let form = Form::Mesh(geom.mesh.clone()?);
        let colliding = !geom.surface.is_visual();
        let name = geom.name.clone();
        Some(Outline { name, body: 0, pos: geom.pos, quat: geom.quat, colliding, form })
    });
    body.outlines.iter().cloned().chain(meshes)
}

/// Whether an element of `<equality>` is in force.
pub(crate) fn is_active(element: &Element) -> bool {
    element.get("active") != Some("false")
}

/// Whether a body of the world floats by six joints of one degree of freedom, or three and a ball: three slides and what turns.
pub(crate) fn floats_by_parts(element: &Element) -> bool {
    let joints = || element.children.iter().filter(|child| child.name == "joint");
    let count = |kind: &str| joints().filter(|joint| joint.get("type").unwrap_or("hinge") == kind).count();
    count("slide") == 3 && matches!((count("ball"), count("hinge"), joints().count()), (1, 0, 4) | (0, 3, 6))
}
