//! `gaitfit preflight`: the first contact with a robot that hangs, by checklist.

mod files;
mod shown;

use crate::cli::{PATIENCE, Preflight, RobotKind};
use crate::exit::{Exit, Failure};
use crate::output::{self, note};
use crate::signals;
use gaitfit::run::Owned;
use gaitfit_model::{Model, ReadOptions};
use gaitfit_robot::guard::{GuardSettings, Reason};
use gaitfit_robot::link::{Link, Simulated, hanging_go2, simulation};
use gaitfit_robot::preflight::{
    Asked, Beat, Finding, Flight, Flown, Heard, Listened, Moved, Plan, Severity, Stage, TiltReport, fly,
    listen, moved, passed, sampled, tilt, tilted,
};
use gaitfit_robot::run::real_time;
use gaitfit_robot::{Robot, RobotError};
use gaitfit_sim::Batch;
use serde::Serialize;
use std::io::{BufRead, IsTerminal};
use std::path::Path;
use std::time::Duration;

/// The word that a person types before the robot moves.
const WORD: &str = "move";
/// Time between two commands.
const CONTROL: Duration = Duration::from_millis(2);
/// Shortest and longest time of listening, s.
const SECONDS: [f64; 2] = [1.0, 600.0];

/// The result, as `preflight.json` and `--json` have it.
#[derive(Serialize)]
pub struct Document {
    /// The robot's name.
    robot: String,
    /// Whether it is a simulator.
    simulator: bool,
    /// Whether no finding is a fault.
    passed: bool,
    /// Faults first.
    findings: Vec<Finding>,
    listened: Listened,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    tilted: Vec<TiltReport>,
    /// Roll, pitch and yaw of the inertial unit in the base's frame, degrees, if it is mounted turned.
    mounting: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    moved: Option<Moved>,
    /// Files in the folder.
    written: Vec<String>,
}

/// The purpose of a link.
#[derive(Clone, Copy, PartialEq, Eq)]
enum For {
    Listening,
    Moving,
}

/// Listens to the robot, follows a person who tilts it, and moves it. Prints and saves the result.
pub fn run(args: &Preflight) -> Result<(), Failure> {
    check(args)?;
    signals::listen()?;
    let robot = args.robot.robot().map_err(super::run::usage)?;
    let model = description(args, &robot)?;
    let simulator = is_simulator(args);
    super::folder(&args.out, "the result goes")?;
    // Taken before the look for an earlier result, which another process may be writing.
    let _owned = Owned::for_logs(&args.out)?;
    if args.out.join(files::RESULT).exists() {
        return Err(Failure::usage(format!(
            "{}: holds a preflight already; name another folder, so that no log is lost",
            args.out.display()
        )));
    }
    // Before the link: its threads inherit the priority.
    real_time();
    // Made for every robot, because the link of a simulated one borrows it.
    let hung = hanging_go2().map_err(Failure::failed)?;
    let batch = simulation(&hung).map_err(Failure::failed)?;
    let stop = || signals::asked();
    let mut link = open(args, &robot, &batch, For::Listening)?;
    note(&format!("listening for {} s; nothing is sent. Let the robot hang still", args.seconds));
    let length = Duration::from_secs_f64(args.seconds);
    let (heard, others) = listen(&mut *link, &mut Beat::default(), length, &stop).map_err(failed)?;
    let (listened, mut findings) = Listened::new(&heard, others, &robot, simulator);
    let mut mounting = listened.imu.as_ref().and_then(|unit| unit.mounting);
    let mut reports = Vec::new();
    // A robot that was not heard cannot show how it is turned.
    if args.tilt && !heard.is_empty() {
        let turns = tilt(&mut *link, &mut Beat::default(), &mut ask, &stop).map_err(failed)?;
        let bias = listened.imu.as_ref().map_or([0.0; 3], |unit| unit.gyro_bias.map(|axis| axis.value));
        let (axes, mounted, more) = tilted(&turns, bias);
        reports = axes;
        // Turns show all three axes, gravity two.
        if reports.len() == 3 {
            mounting = mounted;
        }
        findings.extend(more);
    }
    // The link for listening must be closed: moving opens one that sends.
    drop(link);
    let mut flown = None;
    if args.moves {
        flown = motion(args, &robot, &batch, &heard, &findings)?;
    }
    let rows = flown.as_ref().map(sampled);
    let result =
        flown.as_ref().zip(rows.as_ref()).map(|(flown, rows)| moved(flown, rows, &robot, model.as_ref()));
    let moved = result.map(|(moved, more)| {
        findings.extend(more);
        moved
    });
    // Faults are first in the order of severities.
    findings.sort_by_key(|finding| finding.severity);
    let mut document = Document {
        robot: robot.name.clone(),
        simulator,
        passed: passed(&findings),
        findings,
        listened,
        tilted: reports,
        mounting,
        moved,
        written: Vec::new(),
    };
    let flight = flown.as_ref().zip(rows.as_ref());
    // Saved before anything is printed or the exit code is set: the logs of a robot are precious.
    files::write(args, &robot, &heard, flight, &mut document)?;
    match args.json {
        true => output::print_json(&document)?,
        false => output::print(&shown::text(args, &document))?,
    }
    if !document.passed {
        let faults = document.findings.iter().filter(|one| one.severity == Severity::Fault).count();
        return Err(Failure {
            exit: Exit::Check,
            message: format!("{faults} checks failed: repair these faults before the robot walks"),
        });
    }
    Ok(())
}

/// Refuses options that contradict each other, before anything is opened.
fn check(args: &Preflight) -> Result<(), Failure> {
    let simulated = args.robot == RobotKind::Simulated;
    if simulated && (args.interface.is_some() || args.domain != 0) {
        return Err(Failure::usage(
            "--interface, --domain: for a robot such as --robot unitree-go2; the simulated robot is in this program",
        ));
    }
    if !simulated && args.interface.is_none() {
        return Err(Failure::usage("--interface: name the network interface to the robot, for example eth0"));
    }
    if simulated && args.tilt {
        return Err(Failure::usage("--tilt: nobody can tilt the simulated robot; leave it out"));
    }
    if !(SECONDS[0]..=SECONDS[1]).contains(&args.seconds) {
        return Err(Failure::usage(format!(
            "--seconds {}: give {} to {}",
            args.seconds, SECONDS[0], SECONDS[1]
        )));
    }
    // Domain 0 is that of real robots.
    if (args.yes || args.patience != PATIENCE) && !is_simulator(args) {
        return Err(Failure::usage(
            "--yes, --patience: for simulators only, which are in another domain than 0 (--domain)",
        ));
    }
    // Nobody types a word into a pipe, and a robot must not move on the content of a file.
    let asks = args.tilt || args.moves && !args.yes;
    if asks && !std::io::stdin().is_terminal() {
        return Err(Failure::usage(
            "--tilt, --move: a person must be there, and standard input is no terminal; with a simulator, in another domain \
             than 0, use --move --yes",
        ));
    }
    Ok(())
}

fn is_simulator(args: &Preflight) -> bool {
    args.robot == RobotKind::Simulated || args.domain != 0
}

fn failed(error: RobotError) -> Failure {
    match error {
        RobotError::NotArmed(Reason::Signal | Reason::Named(_)) => {
            Failure { exit: Exit::Interrupted, message: error.to_string() }
        }
        _ => Failure::failed(error),
    }
}

/// The robot's description; that of a Go2 is built in.
fn description(args: &Preflight, robot: &Robot) -> Result<Option<Model>, Failure> {
    // Without a description the checks that need masses are left out.
    let path = match &args.model {
        Some(path) => path.as_path(),
        None if robot.name == "go2" => Path::new(gaitfit::robot::GO2),
        None => return Ok(None),
    };
    let model = if path == Path::new(gaitfit::robot::GO2) {
        gaitfit_model::builtin::go2().map_err(Failure::failed)?
    } else {
        // Leniently: only joints and masses count here, not what the engine can simulate.
        gaitfit_model::read(path, &ReadOptions { lenient: true, ..ReadOptions::default() })
            .map_err(Failure::failed)?
    };
    if let Some(motor) = robot.motors.iter().find(|motor| model.slides(&motor.joint)) {
        return Err(Failure::usage(format!(
            "--model {}: joint `{}` is a slide. Preflight moves only hinges, so it cannot check this robot",
            path.display(),
            motor.joint.escape_debug()
        )));
    }
    match robot.motors.iter().find(|motor| model.find_joint(&motor.joint).is_none()) {
        Some(motor) => Err(Failure::usage(format!(
            "--model {}: has no joint `{}` of the {}; joints are matched by name",
            path.display(),
            motor.joint.escape_debug(),
            robot.title
        ))),
        None => Ok(Some(model)),
    }
}

/// Tells the person what to do.
fn ask(asked: Asked) {
    match asked {
        Asked::Level => note("hold the robot level and still"),
        Asked::Turn(motion) => note(&format!("now {}, by 20° to 40°, and hold it", motion.words())),
        Asked::Done => note("all turns were seen; let it hang"),
        Asked::TooLate(_) => {}
    }
}

fn open<'b>(
    args: &Preflight,
    robot: &Robot,
    batch: &'b Batch,
    what: For,
) -> Result<Box<dyn Link + Send + 'b>, Failure> {
    match &args.interface {
        Some(interface) => over_dds(args, robot, interface, what),
        None => Ok(Box::new(Simulated::new(batch, robot).map_err(Failure::failed)?)),
    }
}

#[cfg(feature = "dds")]
fn over_dds<'b>(
    args: &Preflight,
    robot: &Robot,
    interface: &str,
    what: For,
) -> Result<Box<dyn Link + Send + 'b>, Failure> {
    note(&format!("a {} on {interface}, domain {}", robot.title, args.domain));
    let link = gaitfit_robot::link::Dds::open(robot, interface, args.domain, what == For::Listening)
        .map_err(super::run::usage)?
        .with_patience(Duration::from_millis(args.patience.into()));
    Ok(Box::new(link))
}

#[cfg(not(feature = "dds"))]
fn over_dds<'b>(
    _: &Preflight,
    _: &Robot,
    interface: &str,
    _: For,
) -> Result<Box<dyn Link + Send + 'b>, Failure> {
    Err(super::run::without_dds(interface))
}

/// The small motions, after a person agreed; `None` if the robot is not moved.
fn motion(
    args: &Preflight,
    robot: &Robot,
    batch: &Batch,
    heard: &[Heard],
    findings: &[Finding],
) -> Result<Option<Flown>, Failure> {
    // With a wrong sign or encoder a small motion can become a fast one.
    if !passed(findings) {
        note("the robot is not moved: the checks before found faults. Repair these first");
        return Ok(None);
    }
    let Some(last) = heard.last() else { return Ok(None) };
    // From where the joints are now, so that the first target is no jump.
    let plan = Plan::new(robot, last.state.q);
    #[cfg(feature = "dds")]
    if let Some(interface) = &args.interface
        && robot.messages.has_motion_service()
    {
        super::motion::released(interface, args.domain, args.yes, robot.hangs)?;
    }
    if !signals::confirm(args.yes || agreed(robot, &plan)) {
        note("the robot is not moved");
        return Ok(None);
    }
    let mut link = open(args, robot, batch, For::Moving)?;
    // One number for both: a busy machine delays the states and the loop alike.
    let patience = Duration::from_millis(args.patience.into());
    let guard = GuardSettings {
        stale: patience,
        late: patience,
        simulator: is_simulator(args),
        ..robot.guard(CONTROL)
    };
    let mut announce = |stage: Stage| note(&stage_text(robot, stage));
    let flown =
        fly(&mut *link, &mut Beat::default(), Flight::new(robot, guard), &mut announce, &signals::asked);
    match flown {
        Ok(flown) => Ok(Some(flown)),
        Err(error) => Err(failed(error)),
    }
}

fn agreed(robot: &Robot, plan: &Plan) -> bool {
    note(&format!(
        "The {} must hang with its feet off the ground and nobody near it. For {:.0} s its legs go slowly to their pose in the air, \
         each joint moves alone by 0.1 rad, then all together, then back. Watch that the joint that is named moves. {}: \
         the motors go limp.\nType `{WORD}` and Enter to begin; anything else ends.",
        robot.title,
        plan.seconds(),
        super::run::stopped_by(robot)
    ));
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line).is_ok() && line.trim() == WORD
}

/// The robot's actions in this stage, for the person beside it.
fn stage_text(robot: &Robot, stage: Stage) -> String {
    match stage {
        Stage::Joint(motor) => {
            format!("{} moves alone", robot.motors.get(motor).map_or("?", |motor| &motor.joint))
        }
        Stage::Idle => "idle".to_owned(),
        Stage::Soften => "gains grow; nothing should move".to_owned(),
        Stage::Approach => "slowly to the pose in the air".to_owned(),
        Stage::Hold => "holds this pose".to_owned(),
        Stage::Excite => "all joints move together".to_owned(),
        Stage::Return => "slowly back".to_owned(),
        Stage::Damping => "damping".to_owned(),
    }
}
