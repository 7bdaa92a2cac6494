//! `gaitfit excite`: motions that show a fit what it looks for.

use super::{folder, sensitivity::parameters};
use crate::cli;
use crate::exit::Failure;
use crate::output;
use crate::progress::Lines;
use crate::table::table;
use crate::watcher::watched;
use gaitfit::excite::{Chirp, Swept};
use gaitfit_model::shown;
use serde::Serialize;
use std::fmt::Write;

/// A chirp, as `--json` prints it.
#[derive(Serialize)]
struct Document {
    #[serde(flatten)]
    chirp: Chirp,
    written: Vec<String>,
}

/// Finds a chirp within the limits and writes it.
pub fn run(args: &cli::Excite) -> Result<(), Failure> {
    folder(&args.out, "the files go")?;
    let chirp = watched(Lines::Seconds(2), |watch| gaitfit::excite::chirp(&args.chirp(), watch))?;
    let written = chirp.write(&args.out)?;
    if args.json {
        return output::print_json(&Document { chirp, written });
    }
    output::print(&text(&chirp, &written))
}

fn text(chirp: &Chirp, written: &[String]) -> String {
    let mut text = format!(
        "A chirp of {:.1} s for {}, base clamped, legs in the air. Its limits hold on {} simulated robots all over the \
         bounds of the fit.\n\n",
        chirp.seconds,
        shown(&chirp.robot),
        chirp.robots
    );
    let header = ["joint", "about, rad", "±, rad", "to, Hz", "position, rad", "speed, rad/s", "torque, N·m"];
    let mut rows = table(&header, &[1, 2, 3]);
    for Swept {
        name,
        centre,
        amplitude,
        top_hz,
        position,
        range,
        velocity,
        velocity_limit,
        torque,
        torque_limit,
        ..
    } in &chirp.joints
    {
        rows.add_row([
            shown(name),
            format!("{centre:.3}"),
            format!("{amplitude:.3}"),
            format!("{top_hz:.2}"),
            format!("{:.2} to {:.2} in {:.2} to {:.2}", position[0], position[1], range[0], range[1]),
            format!("{velocity:.1} of {velocity_limit:.1}"),
            format!("{torque:.1} of {torque_limit:.1}"),
        ]);
    }
    let _ = writeln!(text, "{rows}\n");
    let limited: Vec<&Swept> = chirp.joints.iter().filter(|joint| joint.limited_by.is_some()).collect();
    match limited.is_empty() {
        true => text.push_str("No limit made it smaller than asked for.\n"),
        false => text.push_str("What made it smaller or slower than asked for:\n"),
    }
    for Swept { name, limited_by, .. } in limited {
        let _ = writeln!(text, "  {}: {}", shown(name), limited_by.as_deref().unwrap_or_default());
    }
    let _ = writeln!(
        text,
        "\nWhat a fit of its log can tell, if the fitted simulator differs from the log by {:.2e} of half the joints' range:\n\n{}",
        chirp.difference,
        parameters(&chirp.parameters)
    );
    for note in &chirp.notes {
        let _ = writeln!(text, "note: {note}");
    }
    for path in written {
        let _ = writeln!(text, "{path}");
    }
    text
}
