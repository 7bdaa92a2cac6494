//! A log beside its simulation: two robots on one clock and each joint's curves, as a page.

mod motion;
mod robots;

use crate::settings::{self, AdaptConfig, Base, check};
use crate::{Error, robot, theta};
use gaitfit_adapt::cost::{CostKind, wasserstein1};
use gaitfit_log::{ReadOptions, Trajectory, read_csv};
use gaitfit_model::Model;
use gaitfit_view::fit::JointTrace;
use gaitfit_view::{Replay, Setting, SideBySide, side_by_side_html};
use motion::Motion;
use robots::Robots;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Frames a second of the robots at most: a screen shows no more.
const MAX_FRAME_HZ: f64 = 60.0;
/// Length of the part that a page shows, s, if no other is asked for.
pub const SHOWN_S: f64 = 60.0;

/// Choice of the log, the robot and the part to be shown.
#[derive(Clone, Debug, Default)]
pub struct ViewSettings {
    /// The log (.csv).
    pub log: PathBuf,
    /// Fitted parameters (theta.toml) of the simulated robot; without them it is the robot file's.
    pub theta: Option<PathBuf>,
    /// Configuration of the fit; `config.toml` beside the parameters without one.
    pub config: Option<PathBuf>,
    /// Robot file, instead of the configuration's. Without either the built-in Go2, if the log is of it.
    pub robot: Option<PathBuf>,
    /// Policy that walked, instead of the configuration's.
    pub policy: Option<PathBuf>,
    /// Changes of the configuration's settings, `key=value`.
    pub set: Vec<String>,
    /// Start of the shown part, s after the log's start.
    pub from_s: f64,
    /// Length of the shown part, s; [`SHOWN_S`] without a number.
    pub seconds: Option<f64>,
    /// Threads; one for each core without a number.
    pub threads: Option<usize>,
}

/// The page, and its result.
#[derive(Clone, Debug, Serialize)]
pub struct Viewed {
    /// The page as HTML.
    #[serde(skip)]
    pub html: String,
    /// The result in a sentence.
    pub headline: String,
    /// Distance of the simulated joint positions from the log's, rad: with the robot file, and with the fitted parameters.
    /// RMS over samples and joints for logs of a clamped robot; for walks the Wasserstein-1 distance, mean over joints.
    /// Absent where that robot was not simulated.
    pub distance_rad: [Option<f64>; 2],
    /// Whether the simulated robots fell, and when, s after the start of the shown part.
    pub fell_s: Option<f64>,
    /// Facts to know before trusting the page.
    pub warnings: Vec<String>,
}

/// A log and its simulations, over one time.
struct Shown {
    name: String,
    model: Model,
    /// The measured side, joints in the order of `joints`.
    log: Trajectory,
    /// For each of the log's joints, its index in the model.
    joints: Vec<usize>,
    /// Angles of joints that the log lacks, model order, rad.
    rest: Vec<f64>,
    nominal: Option<Simulated>,
    fitted: Option<Simulated>,
    /// Whether the base was clamped.
    clamped: bool,
    warnings: Vec<String>,
}

/// A simulated robot: the log's joints and rows.
struct Simulated {
    /// Joint angles, rad; `rows × joints`.
    position: Vec<f64>,
    /// Position, m, and orientation, wxyz, of the base, a row a sample; of a clamped robot empty.
    base: Vec<([f64; 3], [f64; 4])>,
    /// First row in which it had fallen.
    fell_at: Option<usize>,
}

/// Simulates the log and draws the page.
///
/// # Errors
/// A log, robot, policy or parameters that cannot be read or do not go together; no robot; a part without samples.
pub fn view(settings: &ViewSettings) -> Result<Viewed, Error> {
    let shown = Robots::open(settings)?.simulate()?;
    let rows = part(settings, &shown)?;
    page(settings, shown, rows)
}

/// The configuration by which the log is simulated, and the path from which it looks for files.
fn config(settings: &ViewSettings) -> Result<(AdaptConfig, PathBuf), Error> {
    let beside = settings.theta.as_ref().map(|theta| theta.with_file_name("config.toml"));
    let path = settings.config.clone().or(beside.filter(|path| path.is_file()));
    let mut set = settings.set.clone();
    // After the user's own changes, because the last one of a key wins: an option names a file more directly.
    for (key, file) in [("robot", &settings.robot), ("policy", &settings.policy)] {
        let value = file.as_ref().map(|file| toml::Value::from(file.display().to_string()));
        set.extend(value.map(|value| format!("{key}={value}")));
    }
    let mut config: AdaptConfig = settings::load(path.as_deref(), &set)?;
    let log = settings.log.display().to_string();
    config.logs = vec![log.clone()];
    config.validate = vec![log];
    // Every log can be compared by this one, whatever it lacks.
    config.costs = vec![CostKind::Wass];
    if let Some(path) = &path {
        check::check(&config, path)?;
    }
    Ok((config, path.unwrap_or_else(|| PathBuf::from("view"))))
}

/// Rows of the log that are shown.
fn part(settings: &ViewSettings, shown: &Shown) -> Result<std::ops::Range<usize>, Error> {
    let time = &shown.log.time;
    let start = time.first().copied().unwrap_or_default() + settings.from_s;
    let end = start + settings.seconds.unwrap_or(SHOWN_S);
    // Times of a log rise, so both ends can be searched by halves.
    let rows = time.partition_point(|t| *t < start)..time.partition_point(|t| *t <= end);
    if rows.len() < 2 {
        return Err(Error::settings(format!(
            "{}: no samples from {} s on; it lasts {:.2} s. Give another --from or --seconds",
            shown.name,
            settings.from_s,
            shown.log.duration()
        )));
    }
    Ok(rows)
}

fn page(settings: &ViewSettings, shown: Shown, rows: std::ops::Range<usize>) -> Result<Viewed, Error> {
    let width = shown.joints.len();
    let measured = &shown.log.position;
    let distance = |simulated: &Option<Simulated>| {
        let simulated = simulated.as_ref()?;
        let cells = rows.start * width..rows.end * width;
        // The angle of a wheel grows without end, so it has no distance.
        let compared: Vec<usize> =
            (0..width).filter(|&joint| !shown.log.has_velocity_target(joint)).collect();
        let angles = |all: &[f64]| -> Vec<f64> {
            all.chunks_exact(width).flat_map(|row| compared.iter().map(|&joint| row[joint])).collect()
        };
        let (simulated, measured) = (angles(&simulated.position[cells.clone()]), angles(&measured[cells]));
        distance(shown.clamped, &simulated, &measured, compared.len())
    };
    let distance_rad = [distance(&shown.nominal), distance(&shown.fitted)];
    // The fitted robot stands beside the log; without one the robot before the fit.
    let beside = shown.fitted.as_ref().or(shown.nominal.as_ref());
    let start = shown.log.time[rows.start];
    let fell = beside.and_then(|one| one.fell_at).filter(|row| rows.contains(row));
    let fell_s = fell.map(|row| shown.log.time[row] - start);
    let headline = headline(&shown, distance_rad, fell_s);
    let name = settings.log.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let seconds = shown.log.time[rows.end - 1] - start;
    let fact = |name: &str, value: String| Setting { name: name.to_owned(), value };
    let mut facts = vec![
        fact("Log", format!("{:.2} s at {:.0} Hz", shown.log.duration(), shown.log.rate_hz)),
        fact(
            "Shown",
            format!("{:.2} to {:.2} s", shown.log.time[rows.start], shown.log.time[rows.start] + seconds),
        ),
        fact("Base", if shown.clamped { "clamped" } else { "free" }.to_owned()),
    ];
    if let Some(theta) = &settings.theta {
        facts.push(fact("Fitted parameters", theta.display().to_string()));
    }
    let report = SideBySide {
        title: name,
        robot: shown.model.name.clone(),
        headline: headline.clone(),
        facts,
        replay: replay(&shown, &rows),
        traces: traces(&shown, &rows),
        aligned: shown.clamped,
        warnings: shown.warnings.clone(),
    };
    let html = side_by_side_html(&report).map_err(Error::failed)?;
    Ok(Viewed { html, headline, distance_rad, fell_s, warnings: shown.warnings })
}

/// How far simulated joints are from measured ones, rad: see [`Viewed::distance_rad`].
fn distance(aligned: bool, simulated: &[f64], measured: &[f64], width: usize) -> Option<f64> {
    // A walk and its simulation drift out of phase, so only their distributions can be compared.
    let distance = if aligned {
        let squares = simulated.iter().zip(measured).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / simulated.len() as f64).sqrt()
    } else {
        let joint = |joint: usize| {
            let column = |all: &[f64]| -> Vec<f64> {
                let mut column: Vec<f64> = all.iter().skip(joint).step_by(width).copied().collect();
                column.sort_by(f64::total_cmp);
                column
            };
            let simulated: Vec<f32> = column(simulated).iter().map(|&x| x as f32).collect();
            wasserstein1(&simulated, &column(measured))
        };
        (0..width).map(joint).sum::<f64>() / width as f64
    };
    distance.is_finite().then_some(distance)
}

fn headline(shown: &Shown, distance_rad: [Option<f64>; 2], fell_s: Option<f64>) -> String {
    let what = if shown.clamped {
        "RMS error of the simulated joint positions"
    } else {
        "Distance of simulated from measured joint positions (W₁, mean over joints)"
    };
    let unit = shown.model.units("rad");
    let mut text = match distance_rad {
        [Some(nominal), Some(fitted)] => {
            format!("{what}: robot file {nominal:.4} {unit}, fitted {fitted:.4} {unit}.")
        }
        [Some(nominal), None] => format!("{what}: robot file {nominal:.4} {unit}."),
        [None, Some(fitted)] => format!("{what}: fitted {fitted:.4} {unit}."),
        [None, None] if shown.nominal.is_some() => "The simulation diverges.".to_owned(),
        [None, None] => "The log alone, without a simulation.".to_owned(),
    };
    if let Some(seconds) = fell_s {
        text.push_str(&format!(" The simulated robot falls at {seconds:.2} s."));
    }
    text
}

/// The robots, at most [`MAX_FRAME_HZ`] frames a second.
fn replay(shown: &Shown, rows: &std::ops::Range<usize>) -> Replay {
    let dt = shown.log.dt();
    // A log at 60 Hz shows every row, whatever the last digit of its step says.
    let every = (1.0 / (dt * MAX_FRAME_HZ) - 0.01).ceil().max(1.0) as usize;
    let shape = crate::replay::shape("", &shown.model, &[]);
    // The page draws all joints of the model; those that the log lacks stay at rest.
    let whole = |position: &[f64]| -> Vec<f64> {
        let mut positions = Vec::with_capacity(rows.len() * shown.rest.len());
        for row in position.chunks_exact(shown.joints.len()) {
            let mut angles = shown.rest.clone();
            for (&joint, &angle) in shown.joints.iter().zip(row) {
                angles[joint] = angle;
            }
            positions.extend(angles);
        }
        positions
    };
    let commands = shown.log.command.as_deref().filter(|_| !shown.clamped);
    let robot = |name: &str, motion: Motion| {
        let mut frames = motion.frames(&shown.model, rows.start, every, commands);
        // `frames` goes on to the end of the log; only the shown rows count.
        frames.truncate(rows.len().div_ceil(every));
        gaitfit_view::replay::ReplayRobot { name: name.to_owned(), frames, ..shape.clone() }
    };
    let joints = whole(&shown.log.position);
    let attitude = shown.log.base.as_ref().and_then(|base| base.quaternion.as_deref());
    let measured = match shown.clamped {
        true => Motion::clamped(&shown.model, dt, joints),
        false => Motion::walked(&shown.model, dt, joints, attitude),
    };
    // A clamped simulation has no base of its own, so it hangs where the measured robot does.
    let height = measured.position.first().copied().unwrap_or_default();
    let mut robots = vec![robot("log", measured)];
    let simulated = shown.fitted.as_ref().map(|one| ("fitted simulator", one));
    if let Some((name, one)) = simulated.or(shown.nominal.as_ref().map(|one| ("robot file", one))) {
        let joints = whole(&one.position);
        let (position, quaternion) = match one.base.is_empty() {
            true => (vec![height; shown.log.len()], vec![[1.0, 0.0, 0.0, 0.0]; shown.log.len()]),
            false => one.base.iter().copied().unzip(),
        };
        robots.push(robot(name, Motion { dt, joints, position, quaternion }));
    }
    let note = match (shown.clamped, attitude.is_some()) {
        (true, _) => "The base is clamped; the simulated robot gets the targets of the log.",
        (false, true) => {
            "The log's base follows from its attitude and from feet that stand without sliding, so its speed is an estimate."
        }
        (false, false) => {
            "The log has no attitude: its base is drawn level and follows from feet that stand without sliding."
        }
    };
    Replay { dt: dt * every as f64, robots, note: note.to_owned(), ..Replay::default() }
}

fn traces(shown: &Shown, rows: &std::ops::Range<usize>) -> Vec<JointTrace> {
    let width = shown.joints.len();
    let start = shown.log.time[rows.start];
    let column = |all: &[f64], joint: usize| -> Vec<f64> {
        all.iter().skip(joint).step_by(width).skip(rows.start).take(rows.len()).copied().collect()
    };
    let positions = |simulated: &Option<Simulated>, joint: usize| {
        simulated.as_ref().map(|one| column(&one.position, joint)).unwrap_or_default()
    };
    let trace = |(joint, name): (usize, &String)| JointTrace {
        joint: name.clone(),
        file: shown.name.clone(),
        time_s: shown.log.time[rows.clone()].iter().map(|time| time - start).collect(),
        measured: column(&shown.log.position, joint),
        fitted: positions(&shown.fitted, joint),
        nominal: positions(&shown.nominal, joint),
        // The target of a wheel is a velocity, which has no place beside its angle.
        target: (shown.log.target.as_deref().filter(|_| !shown.log.has_velocity_target(joint)))
            .map(|target| column(target, joint))
            .unwrap_or_default(),
        slides: !shown.model.joints[shown.joints[joint]].kind.is_hinge(),
    };
    shown.log.joints.iter().enumerate().map(trace).collect()
}

#[cfg(test)]
mod tests;
