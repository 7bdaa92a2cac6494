//! URDF: links and joints to the same content as an MJCF file.
//!
//! What URDF cannot say has MuJoCo's defaults: contact parameters, solver options, no armature. A ground
//! plane z = 0 is added (not below a floating robot that the caller clamps), and a motor with control range ±effort on every joint that moves.

mod foreign;
mod joint;
mod link;
mod mend;
mod shown;

use std::collections::HashMap;

use crate::attributes::{Attributes, Context};
use crate::coupling::resolve;
use crate::error::ModelError;
use crate::inertia::MASSLESS;
use crate::model::{Actuator, Coupling, Joint, Root};
use crate::options::{Compiler, default_options, read_option};
use crate::orientation::{compose, euler};
use crate::rotation::{IDENTITY, Quat, Vec3};
use crate::shown::shown;
use crate::spec::{BodySpec, Disabled, GeomKind, GeomSpec, MAX_BODIES, Spec, Surface};
use crate::xml::{At, Element};

use foreign::list_element;
use joint::{Connection, read_joint};
pub(crate) use link::COLLISION_MESH;
use link::read_link;
use mend::{Impossible, mend_inertias};

/// Share of the robot's mass up to which the parent of a floating joint stands for the world: its mass is a
/// placeholder then.
const MAX_WORLD_SHARE: f64 = 1e-3;

/// A link and how it hangs.
struct Link {
    body: BodySpec,
    /// Index of the joint that holds it.
    held_by: Option<usize>,
    /// Its inertia, if no body can have it.
    impossible: Option<Impossible>,
}

/// Reads the element tree of a `<robot>` document; returns the content and the root override that the
/// compiler is to apply.
pub(crate) fn read(
    ctx: &mut Context,
    document: &Element,
    wanted: Option<Root>,
) -> Result<(Spec, Option<Root>), ModelError> {
    let mut a = Attributes::new(document);
    let name = a.text("name").filter(|n| !n.is_empty()).map(str::to_string);
    a.ignore(&["version"]);
    a.finish(ctx)?;

    let mut compiler = Compiler::default();
    let mut options = default_options();
    let mut disabled = Disabled::default();
    // MuJoCo's own extension of URDF: its settings count here as there.
    for extension in document.children.iter().filter(|c| c.name == "mujoco") {
        for child in &extension.children {
            match child.name.as_str() {
                "compiler" => compiler.read(ctx, child)?,
                "option" => read_option(ctx, child, &mut options, &mut disabled)?,
                "size" => {}
                _ => ctx.refuse(child.at, child.label(), "not read from URDF", "write MJCF instead")?,
            }
        }
    }

    // Shapes of the links are read next, and their meshes lie in the folder that <compiler> names.
    ctx.mesh_folder = compiler.mesh_folder.clone();
    // Links come first, because joints name them.
    let mut links = Vec::new();
    let mut by_name = HashMap::new();
    for element in document.children.iter().filter(|c| c.name == "link") {
        if links.len() >= MAX_BODIES {
            return Err(ctx.too_many(element.at, "links", MAX_BODIES));
        }
        let link = read_link(ctx, element, &compiler)?;
        if by_name.insert(link.body.name.clone(), links.len()).is_some() {
            return Err(ctx.invalid(
                element.at,
                format!("link name \"{}\" is used twice", shown(&link.body.name)),
                "names must differ",
            ));
        }
        links.push(link);
    }
    let mut connections: Vec<Connection> = Vec::new();
    for element in document.children.iter().filter(|c| c.name == "joint") {
        let Some(connection) = read_joint(ctx, element, &by_name)? else { continue };
        if links[connection.child].held_by.is_some() {
            return Err(ctx.invalid(
                element.at,
                format!("link \"{}\" is the child of two joints", shown(&links[connection.child].body.name)),
                "a robot is a tree: keep one",
            ));
        }
        links[connection.child].held_by = Some(connections.len());
        connections.push(connection);
    }
    // What is left is known to be harmless, or it is refused.
    for element in &document.children {
        match element.name.as_str() {
            "link" | "joint" | "material" | "mujoco" => {}
            _ if list_element(ctx, element, "") => {}
            _ => ctx.refuse(element.at, element.label(), "not known in <robot>", "remove it")?,
        }
    }

    // Only now is the mass of the whole robot known.
    mend_inertias(ctx, &mut links, &connections)?;
    note_unlimited(ctx, &connections);
    let bodies = assemble(ctx, document.at, links, &connections, wanted)?;
    let named = connections.iter_mut().filter_map(|connection| connection.follows.take()).collect();
    let couplings = resolve(ctx, named, &bodies)?;
    let actuators = motors(&bodies, &connections, &couplings);
    let spec = Spec {
        name,
        options,
        disabled,
        bodies,
        fields: Vec::new(),
        excludes: Vec::new(),
        pairs: Vec::new(),
        actuators,
        couplings,
        keys: Vec::new(),
        total_mass: compiler.total_mass,
    };
    Ok((spec, wanted))
}

/// Says which revolute and prismatic joints have no limits. URDF wants them; MuJoCo lets such joints move, and so does this reader.
fn note_unlimited(ctx: &mut Context, connections: &[Connection]) {
    let free: Vec<&Connection> = connections.iter().filter(|connection| connection.unlimited).collect();
    let Some(first) = free.first() else { return };
    let name = first.joint.as_ref().map_or("", |joint| &joint.name);
    let slides =
        |connection: &&Connection| connection.joint.as_ref().is_some_and(|joint| !joint.kind.is_hinge());
    let kinds = if free.iter().any(slides) { "revolute or prismatic" } else { "revolute" };
    let act = if free.iter().any(slides) { "move" } else { "turn" };
    ctx.note(
        first.element,
        format!("{kinds} joints without limits ({}, such as \"{}\")", free.len(), shown(name)),
        format!("their <limit> has neither `lower` nor `upper`: they {act} without limits, as in MuJoCo"),
    );
}

/// The one link without a parent.
fn root_link(
    ctx: &mut Context,
    at: At,
    links: &[Link],
    connections: &[Connection],
) -> Result<usize, ModelError> {
    let mut roots = (0..links.len()).filter(|&l| links[l].held_by.is_none());
    let Some(root) = roots.next() else {
        let Some(first) = links.first() else {
            return Err(ctx.invalid(at, "the robot has no <link>", "give it links and joints"));
        };
        // Every link hangs on another: from any of them on, the way up leads into a ring.
        let mut on_the_way = Vec::new();
        let mut link = 0;
        while !on_the_way.contains(&link) {
            on_the_way.push(link);
            let Some(held_by) = links[link].held_by else { break };
            link = connections[held_by].parent;
        }
        let at = links[link].held_by.map_or(first.body.at, |joint| connections[joint].element);
        return Err(ctx.invalid(
            at,
            format!(
                "every link has a parent, so the joints form a ring, which goes through link \"{}\"",
                shown(&links[link].body.name)
            ),
            "a robot is a tree with one root link: remove a joint of the ring",
        ));
    };
    if let Some(other) = roots.next() {
        return Err(ctx.invalid(
            links[other].body.at,
            format!(
                "links \"{}\" and \"{}\" both have no parent",
                shown(&links[root].body.name),
                shown(&links[other].body.name)
            ),
            "join them by a joint",
        ));
    }
    Ok(root)
}

/// Orders the links depth first below the world and hangs the joints on them.
fn assemble(
    ctx: &mut Context,
    at: At,
    links: Vec<Link>,
    connections: &[Connection],
    wanted: Option<Root>,
) -> Result<Vec<BodySpec>, ModelError> {
    let mut root = root_link(ctx, at, &links, connections)?;
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); links.len()];
    for (index, connection) in connections.iter().enumerate() {
        children[connection.parent].push(index);
    }

    let mut bodies = vec![BodySpec::new("world".to_string(), at, 0)];
    let mut bodyless: Vec<Option<BodySpec>> = links.into_iter().map(|l| Some(l.body)).collect();
    root = below_floating_joint(ctx, root, &mut bodyless, connections, &children)?;
    // A bare link called `world` stands for the world itself, so the robot is fixed.
    let is_world = bodyless[root].as_ref().is_some_and(|b| {
        b.name == "world" && b.inertial == MASSLESS && b.geoms.is_empty() && !children[root].is_empty()
    });
    let mut pose = ([0.0; 3], IDENTITY);
    // Massless links above the trunk are folded into it; the poses of their fixed joints add up.
    while let [only] = children[root][..]
        && !is_world
        && connections[only].is_fixed()
        && let Some(body) = bodyless[root].take_if(|b| b.inertial == MASSLESS && b.geoms.is_empty())
    {
        let connection = &connections[only];
        let child = bodyless[connection.child].as_ref().map_or("", |child| &child.name);
        ctx.note(
            body.at,
            format!("root link \"{}\"", shown(&body.name)),
            format!("it has no mass and is fixed to \"{}\" alone, which is the root here", shown(child)),
        );
        pose = compose(pose, (connection.pos, connection.quat));
        root = connection.child;
    }
    // A floating robot clamped on request hangs in the air: its file says nothing of a height.
    if is_world || wanted != Some(Root::Fixed) {
        bodies[0].geoms.push(GeomSpec {
            name: "ground".to_string(),
            at,
            pos: [0.0; 3],
            quat: IDENTITY,
            kind: GeomKind::Plane,
            surface: Surface::default(),
            mesh: None,
        });
    }
    // Depth first with an explicit stack; children reversed so that they come out in file order.
    let mut stack: Vec<(usize, usize)> = Vec::new();
    if is_world {
        stack.extend(children[root].iter().rev().map(|&c| (c, 0)));
    } else if let Some(mut body) = bodyless[root].take() {
        if wanted != Some(Root::Fixed) {
            // URDF has no element for a free joint: messages name the link instead.
            body.free = Some(body.at);
        }
        (body.pos, body.quat) = pose;
        bodies.push(body);
        stack.extend(children[root].iter().rev().map(|&c| (c, 1)));
    }
    while let Some((index, parent)) = stack.pop() {
        let connection = &connections[index];
        let Some(mut body) = bodyless[connection.child].take() else { continue };
        body.parent = parent;
        (body.pos, body.quat) = (connection.pos, connection.quat);
        if let Some(joint) = &connection.joint {
            body.joints.push((joint.clone(), connection.element));
        }
        stack.extend(children[connection.child].iter().rev().map(|&c| (c, bodies.len())));
        bodies.push(body);
    }
    // Links of a ring hang on each other, so no way from the root leads to them.
    if let Some(left) = bodyless.iter().flatten().find(|b| !(is_world && b.name == "world")) {
        return Err(ctx.invalid(
            left.at,
            format!("link \"{}\" hangs on itself through its joints", shown(&left.name)),
            "break the cycle",
        ));
    }
    Ok(bodies)
}

/// A motor for every joint that does not follow another one.
fn motors(bodies: &[BodySpec], connections: &[Connection], couplings: &[Coupling]) -> Vec<Actuator> {
    let joints = bodies.iter().flat_map(|body| &body.joints).enumerate();
    let follows = |index: usize| couplings.iter().any(|coupling| coupling.follower == index);
    let driven: Vec<_> = joints.filter(|(index, _)| !follows(*index)).collect();
    // `a_joint` gives its motor the name `a`, unless a joint `a` does.
    let name = |joint: &Joint| {
        let plain = joint.name.strip_suffix("_joint");
        let free = plain.filter(|plain| driven.iter().all(|(_, (other, _))| other.name != *plain));
        free.unwrap_or(&joint.name).to_string()
    };
    driven
        .iter()
        .map(|(index, (joint, _))| {
            // Joints are in the order of the tree, connections in that of the file: names match them.
            let moves_it = |connection: &&Connection| {
                connection.joint.as_ref().is_some_and(|other| other.name == joint.name)
            };
            // 0 where the file states no effort: such a motor has no bound.
            let limit = connections.iter().find(moves_it).map_or(0.0, |connection| connection.effort);
            Actuator {
                name: name(joint),
                joint: *index,
                gear: 1.0,
                ctrlrange: (limit > 0.0).then_some([-limit, limit]),
                forcerange: None,
                gain: 1.0,
                bias: [0.0; 3],
            }
        })
        .collect()
}

/// The robot's root: the child of a floating joint at the root, whose parent stands for the world and is left out.
///
/// # Errors
/// A floating joint elsewhere, or below a link that is a part of the robot.
fn below_floating_joint(
    ctx: &mut Context,
    root: usize,
    links: &mut [Option<BodySpec>],
    connections: &[Connection],
    children: &[Vec<usize>],
) -> Result<usize, ModelError> {
    let Some(floating) = connections.iter().find(|connection| connection.floats) else { return Ok(root) };
    let total: f64 = links.iter().flatten().map(|link| link.inertial.mass).sum();
    let bare = |link: &BodySpec| link.geoms.is_empty() && link.inertial.mass <= MAX_WORLD_SHARE * total;
    // Another link on the root would hang in the world, so the root would not be the world.
    let alone = floating.parent == root && children[root].len() == 1;
    let Some(world) = links[root].take_if(|link| alone && bare(link)) else {
        ctx.refuse_unmended(
            floating.element,
            "a joint of type floating below a part of the robot",
            "one body of a robot floats: its root",
            "replace it",
        )?;
        return Ok(root);
    };
    let child = links[floating.child].as_ref().map_or("", |link| &link.name);
    let how = format!("a floating joint hangs \"{}\" on it, which is the floating root here", shown(child));
    ctx.note(world.at, format!("root link \"{}\"", shown(&world.name)), how);
    Ok(floating.child)
}

/// An attribute that must be there and not empty.
fn required<'e>(ctx: &Context, a: &mut Attributes<'e>, name: &str) -> Result<&'e str, ModelError> {
    match a.text(name).filter(|t| !t.is_empty()) {
        Some(text) => Ok(text),
        None => Err(ctx.invalid(
            a.element().at,
            format!("{} without `{name}`", a.element().label()),
            format!("add {name}=\"...\""),
        )),
    }
}

/// `<origin xyz rpy>`; roll, pitch, yaw turn about fixed axes.
fn read_origin(ctx: &mut Context, element: &Element) -> Result<(Vec3, Quat), ModelError> {
    let mut a = Attributes::new(element);
    let mut pos = [0.0; 3];
    let mut rpy = [0.0; 3];
    a.set_array(ctx, "xyz", &mut pos)?;
    a.set_array(ctx, "rpy", &mut rpy)?;
    a.finish(ctx)?;
    // Capitals: about fixed axes.
    Ok((pos, euler(rpy, *b"XYZ")))
}
