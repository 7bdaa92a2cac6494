//! `gaitfit export`: a policy in other programs' formats, and at a glance.

use super::policy::{document, text};
use crate::cli::Export;
use crate::exit::Failure;
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit_policy::{Policy, PolicyError, onnx, weights};
use std::path::PathBuf;

/// Reads the policy, writes what is asked for, prints what it is.
pub fn run(args: &Export) -> Result<(), Failure> {
    type Writer = fn(&Policy) -> Result<Vec<u8>, PolicyError>;
    let named: [(&Option<PathBuf>, &str, &str, Writer); 2] = [
        (&args.onnx, "--onnx", "onnx", onnx::write),
        (&args.safetensors, "--safetensors", "safetensors", weights::write),
    ];
    let asked = named.into_iter().filter_map(|(path, option, ending, writer)| {
        Some((Output { path: path.as_deref()?, option, ending: Some(ending) }, writer))
    });
    let (outputs, writers): (Vec<Output<'_>>, Vec<Writer>) = asked.unzip();
    let policy = gaitfit_policy::read(&args.policy).map_err(Failure::failed)?;
    let read = gaitfit_policy::files_of(&args.policy).map_err(Failure::failed)?;
    files::check(&outputs, read.iter().map(PathBuf::as_path))?;
    let mut written = Vec::new();
    for (output, writer) in outputs.iter().zip(writers) {
        let bytes = writer(&policy)
            .map_err(|error| Failure::failed(format!("{}: {error}", args.policy.display())))?;
        files::write(output.path, &bytes)?;
        written.push(output.path.display().to_string());
    }
    let document = document(&policy, written);
    if args.json { output::print_json(&document) } else { output::print(&text(&document)) }
}
