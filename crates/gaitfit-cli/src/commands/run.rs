//! `gaitfit run`: a policy on a robot.

use super::walks::Who;
use super::{folder, trial, walks};
use crate::cli::{PATIENCE, RobotKind, Run};
use crate::exit::{Exit, Failure};
use crate::keyboard::{self, Keyboard};
use crate::output::{self, note};
use crate::signals;
use gaitfit::policy_file::{self, PolicyFile};
use gaitfit::run::Owned;
use gaitfit_model::argument;
use gaitfit_policy::Policy;
use gaitfit_robot::guard::{GuardSettings, Reason};
use gaitfit_robot::link::{Link, Simulated, simulation};
use gaitfit_robot::run::{
    ByRemote, Controller, Live, RUN, Recorder, Sender, Summary, Trials, WHOLE, live, real_time, suits,
};
use gaitfit_robot::{Phase, Robot, RobotError, RobotState, Supervisor, Times};
use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The word that a person types to arm a robot.
const WORD: &str = "walk";
/// Folder of a dry run's logs within the one for logs: no fit reads them, and the walk itself may go beside.
const DRY: &str = "dry-run";

/// Stands the robot up, walks, lies it down.
pub fn run(args: &Run) -> Result<(), Failure> {
    // Domain 0 is that of real robots, so another domain has a simulator.
    let simulator = args.robot == RobotKind::Simulated || args.link.domain != 0;
    check(args, simulator)?;
    // Before anything moves: a signal must stop the robot first, and then the program.
    signals::listen()?;
    let PolicyFile { path, note: chosen } = policy_file::find(&args.policy)?;
    // A run folder has several policies; the person must see which one will walk.
    chosen.iter().for_each(|chosen| note(chosen));
    let policy = gaitfit_policy_files::read(&path).map_err(Failure::failed)?;
    let robot = args.robot.robot().map_err(usage)?;
    suits(&policy, &robot).map_err(|error| Failure::usage(format!("{}: {error}", args.policy.display())))?;
    if args.remote && !robot.messages.has_remote() {
        return Err(Failure::usage(
            "--remote: the messages of this robot (`messages` in its file) have no remote; use --keyboard or --commands",
        ));
    }
    let who = walks::who(args, &policy)?;
    if args.link.pause.is_some() && who.logs().is_none() {
        return Err(Failure::usage("--pause: there is only one walk; leave --pause out"));
    }
    let stand = args.link.stand(&robot).map_err(Failure::usage)?;
    let control = Duration::from_secs_f64(policy.interface.control_dt);
    // Refused now if the policy is for other joints, before anybody is asked for the word.
    let postures = robot.postures(&policy.interface).map_err(usage)?;
    let guard = guard(args, &robot, control, simulator);
    // Copied, because the guard moves into the supervisor.
    let limits = guard.limits;
    let out = logs_of(args);
    // Until the summary is written: two walks into one folder would destroy each other's logs.
    let _owned = new_folder(&out)?;
    let controller = controller(args, &robot, &policy, &who, &out).map_err(usage)?;
    // The link's threads inherit it.
    let real_time = real_time();
    // Declared outside of the `match`: the link borrows it and lives longer than the branch.
    let batch;
    let link: Box<dyn Link + Send + '_> = match (&args.robot, &args.link.interface) {
        (RobotKind::Linked(_), Some(interface)) => over_dds(args, &robot, interface)?,
        (RobotKind::Linked(_), None) => {
            return Err(Failure::usage("--interface: name the network interface"));
        }
        (RobotKind::Simulated, _) => {
            let model = gaitfit_model::builtin::go2().map_err(Failure::failed)?;
            batch = simulation(&model).map_err(Failure::failed)?;
            Box::new(Simulated::new(&batch, &robot).map_err(Failure::failed)?)
        }
    };
    let sender = Sender::new(
        link,
        Supervisor::new(guard, postures, Times { settle: stand, ..Times::default() }),
        args.link.dry_run,
    );
    // Dropped when the run is over, whatever ends it: the terminal is then as it was.
    let mut keys = None;
    let summary = live(
        sender,
        controller,
        Live {
            confirm: &mut |state| {
                signals::confirm(confirm(args, &robot, &who, stand, state)) && prepared(args, &who, &mut keys)
            },
            phase: &mut |phase: Phase| {
                note(phase.name());
                if phase == Phase::Stand && robot.hangs {
                    note(&format!(
                        "lower the robot until it stands on its feet; the policy acts in {} s",
                        stand.as_secs_f64()
                    ));
                }
            },
            stop: &|| signals::asked().or_else(keyboard::stopped),
            control,
            real_time,
            limits,
        },
    );
    drop(keys);
    finish(args, &who, summary)
}

/// The limits of a guard that waits for states and outputs as long as `--patience` says.
fn guard(args: &Run, robot: &Robot, control: Duration, simulator: bool) -> GuardSettings {
    let patience = Duration::from_millis(args.link.patience.into());
    let guard = GuardSettings { stale: patience, late: patience, simulator, ..robot.guard(control) };
    // Never below the robot's own limit: patience is for machines that are slower than a robot's.
    let late_policy = guard.late_policy.max(2 * control + patience);
    GuardSettings { late_policy, ..guard }
}

/// The policy under the commands asked for, whose logs go to `out`.
fn controller<'a>(
    args: &'a Run,
    robot: &Robot,
    policy: &'a Policy,
    who: &'a Who,
    out: &Path,
) -> Result<Controller<'a>, RobotError> {
    let recorder = match who.logs() {
        Some(count) => Recorder::of_walks(out, count, &policy.interface, robot),
        None => Recorder::new(out, &policy.interface, robot),
    }?;
    let recorder = if args.link.dry_run { recorder.dry() } else { recorder };
    match who {
        Who::Script(script) => Controller::new(robot, policy, script, recorder),
        Who::Remote(ranges) => Controller::new(robot, policy, ByRemote(*ranges), recorder),
        Who::Keys(steering) => Controller::new(robot, policy, steering.clone(), recorder),
        Who::Trials(trials) => {
            Controller::new(robot, policy, Trials::new(trials, trial::next(args, trials)), recorder)
        }
    }
}

/// Prepares what an armed walk needs: the form of drift trials, or the keyboard. `false` if that failed.
fn prepared(args: &Run, who: &Who, keys: &mut Option<Keyboard>) -> bool {
    let prepared = match who {
        // In a dry run nothing moves, so there is no drift for a form.
        Who::Trials(trials) if !args.link.dry_run => trial::write_form(args, trials),
        Who::Keys(steering) => Keyboard::listen(steering.clone()).map(|keyboard| *keys = Some(keyboard)),
        _ => Ok(()),
    };
    prepared.map_err(|failure| note(&failure.message)).is_ok()
}

/// Refuses options that do not go together.
fn check(args: &Run, simulator: bool) -> Result<(), Failure> {
    if args.robot == RobotKind::Simulated && (args.link.interface.is_some() || args.link.domain != 0) {
        return Err(Failure::usage(
            "--interface, --domain: for a robot such as --robot unitree-go2; the simulated robot is in this program",
        ));
    }
    if matches!(args.robot, RobotKind::Linked(_)) && args.link.interface.is_none() {
        return Err(Failure::usage("--interface: name the network interface to the robot, for example eth0"));
    }
    if args.link.yes && !simulator {
        return Err(Failure::usage(
            "--yes: for simulators only, which are in another domain than 0 (--domain)",
        ));
    }
    if args.link.patience != PATIENCE && !simulator {
        return Err(Failure::usage("--patience: for simulators only; a robot has 20 ms"));
    }
    if !args.link.yes && !args.link.dry_run && !std::io::stdin().is_terminal() {
        return Err(Failure::usage(
            "a person must type a word before the robot moves, and standard input is no terminal; with a simulator, in \
             another domain than 0, use --yes",
        ));
    }
    if args.keyboard && !std::io::stdin().is_terminal() {
        return Err(Failure::usage("--keyboard: standard input is no terminal, so no key can be read"));
    }
    Ok(())
}

/// The link to a robot.
#[cfg(feature = "dds")]
fn over_dds(args: &Run, robot: &Robot, interface: &str) -> Result<Box<dyn Link + Send>, Failure> {
    note(&format!("listening to a {} on {interface}, domain {}", robot.title, args.link.domain));
    if !args.link.dry_run && robot.messages.has_motion_service() {
        super::motion::released(interface, args.link.domain, args.link.yes, robot.hangs)?;
    }
    let link = gaitfit_robot::link::Dds::open(robot, interface, args.link.domain, args.link.dry_run)
        .map_err(usage)?
        .with_patience(Duration::from_millis(args.link.patience.into()));
    Ok(Box::new(link))
}

/// Refuses a link that there cannot be, without opening it.
#[cfg(feature = "dds")]
pub fn check_link(interface: &str, domain: u16) -> Result<(), Failure> {
    gaitfit_robot::link::Dds::check(interface, domain).map(|_| ()).map_err(usage)
}

#[cfg(not(feature = "dds"))]
fn over_dds(_: &Run, _: &Robot, interface: &str) -> Result<Box<dyn Link + Send>, Failure> {
    Err(without_dds(interface))
}

/// There is none.
#[cfg(not(feature = "dds"))]
pub fn check_link(interface: &str, _: u16) -> Result<(), Failure> {
    Err(without_dds(interface))
}

/// Says how to get one.
#[cfg(not(feature = "dds"))]
pub fn without_dds(interface: &str) -> Failure {
    Failure {
        exit: Exit::Missing,
        message: format!(
            "--interface {interface}: this program was built without DDS; build it with `cargo build --release --features \
             dds`, or rehearse with --robot simulated"
        ),
    }
}

/// Errors of what was asked for, and those of the machine.
pub fn usage(error: RobotError) -> Failure {
    match error {
        RobotError::Write { .. } | RobotError::Dds { .. } => Failure::failed(error),
        _ => Failure::usage(error),
    }
}

/// The folder of the logs.
fn logs_of(args: &Run) -> PathBuf {
    if args.link.dry_run { args.out.join(DRY) } else { args.out.clone() }
}

/// A folder without a run in it, which no other process writes into.
fn new_folder(path: &Path) -> Result<Owned, Failure> {
    folder(path, "the logs go")?;
    if path.is_dir() && !Owned::was_taken(path) {
        // A folder that is refused gets no lock.
        without_run(path)?;
    }
    let owned = Owned::for_logs(path)?;
    without_run(path)?;
    Ok(owned)
}

/// Refuses a folder that holds a run.
fn without_run(path: &Path) -> Result<(), Failure> {
    let logs = gaitfit_log::csv_files(path).map_err(Failure::failed)?;
    if !logs.is_empty() || path.join(RUN).join(WHOLE).exists() {
        return Err(Failure::usage(format!(
            "{}: holds a run already; name another folder, so that no log is lost",
            path.display()
        )));
    }
    Ok(())
}

/// Shows the robot's state and asks for the word. `stand`: how long the robot stands before the policy acts.
fn confirm(args: &Run, robot: &Robot, who: &Who, stand: Duration, state: &RobotState) -> bool {
    // One motor that is too hot stops the walk, so the hottest one counts.
    let hottest = state.temperature.iter().enumerate().max_by_key(|(_, degrees)| **degrees);
    let (motor, degrees) = hottest.map_or((0, 0), |(motor, degrees)| (motor, *degrees));
    let name = robot.motors.get(motor).map_or("none", |motor| &motor.joint);
    let hottest = match robot.messages.has_temperatures() {
        true => format!("hottest motor {name} at {degrees} °C"),
        false => "temperatures not reported".to_owned(),
    };
    let battery = state.battery.map_or("not reported".to_owned(), |battery| format!("{} %", battery.charge));
    note(&format!("connected to the robot: battery {battery}, {hottest}"));
    // Nothing moves, so nobody need agree.
    if args.link.dry_run {
        note("a dry run: nothing is sent");
        return true;
    }
    if args.link.yes {
        return true;
    }
    if robot.hangs {
        note(&format!(
            "A {} must hang: the program cannot lay it down, and nothing else holds it before and after the walk. When it has \
             taken its default pose, you have {} s to lower it until it stands on its feet (--stand). Lift it again before the walk ends.",
            robot.title,
            stand.as_secs_f64()
        ));
    }
    let (first, last) = match robot.hangs {
        true => ("take its default pose", "move its joints to 0 and go limp"),
        false => ("stand up", "lie down"),
    };
    note(&format!(
        "It will {first}, {}; then stop and {last}. Clear the ground, hold the robot's own switch ready. {}: the motors go \
         limp and it sinks.\nType `{WORD}` and Enter to begin; anything else ends.",
        who.length(),
        stopped_by(robot)
    ));
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line).is_ok() && line.trim() == WORD
}

/// What stops a robot at once, for the person beside it.
pub fn stopped_by(robot: &Robot) -> &'static str {
    match robot.messages.has_remote() {
        true => "Ctrl-C stops it, and so does B on its remote",
        false => "Ctrl-C stops it (its remote does not)",
    }
}

/// Prints and saves what the run was; the reason of a stop is the last thing said.
fn finish(args: &Run, who: &Who, summary: Result<Summary, RobotError>) -> Result<(), Failure> {
    let summary = summary.map_err(|error| Failure {
        exit: if matches!(error, RobotError::NotArmed(Reason::Signal | Reason::Named(_))) {
            Exit::Interrupted
        } else {
            Exit::Failed
        },
        message: error.to_string(),
    })?;
    // First tell the person, then write files: a full disk or a missing folder may keep them from being written.
    let printed = match args.json {
        true => output::print_json(&summary),
        false if summary.armed => output::print(&shown(args, &summary)),
        false => Ok(()),
    };
    if !summary.armed {
        // A signal before the word is an interruption. Any other text than the word is a refusal.
        return match signals::asked() {
            Some(_) => {
                Err(Failure { exit: Exit::Interrupted, message: "interrupted; nothing was sent".to_owned() })
            }
            None => Err(Failure { exit: Exit::Check, message: "not armed; nothing was sent".to_owned() }),
        };
    }
    let kept = printed.and_then(|()| save(args, who, &summary));
    if let (Who::Trials(_), false) = (who, args.link.dry_run) {
        let form = trial::form_path(args);
        note(&format!("fill in {}, then: gaitfit drift {}", form.display(), argument(&form)));
    }
    // Without a reason the walk came to its end.
    let Some(reason) = &summary.reason else {
        kept?;
        return match args.json || args.link.dry_run {
            true => Ok(()),
            false => output::next(&[format!(
                "gaitfit new --policy {} --logs {} --out my-robot.toml",
                argument(&args.policy),
                argument(&args.out)
            )]),
        };
    };
    // The reason of the stop matters more than a file that could not be written.
    if let Err(problem) = kept {
        note(&problem.message);
    }
    // Ctrl-C arrives as a key while the keyboard steers, and as a signal otherwise.
    let interrupted = signals::asked().is_some() || keyboard::stopped() == Some(Reason::Signal);
    let exit = if interrupted { Exit::Interrupted } else { Exit::Failed };
    Err(Failure { exit, message: format!("damped: {reason}") })
}

/// Writes the summary beside the logs.
fn save(args: &Run, who: &Who, summary: &Summary) -> Result<(), Failure> {
    let text = serde_json::to_vec_pretty(summary)
        .map_err(|error| Failure::failed(format!("cannot write the summary: {error}")))?;
    let out = logs_of(args);
    // With several walks, the files about the whole run have a folder of their own.
    let folder = if who.logs().is_some() { out.join(RUN) } else { out };
    Ok(gaitfit::files::write(&folder.join("summary.json"), &text)?)
}

fn shown(args: &Run, summary: &Summary) -> String {
    let late = |lateness: &gaitfit_robot::run::Lateness| {
        format!("{} / {} / {} µs", lateness.p50, lateness.p99, lateness.max)
    };
    // Only torques that are reported for long enough show it.
    let delay = summary
        .delay
        .map_or("not measured: the walk is short, or no torques are reported".to_owned(), |delay| {
            format!("{} ms, {:.0} % of the torque unexplained", delay.ms, 100.0 * delay.residual)
        });
    let rows = [
        (
            "states received",
            format!(
                "{} at {:.0} Hz, longest gap {:.1} ms",
                summary.states, summary.state_hz, summary.longest_gap_ms
            ),
        ),
        (
            "commands sent",
            summary.clamped.map_or("none: a dry run".to_owned(), |clamped| {
                format!("{}, {clamped} while walking changed by the guard", summary.commands)
            }),
        ),
        (
            "policy outputs",
            format!(
                "{}, on states {:.1} ms old, {:.1} at most",
                summary.outputs, summary.state_age_ms, summary.oldest_state_ms
            ),
        ),
        ("send loop late, p50 / p99 / max", late(&summary.send_late_us)),
        ("policy loop late, p50 / p99 / max", late(&summary.control_late_us)),
        (
            "real-time priority",
            if summary.real_time { "yes" } else { "no: the system did not give it" }.to_owned(),
        ),
        ("command to torque", delay),
        ("logs", logs_of(args).display().to_string()),
    ];
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    rows.iter().map(|(name, value)| format!("{name:width$}  {value}\n")).collect()
}
