//! `gaitfit view`: a log beside its simulation, as a page.

use crate::cli::View;
use crate::exit::Failure;
use crate::{output, viewer};
use gaitfit::files::{self, Output};
use gaitfit::view::{ViewSettings, view};
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// The page and what it shows.
#[derive(Serialize)]
struct Document<'a> {
    page: &'a Path,
    #[serde(flatten)]
    viewed: &'a gaitfit::view::Viewed,
}

/// Simulates the log and writes the page.
pub fn run(args: &View) -> Result<(), Failure> {
    let from = ("--from", args.from, args.from >= 0.0, "not below 0");
    let seconds = ("--seconds", args.seconds, args.seconds > 0.0, "above 0");
    for (option, value, inside, bound) in [from, seconds] {
        // NaN fails the comparison above, and infinity the second check.
        if !(inside && value.is_finite()) {
            return Err(Failure::usage(format!("{option} {value}: give a number of seconds, {bound}")));
        }
    }
    let page = match &args.out {
        Some(out) => out.clone(),
        // Into the current folder: a page beside the log would change a folder of inputs.
        None => PathBuf::from(args.log.file_name().unwrap_or(args.log.as_os_str())).with_extension("html"),
    };
    let inputs = [
        Some(&args.log),
        args.theta.as_ref(),
        args.config.as_ref(),
        args.robot.as_ref(),
        args.policy.as_ref(),
    ];
    // `--out` names the file to replace; without it nobody asked for a file of this name.
    if args.out.is_none() && page.exists() {
        return Err(Failure::usage(format!(
            "{} exists already; name a page with --out, which replaces a page of that name",
            page.display()
        )));
    }
    let asked = Output { path: &page, option: "--out", ending: Some("html") };
    files::check(&[asked], inputs.into_iter().flatten().map(PathBuf::as_path))?;
    let viewed = view(&ViewSettings {
        log: args.log.clone(),
        theta: args.theta.clone(),
        config: args.config.clone(),
        robot: args.robot.clone(),
        policy: args.policy.clone(),
        set: args.set.clone(),
        from_s: args.from,
        seconds: Some(args.seconds),
        threads: args.threads.map(NonZeroUsize::get),
    })?;
    files::write(&page, viewed.html.as_bytes())?;
    viewer::show(args.open, &page);
    if args.json {
        return output::print_json(&Document { page: &page, viewed: &viewed });
    }
    let warnings: String = viewed.warnings.iter().map(|warning| format!("note: {warning}\n")).collect();
    output::print(&format!("{}\n{warnings}page: {}\n", viewed.headline, page.display()))?;
    match (&args.theta, viewed.distance_rad) {
        // Only the robot file's parameters were simulated, so a comparison with fitted ones is the next step.
        (None, [Some(_), _]) => output::next(&[format!(
            "gaitfit view {} --theta runs/FIT/theta.toml --out {}",
            gaitfit_model::argument(&args.log),
            gaitfit_model::argument(&page)
        )]),
        _ => Ok(()),
    }
}
