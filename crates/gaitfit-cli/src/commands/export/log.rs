//! A log for viewers.

use crate::cli::Export;
use crate::exit::Failure;
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit_log::{ReadOptions, read_csv};
use serde::Serialize;

/// The written files, as `--json` prints them.
#[derive(Serialize)]
struct Document {
    written: String,
    samples: usize,
    left_out: Vec<&'static str>,
}

/// Reads the log and writes it as MCAP.
pub fn run(args: &Export) -> Result<(), Failure> {
    let out = super::needed(args, "log.mcap")?;
    files::check(&[Output { path: out, option: "--out", ending: Some("mcap") }], [args.file.as_path()])?;
    let log = read_csv(&args.file, &ReadOptions::default()).map_err(Failure::failed)?;
    let (bytes, left_out) = gaitfit_import::mcap_bytes(&log)
        .map_err(|error| Failure::failed(format!("{}: {error}", args.file.display())))?;
    files::write(out, &bytes)?;
    let document = Document { written: out.display().to_string(), samples: log.len(), left_out };
    if args.json {
        return output::print_json(&document);
    }
    let mut text =
        format!("{}: {} samples; open it in Foxglove or PlotJuggler\n", document.written, document.samples);
    for what in &document.left_out {
        text.push_str(&format!("left out: {what}\n"));
    }
    output::print(&text)
}
