//! Entry points: a path or a text to a [`Model`].

use std::path::Path;

use crate::attributes::Context;
use crate::compile::compile;
use crate::error::{ModelError, Place};
use crate::model::{Model, Root};
use crate::shown::shown;
use crate::xml::{self, Element, Sources};
use crate::{mjcf, urdf};

/// How a robot file is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Drop what is not honoured and list it in [`Model::dropped`], instead of refusing the file.
    pub lenient: bool,
    /// How the root body is attached, whatever the file says: [`Root::Fixed`] clamps a floating robot at
    /// its pose of the file, for in-air tests. `None`: the file's own root (for URDF, floating unless
    /// the root link is called `world`).
    pub root: Option<Root>,
    /// Give a floating robot of an MJCF file without any plane a floor z = 0, which [`Model::changed`] says. MuJoCo has no
    /// such floor. A URDF always gets one.
    pub add_floor: bool,
    /// Mend what a strict reading refuses and a robot can be simulated without: joints that are coupled across limbs are
    /// locked, links without mass get one, impossible inertias become possible, unknown parts are dropped. [`Model::changed`] and
    /// [`Model::dropped`] list it. The shapes of meshes and visuals are kept in [`Model::outlines`]. Closed loops and ball
    /// joints are refused as ever.
    pub mend: bool,
}

/// Reads a robot file; the root element tells MJCF (`<mujoco>`) from URDF (`<robot>`).
///
/// # Errors
/// [`ModelError`], with file, line, column, and what to do.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Model, ModelError> {
    let mut sources = Sources::default();
    let document = xml::load(path, &mut sources)?;
    let stem = path.file_stem().map_or("robot".to_string(), |s| s.to_string_lossy().into_owned());
    build(&document, &sources, &stem, options)
}

/// Reads MJCF from a text; `<include>` is refused, because there is no folder to look in.
///
/// # Errors
/// As [`read`]; the file is called `<text>` in messages.
pub fn read_mjcf_str(text: &str, options: &ReadOptions) -> Result<Model, ModelError> {
    read_str(text, "mujoco", options)
}

/// Reads URDF from a text.
///
/// # Errors
/// As [`read`]; the file is called `<text>` in messages.
pub fn read_urdf_str(text: &str, options: &ReadOptions) -> Result<Model, ModelError> {
    read_str(text, "robot", options)
}

fn read_str(text: &str, root: &str, options: &ReadOptions) -> Result<Model, ModelError> {
    let mut sources = Sources::default();
    let document = xml::parse("<text>", text, &mut sources)?;
    if document.name != root {
        return Err(wrong_root(&document, &sources));
    }
    build(&document, &sources, "robot", options)
}

fn build(
    document: &Element,
    sources: &Sources,
    stem: &str,
    options: &ReadOptions,
) -> Result<Model, ModelError> {
    let mut ctx = Context {
        sources,
        lenient: options.lenient,
        mend: options.mend,
        mesh_folder: String::new(),
        add_floor: options.add_floor,
        dropped: Vec::new(),
        changed: Vec::new(),
    };
    let (spec, wanted) = match document.name.as_str() {
        "mujoco" => (mjcf::read(&mut ctx, document, options.root)?, options.root),
        "robot" => urdf::read(&mut ctx, document, options.root)?,
        _ => return Err(wrong_root(document, sources)),
    };
    compile(&mut ctx, spec, stem, wanted)
}

fn wrong_root(document: &Element, sources: &Sources) -> ModelError {
    let place: Place = sources.place(document.at);
    ModelError::Invalid {
        place,
        message: format!("the root element is <{}>", shown(&document.name)),
        remedy: "give an MJCF file (<mujoco>) or a URDF file (<robot>)".into(),
    }
}
