//! From a file's content to one robot: choose the root, number everything, check it can move.

use crate::attributes::Context;
use crate::contact::{candidates, numbered, self_collisions};
use crate::coupling::of_robot;
use crate::error::ModelError;
use crate::inertia::MIN_MASS;
use crate::keyframes::fill_keyframes;
use crate::looks::Source;
use crate::mend::{fill_masses, outlines};
use crate::model::{Body, Geom, Model, Plane, Root, Shape};
use crate::names::name_everything;
use crate::orientation::compose;
use crate::root::{attach, choose_robot, free_joint, is_below, weld_roots};
use crate::rotation::{IDENTITY, Quat, Vec3};
use crate::scan::MAX_NAME;
use crate::self_contact::Parts;
use crate::servo::{resolve_damping_ratios, resolve_springs};
use crate::shown::{escaped, shown, shown_number};
use crate::spec::{GeomKind, GeomSpec, Spec};
use crate::terrain::{Ground, Obstacle, ObstacleShape};
use crate::xml::At;

/// Largest distance of a link from its parent, or of its centre of mass from its frame, m, and largest mass, kg:
/// beyond them a file states millimetres or grams.
const MAX_DISTANCE: f64 = 1000.0;
const MAX_MASS: f64 = 1e6;

/// Builds the model. `stem` names it if the file does not; `wanted` overrides how the root is attached.
pub(crate) fn compile(
    ctx: &mut Context,
    mut spec: Spec,
    stem: &str,
    wanted: Option<Root>,
) -> Result<Model, ModelError> {
    // Names come first, because messages of all later steps use them.
    name_everything(ctx, &mut spec)?;
    let Some(robot) = choose_robot(ctx, &spec)? else {
        return Err(ctx.invalid(
            spec.bodies.get(1).map_or(At::default(), |b| b.at),
            "no body of the file can move",
            "give the robot hinges or slides",
        ));
    };
    let root = robot.root;
    let attachment = attach(ctx, &spec, root, wanted)?;
    let floating = attachment == Root::Floating;
    let others_move = robot.others_move;

    // Bodies of the robot are contiguous in depth-first order.
    let member: Vec<bool> = (0..spec.bodies.len()).map(|b| is_below(&spec, b, root)).collect();
    let welds = weld_roots(&spec, root, floating, &member);
    if ctx.mend {
        fill_masses(ctx, &mut spec, &welds, &member);
    }
    // Before this line some masses are missing.
    scale_total_mass(&mut spec);
    // Checked before anything is renumbered: the messages name places of the file.
    check_sizes(ctx, &spec, &member)?;
    check_masses(ctx, &spec, &welds, &member)?;
    // Contacts with the ground become pairs; those of the robot with itself are only counted.
    let pairs = candidates(ctx, &spec, &welds, &member)?;
    let ignored = self_collisions(&spec, &welds, &member);
    if ignored > 0 {
        // Word for word: runs are continued only where the robot, this list included, is the same.
        ctx.drop_quietly(
            At::default(),
            format!("self-collision ({ignored} geom pairs)"),
            "contacts are computed between the robot and ground planes only",
        );
        // It comes from no single place of the file, which line 0 says.
        if let Some(last) = ctx.dropped.last_mut() {
            (last.line, last.column) = (0, 0);
        }
    }
    if spec.disabled.contact {
        ctx.drop_quietly(At::default(), "all contacts", "the file's option flags switch them off");
    }

    let mut model = Model {
        name: spec.name.clone().unwrap_or_else(|| escaped(stem, MAX_NAME)),
        options: spec.options.clone(),
        root: attachment,
        bodies: Vec::new(),
        joints: Vec::new(),
        geoms: Vec::new(),
        planes: Vec::new(),
        obstacles: Vec::new(),
        pairs: Vec::new(),
        self_pairs: Vec::new(),
        velocity_targets: Vec::new(),
        parts: Parts::new(&spec, &welds, &member),
        free_joint: free_joint(&spec, root).filter(|_| attachment == Root::Floating),
        actuators: Vec::new(),
        couplings: Vec::new(),
        keyframes: Vec::new(),
        sites: Vec::new(),
        outlines: Vec::new(),
        source: Source::default(),
        dropped: Vec::new(),
        changed: Vec::new(),
    };
    if spec.disabled.gravity {
        model.options.gravity = [0.0; 3];
    }
    // From here on numbers are the model's own: the root is 0, and other bodies are gone.
    let joint_numbers = fill_bodies(&mut model, &spec, root, &member);
    if ctx.mend {
        model.outlines = outlines(&spec, &member);
    }
    fill_geoms(ctx, &mut model, &spec, &member, &welds, &pairs)?;
    fill_actuators(ctx, &mut model, &mut spec, &joint_numbers);
    model.couplings = of_robot(&spec, &joint_numbers);
    // Before the flags: a `springdamper` gives stiffness and damping, which they may switch off.
    resolve_springs(&mut model);
    for joint in &mut model.joints {
        if spec.disabled.spring {
            joint.stiffness = 0.0;
        }
        if spec.disabled.damper {
            joint.damping = 0.0;
        }
    }
    resolve_damping_ratios(&mut model);
    if !others_move {
        fill_keyframes(ctx, &mut model, &spec, root)?;
    } else if let Some(key) = spec.keys.first() {
        let what = format!("{} keyframes", spec.keys.len());
        ctx.drop_quietly(key.at, what, "they also hold the bodies that were dropped");
    }
    model.dropped = std::mem::take(&mut ctx.dropped);
    model.changed = std::mem::take(&mut ctx.changed);
    // A robot that its file fixes to the world, such as an arm on a table, keeps that world.
    let hangs = ctx.in_the_air && !floating && spec.bodies[root].free.is_some();
    Ok(if hangs { model.in_the_air() } else { model })
}

/// The actuators of the robot's joints; `joint_numbers`: the model's joints, by those of `spec`.
fn fill_actuators(ctx: &mut Context, model: &mut Model, spec: &mut Spec, joint_numbers: &[Option<usize>]) {
    for mut actuator in spec.actuators.drain(..) {
        match joint_numbers[actuator.joint] {
            Some(joint) => {
                actuator.joint = joint;
                if spec.disabled.clampctrl {
                    actuator.ctrlrange = None;
                }
                model.actuators.push(actuator);
            }
            None => ctx.drop_quietly(
                At::default(),
                format!("actuator \"{}\"", shown(&actuator.name)),
                "its joint belongs to a body that was dropped",
            ),
        }
    }
}

fn scale_total_mass(spec: &mut Spec) {
    let sum: f64 = spec.bodies.iter().map(|b| b.inertial.mass).sum();
    // Masses that sum to nothing cannot be scaled.
    if let Some(wanted) = spec.total_mass.filter(|_| sum > MIN_MASS) {
        for body in &mut spec.bodies {
            body.inertial.mass *= wanted / sum;
            body.inertial.inertia = body.inertial.inertia.map(|i| i * (wanted / sum));
        }
    }
}

/// Refuses bodies that no robot has: the simulation of one diverges, and nothing then names the file.
fn check_sizes(ctx: &Context, spec: &Spec, member: &[bool]) -> Result<(), ModelError> {
    for body in spec.bodies.iter().zip(member).filter_map(|(body, member)| member.then_some(body)) {
        let farthest = body.pos.iter().chain(&body.inertial.pos).map(|x| x.abs()).fold(0.0, f64::max);
        let problem = if farthest > MAX_DISTANCE {
            Some((format!("has a position of {} m", shown_number(farthest)), "give lengths in metres"))
        } else if body.inertial.mass > MAX_MASS {
            Some((
                format!("has a mass of {} kg", shown_number(body.inertial.mass)),
                "give masses in kilograms",
            ))
        } else {
            None
        };
        if let Some((what, remedy)) = problem {
            return Err(ctx.invalid(body.at, format!("body \"{}\" {what}", shown(&body.name)), remedy));
        }
    }
    Ok(())
}

/// Everything that moves needs mass and inertia, its own or of parts welded to it.
fn check_masses(ctx: &Context, spec: &Spec, welds: &[usize], member: &[bool]) -> Result<(), ModelError> {
    for (index, body) in spec.bodies.iter().enumerate().skip(1) {
        // The topmost body of a weld answers for all parts of it.
        if welds[index] != index || !member[index] {
            continue;
        }
        // Parts have larger numbers than the body that they are welded to.
        let parts = || (index..welds.len()).filter(|&b| welds[b] == index).map(|b| spec.bodies[b].inertial);
        let mass: f64 = parts().map(|p| p.mass).sum();
        if mass < MIN_MASS || !parts().any(|p| p.inertia.iter().any(|i| *i >= MIN_MASS)) {
            return Err(ctx.invalid(
                body.at,
                format!("body \"{}\" moves, but has no mass or no inertia", shown(&body.name)),
                "give it an <inertial>, or geoms with mass",
            ));
        }
    }
    Ok(())
}

/// Bodies, joints and sites; returns for each joint of the file its place in the model.
fn fill_bodies(model: &mut Model, spec: &Spec, root: usize, member: &[bool]) -> Vec<Option<usize>> {
    let mut numbers = Vec::new();
    for (index, body) in spec.bodies.iter().enumerate() {
        if !member[index] {
            // Joints of dropped bodies keep their places, because actuators and couplings count the file's joints.
            numbers.extend(body.joints.iter().map(|_| None));
            continue;
        }
        // Bodies of the robot follow each other, so subtracting the root's number is enough.
        let place = index - root;
        model.bodies.push(Body {
            name: body.name.clone(),
            parent: (index != root).then(|| body.parent - root),
            pos: body.pos,
            quat: body.quat,
            mass: body.inertial.mass,
            ipos: body.inertial.pos,
            iquat: body.inertial.quat,
            inertia: body.inertial.inertia,
        });
        for (joint, _) in &body.joints {
            let mut joint = joint.clone();
            joint.body = place;
            if spec.disabled.limit {
                joint.range = None;
            }
            if spec.disabled.frictionloss {
                joint.frictionloss = 0.0;
            }
            numbers.push(Some(model.joints.len()));
            model.joints.push(joint);
        }
        for site in &body.sites {
            model.sites.push(crate::model::Site { body: place, ..site.clone() });
        }
    }
    numbers
}

/// Where a geom of the file is in the model.
#[derive(Clone, Copy)]
enum Place {
    Geom(usize),
    Ground(Ground),
}

/// A static box or height field.
fn obstacle(spec: &Spec, body: usize, geom: &GeomSpec) -> Obstacle {
    let (pos, quat) = compose(world_pose(spec, body), (geom.pos, geom.quat));
    let shape = match geom.kind {
        GeomKind::Field(field) => ObstacleShape::Field(spec.fields[field].clone()),
        GeomKind::Solid(Shape::Box { half_size }) => ObstacleShape::Box { half_size },
        // Never reached: `fill_geoms` makes obstacles of boxes and height fields only.
        _ => ObstacleShape::Box { half_size: [0.0; 3] },
    };
    Obstacle { name: geom.name.clone(), pos, quat, shape }
}

/// Geoms, planes, obstacles and pairs. Shapes that cannot touch anything are dropped; those that could touch, but
/// that the engine does not know, are refused.
fn fill_geoms(
    ctx: &mut Context,
    model: &mut Model,
    spec: &Spec,
    member: &[bool],
    welds: &[usize],
    pairs: &[crate::contact::Candidate],
) -> Result<(), ModelError> {
    let root = member.iter().position(|m| *m).unwrap_or(0);
    let mut places = Vec::new();
    for (number, (body, geom)) in numbered(spec).into_iter().enumerate() {
        // A visual geom collides all the same if a <pair> names it.
        let paired = pairs.iter().any(|p| p.geom == number || p.ground == number);
        let visual = geom.surface.is_visual() && !paired;
        let what = |kind: &str| format!("geom \"{}\" ({kind})", shown(&geom.name));
        let kind = match geom.kind {
            GeomKind::Plane => "plane",
            GeomKind::Field(_) => "hfield",
            GeomKind::Solid(shape) => shape.name(),
            GeomKind::Other(kind) => kind,
        };
        let mut place = None;
        match geom.kind {
            _ if visual => {
                ctx.drop_quietly(geom.at, what(&format!("{kind}, visual")), "only seen, without contact")
            }
            GeomKind::Plane if welds[body] != 0 => {
                return Err(ctx.invalid(
                    geom.at,
                    format!("{} is part of a moving body", what(kind)),
                    "planes belong to the world",
                ));
            }
            GeomKind::Plane => {
                place = Some(Place::Ground(Ground::Plane(model.planes.len())));
                let (pos, quat) = compose(world_pose(spec, body), (geom.pos, geom.quat));
                model.planes.push(Plane { name: geom.name.clone(), pos, quat });
            }
            GeomKind::Solid(shape) if member[body] => {
                place = Some(Place::Geom(model.geoms.len()));
                model.geoms.push(Geom {
                    name: geom.name.clone(),
                    body: body - root,
                    shape,
                    pos: geom.pos,
                    quat: geom.quat,
                });
            }
            // A box that does not move and is no part of the robot is ground.
            GeomKind::Solid(Shape::Box { .. }) | GeomKind::Field(_) if welds[body] == 0 && !member[body] => {
                if paired {
                    place = Some(Place::Ground(Ground::Obstacle { obstacle: model.obstacles.len() }));
                    model.obstacles.push(obstacle(spec, body, geom));
                } else {
                    ctx.drop_quietly(geom.at, what(kind), "no geom of the robot meets it");
                }
            }
            // Another shape of the world could touch the robot and change its motion.
            _ if !member[body] => ctx.refuse(
                geom.at,
                what(kind),
                "the only obstacles are planes, boxes and height fields",
                "remove it, or set contype and conaffinity to 0",
            )?,
            _ => ctx.refuse(
                geom.at,
                what(kind),
                uncollidable(ctx, spec, member, pairs),
                "use spheres, capsules, cylinders or boxes for contact, or set contype and conaffinity to 0",
            )?,
        }
        places.push(place);
    }
    // A pair whose geom or ground was refused or dropped has no place for it and goes too.
    for pair in pairs {
        if let (Some(Place::Geom(geom)), Some(Place::Ground(ground))) =
            (places[pair.geom], places[pair.ground])
        {
            model.pairs.push(crate::model::ContactPair { geom, ground, ..pair.parameters.clone() });
        }
    }
    Ok(())
}

/// Why a geom of the robot is refused whose shape does not collide here, and what is left to touch the ground.
fn uncollidable(ctx: &Context, spec: &Spec, member: &[bool], pairs: &[crate::contact::Candidate]) -> String {
    let why = "this shape does not collide here";
    if ctx.drops() {
        return why.to_string();
    }
    let geoms = numbered(spec);
    let such = |(body, geom): &&(usize, &GeomSpec)| {
        member[*body] && matches!(geom.kind, GeomKind::Other(_)) && !geom.surface.is_visual()
    };
    let such = geoms.iter().filter(such).count();
    let touching = (0..geoms.len()).filter(|&number| pairs.iter().any(|p| p.geom == number)).count();
    let others = match touching {
        0 => "no other geom touches the ground".to_string(),
        count => format!("{count} others touch the ground"),
    };
    format!("{why} ({such} geoms of the robot are such, {others})")
}

/// Pose of a body in the world with all joints at rest.
fn world_pose(spec: &Spec, mut body: usize) -> (Vec3, Quat) {
    let mut pose = ([0.0; 3], IDENTITY);
    while body != 0 {
        let b = &spec.bodies[body];
        pose = compose((b.pos, b.quat), pose);
        body = b.parent;
    }
    pose
}
