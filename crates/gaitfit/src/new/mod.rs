//! A first configuration for a robot's logs: a fit of legs in the air, or with a policy the loop of a robot that walked.
//! What is assumed is reported; what is missing is asked for by name.

mod logs;
mod text;

use crate::adapt::{Opening, Setup};
use crate::robot::{self, Hold};
use crate::settings::{self, AdaptConfig, LoopConfig, groups};
use crate::{Error, files, init, paths, policy_file, robot_file};
use gaitfit_log::PerJoint;
use gaitfit_model::{Model, builtin, read_mjcf_str, shown, shown_number};
use gaitfit_policy::Policy;
use logs::Logs;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Period of the boards that control a robot's motors, s: 1 ms on most robots.
const BOARD_SECONDS: f64 = 0.001;

/// Inputs of a first configuration.
#[derive(Clone, Debug, Default)]
pub struct NewSettings {
    /// Robot file (MJCF or URDF), or `unitree-go2`, the built-in Go2; without one that of the policy's training, or the built-in Go2 if the policy is of it.
    pub robot: Option<PathBuf>,
    /// The policy that walked; without one the logs are of legs in the air.
    pub policy: Option<PathBuf>,
    /// Logs (.csv), or folders of them.
    pub logs: Vec<PathBuf>,
    /// Where the configuration goes.
    pub out: Option<PathBuf>,
    /// Position gains, N·m/rad, where the logs do not state theirs.
    pub kp: Option<PerJoint>,
    /// Velocity gains, N·m·s/rad.
    pub kd: Option<PerJoint>,
    /// Drop what the engine cannot simulate in the robot file.
    pub lenient: bool,
}

/// Something that was assumed or measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Assumed {
    /// Subject of the assumption.
    pub what: &'static str,
    /// The value, and where it comes from.
    pub value: String,
}

/// A configuration that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Written {
    /// The file.
    pub file: String,
    /// What was assumed, in the order of the configuration.
    pub assumed: Vec<Assumed>,
    /// What to know before trusting the logs or the robot file.
    pub warnings: Vec<String>,
    /// Why the configuration cannot be run as it stands; absent if it can.
    pub problem: Option<String>,
    /// The command that runs it.
    pub next: String,
}

/// Data that the configuration is made from.
struct Inputs<'a> {
    settings: &'a NewSettings,
    out: &'a Path,
    model: Model,
    policy: Option<Policy>,
    logs: Logs,
    gains: Option<Gains>,
    groups: Option<Vec<(String, Vec<String>)>>,
}

/// PD gains that the configuration states.
struct Gains {
    kp: PerJoint,
    kd: PerJoint,
    source: &'static str,
}

impl Gains {
    /// The numbers, and where they are from.
    fn text(&self) -> String {
        format!("kp {} N·m/rad, kd {} N·m·s/rad: {}", range(&self.kp), range(&self.kd), self.source)
    }

    /// Warns what a kd of 0 does to the fit.
    fn doubt(&self) -> Option<String> {
        let zero = self.kd.values().into_iter().filter(|kd| *kd == 0.0).count();
        (zero > 0).then(|| {
            "kd is 0: with it the fitted damping also holds the kd that the robot's controller had. If that was not 0, give \
             --kp and --kd"
                .to_owned()
        })
    }
}

/// The gain of all joints, or the smallest and the largest.
fn range(gains: &PerJoint) -> String {
    let values = gains.values();
    let min = values.iter().copied().fold(f64::INFINITY, f64::min);
    let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if min == max { shown_number(min) } else { format!("{} to {}", shown_number(min), shown_number(max)) }
}

/// Writes a configuration and opens it as its command would.
///
/// # Errors
/// What is missing, by name; robot, policy or logs that cannot be read; a file that cannot be written.
pub fn write(settings: &NewSettings) -> Result<Written, Error> {
    let mut settings = settings.clone();
    if let Some(path) = &settings.policy {
        settings.policy = Some(policy_file::find(path)?.path);
    }
    let policy =
        settings.policy.as_deref().map(gaitfit_policy_files::read).transpose().map_err(Error::failed)?;
    // Policies that were trained here name the robot file of their training.
    let remembered = policy.as_ref().and_then(|policy| policy.provenance.robot_file.as_ref());
    let mut moved = None;
    // Without --robot the robot of the policy's training is taken.
    if let (None, Some(recorded), Some(policy), Some(file)) =
        (&settings.robot, remembered, &policy, &settings.policy)
    {
        let (path, note) = robot_file::find(file, recorded, &policy.interface.robot)?;
        settings.robot = Some(path);
        settings.lenient |= recorded.lenient;
        moved = note;
    }
    let built_in = settings.robot.as_deref().is_some_and(robot::is_built_in);
    // A configuration for a policy needs no file of the built-in robot.
    if built_in && policy.is_some() {
        settings.robot = None;
    }
    let mut settings = settings;
    let out = complete(&settings, policy.as_ref(), built_in)?.to_owned();
    let out = out.as_path();
    // A fit of legs in the air names its robot's file.
    let file = built_in.then(|| out.with_file_name("go2.xml")).filter(|_| policy.is_none());
    if let Some(file) = &file {
        // Never overwritten unless it already is that robot.
        if file.exists() && files::read_text(file, files::MAX_BYTES).ok().as_deref() != Some(builtin::GO2) {
            return Err(Error::settings(format!(
                "{}: exists and is not the built-in Go2, which would be written there; give it as --robot, or another --out",
                file.display()
            )));
        }
        settings.robot = Some(file.clone());
    }
    let settings = &settings;
    // Legs in the air are fitted with the base held.
    let hold = if policy.is_some() { Hold::File } else { Hold::Clamped };
    let model = match &settings.robot {
        // Its file is not written yet.
        Some(_) if file.is_some() => read_mjcf_str(builtin::GO2, &Hold::Clamped.options(false))?,
        Some(path) => robot::read(path, settings.lenient, hold)?,
        None => robot::go2()?,
    };
    let logs = Logs::read(&settings.logs, &model, policy.as_ref())?;
    if let Some(log) = logs.files.iter().find(|log| is_sidecar(out, log)) {
        return Err(Error::settings(format!(
            "--out {}: a file of that name beside {} describes that log; give the configuration another name",
            out.display(),
            log.display()
        )));
    }
    // A clamped robot would be fitted to steps on the ground.
    if policy.is_none() && logs.commands {
        return Err(Error::settings(
            "the logs have commands, so the robot walked; also give --policy, the policy that walked \
             (.safetensors, .onnx, or a .toml that describes it)",
        ));
    }
    // A policy states its gains itself.
    let gains = if policy.is_some() { None } else { gains(settings, &model, &logs)? };
    let groups = groups::by_name(&crate::robot::joint_names(&model));
    let inputs = Inputs { settings, out, model, policy, logs, gains, groups };
    // Last, so that a refusal leaves nothing behind; before the configuration, which names the file by its whole path.
    if let Some(file) = &file {
        files::write(file, builtin::GO2.as_bytes())?;
    }
    // Written before it is opened: a configuration with a problem is there to be mended.
    files::write(out, inputs.text().as_bytes())?;
    let mut written = inputs.checked();
    written.warnings.splice(0..0, moved);
    Ok(written)
}

/// Whether `file` would be read as the file that describes `log`.
fn is_sidecar(file: &Path, log: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        std::fs::canonicalize(folder).ok().map(|folder| folder.join(path.file_name().unwrap_or_default()))
    };
    whole(&log.with_extension("toml")).is_some_and(|sidecar| whole(file) == Some(sidecar))
}

/// The output, if everything is given that cannot be guessed.
fn complete<'a>(settings: &'a NewSettings, policy: Option<&Policy>, named: bool) -> Result<&'a Path, Error> {
    let builtin = named || policy.map(|policy| policy.interface.robot.as_str()) == Some("go2");
    // All at once, so that nobody has to run the command three times.
    let mut missing = Vec::new();
    if settings.robot.is_none() && !builtin {
        missing.push("--robot FILE, the robot's MJCF or URDF file (unitree-go2 is the built-in Go2)");
    }
    if settings.logs.is_empty() {
        missing.push(match policy {
            Some(_) => "--logs PATH, logs of walks: a .csv, a recording, or a folder of them",
            None => "--logs PATH, logs of legs in the air (and --policy POLICY if the robot walked)",
        });
    }
    if settings.out.is_none() {
        missing.push("--out FILE.toml, the configuration to write");
    }
    match (&settings.out, missing.is_empty()) {
        (Some(out), true) => Ok(out),
        _ => Err(Error::settings(format!("missing: {}", missing.join("; ")))),
    }
}

/// The gains of logs that do not state theirs: as asked, or those of the robot file's position actuators.
fn gains(settings: &NewSettings, model: &Model, logs: &Logs) -> Result<Option<Gains>, Error> {
    match (&settings.kp, &settings.kd) {
        (Some(kp), Some(kd)) => {
            return Ok(Some(Gains { kp: kp.clone(), kd: kd.clone(), source: "as given" }));
        }
        (None, None) => {}
        _ => return Err(Error::settings("missing: --kp and --kd belong together; give both")),
    }
    if logs.gains {
        return Ok(None);
    }
    // All joints or none: gains of some joints alone would leave the others limp.
    let servos: Option<Vec<[f64; 2]>> =
        (0..model.joints.len()).map(|joint| init::servo(model, joint)).collect();
    // A robot without joints has no gains to take.
    let Some(servos) = servos.filter(|servos| !servos.is_empty()) else {
        return Err(Error::settings(
            "missing: --kp N and --kd N (or a table such as '{ \"*\" = 40, \"*_hip\" = 20 }'), the PD gains while the logs were recorded; neither the logs nor the robot \
             file's actuators state them",
        ));
    };
    let named = |column: usize| {
        let values =
            model.joints.iter().zip(&servos).map(|(joint, gains)| (joint.name.clone(), gains[column]));
        PerJoint::Named(values.collect())
    };
    Ok(Some(Gains { kp: named(0), kd: named(1), source: "the robot file's position actuators" }))
}

impl Inputs<'_> {
    /// The command's name, and its whole line.
    fn next(&self) -> String {
        let command = if self.trains() { "loop" } else { "fit" };
        format!("gaitfit {command} {}", gaitfit_model::argument(self.out))
    }

    /// Whether there is a policy that can be trained further.
    fn trains(&self) -> bool {
        self.policy.as_ref().is_some_and(|policy| policy.untrainable().is_none())
    }

    /// Opens the configuration as its command would, and reports.
    fn checked(self) -> Written {
        let (opened, problem) = match self.open() {
            Ok(setup) => (Some(setup), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let mut warnings = match &opened {
            Some(setup) => setup.warnings.clone(),
            None => robot::remarks(&self.model),
        };
        warnings.extend(self.logs.assumed.iter().cloned());
        warnings.extend(self.gains.as_ref().and_then(Gains::doubt));
        Written {
            file: self.out.display().to_string(),
            assumed: self.assumed(opened.as_ref()),
            warnings,
            problem,
            next: self.next(),
        }
    }

    fn open(&self) -> Result<Setup, Error> {
        let mut config: AdaptConfig = match &self.settings.policy {
            None => settings::load(Some(self.out), &[])?,
            Some(_) => {
                let config: LoopConfig = settings::load(Some(self.out), &[])?;
                config.adapt(1, config.policy.clone(), config.logs.clone())
            }
        };
        // Simulated walks would take seconds, and nothing here shows what they correct.
        config.optimizer.replicates = 0;
        Opening::new(&config, self.out).open()
    }

    /// Returns what was assumed and what the opened fit shows.
    fn assumed(&self, setup: Option<&Setup>) -> Vec<Assumed> {
        let mut lines = Vec::new();
        let mut add = |what, value: String| lines.push(Assumed { what, value });
        let robot =
            self.settings.robot.as_ref().map_or("built-in".to_owned(), |path| path.display().to_string());
        add("robot", format!("{} ({robot}), {} joints", shown(&self.model.name), self.model.joints.len()));
        add("logs", self.logs.text());
        add("joints", self.logs.joints_text(&self.model));
        // With findings about units the warnings say it, and this line would contradict them.
        if self.logs.assumed.is_empty() {
            let units =
                "the logs are in rad, rad/s and s, plausible for this robot; recordings are converted";
            add("units", units.to_owned());
        }
        if self.policy.is_none() {
            add("gains", self.gains.as_ref().map_or("stated by the logs".to_owned(), Gains::text));
        }
        // What follows needs a fit that could be opened.
        let Some(setup) = setup else { return lines };
        if let (Some(policy), Some(notes)) = (&self.policy, &setup.notes) {
            let policy_match = &notes.policy_match;
            let rate = 1.0 / policy.interface.control_dt;
            let verdict = if policy_match.agrees() { "it walked in these logs" } else { "see the warnings" };
            add(
                "policy",
                format!(
                    "{rate:.0} Hz; differs from the logged actions by {:.3} of their spread: {verdict}",
                    policy_match.mismatch
                ),
            );
        }
        let costs: Vec<String> = setup.config.costs.iter().map(ToString::to_string).collect();
        add("cost", costs.join(", "));
        let mut parameters: Vec<&str> = setup.config.parameter.iter().map(|rule| rule.kind.name()).collect();
        // Hinges and slides have rules of their own.
        parameters.dedup();
        let numbers = setup.config.number.iter().map(|rule| rule.kind.name());
        let fitted: Vec<&str> = parameters.into_iter().chain(numbers).collect();
        let delay = if fitted.contains(&"delay") { "" } else { "; the delay is taken as 0" };
        add("fitted", format!("{}{delay}", fitted.join(", ")));
        if let Some(delay) = self::delay(setup) {
            add("delay", delay);
        }
        let simulation = &setup.config.simulation;
        let robot =
            simulation.robot_timestep.map(|step| format!(", the robot's boards {:.1} ms", 1e3 * step));
        add("physics", format!("steps of {:.1} ms{}", 1e3 * simulation.timestep, robot.unwrap_or_default()));
        lines
    }
}

/// Describes the delay that the logs show without a fit: of swinging legs, and from rows to the stamps of
/// their targets.
fn delay(setup: &Setup) -> Option<String> {
    let swings = setup.swings.as_ref().and(setup.config.prior.get("delay"));
    let swings = swings.map(|delay| {
        // In ms. Two standard deviations are the half-width of a 95 % interval.
        format!("{:.1} ± {:.1} ms from targets to swinging legs", 1e3 * delay.value, 2e3 * delay.deviation)
    });
    let logs = setup.fit.logs.iter().map(|log| &log.trajectory);
    let lead = Some(crate::log::lead(logs)).filter(|lead| *lead != 0.0);
    let lead = lead.map(|lead| format!("targets are stamped {:.1} ms after their rows", 1e3 * lead));
    let parts: Vec<String> = swings.into_iter().chain(lead).collect();
    (!parts.is_empty()).then(|| format!("{}; the fit estimates it anew", parts.join("; ")))
}

/// `path` as the configuration `out` names it, as a TOML string.
fn quoted(path: &Path, out: &Path) -> String {
    toml::Value::from(paths::named(path, out)).to_string()
}

#[cfg(test)]
mod tests;
