//! URDF: links and joints to the same content as an MJCF file.
//!
//! What URDF cannot say has MuJoCo's defaults: contact parameters, solver options, no armature. A ground
//! plane z = 0 is added (not below a floating robot that the caller clamps), and a motor with control range ±effort on every revolute joint.

use std::collections::HashMap;

use crate::attributes::{Attributes, Context};
use crate::bodies::check_inertia;
use crate::error::ModelError;
use crate::inertia::{Inertial, MASSLESS, principal, rotated};
use crate::model::{Actuator, Joint, Root, Shape};
use crate::options::{Compiler, default_options, read_option};
use crate::orientation::{IDENTITY, Quat, Vec3, euler, unit};
use crate::spec::{
    BodySpec, Disabled, GeomKind, GeomSpec, MAX_BODIES, MAX_ITEMS, Spec, Surface, default_joint,
};
use crate::xml::{At, Element, shorten};

/// A link and how it hangs.
struct Link {
    body: BodySpec,
    /// Index of the joint that holds it.
    held_by: Option<usize>,
}

/// A joint between two links.
struct Connection {
    element: At,
    parent: usize,
    child: usize,
    pos: Vec3,
    quat: Quat,
    hinge: Option<Joint>,
    effort: f64,
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
                format!("link name \"{}\" is used twice", shorten(&link.body.name)),
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
                format!(
                    "link \"{}\" is the child of two joints",
                    shorten(&links[connection.child].body.name)
                ),
                "a robot is a tree: keep one",
            ));
        }
        links[connection.child].held_by = Some(connections.len());
        connections.push(connection);
    }
    for element in &document.children {
        match element.name.as_str() {
            "link" | "joint" | "material" | "mujoco" => {}
            "transmission" | "gazebo" | "sensor" | "ros2_control" => {
                ctx.drop_quietly(element.at, element.label(), "not part of the robot's dynamics in URDF");
            }
            _ => ctx.refuse(element.at, element.label(), "not known in <robot>", "remove it")?,
        }
    }

    let (bodies, actuators) = assemble(ctx, document.at, links, &connections, wanted)?;
    let spec = Spec {
        name,
        options,
        disabled,
        bodies,
        excludes: Vec::new(),
        pairs: Vec::new(),
        actuators,
        keys: Vec::new(),
        total_mass: compiler.total_mass,
    };
    Ok((spec, wanted))
}

/// Orders the links depth first below the world and hangs the joints on them.
fn assemble(
    ctx: &Context,
    at: At,
    links: Vec<Link>,
    connections: &[Connection],
    wanted: Option<Root>,
) -> Result<(Vec<BodySpec>, Vec<Actuator>), ModelError> {
    let mut roots = (0..links.len()).filter(|&l| links[l].held_by.is_none());
    let Some(root) = roots.next() else {
        return Err(ctx.invalid(at, "no link without a parent", "a robot is a tree with one root link"));
    };
    if let Some(other) = roots.next() {
        return Err(ctx.invalid(
            links[other].body.at,
            format!(
                "links \"{}\" and \"{}\" both have no parent",
                shorten(&links[root].body.name),
                shorten(&links[other].body.name)
            ),
            "join them by a joint",
        ));
    }
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); links.len()];
    for (index, connection) in connections.iter().enumerate() {
        children[connection.parent].push(index);
    }

    let mut bodies = vec![BodySpec::new("world".to_string(), at, 0)];
    let mut actuators = Vec::new();
    let mut joints = 0;
    let mut bodyless: Vec<Option<BodySpec>> = links.into_iter().map(|l| Some(l.body)).collect();
    let is_world = bodyless[root].as_ref().is_some_and(|b| {
        b.name == "world" && b.inertial == MASSLESS && b.geoms.is_empty() && !children[root].is_empty()
    });
    // A floating robot clamped on request hangs in the air: its file says nothing of a height.
    if is_world || wanted != Some(Root::Fixed) {
        bodies[0].geoms.push(GeomSpec {
            name: "ground".to_string(),
            at,
            pos: [0.0; 3],
            quat: IDENTITY,
            kind: GeomKind::Plane,
            surface: Surface::default(),
        });
    }
    // Depth first with an explicit stack; children reversed so that they come out in file order.
    let mut stack: Vec<(usize, usize)> = Vec::new();
    if is_world {
        stack.extend(children[root].iter().rev().map(|&c| (c, 0)));
    } else if let Some(mut body) = bodyless[root].take() {
        if wanted != Some(Root::Fixed) {
            body.free = Some(body.at);
        }
        bodies.push(body);
        stack.extend(children[root].iter().rev().map(|&c| (c, 1)));
    }
    while let Some((index, parent)) = stack.pop() {
        let connection = &connections[index];
        let Some(mut body) = bodyless[connection.child].take() else { continue };
        body.parent = parent;
        (body.pos, body.quat) = (connection.pos, connection.quat);
        if let Some(hinge) = &connection.hinge {
            let limit = connection.effort;
            actuators.push(Actuator {
                name: hinge.name.strip_suffix("_joint").unwrap_or(&hinge.name).to_string(),
                joint: joints,
                gear: 1.0,
                ctrlrange: (limit > 0.0).then_some([-limit, limit]),
                forcerange: None,
                gain: 1.0,
                bias: [0.0; 3],
            });
            joints += 1;
            body.joints.push((hinge.clone(), connection.element));
        }
        stack.extend(children[connection.child].iter().rev().map(|&c| (c, bodies.len())));
        bodies.push(body);
    }
    if let Some(left) = bodyless.iter().flatten().find(|b| !(is_world && b.name == "world")) {
        return Err(ctx.invalid(
            left.at,
            format!("link \"{}\" hangs on itself through its joints", shorten(&left.name)),
            "break the cycle",
        ));
    }
    Ok((bodies, actuators))
}

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

fn read_link(ctx: &mut Context, element: &Element, compiler: &Compiler) -> Result<Link, ModelError> {
    let mut a = Attributes::new(element);
    let name = required(ctx, &mut a, "name")?.to_string();
    a.ignore(&["type"]);
    a.finish(ctx)?;
    let mut body = BodySpec::new(name, element.at, 0);
    let mut has_mass = false;
    for child in &element.children {
        match child.name.as_str() {
            "inertial" if has_mass => {
                return Err(ctx.invalid(child.at, "second <inertial> of a link", "keep one"));
            }
            "inertial" => {
                let inertial = read_inertial(ctx, child)?;
                body.inertial =
                    check_inertia(ctx, child.at, &element.label(), inertial, compiler.balance_inertia)?;
                has_mass = true;
            }
            "collision" => {
                if body.geoms.len() >= MAX_ITEMS / MAX_BODIES {
                    return Err(ctx.too_many(child.at, "collisions of a link", MAX_ITEMS / MAX_BODIES));
                }
                body.geoms.extend(read_collision(ctx, child, element)?);
            }
            "visual" => {}
            _ => ctx.refuse(child.at, child.label(), "not known in <link>", "remove it")?,
        }
    }
    Ok(Link { body, held_by: None })
}

/// `<origin xyz rpy>`; roll, pitch, yaw turn about fixed axes.
fn read_origin(ctx: &mut Context, element: &Element) -> Result<(Vec3, Quat), ModelError> {
    let mut a = Attributes::new(element);
    let mut pos = [0.0; 3];
    let mut rpy = [0.0; 3];
    a.set_array(ctx, "xyz", &mut pos)?;
    a.set_array(ctx, "rpy", &mut rpy)?;
    a.finish(ctx)?;
    Ok((pos, euler(rpy, *b"XYZ")))
}

fn read_inertial(ctx: &mut Context, element: &Element) -> Result<Inertial, ModelError> {
    let mut pose = ([0.0; 3], IDENTITY);
    let mut mass = None;
    let mut tensor = None;
    for child in &element.children {
        match child.name.as_str() {
            "origin" => pose = read_origin(ctx, child)?,
            "mass" => {
                let mut a = Attributes::new(child);
                mass = a.number(ctx, "value")?;
                a.finish(ctx)?;
            }
            "inertia" => {
                let mut a = Attributes::new(child);
                let mut values = [0.0; 6];
                for (value, name) in values.iter_mut().zip(["ixx", "iyy", "izz", "ixy", "ixz", "iyz"]) {
                    let Some(given) = a.number(ctx, name)? else {
                        return Err(ctx.invalid(
                            child.at,
                            format!("<inertia> without `{name}`"),
                            format!("add {name}=\"...\""),
                        ));
                    };
                    *value = given;
                }
                a.finish(ctx)?;
                tensor = Some(values);
            }
            _ => ctx.refuse(child.at, child.label(), "not known in <inertial>", "remove it")?,
        }
    }
    let (Some(mass), Some(tensor)) = (mass, tensor) else {
        return Err(ctx.invalid(
            element.at,
            "<inertial> without mass or inertia",
            "add <mass value=\"...\"/> and <inertia ixx=\"...\" .../>",
        ));
    };
    let (inertia, axes) = principal(turn(tensor, pose.1));
    if inertia[2] < 0.0 {
        return Err(ctx.invalid(
            element.at,
            format!("<inertia> has a principal moment of {}", inertia[2]),
            "give a positive definite tensor",
        ));
    }
    Ok(Inertial { mass, pos: pose.0, quat: axes, inertia })
}

/// The tensor in the link's axes, given in axes rotated by `quat`.
fn turn(tensor: [f64; 6], quat: Quat) -> [f64; 6] {
    if quat == IDENTITY {
        return tensor;
    }
    let (values, axes) = principal(tensor);
    rotated(values, crate::orientation::mul(quat, axes))
}

fn read_collision(
    ctx: &mut Context,
    element: &Element,
    link: &Element,
) -> Result<Option<GeomSpec>, ModelError> {
    let mut a = Attributes::new(element);
    let name = a.text("name").unwrap_or("").to_string();
    a.finish(ctx)?;
    let mut pose = ([0.0; 3], IDENTITY);
    let mut kind = None;
    for child in &element.children {
        match child.name.as_str() {
            "origin" => pose = read_origin(ctx, child)?,
            "geometry" => {
                for shape in &child.children {
                    kind = read_shape(ctx, shape, link)?;
                }
            }
            // Seen in the wild inside <collision>; it only colours.
            "material" => {}
            _ => ctx.refuse(child.at, child.label(), "not known in <collision>", "remove it")?,
        }
    }
    Ok(kind.map(|shape| GeomSpec {
        name,
        at: element.at,
        pos: pose.0,
        quat: pose.1,
        kind: GeomKind::Solid(shape),
        surface: Surface::default(),
    }))
}

fn read_shape(ctx: &mut Context, element: &Element, link: &Element) -> Result<Option<Shape>, ModelError> {
    let mut a = Attributes::new(element);
    let mut size = |ctx: &Context, name: &str| -> Result<f64, ModelError> {
        match a.number(ctx, name)? {
            Some(value) if value > 0.0 => Ok(value),
            _ => Err(ctx.invalid(
                element.at,
                format!("{} needs `{name}` above zero", element.label()),
                format!("add {name}=\"...\""),
            )),
        }
    };
    let shape = match element.name.as_str() {
        "sphere" => Shape::Sphere { radius: size(ctx, "radius")? },
        "cylinder" => {
            Shape::Cylinder { radius: size(ctx, "radius")?, half_length: size(ctx, "length")? / 2.0 }
        }
        "capsule" => Shape::Capsule { radius: size(ctx, "radius")?, half_length: size(ctx, "length")? / 2.0 },
        "box" => match a.array::<3>(ctx, "size")? {
            Some(full) if full.iter().all(|s| *s > 0.0) => Shape::Box { half_size: full.map(|s| s / 2.0) },
            _ => {
                return Err(ctx.invalid(
                    element.at,
                    "<box> needs three sizes above zero",
                    "add size=\"x y z\"",
                ));
            }
        },
        "mesh" => {
            ctx.drop_quietly(
                element.at,
                format!("collision mesh of {}", link.label()),
                "meshes do not collide here",
            );
            return Ok(None);
        }
        _ => {
            ctx.refuse(element.at, element.label(), "not a shape known here", "use box, sphere or cylinder")?;
            return Ok(None);
        }
    };
    a.finish(ctx)?;
    Ok(Some(shape))
}

fn read_joint(
    ctx: &mut Context,
    element: &Element,
    links: &HashMap<String, usize>,
) -> Result<Option<Connection>, ModelError> {
    let mut a = Attributes::new(element);
    let name = required(ctx, &mut a, "name")?.to_string();
    let kind = required(ctx, &mut a, "type")?;
    a.finish(ctx)?;
    let label = element.label();
    let turns = matches!(kind, "revolute" | "continuous");
    if !turns && kind != "fixed" {
        // Dropped, the joint becomes a weld: its child stays part of the robot.
        ctx.refuse(
            element.at,
            format!("{label} of type {}", shorten(kind)),
            "only revolute, continuous and fixed joints are simulated",
            "replace it",
        )?;
    }
    let mut ends: [Option<usize>; 2] = [None; 2];
    let mut pose = ([0.0; 3], IDENTITY);
    let mut joint = default_joint();
    joint.name = name;
    joint.axis = [1.0, 0.0, 0.0];
    let mut effort = 0.0;
    let mut limits = None;
    for child in &element.children {
        let mut a = Attributes::new(child);
        match child.name.as_str() {
            "parent" | "child" => {
                let wanted = required(ctx, &mut a, "link")?;
                let Some(&link) = links.get(wanted) else {
                    return Err(ctx.invalid(
                        child.at,
                        format!("{label} names link \"{}\", which does not exist", shorten(wanted)),
                        "name an existing link",
                    ));
                };
                ends[usize::from(child.name == "child")] = Some(link);
            }
            "origin" => {
                pose = read_origin(ctx, child)?;
                continue;
            }
            "axis" => a.set_array(ctx, "xyz", &mut joint.axis)?,
            "limit" => {
                let (mut lower, mut upper) = (0.0, 0.0);
                a.set(ctx, "lower", &mut lower)?;
                a.set(ctx, "upper", &mut upper)?;
                a.set_nonnegative(ctx, "effort", &mut effort)?;
                let mut speed = 0.0;
                a.set_nonnegative(ctx, "velocity", &mut speed)?;
                joint.velocity_limit = (speed > 0.0).then_some(speed);
                limits = Some([lower, upper]);
            }
            "dynamics" => {
                a.set_nonnegative(ctx, "damping", &mut joint.damping)?;
                a.set_nonnegative(ctx, "friction", &mut joint.frictionloss)?;
            }
            "mimic" => {
                ctx.refuse(child.at, format!("<mimic> of {label}"), "coupled joints", "remove it")?;
                continue;
            }
            "safety_controller" | "calibration" => {
                let what = format!("<{}> of {label}", child.name);
                ctx.drop_quietly(child.at, what, "part of a controller, not of the robot");
                continue;
            }
            _ => {
                ctx.refuse(child.at, child.label(), "not known in <joint>", "remove it")?;
                continue;
            }
        }
        a.finish(ctx)?;
    }
    let [Some(parent), Some(child)] = ends else {
        return Err(ctx.invalid(
            element.at,
            format!("{label} without a parent or child link"),
            "add <parent link=\"...\"/> and <child link=\"...\"/>",
        ));
    };
    joint.axis = match unit(joint.axis) {
        Some(axis) => axis,
        None if !turns => joint.axis,
        None => {
            return Err(ctx.invalid(element.at, format!("{label}: the axis is zero"), "give a direction"));
        }
    };
    if kind == "revolute" {
        let Some([lower, upper]) = limits.filter(|[lower, upper]| lower < upper) else {
            return Err(ctx.invalid(
                element.at,
                format!("{label} is revolute, but has no limits with lower < upper"),
                "add <limit lower=\"...\" upper=\"...\" effort=\"...\" velocity=\"...\"/>, or make it continuous",
            ));
        };
        joint.range = Some([lower, upper]);
    }
    Ok(Some(Connection {
        element: element.at,
        parent,
        child,
        pos: pose.0,
        quat: pose.1,
        hinge: turns.then_some(joint),
        effort,
    }))
}
