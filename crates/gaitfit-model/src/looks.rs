//! What a robot looks like in pictures: the meshes of its file, thin enough for a page.
//!
//! Pictures do without what is missing, damaged or too large.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use crate::mesh::{MAX_COORDINATE, Pool, ThinMesh};
use crate::model::Model;
use crate::orientation::compose;
use crate::outline::{Form, MeshFile, Outline};
use crate::read::outlines;
use crate::rotation::{IDENTITY, Quat, Vec3, sub};
use crate::xml::Element;

/// The text of `<custom>` that names the file which shows what a robot looks like, as seen from the robot's own file.
pub(crate) const SOURCE: &str = "gaitfit_source";
/// Max number of triangles of all meshes together.
const MAX_TRIANGLES: usize = 15_000;
/// Max number of places of meshes, of mesh files, and of their bytes.
const MAX_PLACES: usize = 256;
const MAX_FILES: usize = 256;
const MAX_BYTES: u64 = 200_000_000;
/// Max number of triangles that are read from the files.
const MAX_READ: usize = 1 << 20;

/// Meshes on the links of a robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Looks {
    /// The meshes, each in a frame in the middle of its box.
    pub meshes: Vec<ThinMesh>,
    /// Places of the meshes on the links.
    pub places: Vec<Look>,
}

/// A mesh on a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// The body's name.
    pub body: String,
    /// Position in the body's frame, m.
    pub pos: Vec3,
    /// Orientation in the body's frame, wxyz.
    pub quat: Quat,
    /// Its place in [`Looks::meshes`].
    pub mesh: usize,
}

/// The file that shows what a robot looks like. Copies of a model read its meshes once.
#[derive(Clone, Debug, Default)]
pub struct Source(Option<Arc<Kept>>);

#[derive(Debug)]
struct Kept {
    file: PathBuf,
    looks: OnceLock<Looks>,
}

impl PartialEq for Source {
    /// A robot is the same wherever it was read from.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Source {
    /// The robot file `file`.
    pub fn new(file: &Path) -> Self {
        Self(Some(Arc::new(Kept { file: file.to_owned(), looks: OnceLock::new() })))
    }

    /// The source of the robot in the file at `path`: the one that it names, or itself.
    pub(crate) fn named_by(path: &Path, document: &Element) -> Self {
        let custom = document.children.iter().filter(|section| section.name == "custom");
        let texts = custom.flat_map(|section| &section.children).filter(|child| child.name == "text");
        let named = texts.filter(|text| text.get("name") == Some(SOURCE)).find_map(|text| text.get("data"));
        match named {
            Some(named) => Self::new(&path.parent().unwrap_or(Path::new("")).join(named)),
            None => Self::new(path),
        }
    }

    /// The file; none of a robot that was read from a text.
    pub fn file(&self) -> Option<&Path> {
        self.0.as_ref().map(|kept| kept.file.as_path())
    }
}

impl Model {
    /// The meshes of the robot's file: of each link those that are shown, or else those that collide. Links that lack a
    /// mesh file have none. The first call reads the files. The meshes have at most 15,000 triangles together.
    pub fn looks(&self) -> &Looks {
        static BARE: Looks = Looks { meshes: Vec::new(), places: Vec::new() };
        self.source.0.as_ref().map_or(&BARE, |kept| kept.looks.get_or_init(|| read(&kept.file, self)))
    }
}

/// The meshes that the robot file at `path` has for the bodies of `model`; what cannot be read is left out.
fn read(path: &Path, model: &Model) -> Looks {
    let bodies =
        outlines(path).unwrap_or_default().into_iter().filter(|(body, _)| model.body(body).is_some());
    let mut files = Files::default();
    let mut places = Vec::new();
    for (body, outlines) in bodies {
        let shown = outlines.iter().any(|outline| !outline.colliding && is_mesh(outline));
        // The visual meshes if there are any, else the colliding ones.
        let meshes = outlines.iter().filter(|outline| outline.colliding != shown && is_mesh(outline));
        // A link with a missing mesh has none: a part of a link looks like another robot.
        let whole: Option<Vec<Look>> = meshes.map(|outline| files.look(&body, outline)).collect();
        // A link that would pass the limit is left out whole.
        places.extend(whole.filter(|whole| places.len() + whole.len() <= MAX_PLACES).unwrap_or_default());
    }
    // Meshes of links that are left out would take triangles from the others.
    files.pool.keep(|mesh| places.iter().any(|place| place.mesh == mesh));
    let mut thin = files.pool.thinned(MAX_TRIANGLES);
    // A mesh that is small beside the others may have lost all of its triangles.
    places.retain(|place| !thin[place.mesh].triangles.is_empty());
    let middles: Vec<Vec3> = thin.iter_mut().map(centred).collect();
    // Meshes without a place on a link are left out, so the others get new numbers.
    let (mut meshes, mut numbers) = (Vec::new(), vec![None; thin.len()]);
    for place in &mut places {
        (place.pos, place.quat) = compose((place.pos, place.quat), (middles[place.mesh], IDENTITY));
        place.mesh = *numbers[place.mesh].get_or_insert_with(|| {
            meshes.push(std::mem::take(&mut thin[place.mesh]));
            meshes.len() - 1
        });
    }
    Looks { meshes, places }
}

fn is_mesh(outline: &Outline) -> bool {
    matches!(outline.form, Form::Mesh(_))
}

/// Moves the middle of a mesh's box to the origin; returns where it was.
fn centred(mesh: &mut ThinMesh) -> Vec3 {
    let along = |k: usize| mesh.vertices.iter().map(move |vertex| vertex[k]);
    let middle = std::array::from_fn(|k| match along(k).reduce(f64::min).zip(along(k).reduce(f64::max)) {
        Some((low, high)) => (low + high) / 2.0,
        None => 0.0,
    });
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = sub(*vertex, middle));
    middle
}

/// Mesh files, each read once.
#[derive(Default)]
struct Files {
    pool: Pool,
    bytes: u64,
    /// The number of each mesh in the pool, none of one that cannot be shown.
    known: HashMap<String, Option<usize>>,
}

impl Files {
    /// An outline that is a mesh, on its body.
    fn look(&mut self, body: &str, outline: &Outline) -> Option<Look> {
        let Form::Mesh(file) = &outline.form else { return None };
        Some(Look { body: body.to_owned(), pos: outline.pos, quat: outline.quat, mesh: self.take(file)? })
    }

    /// The number of a mesh.
    fn take(&mut self, file: &MeshFile) -> Option<usize> {
        // The same file with another scale or frame is another mesh.
        let key = format!("{file:?}");
        if let Some(known) = self.known.get(&key) {
            return *known;
        }
        if self.known.len() >= MAX_FILES {
            return None;
        }
        let mesh = self.read(file);
        self.known.insert(key, mesh);
        mesh
    }

    fn read(&mut self, file: &MeshFile) -> Option<usize> {
        let bytes = std::fs::metadata(&file.file).ok()?.len();
        if self.bytes + bytes > MAX_BYTES {
            return None;
        }
        self.bytes += bytes;
        let mesh = file.read().ok()?;
        let plausible = |x: &f64| x.abs() < MAX_COORDINATE;
        let fits = self.pool.len() + mesh.triangles.len() <= MAX_READ;
        (fits && mesh.triangles.iter().flatten().flatten().all(plausible)).then(|| self.pool.add(&mesh))
    }
}
