//! A policy in other programs' formats, and at a glance.

use crate::cli::Export;
use crate::commands::folder;
use crate::commands::policy::{document, text};
use crate::exit::Failure;
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit::policy_file::{self, PolicyFile};
use gaitfit::robot::{self, Hold};
use gaitfit::robot_file;
use gaitfit_model::{Model, builtin};
use gaitfit_policy::{Policy, PolicyError};
use gaitfit_policy_files::{deploy, onnx, weights};
use std::path::{Path, PathBuf};

/// A file to write.
struct File {
    path: PathBuf,
    option: &'static str,
    ending: Option<&'static str>,
    bytes: Vec<u8>,
}

/// Reads the policy, writes what is asked for, prints what it is.
pub fn run(args: &Export) -> Result<(), Failure> {
    let folders = [(&args.bundle, "--bundle"), (&args.cpp, "--cpp")];
    for path in folders.iter().filter_map(|(path, _)| path.as_ref()) {
        folder(path, "the files go")?;
    }
    // An option without effect would look as if it had one.
    if args.force && folders.iter().all(|(path, _)| path.is_none()) {
        return Err(Failure::usage(
            "--force is for --bundle and --cpp; --onnx and --safetensors replace the file that they name"
                .to_owned(),
        ));
    }
    let deployed = args.bundle.is_some() || args.cpp.is_some();
    if (args.robot.is_some() || args.lenient) && !deployed {
        return Err(Failure::usage(
            "--robot and --lenient are for --bundle and --cpp, which have effort limits of the robot; leave them out",
        ));
    }
    let PolicyFile { path, note } = policy_file::find(&args.file)?;
    note.iter().for_each(|note| output::note(note));
    let policy = gaitfit_policy_files::read(&path).map_err(Failure::failed)?;
    // A policy may be several files; none of them may be overwritten.
    let read = gaitfit_policy_files::files_of(&path).map_err(Failure::failed)?;
    // Only these files contain effort limits, so only they need the robot.
    let model = if deployed { model(args, &path, &policy)? } else { None };
    let (files, unsaid) = made(args, &policy, model.as_ref())?;
    // Files with an ending were named one by one and may be replaced; those of a folder were not.
    if let Some(file) = files.iter().find(|file| file.ending.is_none() && !args.force && file.path.exists()) {
        return Err(Failure::usage(format!(
            "{} exists already; give another {}, or --force to overwrite it",
            file.path.display(),
            file.option
        )));
    }
    // Folders first: the check of the outputs looks whether their folders are there.
    for file in files.iter().filter(|file| file.ending.is_none()) {
        let folder = file.path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder)
            .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
    }
    let outputs: Vec<Output<'_>> = files
        .iter()
        .map(|file| Output { path: &file.path, option: file.option, ending: file.ending })
        .collect();
    let inputs = read.iter().map(PathBuf::as_path).chain(args.robot.as_deref());
    files::check(&outputs, inputs)?;
    let mut written = Vec::new();
    for file in &files {
        files::write(&file.path, &file.bytes)?;
        written.push(file.path.display().to_string());
    }
    let document = document(&policy, written).without(unsaid);
    if args.json { output::print_json(&document) } else { output::print(&text(&document)) }
}

/// All files that are asked for, and what they do not say.
fn made(args: &Export, policy: &Policy, model: Option<&Model>) -> Result<(Vec<File>, Vec<String>), Failure> {
    type Writer = fn(&Policy) -> Result<Vec<u8>, PolicyError>;
    let failed = |error| Failure::failed(format!("{}: {error}", args.file.display()));
    let single: [(&Option<PathBuf>, _, _, Writer); 2] = [
        (&args.onnx, "--onnx", "onnx", onnx::write),
        (&args.safetensors, "--safetensors", "safetensors", weights::write),
    ];
    let (mut files, mut unsaid) = (Vec::new(), Vec::new());
    for (path, option, ending, writer) in single {
        let Some(path) = path.clone() else { continue };
        files.push((path, option, ending, writer));
    }
    // Names are checked before anything is made.
    let asked: Vec<Output<'_>> = files
        .iter()
        .map(|(path, option, ending, _)| Output { path, option, ending: Some(*ending) })
        .collect();
    files::check(&asked, [])?;
    let mut made = Vec::new();
    for (path, option, ending, writer) in files {
        made.push(File { path, option, ending: Some(ending), bytes: writer(policy).map_err(failed)? });
    }
    let mut add = |folder: &Path, option, deployment: deploy::Deployment| {
        for (name, bytes) in deployment.files {
            made.push(File { path: folder.join(name), option, ending: None, bytes });
        }
        unsaid.extend(deployment.unsaid);
    };
    if let Some(folder) = &args.bundle {
        add(folder, "--bundle", deploy::bundle(policy, model).map_err(failed)?);
    }
    if let Some(folder) = &args.cpp {
        add(folder, "--cpp", deploy::cxx(policy, model).map_err(failed)?);
    }
    Ok((made, unsaid))
}

/// The robot whose effort limits are written: the one named, that of the policy's training, or the built-in Go2 for a
/// policy that names it.
fn model(args: &Export, path: &Path, policy: &Policy) -> Result<Option<Model>, Failure> {
    // From the surest to the least sure: named, recorded at the training, built in.
    let recorded = policy.provenance.robot_file.as_ref();
    if let Some(robot) = &args.robot {
        let lenient =
            args.lenient || recorded.is_some_and(|recorded| robot_file::as_leniently(robot, recorded));
        return Ok(Some(robot::read(robot, lenient, Hold::File)?));
    }
    if let Some(recorded) = recorded {
        let (robot, note) = robot_file::find(path, recorded, &policy.interface.robot)?;
        note.iter().for_each(|note| output::note(note));
        return Ok(Some(robot::read(&robot, args.lenient || recorded.lenient, Hold::File)?));
    }
    if args.lenient {
        return Err(Failure::usage(
            "--lenient is for a robot's file, and the policy names none; give --robot",
        ));
    }
    let go2 = builtin::go2().map_err(Failure::failed)?;
    // The name alone is no proof: another robot of this name would get the Go2's effort limits.
    let interface = &policy.interface;
    let built_in = interface.robot == go2.name
        && interface.resolve(&go2).and_then(|joints| interface.resolve_held(&go2, &joints)).is_ok();
    Ok(built_in.then_some(go2))
}
