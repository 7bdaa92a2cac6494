//! Motions that show a fit what it looks for: chirps for legs in the air, and commands for a walking policy.

mod body;
mod commands;
mod design;
mod files;
mod forecast;
mod information;
mod look;
pub mod playlist;
mod pool;
mod safe;
mod settings;
mod sweep;
#[cfg(test)]
mod tests;

pub use commands::{CommandSettings, Commands, Expected, commands};
pub use settings::{ChirpSettings, Turns};

use gaitfit_fit::adapt::ParameterSensitivity;
use gaitfit_run::watch::Watch;
use gaitfit_settings::Error;
use serde::Serialize;
use std::path::Path;

/// A chirp whose limits hold in simulation.
#[derive(Clone, Debug, Serialize)]
pub struct Chirp {
    /// The robot.
    pub robot: String,
    /// Length, s.
    pub seconds: f64,
    /// Targets.
    pub samples: usize,
    /// Simulated robots on which the limits hold.
    pub robots: usize,
    /// Simulations of all of them until the limits held.
    pub rounds: usize,
    /// The joints that move.
    pub joints: Vec<Swept>,
    /// Root mean square of the differences that the expected deviations hold for, where the robot's range is 2.
    pub difference: f64,
    /// How well a fit of a log of this chirp can tell each parameter.
    pub parameters: Vec<ParameterSensitivity>,
    /// Where gains, pose and limits are from, and what to know before playing it.
    pub notes: Vec<String>,
    /// Files by name.
    #[serde(skip)]
    pub files: Vec<(&'static str, String)>,
    /// Log that the robot of the file would record.
    #[serde(skip)]
    pub expected: gaitfit_log::Trajectory,
}

/// A joint's chirp, and the most that any simulated robot did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Swept {
    /// The joint.
    pub name: String,
    /// Middle of its motion, rad.
    pub centre: f64,
    /// Amplitude of its targets, rad.
    pub amplitude: f64,
    /// Last frequency, Hz.
    pub top_hz: f64,
    /// Lowest and highest position, rad.
    pub position: [f64; 2],
    /// Range of the joint, rad, without the margin.
    pub range: [f64; 2],
    /// Largest speed, rad/s.
    pub velocity: f64,
    /// Speed limit, rad/s, without the margin.
    pub velocity_limit: f64,
    /// Largest torque that the controller asks for, N·m.
    pub torque: f64,
    /// Torque limit, N·m, without the margin.
    pub torque_limit: f64,
    /// The limit that made the chirp smaller than asked for, and the robot that met it; absent if none did.
    pub limited_by: Option<String>,
}

/// The log that `chirp` expects of the robot as its file says.
const EXPECTED: &str = "expected.csv";

/// Finds a chirp within all limits: it is simulated on robots all over the bounds of the fit, and made smaller and slower
/// until the limits hold on all of them.
///
/// # Errors
/// Settings out of range; a robot that cannot be read, or without limits or gains; limits that cannot hold.
pub fn chirp(settings: &ChirpSettings, watch: &Watch<'_>) -> Result<Chirp, Error> {
    settings.check()?;
    let body = body::Body::read(settings)?;
    let trial = safe::Trial::new(settings, &body)?;
    // Safety decides the chirp; the forecast only tells what it will show.
    let safe = safe::shrink(settings, &body, &trial, watch)?;
    let forecast = forecast::forecast(settings, &body, &safe.targets, trial.theta())?;
    let expected = body.trajectory(settings.rate, &safe.targets, safe.expected.clone());
    let mut notes = body.notes.clone();
    notes.push(
        "the robot's own parts do not touch each other in the simulation: watch the first run with a hand on the stop"
            .to_owned(),
    );
    Ok(Chirp {
        robot: body.model.name.clone(),
        seconds: safe.sweep.samples() as f64 / settings.rate,
        samples: safe.sweep.samples(),
        robots: trial.robots(),
        rounds: safe.rounds,
        joints: safe.swept(&body),
        difference: settings.difference,
        parameters: forecast,
        notes,
        files: files::files(settings, &body, &safe)?,
        expected,
    })
}

impl Chirp {
    /// Writes its files into `folder`, which is made if it is not there, and gives their names. `force` overwrites files
    /// that differ.
    ///
    /// # Errors
    /// Without `force` a file of `folder` that differs, before anything is written; a file that cannot be written.
    pub fn write(&self, folder: &Path, force: bool) -> Result<Vec<String>, Error> {
        let differs = |(name, text): &&(&str, String)| {
            let path = folder.join(name);
            // A file that is no text is another one, too.
            path.exists()
                && gaitfit_run::files::read_text(&path, gaitfit_run::files::MAX_BYTES)
                    .map_or(true, |old| old != *text)
        };
        let differing: Vec<&str> = self.files.iter().filter(differs).map(|(name, _)| *name).collect();
        if !force && !differing.is_empty() {
            return Err(Error::settings(format!(
                "{}: the folder has another {}, which may hold your changes; give another --out, or --force to overwrite",
                folder.display(),
                differing.join(", ")
            )));
        }
        std::fs::create_dir_all(folder).map_err(|source| gaitfit_run::Error::File {
            access: gaitfit_run::Access::Make,
            path: folder.to_owned(),
            source,
            remedy: String::new(),
        })?;
        let mut written = Vec::new();
        for (name, text) in &self.files {
            let path = folder.join(name);
            gaitfit_run::files::write(&path, text.as_bytes())?;
            written.push(path.display().to_string());
        }
        let path = folder.join(EXPECTED);
        gaitfit_log::write_csv(&path, &self.expected)?;
        written.push(path.display().to_string());
        Ok(written)
    }
}
