//! The shapes of a URDF's links that the engine does not simulate: kept by a mending reading.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::model::Shape;
use crate::outline::{Form, MAX_OUTLINES, MeshFile, Outline, resolve};
use crate::rotation::IDENTITY;
use crate::spec::{BodySpec, MAX_BODIES};
use crate::xml::Element;

use super::read_origin;

/// Keeps the shape of a `<visual>` or a colliding mesh; simple shapes that collide are geoms. Does nothing in a reading that
/// does not mend. What cannot be read of a visual is passed over: no other reading looks at it.
pub(super) fn show(
    ctx: &mut Context,
    element: &Element,
    body: &mut BodySpec,
    colliding: bool,
) -> Result<(), ModelError> {
    let Some(folder) = ctx.sources.folder.clone().filter(|_| ctx.mend) else { return Ok(()) };
    // Each link has an equal share of the limit, so all links together keep it.
    if body.outlines.len() >= MAX_OUTLINES / MAX_BODIES {
        return Ok(());
    }
    let mut pose = ([0.0; 3], IDENTITY);
    let mut forms = Vec::new();
    for child in &element.children {
        match child.name.as_str() {
            "origin" => match read_origin(ctx, child) {
                Ok(origin) => pose = origin,
                // Nobody knows where the visual is.
                Err(_) if !colliding => return Ok(()),
                Err(error) => return Err(error),
            },
            "geometry" => forms.extend(child.children.iter().filter_map(|shape| {
                let mut a = Attributes::new(shape);
                let length = |value: f64| (value > 0.0).then_some(value);
                // A visual without a usable number is left out.
                let mut number = |name: &str| a.number(ctx, name).ok().flatten().and_then(length);
                Some(match shape.name.as_str() {
                    "mesh" => {
                        let file = resolve(&folder, a.text("filename")?, &ctx.mesh_folder);
                        let scale = a.array(ctx, "scale").ok().flatten().unwrap_or([1.0; 3]);
                        Form::Mesh(MeshFile { file, frame: ([0.0; 3], IDENTITY), scale })
                    }
                    // Simple shapes that collide are geoms already.
                    _ if colliding => return None,
                    "sphere" => Form::Solid(Shape::Sphere { radius: number("radius")? }),
                    "cylinder" => Form::Solid(Shape::Cylinder {
                        radius: number("radius")?,
                        half_length: number("length")? / 2.0,
                    }),
                    "box" => {
                        let size: [f64; 3] = a.array(ctx, "size").ok().flatten()?;
                        Form::Solid(Shape::Box { half_size: size.map(|side| side / 2.0) })
                    }
                    _ => return None,
                })
            })),
            _ => {}
        }
    }
    body.outlines.extend(forms.into_iter().map(|form| Outline {
        name: body.name.clone(),
        body: 0,
        pos: pose.0,
        quat: pose.1,
        colliding,
        form,
    }));
    Ok(())
}
