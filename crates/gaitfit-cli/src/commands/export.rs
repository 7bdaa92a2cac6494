//! `gaitfit export`: a policy in other programs' formats, and at a glance.

use super::policy::{document, text};
use crate::cli::Export;
use crate::exit::Failure;
use crate::output;
use gaitfit::files;
use gaitfit_policy::{Policy, PolicyError, onnx, weights};
use std::path::PathBuf;

/// Reads the policy, writes what is asked for, prints what it is.
pub fn run(args: &Export) -> Result<(), Failure> {
    type Writer = fn(&Policy) -> Result<Vec<u8>, PolicyError>;
    let outputs: [(&Option<PathBuf>, &str, Writer); 2] =
        [(&args.onnx, "onnx", onnx::write), (&args.safetensors, "safetensors", weights::write)];
    for (path, ending, _) in outputs {
        if let Some(path) = path {
            files::check(path, &format!("--{ending}"), ending)?;
        }
    }
    let policy = gaitfit_policy::read(&args.policy).map_err(Failure::failed)?;
    let mut written = Vec::new();
    for (path, _, writer) in outputs {
        let Some(path) = path else { continue };
        let bytes = writer(&policy)
            .map_err(|error| Failure::failed(format!("{}: {error}", args.policy.display())))?;
        files::write(path, &bytes)?;
        written.push(path.display().to_string());
    }
    let document = document(&policy, written);
    if args.json { output::print_json(&document) } else { output::print(&text(&document)) }
}
