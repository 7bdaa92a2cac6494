//! Entry points: a path or a text to a [`Model`].

use std::path::Path;

use crate::attributes::Context;
use crate::compile::compile;
use crate::error::{ModelError, Place};
use crate::looks::Source;
use crate::mend::of_body;
use crate::model::{Model, Root};
use crate::names::name_everything;
use crate::outline::Outline;
use crate::shown::shown;
use crate::spec::Spec;
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
    /// A floating robot that `root` clamps touches nothing of the world: it hangs, as [`Model::in_the_air`] says. A robot that
    /// its file fixes keeps the file's world.
    pub in_the_air: bool,
    /// Mend what a strict reading refuses and a robot can be simulated without: links without mass get one, impossible
    /// inertias become possible, unknown parts are dropped. [`Model::changed`] and [`Model::dropped`] list it. The shapes of
    /// meshes and visuals are kept in [`Model::outlines`]. Closed loops and ball joints are refused as ever.
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
    let source = Source::named_by(path, &document);
    Ok(Model { source, ..build(&document, &sources, &stem, options)? })
}

/// Outlines of the bodies of a robot file, by their names. Parts that no robot is simulated with do not matter.
pub(crate) fn outlines(path: &Path) -> Result<Vec<(String, Vec<Outline>)>, ModelError> {
    let mut sources = Sources::default();
    let document = xml::load(path, &mut sources)?;
    let options = ReadOptions { lenient: true, mend: true, ..ReadOptions::default() };
    // Pictures need no masses, and weighing would read each mesh once more.
    let mut ctx = Context { weighs_meshes: false, ..context(&sources, &options) };
    let (mut spec, _) = content(&mut ctx, &document, None)?;
    // Unnamed bodies get the names that they have in the model: looks find their body by its name.
    name_everything(&ctx, &mut spec)?;
    // The first body is the world.
    let bodies = spec.bodies.into_iter().skip(1);
    Ok(bodies.map(|body| (body.name.clone(), of_body(&body).collect())).collect())
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
    let mut ctx = context(sources, options);
    let (spec, wanted) = content(&mut ctx, document, options.root)?;
    compile(&mut ctx, spec, stem, wanted)
}

fn context<'s>(sources: &'s Sources, options: &ReadOptions) -> Context<'s> {
    Context {
        sources,
        lenient: options.lenient,
        mend: options.mend,
        weighs_meshes: options.mend,
        mesh_folder: String::new(),
        add_floor: options.add_floor,
        in_the_air: options.in_the_air,
        dropped: Vec::new(),
        changed: Vec::new(),
    }
}

/// Contents of a document, and how its root is attached if the caller `wanted` that.
fn content(
    ctx: &mut Context,
    document: &Element,
    wanted: Option<Root>,
) -> Result<(Spec, Option<Root>), ModelError> {
    match document.name.as_str() {
        "mujoco" => Ok((mjcf::read(ctx, document, wanted)?, wanted)),
        "robot" => urdf::read(ctx, document, wanted),
        _ => Err(wrong_root(document, ctx.sources)),
    }
}

fn wrong_root(document: &Element, sources: &Sources) -> ModelError {
    let place: Place = sources.place(document.at);
    ModelError::Invalid {
        place,
        message: format!("the root element is <{}>", shown(&document.name)),
        remedy: "give an MJCF file (<mujoco>) or a URDF file (<robot>)".into(),
    }
}
