//! Every built-in robot against the vendor's simulator server in another process, its bridge unchanged, over DDS on the
//! loopback interface (`tools/link_server.py`): the robot hangs, and a policy swings the joints that it must move.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use gaitfit_log::{ReadOptions, read_csv};
use gaitfit_policy::{Interface, Policy};
use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::link::Dds;
use gaitfit_robot::preflight::{Beat, Finding, Flight, Listened, Moved, fly, listen, moved, passed, sampled};
use gaitfit_robot::robot::{BUILT_IN, Motor};
use gaitfit_robot::run::{Controller, Live, Recorder, Script, Sender, Summary, WALK, live, real_time, suits};
use gaitfit_robot::{Phase, Robot, Supervisor, Times};

use crate::dds::alone;
use crate::server::Server;
use crate::toy::{CONTROL, interface};

/// First of the domains that these tests use.
const DOMAIN: u16 = 51;
/// How far the policy swings a joint, rad.
const SWING: f64 = 0.1;
/// How fast the policy rolls a wheel, rad/s.
const ROLL: f64 = 4.0;

/// A policy that rolls the wheels. It swings all other joints that must be moved, at 1 Hz.
fn swing(robot: &Robot) -> Policy {
    let is_moved = |motor: &Motor| motor.held.is_none() || motor.is_wheel();
    let moved: Vec<usize> = (0..robot.motors.len()).filter(|&k| is_moved(&robot.motors[k])).collect();
    let scale = |&k: &usize| if robot.motors[k].is_wheel() { ROLL } else { SWING };
    let interface = Interface { action_scale: moved.iter().map(scale).collect(), ..interface(robot, &moved) };
    let step = AtomicU32::new(0);
    let rolls: Vec<bool> = robot.motors.iter().map(Motor::is_wheel).collect();
    let act = move |_: usize, _: &[f32], actions: &mut [f32]| {
        let time = 0.02 * step.fetch_add(1, Ordering::Relaxed) as f32;
        actions.fill((std::f32::consts::TAU * time).sin());
        for (action, &k) in actions.iter_mut().zip(&moved) {
            if rolls[k] {
                *action = 1.0;
            }
        }
        true
    };
    Policy::of_function(interface, Arc::new(act)).unwrap()
}

fn run_on(robot: &Robot, domain: u16, folder: &Path, seconds: f64, told: &mut dyn FnMut(Phase)) -> Summary {
    // The machine of a test is busy, and a simulator in Python is slow.
    let patience = Duration::from_millis(400);
    let guard = GuardSettings { stale: patience, late: patience, simulator: true, ..robot.guard(CONTROL) };
    let guard = GuardSettings { late_policy: patience, ..guard };
    run_guarded(robot, domain, folder, seconds, guard, Times::default(), told)
}

/// The policy that swings on a robot in this domain, under these rules.
pub fn run_guarded(
    robot: &Robot,
    domain: u16,
    folder: &Path,
    seconds: f64,
    guard: GuardSettings,
    times: Times,
    told: &mut dyn FnMut(Phase),
) -> Summary {
    let policy = swing(robot);
    suits(&policy, robot).unwrap();
    let script = Script::new(vec![(0.0, [0.0; 3]), (seconds, [0.0; 3])]).unwrap();
    let limits = guard.limits;
    let recorder = Recorder::new(folder, &policy.interface, robot).unwrap();
    let controller = Controller::new(robot, &policy, &script, recorder).unwrap();
    let real_time = real_time();
    let link = Box::new(Dds::open(robot, "lo", domain, false).unwrap().with_patience(guard.stale));
    let postures = robot.postures(&policy.interface).unwrap();
    let sender = Sender::new(link, Supervisor::new(guard, postures, times), false);
    let ask =
        Live { confirm: &mut |_| true, phase: told, stop: &|| None, control: CONTROL, real_time, limits };
    live(sender, controller, ask).unwrap()
}

fn server(name: &str, domain: u16) -> Option<Server> {
    let file = BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)?;
    let folder = std::env::temp_dir().join(format!("gaitfit-link-{}-{domain}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("robot.toml");
    std::fs::write(&path, file).unwrap();
    let started = Server::start_with(&[path.display().to_string()], domain, 60.0);
    std::fs::remove_dir_all(&folder).unwrap();
    started
}

#[test]
#[ignore = "needs ../shared with the vendor's simulator, and cyclonedds and mujoco in .venv"]
fn shared_each_robot_swings_its_joints_on_the_vendors_server() {
    let _alone = alone();
    for (number, (name, _)) in BUILT_IN.iter().enumerate() {
        let domain = DOMAIN + number as u16;
        let robot = Robot::built_in(name).unwrap();
        let Some(server) = server(name, domain) else { return };
        let folder = tempfile::tempdir().unwrap();
        let mut phases = Vec::new();
        let summary = run_on(&robot, domain, folder.path(), 3.0, &mut |phase| phases.push(phase));
        let felt = server.end();
        eprintln!("{name}: {} of {} commands taken, {felt}", felt["commands"], summary.commands);
        assert_eq!(summary.reason, None, "{name}");
        use Phase::{Damping, LieDown, Stand, StandUp, Stop, Walk};
        assert_eq!(phases, [StandUp, Stand, Walk, Stop, LieDown, Damping], "{name}");
        for (count, why) in
            [("wrong", "checksums"), ("machine", "kind of machine"), ("beyond", "slots without a motor")]
        {
            assert_eq!(felt[count], 0, "{name}: {why}");
        }
        let taken = felt["commands"].as_f64().unwrap();
        assert!(taken > 0.8 * summary.commands as f64, "{name}: {taken} of {}", summary.commands);
        let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
        assert_eq!(log.robot.as_deref(), Some(robot.name.as_str()));
        let joints = log.joints.len();
        assert!(log.len() > 130, "{name}: {}", log.len());
        let moved = &felt["moved"];
        assert_eq!(log.velocity_joints.len(), robot.motors.iter().filter(|motor| motor.is_wheel()).count());
        for (joint, named) in log.joints.iter().enumerate() {
            let motor = &robot.motors[robot.motors_of(&log.joints).unwrap()[joint]];
            let name = motor.joint.as_str();
            let angles: Vec<f64> = log.position.iter().skip(joint).step_by(joints).copied().collect();
            let way = angles.iter().fold(f64::MIN, |a, &b| a.max(b))
                - angles.iter().fold(f64::MAX, |a, &b| a.min(b));
            if motor.is_wheel() {
                // The policy rolls it for three seconds, and for the second in which the robot comes to rest.
                assert!(log.velocity_joints.contains(named), "{name}");
                assert!((0.8 * 3.0 * ROLL..1.2 * 3.0 * ROLL).contains(&way), "{name}: {way}");
                assert!(
                    (moved[name].as_f64().unwrap() - way).abs() < 1.5 * ROLL,
                    "{name}: {way} {}",
                    moved[name]
                );
                continue;
            }
            // Twice the swing, less what the motor lags, or more where it is weakly damped; the joint itself moved as far.
            assert!((0.8 * SWING..3.0 * SWING).contains(&way), "{name}: {way}");
            assert!(moved[name].as_f64().unwrap() > 0.9 * way, "{name}: {way} {}", moved[name]);
        }
        for motor in robot.motors.iter().filter(|motor| motor.held.is_some() && !motor.is_wheel()) {
            let way = moved[&motor.joint].as_f64().unwrap();
            assert!(way < 0.05, "{} is kept where it is: {way}", motor.joint);
        }
        assert!(felt["load"].as_f64().unwrap() <= 1.1, "{name}: {}", felt["load"]);
    }
}

/// Listens to the robot and moves it as `gaitfit preflight --move` does; the names of what is found at all, and its motions.
fn checked(robot: &Robot, domain: u16) -> (Vec<String>, Option<Moved>) {
    let stop = || None;
    let mut link = Dds::open(robot, "lo", domain, true).unwrap();
    let (heard, others) = listen(&mut link, &mut Beat::default(), Duration::from_secs(5), &stop).unwrap();
    let (_, mut findings) = Listened::new(&heard, others, robot, true);
    drop(link);
    let shown = |findings: &[Finding]| findings.iter().map(|one| format!("{one:?}")).collect::<Vec<_>>();
    if !passed(&findings) {
        return (shown(&findings), None);
    }
    let patience = Duration::from_millis(400);
    let guard = GuardSettings { stale: patience, late: patience, simulator: true, ..robot.guard(CONTROL) };
    let mut link = Dds::open(robot, "lo", domain, false).unwrap();
    let flight = Flight::new(robot, guard);
    let flown = fly(&mut link, &mut Beat::default(), flight, &mut |_| (), &stop).unwrap();
    let rows = sampled(&flown);
    let (motion, more) = moved(&flown, &rows, robot, None);
    findings.extend(more);
    (shown(&findings), Some(motion))
}

#[test]
#[ignore = "needs ../shared with the vendor's simulator, and cyclonedds and mujoco in .venv"]
fn shared_each_robot_is_checked_on_the_vendors_server() {
    let _alone = alone();
    real_time();
    for (number, (name, _)) in BUILT_IN.iter().enumerate() {
        let domain = DOMAIN + 20 + number as u16;
        let robot = Robot::built_in(name).unwrap();
        let Some(server) = server(name, domain) else { return };
        let (findings, motions) = checked(&robot, domain);
        let felt = server.end();
        for finding in &findings {
            eprintln!("{name}: {finding}");
        }
        let motions = motions.unwrap_or_else(|| panic!("{name} is not moved: {findings:?}"));
        eprintln!(
            "{name}: {} joints moved, {} commands, {} changed; delay {:?}; {felt}",
            motions.joints.len(),
            motions.commands,
            motions.changed,
            motions.delay
        );
        for one in &motions.joints {
            eprintln!("{name} {}: {:.2?} times the torque of its command", one.joint, one.torque_gain);
        }
        assert_eq!(motions.reason, None, "{name}");
        assert_eq!(felt["wrong"], 0, "{name}");
        // The server takes the gains as they are.
        assert!(!findings.iter().any(|finding| finding.contains("Gains")), "{name}: {findings:?}");
        let moving = robot.motors.iter().filter(|motor| motor.kp > 0.0).count();
        assert_eq!(motions.joints.len(), moving, "{name}");
        assert!(felt["load"].as_f64().unwrap() <= 1.1, "{name}: {}", felt["load"]);
    }
}

#[test]
#[ignore = "needs ../shared with the vendor's simulator, and cyclonedds and mujoco in .venv"]
fn shared_a_humanoids_server_that_is_killed_is_noticed() {
    let _alone = alone();
    let robot = Robot::built_in("unitree-g1").unwrap();
    let Some(server) = server("unitree-g1", DOMAIN + 10) else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut told = |phase| {
        if phase == Phase::Walk {
            server.signal("-KILL");
        }
    };
    let summary = run_on(&robot, DOMAIN + 10, folder.path(), 20.0, &mut told);
    assert!(summary.reason.as_ref().unwrap().contains("last state is"), "{:?}", summary.reason);
}
