//! Pages and pictures shown when a command ends (`--open`).

use crate::output::note;
use std::path::Path;
use std::time::Duration;

/// Max time in which a program that opens files may report that it cannot, s.
const PATIENCE: Duration = Duration::from_secs(2);

/// The page of a run folder.
pub fn report(asked: bool, run_folder: &str) {
    show(asked, &Path::new(run_folder).join("report.html"));
}

/// Opens a file with the desktop's program for it, if that was asked. The result is there already, so a desktop that
/// cannot is worth a warning alone.
pub fn show(asked: bool, file: &Path) {
    if !asked {
        return;
    }
    let opened = std::path::absolute(file).and_then(|path| open::that_detached_with_timeout(path, PATIENCE));
    if let Err(error) = opened {
        note(&format!("warning: cannot open {} ({error}); open it in a browser", file.display()));
    }
}
