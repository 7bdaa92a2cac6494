//! What a robot looks like: shapes that its file shows or lets collide and its [`Model`](crate::Model) does not simulate.
//!
//! Only a mending reading keeps them ([`ReadOptions::mend`](crate::ReadOptions::mend)): feet that are meshes get shapes
//! fitted to them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::attributes::{Attributes, Context};
use crate::defaults::Defaults;
use crate::error::ModelError;
use crate::mesh::{self, Mesh, MeshError};
use crate::model::Shape;
use crate::options::Compiler;
use crate::rotation::{IDENTITY, Quat, Vec3, add, normalize, rotate, rotate_back, sub};
use crate::shown::shown;
use crate::xml::Element;

// A package's robot file usually lies one or two folders below the package. Each folder more costs two look-ups for
// every mesh.
/// Max number of folders above a robot file in which a package is looked for.
const MAX_FOLDERS: usize = 8;
/// Max number of shapes that are kept.
pub(crate) const MAX_OUTLINES: usize = 2048;

/// A shape of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// The geom's name, or the link's.
    pub name: String,
    /// The body, by its place in the model.
    pub body: usize,
    /// Position in the body frame, m.
    pub pos: Vec3,
    /// Orientation in the body frame, wxyz.
    pub quat: Quat,
    /// Whether the file lets it collide.
    pub colliding: bool,
    /// Its shape.
    pub form: Form,
}

/// The shape of an outline.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// A simple shape.
    Solid(Shape),
    /// A mesh.
    Mesh(MeshFile),
}

/// A mesh of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// Where it should be; it may be missing.
    pub file: PathBuf,
    /// Position and orientation in the file of what the file calls the mesh's own frame: `refpos` and `refquat` of MJCF.
    pub frame: (Vec3, Quat),
    /// Factors along the axes of that frame; the file's unit times these is metres.
    pub scale: Vec3,
}

impl MeshFile {
    /// The mesh in metres, in its own frame.
    ///
    /// # Errors
    /// A file that is missing or that cannot be read.
    pub fn read(&self) -> Result<Mesh, MeshError> {
        let mut mesh = mesh::read(&self.file)?;
        for point in mesh.triangles.iter_mut().flatten() {
            // From the file's frame to the mesh's own, and there to metres.
            let local = rotate_back(self.frame.1, sub(*point, self.frame.0));
            *point = std::array::from_fn(|k| local[k] * self.scale[k]);
        }
        Ok(mesh)
    }
}

impl Outline {
    /// Points on its surface in the body frame, m: a mesh's vertices; a simple shape's corners, or points around it.
    ///
    /// # Errors
    /// A mesh that cannot be read.
    pub fn points(&self) -> Result<Vec<Vec3>, MeshError> {
        let inner: Vec<Vec3> = match &self.form {
            Form::Mesh(file) => file.read()?.triangles.into_iter().flatten().collect(),
            Form::Solid(shape) => surface(shape),
        };
        Ok(inner.into_iter().map(|point| add(self.pos, rotate(self.quat, point))).collect())
    }
}

/// Points on the surface of a shape, in its frame.
fn surface(shape: &Shape) -> Vec<Vec3> {
    // The chord between two of 24 points lies at most 0.9 % of the radius inside the circle.
    /// Number of points around, and from pole to pole.
    const AROUND: usize = 24;
    let ring = |radius: f64, z: f64| {
        (0..AROUND).map(move |step| {
            let (sine, cosine) = (std::f64::consts::TAU * step as f64 / AROUND as f64).sin_cos();
            [radius * cosine, radius * sine, z]
        })
    };
    let ball = |radius: f64, half: f64| {
        (0..=AROUND).flat_map(move |step| {
            let (sine, cosine) = (std::f64::consts::PI * step as f64 / AROUND as f64).sin_cos();
            // The halves of a ball are moved apart along the capsule's axis.
            ring(radius * sine, radius * cosine + half * cosine.signum())
        })
    };
    match *shape {
        Shape::Sphere { radius } => ball(radius, 0.0).collect(),
        // The ring between the halves is one of the upper half alone.
        Shape::Capsule { radius, half_length } => {
            ball(radius, half_length).chain(ring(radius, -half_length)).collect()
        }
        Shape::Cylinder { radius, half_length } => {
            ring(radius, half_length).chain(ring(radius, -half_length)).collect()
        }
        Shape::Box { half_size } => (0..8)
            .map(|corner| {
                std::array::from_fn(|k| if corner >> k & 1 == 0 { -half_size[k] } else { half_size[k] })
            })
            .collect(),
    }
}

/// The meshes of an MJCF file's assets, by name.
#[derive(Debug, Default)]
pub(crate) struct Meshes(HashMap<String, MeshFile>);

impl Meshes {
    /// The meshes that the `<asset>` section names. It notes a class that does not exist.
    pub fn read(
        &mut self,
        ctx: &mut Context,
        asset: &Element,
        compiler: &Compiler,
        defaults: &Defaults,
    ) -> Result<(), ModelError> {
        // A text has no folder to look in, and only a mending reading has a use for meshes.
        let sources = ctx.sources;
        let Some(folder) = sources.folder.as_ref().filter(|_| ctx.mend) else { return Ok(()) };
        for element in asset.children.iter().filter(|child| child.name == "mesh") {
            let mut a = Attributes::new(element);
            let Some(file) = a.text("file") else { continue };
            let name = a.text("name").unwrap_or_else(|| crate::terrain::stem(file));
            let class = match a.text("class") {
                None => 0,
                Some(class) => defaults.find(ctx, element.at, class).unwrap_or_else(|_| {
                    let how = format!("its default class \"{}\" does not exist: `main` counts", shown(class));
                    ctx.note(element.at, element.label(), how);
                    0
                }),
            };
            let mut scale = defaults.class(class).mesh_scale;
            a.set_array(ctx, "scale", &mut scale)?;
            let mut frame = ([0.0; 3], IDENTITY);
            a.set_array(ctx, "refpos", &mut frame.0)?;
            a.set_array(ctx, "refquat", &mut frame.1)?;
            frame.1 = normalize(frame.1);
            if self.0.len() >= MAX_OUTLINES {
                return Err(ctx.too_many(element.at, "meshes", MAX_OUTLINES));
            }
            let file = folder.join(&compiler.mesh_folder).join(file);
            self.0.insert(name.to_string(), MeshFile { file, frame, scale });
        }
        Ok(())
    }

    /// A mesh by its name.
    pub fn get(&self, name: &str) -> Option<&MeshFile> {
        self.0.get(name)
    }
}

/// The file of a URDF's `filename`: `package://name/path` is looked for in the folders above the robot file, and any file
/// also in `mesh_folder`. The first place that has it; else the one where it should be.
pub(crate) fn resolve(folder: &Path, filename: &str, mesh_folder: &str) -> PathBuf {
    let (package, rest) = match filename.split_once("://") {
        Some(("package" | "model", path)) => match path.split_once('/') {
            Some((package, rest)) => (Some(package), rest),
            None => (None, path),
        },
        Some(("file", path)) => (None, path),
        // Any other text is a path.
        _ => (None, filename),
    };
    // Files from Windows have backslashes.
    let base = rest.rsplit(['/', '\\']).next().unwrap_or(rest);
    let mut places = vec![folder.join(rest), folder.join(mesh_folder).join(base)];
    if let Some(package) = package {
        // A relative folder has no ancestors above the one that the program runs in.
        let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
        for above in absolute.ancestors().take(MAX_FOLDERS) {
            // The package is a folder of that name, or a folder above under another name.
            places.push(above.join(package).join(rest));
            places.push(above.join(rest));
        }
    }
    // Where no place has the file, the error names the place that the robot file states.
    let present = places.iter().find(|path| path.is_file()).cloned();
    present.unwrap_or_else(|| places.swap_remove(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ends_of_a_capsule_have_a_rim() {
        let points = surface(&Shape::Capsule { radius: 0.1, half_length: 0.2 });
        for end in [-0.2_f64, 0.2] {
            let on_rim = |point: &&Vec3| {
                (point[2] - end).abs() < 1e-12 && (point[0].hypot(point[1]) - 0.1).abs() < 1e-12
            };
            assert_eq!(points.iter().filter(on_rim).count(), 24, "{end}");
        }
    }
}
