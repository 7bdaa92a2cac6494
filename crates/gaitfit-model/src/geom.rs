//! MJCF `<geom>`: attributes, size, pose, mass.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::inertia::{Inertial, MASSLESS, Solid};
use crate::mend::Weight;
use crate::model::Shape;
use crate::options::{Compiler, InertiaFromGeom};
use crate::orientation::read_orientation;
use crate::outline::Meshes;
use crate::rotation::{IDENTITY, Quat, Vec3, add, dot, unit, z_to};
use crate::shown::shown;
use crate::spec::{GeomKind, GeomSpec, Surface};
use crate::terrain::Fields;
use crate::xml::Element;

/// `geom type`, in MuJoCo's words.
const TYPES: [&str; 9] =
    ["sphere", "capsule", "cylinder", "box", "plane", "ellipsoid", "mesh", "hfield", "sdf"];

/// A `<geom>` as written, over its default class.
#[derive(Clone, Debug)]
pub(crate) struct GeomForm {
    kind: usize,
    size: Vec3,
    fromto: Option<[f64; 6]>,
    pos: Vec3,
    quat: Quat,
    group: i32,
    mass: Option<f64>,
    density: f64,
    shell: bool,
    mesh: bool,
    mesh_name: Option<String>,
    field: Option<String>,
    surface: Surface,
}

impl Default for GeomForm {
    fn default() -> Self {
        Self {
            kind: 0,
            size: [0.0; 3],
            fromto: None,
            pos: [0.0; 3],
            quat: IDENTITY,
            group: 0,
            mass: None,
            // MuJoCo's default: water.
            density: 1000.0,
            shell: false,
            mesh: false,
            mesh_name: None,
            field: None,
            surface: Surface::default(),
        }
    }
}

impl GeomForm {
    /// Reads attributes over the present values; the caller finishes the attributes.
    pub fn apply(
        &mut self,
        ctx: &mut Context,
        a: &mut Attributes,
        compiler: &Compiler,
    ) -> Result<(), ModelError> {
        if let Some(kind) = a.word(ctx, "type", &TYPES)? {
            self.kind = kind;
        }
        a.prefix(ctx, "size", &mut self.size)?;
        if let Some(fromto) = a.array(ctx, "fromto")? {
            self.fromto = Some(fromto);
        }
        a.set_array(ctx, "pos", &mut self.pos)?;
        read_orientation(a, ctx, compiler.units, &mut self.quat)?;
        if let Some(group) = a.integer(ctx, "group")? {
            self.group = group;
        }
        if let Some(mass) = a.number(ctx, "mass")? {
            if mass < 0.0 {
                return Err(ctx.invalid(a.at("mass"), "negative geom mass", "give zero or more"));
            }
            self.mass = Some(mass);
        }
        a.set_nonnegative(ctx, "density", &mut self.density)?;
        if let Some(shell) = a.boolean(ctx, "shellinertia")? {
            self.shell = shell;
        }
        if let Some(name) = a.text("mesh") {
            self.mesh = true;
            self.mesh_name = Some(name.to_string());
        }
        if let Some(name) = a.text("hfield") {
            // As with a mesh, the size is the asset's.
            self.mesh = true;
            self.field = Some(name.to_string());
        }
        let s = &mut self.surface;
        for (name, target) in
            [("contype", &mut s.contype), ("conaffinity", &mut s.conaffinity), ("priority", &mut s.priority)]
        {
            if let Some(value) = a.integer(ctx, name)? {
                *target = value;
            }
        }
        s.condim = read_condim(ctx, a)?.unwrap_or(s.condim);
        a.prefix(ctx, "friction", &mut s.friction)?;
        if s.friction.iter().any(|f| *f < 0.0) {
            return Err(ctx.invalid(a.at("friction"), "negative friction", "give zero or more"));
        }
        a.set_nonnegative(ctx, "solmix", &mut s.solmix)?;
        a.reference(ctx, "solref", &mut s.solref)?;
        a.prefix(ctx, "solimp", &mut s.solimp)?;
        a.set(ctx, "margin", &mut s.margin)?;
        a.set(ctx, "gap", &mut s.gap)?;
        a.refuse_nonzero(ctx, "surfacevel", "moving surfaces are not simulated", "remove it")?;
        a.refuse_nonzero(ctx, "adhesion", "adhesion is not simulated", "remove it")?;
        // Drawing, and fluid forces that need a density or viscosity, which <option> refuses.
        a.ignore(&["material", "rgba", "user", "fitscale", "fluidshape", "fluidcoef"]);
        Ok(())
    }

    /// The contact properties of a geom of this class.
    pub fn surface(&self) -> Surface {
        self.surface
    }

    /// The geom in its body's frame (`fields`, `meshes`: the file's assets), and what it adds to the body's inertia (`None`: unknown).
    pub fn finish(
        &self,
        ctx: &mut Context,
        element: &Element,
        fields: &Fields,
        meshes: &Meshes,
    ) -> Result<(GeomSpec, Option<Inertial>), ModelError> {
        let type_name = TYPES[self.kind];
        let at = element.at;
        let mut size = self.size;
        let (mut pos, mut quat) = (self.pos, self.quat);
        // `fromto` gives length, place and direction at once.
        if let Some([x0, y0, z0, x1, y1, z1]) = self.fromto {
            if !matches!(type_name, "capsule" | "cylinder" | "box" | "ellipsoid") {
                return Err(ctx.invalid(
                    at,
                    format!("{}: `fromto` on a {type_name}", element.label()),
                    "use `pos`, or a capsule, cylinder, box or ellipsoid",
                ));
            }
            if pos != [0.0; 3] {
                return Err(ctx.invalid(
                    at,
                    format!("{} has both `pos` and `fromto`", element.label()),
                    "keep one",
                ));
            }
            // MuJoCo's z axis points from the second point to the first.
            let along = [x0 - x1, y0 - y1, z0 - z1];
            let direction = unit(along).ok_or_else(|| {
                ctx.invalid(at, format!("{}: the points of `fromto` coincide", element.label()), "move one")
            })?;
            let half = dot(along, along).sqrt() / 2.0;
            // The half length is the third size of a box, and the second of a capsule.
            size = if matches!(type_name, "box" | "ellipsoid") {
                [size[0], size[0], half]
            } else {
                [size[0], half, 0.0]
            };
            pos = add([x0, y0, z0], [x1, y1, z1]).map(|x| x / 2.0);
            quat = z_to(direction);
        }
        let needed = match type_name {
            "sphere" => 1,
            "capsule" | "cylinder" => 2,
            "box" | "ellipsoid" => 3,
            _ => 0,
        };
        // A shape that is fitted to a mesh gets its size from it.
        if !self.mesh && size[..needed].iter().any(|s| *s <= 0.0) {
            return Err(ctx.invalid(
                at,
                format!("{}: a {type_name} needs {needed} sizes above zero", element.label()),
                "complete `size`",
            ));
        }
        let solid = match type_name {
            // It is fitted to a mesh, so its size is not known here.
            _ if self.mesh => None,
            "sphere" => Some(Solid::Sphere { radius: size[0] }),
            "capsule" => Some(Solid::Capsule { radius: size[0], half_length: size[1] }),
            "cylinder" => Some(Solid::Cylinder { radius: size[0], half_length: size[1] }),
            "box" => Some(Solid::Box { half_size: size }),
            "ellipsoid" => Some(Solid::Ellipsoid { semi_axes: size }),
            _ => None,
        };
        // Shapes that are computed keep their sizes; of the others only a name is needed, for messages.
        let kind = match (type_name, solid) {
            ("plane", _) => GeomKind::Plane,
            ("hfield", _) => self.field(ctx, element, fields)?,
            (_, Some(Solid::Sphere { radius })) => GeomKind::Solid(Shape::Sphere { radius }),
            (_, Some(Solid::Capsule { radius, half_length })) => {
                GeomKind::Solid(Shape::Capsule { radius, half_length })
            }
            (_, Some(Solid::Cylinder { radius, half_length })) => {
                GeomKind::Solid(Shape::Cylinder { radius, half_length })
            }
            (_, Some(Solid::Box { half_size })) => GeomKind::Solid(Shape::Box { half_size }),
            ("sphere" | "capsule" | "cylinder" | "box", None) => {
                GeomKind::Other("primitive fitted to a mesh")
            }
            (other, _) => GeomKind::Other(other),
        };
        let name = element.get("name").unwrap_or("").to_string();
        // `meshes` is empty unless the reading mends.
        let mesh = self.mesh_name.as_deref().and_then(|name| meshes.get(name)).cloned();
        let inertial = self.inertial(ctx, element, kind, solid, pos, quat)?;
        Ok((GeomSpec { name, at, pos, quat, kind, surface: self.surface, mesh }, inertial))
    }

    /// A height field of the assets.
    fn field(&self, ctx: &mut Context, element: &Element, fields: &Fields) -> Result<GeomKind, ModelError> {
        let name = self.field.as_deref().unwrap_or("");
        match fields.names.get(name) {
            Some(Ok(field)) => return Ok(GeomKind::Field(*field)),
            // What is only seen needs no heights.
            Some(Err(_)) if self.surface.is_visual() => {}
            Some(Err(why)) => {
                let what = format!("height field \"{}\"", shown(name));
                ctx.refuse(element.at, what, why.clone(), "give its heights, or take a flat floor")?;
            }
            None => {
                let message =
                    format!("{} names hfield \"{}\", which does not exist", element.label(), shown(name));
                return Err(ctx.invalid(element.at, message, "name an <hfield> of <asset>"));
            }
        }
        Ok(GeomKind::Other("hfield"))
    }

    fn inertial(
        &self,
        ctx: &mut Context,
        element: &Element,
        kind: GeomKind,
        solid: Option<Solid>,
        pos: Vec3,
        quat: Quat,
    ) -> Result<Option<Inertial>, ModelError> {
        let massless = self.mass == Some(0.0) || (self.mass.is_none() && self.density == 0.0);
        // As in MuJoCo planes and height fields have no mass.
        if massless || kind == GeomKind::Plane || self.field.is_some() {
            return Ok(Some(MASSLESS));
        }
        // A mesh is weighed only where its mass is needed, which the body decides.
        let Some(solid) = solid else { return Ok(None) };
        if self.shell {
            let what = format!("`shellinertia` of {}", element.label());
            let why = "shapes are solid here";
            ctx.refuse(element.at, what, why, "give the body an <inertial>, and remove it")?;
        }
        // A stated mass goes before the density, as in MuJoCo.
        let mass = self.mass.unwrap_or(self.density * solid.volume());
        if !mass.is_finite() {
            return Err(ctx.invalid(
                element.at,
                format!("{} has a mass too large to compute", element.label()),
                "reduce `density` or `size`",
            ));
        }
        Ok(Some(Inertial { mass, pos, quat, inertia: solid.inertia(mass) }))
    }

    /// The mass that the geom states, kg, or its density, kg/m³.
    pub fn weight(&self) -> Weight {
        self.mass.map_or(Weight::Density(self.density), Weight::Mass)
    }

    /// Whether the body's inertia is computed from this geom.
    pub fn counts(&self, compiler: &Compiler, explicit_inertial: bool) -> bool {
        let wanted = match compiler.inertia_from_geom {
            InertiaFromGeom::Never => false,
            InertiaFromGeom::Always => true,
            InertiaFromGeom::Auto => !explicit_inertial,
        };
        wanted && (compiler.inertia_groups[0]..=compiler.inertia_groups[1]).contains(&self.group)
    }
}

/// `condim`, one of 1, 3, 4, 6.
pub(crate) fn read_condim(ctx: &Context, a: &mut Attributes) -> Result<Option<u8>, ModelError> {
    Ok(a.word(ctx, "condim", &["1", "3", "4", "6"])?.map(|index| [1, 3, 4, 6][index]))
}
