//! URDF `<link>`: inertia and collision primitives.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::inertia::{Inertial, principal, rotated};
use crate::inertial::{check_inertia, without_rounding};
use crate::model::Shape;
use crate::options::Compiler;
use crate::rotation::{IDENTITY, Quat, product};
use crate::shown::shown_number;
use crate::spec::{BodySpec, GeomKind, GeomSpec, MAX_BODIES, MAX_ITEMS, Surface};
use crate::xml::Element;

use super::foreign::{list_attributes, list_element};
use super::mend::Impossible;
use super::shown::show;
use super::{Link, read_origin, required};

/// How the entry of a collision mesh in [`crate::Model::dropped`] begins; its link follows.
pub(crate) const COLLISION_MESH: &str = "collision mesh of ";

/// Reads one link, not yet hung on anything.
pub(super) fn read_link(
    ctx: &mut Context,
    element: &Element,
    compiler: &Compiler,
) -> Result<Link, ModelError> {
    let mut a = Attributes::new(element);
    let name = required(ctx, &mut a, "name")?.to_string();
    a.ignore(&["type"]);
    list_attributes(ctx, &mut a);
    a.finish(ctx)?;
    let mut body = BodySpec::new(name, element.at, 0);
    let mut has_mass = false;
    let mut impossible = None;
    for child in &element.children {
        match child.name.as_str() {
            "inertial" if has_mass => {
                return Err(ctx.invalid(child.at, "second <inertial> of a link", "keep one"));
            }
            "inertial" => {
                let inertial = read_inertial(ctx, child)?;
                match check(ctx, child, &element.label(), inertial, compiler.balance_inertia) {
                    Ok(inertial) => body.inertial = inertial,
                    Err(error) => {
                        // Whether it can be mended shows when the whole robot is known (`mend_inertias`).
                        body.inertial = inertial;
                        impossible = Some(Impossible { at: child.at, error: Box::new(error) });
                    }
                }
                has_mass = true;
            }
            "collision" => {
                // Each link has an equal share of the file's limit, so all links together keep it.
                if body.geoms.len() >= MAX_ITEMS / MAX_BODIES {
                    return Err(ctx.too_many(child.at, "collisions of a link", MAX_ITEMS / MAX_BODIES));
                }
                body.geoms.extend(read_collision(ctx, child, element)?);
                show(ctx, child, &mut body, true)?;
            }
            "visual" => show(ctx, child, &mut body, false)?,
            // Links have no pose of their own in URDF: their joint has it.
            "origin" => ctx.drop_quietly(
                child.at,
                format!("<origin> in {}", element.label()),
                "a link has none in URDF",
            ),
            _ if list_element(ctx, child, &element.label()) => {}
            _ => ctx.refuse(child.at, child.label(), "not known in <link>", "remove it")?,
        }
    }
    Ok(Link { body, held_by: None, impossible })
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
    // URDF gives the tensor in the axes of <origin>.
    let (inertia, axes) = principal(turn(tensor, pose.1));
    Ok(Inertial { mass, pos: pose.0, quat: axes, inertia })
}

/// Whether a body can have such an inertia.
fn check(
    ctx: &Context,
    element: &Element,
    label: &str,
    inertial: Inertial,
    balance: bool,
) -> Result<Inertial, ModelError> {
    // The moments come in falling order: the last one is the smallest.
    if without_rounding(inertial.inertia)[2] < 0.0 {
        return Err(ctx.invalid(
            element.at,
            format!("<inertia> of {label} has a principal moment of {}", shown_number(inertial.inertia[2])),
            "give a positive definite tensor",
        ));
    }
    check_inertia(ctx, element.at, label, inertial, balance)
}

/// The tensor in the link's axes, given in axes rotated by `quat`.
fn turn(tensor: [f64; 6], quat: Quat) -> [f64; 6] {
    // Kept as it is: a decomposition would change the last digits.
    if quat == IDENTITY {
        return tensor;
    }
    let (values, axes) = principal(tensor);
    rotated(values, product(quat, axes))
}

fn read_collision(
    ctx: &mut Context,
    element: &Element,
    link: &Element,
) -> Result<Option<GeomSpec>, ModelError> {
    let mut a = Attributes::new(element);
    let name = a.text("name").unwrap_or("").to_string();
    list_attributes(ctx, &mut a);
    a.finish(ctx)?;
    let mut pose = ([0.0; 3], IDENTITY);
    let mut kind = None;
    for child in &element.children {
        match child.name.as_str() {
            "origin" => pose = read_origin(ctx, child)?,
            "geometry" => {
                for shape in &child.children {
                    // A <geometry> should have one shape; of several the last one counts.
                    kind = read_shape(ctx, shape, link)?;
                }
            }
            _ if list_element(ctx, child, &link.label()) => {}
            _ => ctx.refuse(child.at, child.label(), "not known in <collision>", "remove it")?,
        }
    }
    // A mesh gives no shape that collides, so there is no geom.
    Ok(kind.map(|shape| GeomSpec {
        name,
        at: element.at,
        pos: pose.0,
        quat: pose.1,
        kind: GeomKind::Solid(shape),
        surface: Surface::default(),
        mesh: None,
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
        // URDF has full lengths and sizes, the model has halves.
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
                format!("{COLLISION_MESH}{}", link.label()),
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
