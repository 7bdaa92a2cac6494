//! The chirp as files: targets, a script that plays them, and the configuration that fits the log.

use super::body::Body;
use super::safe::Safe;
use super::settings::ChirpSettings;
use gaitfit_settings::{Error, paths};
use std::fmt::Write;
use std::path::Path;

/// Plays the targets on a robot, in MuJoCo, or not at all.
const PLAYER: &str = include_str!("play.py");
/// Line of the script that the robot's numbers replace.
const NUMBERS: &str = "CHIRP = {}";

/// Files by name.
pub(super) fn files(
    settings: &ChirpSettings,
    body: &Body,
    safe: &Safe,
) -> Result<Vec<(&'static str, String)>, Error> {
    let mut files =
        vec![("chirp.csv", targets(settings, body, &safe.targets)), ("play.py", player(settings, body)?)];
    if settings.fit.is_none() {
        files.push(("fit.toml", fit(settings, body)));
    }
    Ok(files)
}

/// Time and targets, with rate and gains as in a log.
fn targets(settings: &ChirpSettings, body: &Body, targets: &[f64]) -> String {
    let name = toml::Value::from(body.model.name.as_str());
    let mut text = format!("# robot = {name}\n# rate_hz = {:?}\n", settings.rate);
    let _ = writeln!(text, "# kp = {:?}\n# kd = {:?}", body.gains.kp, body.gains.kd);
    text.push_str("time");
    for joint in &body.names {
        let _ = write!(text, ",qdes_{joint}");
    }
    text.push('\n');
    for (sample, row) in targets.chunks_exact(body.names.len()).enumerate() {
        // Time in whole microseconds, and targets with all their digits: the robot shall play what was
        // simulated.
        let _ = write!(text, "{:.6}", sample as f64 / settings.rate);
        for target in row {
            let _ = write!(text, ",{target:?}");
        }
        text.push('\n');
    }
    text
}

/// The script with the robot's numbers.
fn player(settings: &ChirpSettings, body: &Body) -> Result<String, Error> {
    let column = |values: &[f64]| -> Vec<Option<f64>> {
        values.iter().map(|&value| Some(value).filter(|value| value.is_finite())).collect()
    };
    // JSON of numbers, texts and lists is valid Python too.
    let numbers = serde_json::json!({
        "robot": body.model.name,
        "rate": settings.rate,
        "joints": body.names,
        "kp": body.gains.kp,
        "kd": body.gains.kd,
        "low": body.range.iter().map(|range| range[0]).collect::<Vec<_>>(),
        "high": body.range.iter().map(|range| range[1]).collect::<Vec<_>>(),
        "speed": column(&body.velocity),
        "torque": column(&body.torque),
    });
    // A limit that a joint lacks is `null` in JSON, on a line of its own, and `None` in the script, which is Python.
    let numbers: Vec<String> = serde_json::to_string_pretty(&numbers)
        .map_err(Error::failed)?
        .lines()
        .map(|line| {
            if line.trim_matches([' ', ',']) == "null" {
                line.replace("null", "None")
            } else {
                line.to_owned()
            }
        })
        .collect();
    let numbers = numbers.join("\n");
    Ok(PLAYER.replacen(NUMBERS, &format!("CHIRP = {numbers}"), 1))
}

/// A configuration of `gaitfit fit` for the log that the script writes.
fn fit(settings: &ChirpSettings, body: &Body) -> String {
    let text = |text: &str| toml::Value::from(text).to_string();
    let table = |values: &[f64]| {
        let entries: Vec<String> = body
            .names
            .iter()
            .zip(values)
            .map(|(name, value)| format!("{} = {value:?}", text(name)))
            .collect();
        format!("{{ {} }}", entries.join(", "))
    };
    let mut out = format!(
        "# Fits the log of the chirp: play.py writes log.csv, then `gaitfit fit fit.toml`. The bounds (`upper`) are those of the\n\
         # robots on which the chirp was simulated; the fit may have wider ones.\n\nrobot = {}\n",
        // The folder of the files is known later; from wherever it is, the whole path leads to the robot.
        text(&paths::named(&settings.robot, Path::new("chirp/fit.toml")))
    );
    if settings.lenient {
        out.push_str("lenient = true\n");
    }
    out.push_str("logs = [\"log.csv\"]\n\n[gains]\n");
    let _ = writeln!(out, "kp = {}\nkd = {}", table(&body.gains.kp), table(&body.gains.kd));
    // The same rules and bounds as the chirp was simulated with.
    for rule in &body.config.parameter {
        let joints: Vec<String> = rule.joints.iter().map(|pattern| text(pattern)).collect();
        let per = match rule.per {
            gaitfit_adapt::Sharing::Group => "group",
            gaitfit_adapt::Sharing::Joint => "joint",
            gaitfit_adapt::Sharing::All => "all",
        };
        let _ = writeln!(out, "\n[[parameter]]\nkind = \"{}\"\nper = \"{per}\"", rule.kind.name());
        let _ = writeln!(out, "joints = [{}]", joints.join(", "));
        if let Some(name) = &rule.name {
            let _ = writeln!(out, "name = {}", text(name));
        }
        if let Some(upper) = rule.upper {
            let _ = writeln!(out, "upper = {upper:?}");
        }
    }
    // A value a joint: too many for a search by draws, and exact derivatives need tens of simulations each.
    let _ = write!(out, "\n[optimizer]\n{}", gaitfit_fit::air::choices::SEARCH);
    let _ = writeln!(out, "\n[simulation]\ntimestep = {:?}", body.config.simulation.timestep);
    out
}
