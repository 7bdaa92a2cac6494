//! MJCF `<site>`: a named point on a body.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::model::Site;
use crate::options::Compiler;
use crate::orientation::{compose, read_orientation};
use crate::rotation::{IDENTITY, Quat, Vec3, add, unit, z_to};
use crate::xml::Element;

/// A `<site>` as written, over its default class.
#[derive(Clone, Debug)]
pub(crate) struct SiteForm {
    pos: Vec3,
    quat: Quat,
    fromto: Option<[f64; 6]>,
}

impl Default for SiteForm {
    fn default() -> Self {
        Self { pos: [0.0; 3], quat: IDENTITY, fromto: None }
    }
}

impl SiteForm {
    /// Reads attributes over the present values; the caller finishes the attributes.
    pub fn apply(
        &mut self,
        ctx: &mut Context,
        a: &mut Attributes,
        compiler: &Compiler,
    ) -> Result<(), ModelError> {
        a.set_array(ctx, "pos", &mut self.pos)?;
        read_orientation(a, ctx, compiler.units, &mut self.quat)?;
        if let Some(fromto) = a.array(ctx, "fromto")? {
            self.fromto = Some(fromto);
        }
        a.ignore(&["type", "group", "material", "size", "rgba", "user"]);
        Ok(())
    }

    /// The site in its body's frame; `body` is left at 0.
    pub fn finish(&self, ctx: &Context, element: &Element, frame: (Vec3, Quat)) -> Result<Site, ModelError> {
        let mut pose = (self.pos, self.quat);
        if let Some([x0, y0, z0, x1, y1, z1]) = self.fromto {
            // As for a geom, z points from the second point to the first.
            let direction = unit([x0 - x1, y0 - y1, z0 - z1]).ok_or_else(|| {
                ctx.invalid(
                    element.at,
                    format!("{}: the points of `fromto` coincide", element.label()),
                    "move one",
                )
            })?;
            pose = (add([x0, y0, z0], [x1, y1, z1]).map(|x| x / 2.0), z_to(direction));
        }
        let (pos, quat) = compose(frame, pose);
        Ok(Site { name: element.get("name").unwrap_or("").to_string(), body: 0, pos, quat })
    }
}
