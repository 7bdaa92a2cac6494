//! The commands of a robot, within the ranges of the policy's training.

use crate::cli::Run;
use crate::exit::Failure;
use crate::keyboard::KEYS;
use crate::output::note;
use gaitfit::excite::playlist;
use gaitfit::world::WorldSettings;
use gaitfit_learn::task::TaskSettings;
use gaitfit_policy::Policy;
use gaitfit_robot::run::{MAX_WALK_SECONDS, Ranges, SPEEDS, Script, Steering, Trial, trials};
use std::path::Path;

/// Most bytes of a file of commands.
const MAX_BYTES: u64 = 64 << 20;
/// Room for the rounding of decimal numbers, m/s or rad/s.
const ROUNDING: f64 = 1e-6;

/// The source of the commands.
pub enum Who {
    /// Rows that were written or drawn before.
    Script(Script),
    /// The robot's remote, within ranges.
    Remote(Ranges),
    /// The keyboard.
    Keys(Steering),
    /// Drift trials.
    Trials(Vec<Trial>),
}

impl Who {
    /// Number of logs, if there is more than one walk.
    pub fn logs(&self) -> Option<usize> {
        match self {
            Self::Script(script) => script.of_many().then(|| script.walks()),
            Self::Trials(trials) => Some(trials.len()),
            Self::Remote(_) | Self::Keys(_) => None,
        }
    }

    /// The duration of the walk, in words.
    pub fn length(&self) -> String {
        match self {
            Self::Script(script) => format!("walk for {:.0} s", script.seconds()),
            Self::Remote(_) => "walk under its remote until A is pressed there (B damps)".to_owned(),
            Self::Keys(_) => format!("walk under the keys until Q. {KEYS}"),
            Self::Trials(trials) => format!("make {} drift trials", trials.len()),
        }
    }
}

/// The commands asked for.
///
/// # Errors
/// A policy that does not walk on four legs; commands beyond its training, where that is not allowed; times out of range,
/// by the name of the option that says them.
pub fn who(args: &Run, policy: &Policy) -> Result<Who, Failure> {
    let task = task(args, policy)?;
    // Gravity of a robot on four legs is along −z.
    if task.posture[2] > -0.9 {
        return Err(Failure::usage(format!(
            "{}: the policy does not walk on four legs (its task has posture = {:?}); `run` stands the robot up on four and \
             lies it down from there, so take a policy that walks on four, for example assets/go2-walk.safetensors",
            args.policy.display(),
            task.posture
        )));
    }
    if args.remote {
        // A remote cannot ask for more than these ranges, so nothing is checked later.
        return Ok(Who::Remote(ranges(policy, &task)));
    }
    if args.keyboard {
        return Ok(Who::Keys(Steering::new(ranges(policy, &task))));
    }
    if let Some(repeats) = args.drift {
        return drift(args, repeats, policy, &task);
    }
    let Some(path) = &args.commands else { return random(args, policy, &task).map(Who::Script) };
    let script = if args.of_collect || is_playlist(path) {
        played(args, path)?
    } else {
        if args.seconds.is_some() {
            return Err(Failure::usage(format!(
                "--seconds: {} has one walk, which its last row ends; leave --seconds out",
                path.display()
            )));
        }
        Script::read(path).map_err(Failure::failed)?
    };
    let remedy =
        "give commands within that, or try the file with --robot simulated and take --beyond-training";
    check_ranges(args, policy, &task, script.extremes(), &path.display().to_string(), remedy)?;
    Ok(Who::Script(script))
}

/// Refuses speeds beyond what the policy was trained for.
fn check_ranges(
    args: &Run,
    policy: &Policy,
    task: &TaskSettings,
    extremes: [[f64; 2]; 3],
    named: &str,
    remedy: &str,
) -> Result<(), Failure> {
    // The ranges of a policy that was trained elsewhere are not known; the commands' own limit applies.
    if policy.provenance.task.is_empty() || args.beyond_training {
        return Ok(());
    }
    let parts = ["vx", "vy", "wz"].into_iter().zip(task.command.ranges(1.0)).zip(extremes);
    for ((name, [low, high]), speeds) in parts {
        let beyond = speeds.into_iter().find(|speed| *speed < low - ROUNDING || *speed > high + ROUNDING);
        if let Some(beyond) = beyond {
            return Err(Failure::usage(format!(
                "{named}: {name} = {} is outside the policy's training, {low} to {high}; {remedy}",
                beyond as f32
            )));
        }
    }
    Ok(())
}

/// Whether a file has commands of several trajectories, as `gaitfit excite --policy` writes them.
fn is_playlist(path: &Path) -> bool {
    let header = |text: String| {
        // The first line that is no comment is the header. Excel writes a byte order mark in front of it.
        let rows = text
            .trim_start_matches('\u{feff}')
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(str::to_owned);
        rows.take(1).any(|header| header.split(',').any(|cell| cell.trim() == "trajectory"))
    };
    // If the file cannot be read, the reader reports it.
    gaitfit::files::read_text(path, MAX_BYTES).is_ok_and(header)
}

/// The walks of such a file, each of `--seconds`.
fn played(args: &Run, path: &Path) -> Result<Script, Failure> {
    if path.is_file() && !is_playlist(path) {
        return Err(Failure::failed(format!(
            "{}: no column `trajectory`; `collect` takes a file of `gaitfit excite --policy`, with the columns \
             trajectory,time,vx_cmd,vy_cmd,wz_cmd. One walk, with the columns t,vx,vy,wz, is for `gaitfit run --commands`",
            path.display()
        )));
    }
    let sequences = playlist::read(path)?;
    // As long as the sequences of `gaitfit excite` are by default.
    let seconds = args.seconds.unwrap_or(4.0);
    check_length("--seconds", seconds)?;
    check_count(
        args,
        sequences.len(),
        seconds,
        &format!("{}: {} trajectories", path.display(), sequences.len()),
    )?;
    let walks = sequences.iter().map(|sequence| {
        // A step at the end or later would never act, and the row at the end stops the walk.
        let within = sequence.steps.iter().filter(|(time, _)| *time < seconds);
        let rows = within.map(|(time, command)| (*time, command.map(|part| part as f32)));
        rows.chain([(seconds, [0.0; 3])]).collect()
    });
    Script::of_walks(&walks.collect::<Vec<_>>(), args.link.pause()).map_err(Failure::usage)
}

fn check_length(option: &str, seconds: f64) -> Result<(), Failure> {
    if (1.0..=MAX_WALK_SECONDS).contains(&seconds) {
        return Ok(());
    }
    Err(Failure::usage(format!("{option}: {seconds} s; give 1 to {MAX_WALK_SECONDS}")))
}

/// Refuses walks that take longer than an hour; `named`: how many there are, and where that is said.
fn check_count(args: &Run, count: usize, seconds: f64, named: &str) -> Result<(), Failure> {
    let pause = args.link.pause();
    if !(0.5..=60.0).contains(&pause) {
        return Err(Failure::usage(format!("--pause: {pause} s; give 0.5 to 60")));
    }
    // N walks have N − 1 pauses: N · seconds + (N − 1) · pause must be at most the limit.
    let max = ((MAX_WALK_SECONDS + pause) / (seconds + pause)).floor();
    if count as f64 > max {
        return Err(Failure::usage(format!(
            "{named} of {seconds} s ({}) with pauses of {pause} s (--pause) take longer than an hour; give at most {max}",
            if args.of_collect || args.trajectories.is_none() { "--seconds" } else { "--random" }
        )));
    }
    Ok(())
}

/// Drift trials.
fn drift(args: &Run, repeats: usize, policy: &Policy, task: &TaskSettings) -> Result<Who, Failure> {
    let [x, y, yaw] = match args.drift_speeds[..] {
        [] => SPEEDS,
        [x, y, yaw] => [x, y, yaw],
        _ => return Err(Failure::usage("--drift-speeds: give three numbers, X,Y,YAW")),
    };
    let trials = trials(repeats, [x, y, yaw]).map_err(|error| Failure::usage(format!("--drift: {error}")))?;
    // Trials go in both directions, so both ends of a range must hold the speed.
    let extremes = [x, y, yaw].map(|speed| [-f64::from(speed), f64::from(speed)]);
    let remedy = "give slower --drift-speeds, or try it with --robot simulated and take --beyond-training";
    check_ranges(args, policy, task, extremes, "--drift-speeds", remedy)?;
    Ok(Who::Trials(trials))
}

/// Max commands from a remote or keyboard: the largest of the policy's training; small ones if the training is not known.
fn ranges(policy: &Policy, task: &TaskSettings) -> Ranges {
    if policy.provenance.task.is_empty() {
        note(
            "the policy's training is unknown: commands go up to 0.5 m/s ahead, 0.3 m/s aside and 0.5 rad/s",
        );
        // A policy of an unknown training may fall under larger commands.
        return [[-0.5, 0.5], [-0.3, 0.3], [-0.5, 0.5]];
    }
    task.command.ranges(1.0).map(|range| range.map(|end| end as f32))
}

/// The policy's task.
fn task(args: &Run, policy: &Policy) -> Result<TaskSettings, Failure> {
    // Only the task is taken from this; nothing is simulated.
    let world = WorldSettings {
        policy: args.policy.clone(),
        robot: None,
        lenient: false,
        task: None,
        theta: None,
        spring: Vec::new(),
        torque_noise: 0.0,
        randomised: false,
        preset: gaitfit_physics::Preset::Fast,
        seed: args.seed,
        threads: None,
    };
    Ok(gaitfit::world::task(&world, policy)?)
}

/// Random commands, drawn from the task.
fn random(args: &Run, policy: &Policy, task: &TaskSettings) -> Result<Script, Failure> {
    let seconds = args.random.unwrap_or_default();
    check_length(if args.of_collect { "--seconds" } else { "--random" }, seconds)?;
    let dt = policy.interface.control_dt;
    let walk = |seed: u64| gaitfit_learn::task::commands(&task.command, dt, seed, seconds);
    let script = match args.trajectories {
        Some(count) => {
            check_count(args, count.get(), seconds, &format!("--trajectories: {count}"))?;
            // The seeds follow each other, so a longer list of walks begins with the same ones.
            let walks: Vec<_> = (0..count.get() as u64).map(|k| walk(args.seed.wrapping_add(k))).collect();
            Script::of_walks(&walks, args.link.pause())
        }
        None => Script::new(walk(args.seed)),
    };
    script.map_err(Failure::usage)
}
