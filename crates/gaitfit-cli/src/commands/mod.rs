//! The commands, one file each.

pub mod adapt;
pub mod bench;
pub mod collect;
pub mod config;
pub mod doctor;
pub mod drift;
pub mod evaluate;
pub mod excite;
pub mod explain;
pub mod export;
pub mod finetune;
pub mod forward;
pub mod import;
pub mod init;
pub mod inspect;
pub mod loop_;
#[cfg(feature = "dds")]
mod motion;
pub mod new;
mod policy;
pub mod preflight;
pub mod record;
pub mod reproduce;
pub mod run;
pub mod runs;
pub mod sensitivity;
pub mod shell;
pub mod train;
mod trial;
pub mod validate;
pub mod view;
mod walks;

use crate::exit::Failure;
use std::path::Path;

/// Refuses a file where a command writes into a folder; `what` goes there.
fn folder(path: &Path, what: &str) -> Result<(), Failure> {
    if path.exists() && !path.is_dir() {
        return Err(Failure::usage(format!(
            "{}: is a file; name the folder that {what} into; it is made if it is absent",
            path.display()
        )));
    }
    Ok(())
}

/// The name of a run: as asked for, as configured, or the configuration file's stem.
fn run_name(asked: Option<&String>, configured: Option<&String>, path: Option<&Path>) -> Option<String> {
    let stem = || Some(path?.file_stem()?.to_string_lossy().into_owned());
    asked.or(configured).cloned().or_else(stem)
}
