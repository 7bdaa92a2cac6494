//! `gaitfit excite`: motions that show a fit what it looks for.

use super::{folder, sensitivity::parameters};
use crate::cli;
use crate::exit::Failure;
use crate::interrupt;
use crate::output;
use crate::progress::Lines;
use crate::table::table;
use crate::watcher::watched;
use gaitfit::excite::{Chirp, Commands, Expected, Swept, playlist};
use gaitfit::files::{self, Output};
use gaitfit::settings::{self, AdaptConfig};
use gaitfit_model::{argument, shown, significant};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A chirp, as `--json` prints it.
#[derive(Serialize)]
struct Document {
    #[serde(flatten)]
    chirp: Chirp,
    written: Vec<String>,
}

/// Commands, as `--json` prints them.
#[derive(Serialize)]
struct Chosen<'a> {
    #[serde(flatten)]
    commands: &'a Commands,
    written: &'a Path,
}

/// Finds a chirp within the limits, or commands for a policy, and writes it.
pub fn run(args: &cli::Excite) -> Result<(), Failure> {
    match &args.policy {
        Some(policy) => choose(args, policy),
        None => chirp(args),
    }
}

fn choose(args: &cli::Excite, policy: &Path) -> Result<(), Failure> {
    let output = Output { path: &args.out, option: "--out", ending: Some("csv") };
    let inputs = [Some(&args.file), args.theta.as_ref()].into_iter().flatten().map(PathBuf::as_path);
    files::check(&[output], inputs.chain([policy]))?;
    let asked = args.commands(policy);
    // Only for the advice at the end, which names the same robot.
    let robot = settings::load::<AdaptConfig>(Some(&args.file), &args.set)?.robot;
    interrupt::listen()?;
    let commands = watched(Lines::Seconds(2), |watch| gaitfit::excite::commands(&asked, watch))?;
    files::write(&args.out, playlist::text(&commands.sequences).as_bytes())?;
    if args.json {
        return output::print_json(&Chosen { commands: &commands, written: &args.out });
    }
    // Three fits are compared: with the logs there are, with random commands beside these, and with the chosen
    // ones.
    let header = ["parameter", "recorded", "random", "chosen", "unit", "chosen over random"];
    let mut rows = table(&header, &[1, 2, 3, 5]);
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| significant(value, 3));
    for Expected { name, unit, counts, recorded, random, chosen } in &commands.parameters {
        let ratio = random
            .zip(*chosen)
            .map_or_else(|| "–".to_owned(), |(random, chosen)| format!("{:.2}", chosen / random));
        let name = format!("{}{}", shown(name), if *counts { "" } else { " (does not count)" });
        rows.add_row([name, number(*recorded), number(*random), number(*chosen), unit.clone(), ratio]);
    }
    let logs = commands.recorded_seconds.map_or_else(String::new, |seconds| {
        let config = shown(&args.file.display().to_string());
        format!(", both beside the {seconds:.0} s of logs that {config} names (alone: recorded)")
    });
    let mut text = format!(
        "{} command sequences of {} s for {}, chosen from {}; the policy fell under {} of these.\n\nExpected standard \
         deviations of a fit, with as many random commands and with the chosen ones{logs}:\n\n{rows}\n\n",
        commands.sequences.len(),
        asked.seconds,
        shown(&commands.robot),
        commands.pool,
        commands.fell,
    );
    if let Some(ratio) = commands.ratio {
        let percent = 100.0 * ratio;
        let _ = writeln!(
            text,
            "The geometric mean of those that count is {percent:.0} % of that with random commands."
        );
    }
    for note in &commands.notes {
        let _ = writeln!(text, "note: {note}");
    }
    let _ = writeln!(text, "{}", args.out.display());
    output::print(&text)?;
    output::next(&[format!(
        "gaitfit collect {} --commands {} --out logs{}",
        argument(policy),
        argument(&args.out),
        super::adapt::robot_option(policy, &robot)
    )])
}

fn chirp(args: &cli::Excite) -> Result<(), Failure> {
    folder(&args.out, "the files go")?;
    interrupt::listen()?;
    let chirp = watched(Lines::Seconds(2), |watch| gaitfit::excite::chirp(&args.chirp(), watch))?;
    let written = chirp.write(&args.out, args.force)?;
    if args.json {
        return output::print_json(&Document { chirp, written });
    }
    output::print(&text(&chirp, &written))?;
    let log = args.out.join("log.csv");
    output::next(&[
        format!(
            "python3 {}, after you fill in its class Robot; it writes {}, which the next command fits",
            argument(&args.out.join("play.py")),
            log.display()
        ),
        match &args.fit {
            None => format!("gaitfit fit {}", argument(&args.out.join("fit.toml"))),
            // The gains and parameters of this fit decided the motion, so its log belongs to the same fit.
            Some(fit) => {
                let logs = format!("logs=[{}]", toml::Value::from(log.display().to_string()));
                format!("gaitfit fit {} --set {}", argument(fit), argument(Path::new(&logs)))
            }
        },
    ])
}

fn text(chirp: &Chirp, written: &[String]) -> String {
    let mut text = format!(
        "A chirp of {:.1} s for {}, base clamped, legs in the air. It stays within the limits on {} simulated robots \
         across the bounds of the fit.\n\n",
        chirp.seconds,
        shown(&chirp.robot),
        chirp.robots
    );
    let header =
        ["joint", "about, rad", "±, rad", "to, Hz", "position, rad", "max speed, rad/s", "max torque, N·m"];
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
    // Limits come after the table, because they explain its numbers.
    let limited: Vec<&Swept> = chirp.joints.iter().filter(|joint| joint.limited_by.is_some()).collect();
    match limited.is_empty() {
        true => text.push_str("No limit reduced it.\n"),
        false => text.push_str(
            "The table shows the final motion. The first one was larger; these limits made it smaller or slower:\n",
        ),
    }
    for Swept { name, limited_by, .. } in limited {
        let _ = writeln!(text, "  {}: {}", shown(name), limited_by.as_deref().unwrap_or_default());
    }
    let _ = writeln!(
        text,
        "\nExpected precision of a fit of its log, if the fitted simulator differs from the log by {:.2e} of half the joints' range:\n\n{}",
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
