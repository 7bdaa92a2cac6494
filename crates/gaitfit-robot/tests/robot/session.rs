//! Whole runs on a simulated Go2, without a clock: the committed walk stands up, walks, lies down, and is recorded.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use gaitfit_log::{ReadOptions, read_csv};
use gaitfit_policy::Policy;
use gaitfit_random::{Purpose, Stream};
use gaitfit_robot::guard::{GuardSettings, Reason};
use gaitfit_robot::link::{Link, Simulated, simulation};
use gaitfit_robot::run::{
    Board, ByRemote, Commands, Controller, Recorder, Script, Sender, WALK, WHOLE, suits,
};
use gaitfit_robot::unitree::Remote;
use gaitfit_robot::{Command, Phase, Reading, RobotState, Seal, Supervisor, Times};

use crate::limits::violation;
use crate::toy::{CONTROL, Toy, go2, postures};

const TICK: Duration = Duration::from_millis(2);

pub fn walk() -> Policy {
    gaitfit_policy_files::read(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2-walk.safetensors"),
    )
    .unwrap()
}

/// What a test sees of the robot behind its link.
#[derive(Clone, Default)]
struct Seen {
    place: Arc<Mutex<[f32; 3]>>,
    state: Arc<Mutex<Option<RobotState>>>,
    wrong: Arc<Mutex<Option<String>>>,
    commands: Arc<Mutex<Vec<Command>>>,
}

/// A robot whose messages a fault may change from some time on; every command is checked against its true state.
struct Watched<'a, F> {
    robot: Simulated<'a>,
    seen: Seen,
    fault: F,
}

impl<F: FnMut(Duration, &Reading) -> Option<Reading> + Send> Link for Watched<'_, F> {
    fn receive(&mut self, now: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        let (fault, seen) = (&mut self.fault, &self.seen);
        let others = self.robot.receive(now, &mut |age, reading| {
            *seen.state.lock().unwrap() = Some(reading.state);
            if let Some(reading) = fault(now, reading) {
                each(age, &reading);
            }
        })?;
        *self.seen.place.lock().unwrap() = self.robot.position();
        Ok(others)
    }

    fn send(&mut self, command: &Command) -> Result<(), String> {
        let state = self.seen.state.lock().unwrap().unwrap();
        if let Some(wrong) = violation(command, &state) {
            self.seen.wrong.lock().unwrap().get_or_insert(wrong);
        }
        self.seen.commands.lock().unwrap().push(*command);
        self.robot.send(command)
    }
}

/// A run to its end, or to `until`: the board, the sender's counts, and its lines.
struct Session {
    board: Board,
    phases: Vec<(Duration, Phase)>,
    seen: Seen,
    commands: u64,
    clamped: u64,
    delay: Option<u64>,
    places: Vec<[f32; 3]>,
}

fn session(
    policy: &Policy,
    rows: &[(f64, [f32; 3])],
    folder: &Path,
    dry: bool,
    until: Duration,
    fault: impl FnMut(Duration, &Reading) -> Option<Reading> + Send,
) -> Session {
    let script = Script::new(rows.to_vec()).unwrap();
    session_under(policy, &script, folder, dry, until, fault)
}

/// The same under any commands.
fn session_under(
    policy: &Policy,
    commands: impl Commands,
    folder: &Path,
    dry: bool,
    until: Duration,
    fault: impl FnMut(Duration, &Reading) -> Option<Reading> + Send,
) -> Session {
    let batch = simulation(&gaitfit_model::builtin::go2().unwrap()).unwrap();
    let seen = Seen::default();
    let link = Watched { robot: Simulated::new(&batch, &go2()).unwrap(), seen: seen.clone(), fault };
    let control = Duration::from_secs_f64(policy.interface.control_dt);
    let postures = go2().postures(&policy.interface).unwrap();
    let supervisor = Supervisor::new(GuardSettings::new(&go2(), control), postures, Times::default());
    let mut sender = Sender::new(Box::new(link), supervisor, dry);
    let recorder = Recorder::new(folder, &policy.interface, &go2()).unwrap();
    let mut controller = Controller::new(&go2(), policy, commands, recorder).unwrap();
    let mut board = Board::default();
    let (mut now, mut phases, mut places) = (Duration::ZERO, Vec::new(), Vec::new());
    while !board.over && now < until {
        now += TICK;
        board.arm = now == Duration::from_millis(300);
        sender.cycle(now, &mut board);
        if now.as_millis().is_multiple_of(control.as_millis()) {
            controller.cycle(now, &mut board).unwrap();
        }
        if phases.last().is_none_or(|(_, phase)| *phase != board.phase) {
            phases.push((now, board.phase));
            places.push(*seen.place.lock().unwrap());
        }
    }
    let delay = sender.trace.delay(&go2().limits()).map(|delay| delay.ms);
    Session { board, phases, seen, commands: sender.commands, clamped: sender.clamped, delay, places }
}

#[test]
fn the_committed_walk_stands_up_walks_and_lies_down_and_its_log_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let policy = walk();
    let rows = [(0.0, [0.5, 0.0, 0.0]), (3.0, [0.0, 0.0, 0.8]), (4.5, [0.0; 3]), (5.0, [0.0; 3])];
    let whole = session(&policy, &rows, folder.path(), false, Duration::from_secs(30), |_, r| Some(*r));
    use Phase::{Damping, Idle, LieDown, Stand, StandUp, Stop, Walk};
    let phases: Vec<Phase> = whole.phases.iter().map(|(_, phase)| *phase).collect();
    assert_eq!(phases, [Idle, StandUp, Stand, Walk, Stop, LieDown, Damping], "{:?}", whole.board.reason);
    assert_eq!((&whole.board.reason, &*whole.seen.wrong.lock().unwrap()), (&None, &None));
    let [stand, walk, lie] = [2, 3, 5].map(|k| whole.places[k]);
    // The gains of standing up, and the policy's softer ones.
    assert!(stand[2] > 0.265 && walk[2] > 0.245, "it stood: {stand:?} {walk:?}");
    let ahead = (lie[0] - walk[0]).hypot(lie[1] - walk[1]);
    assert!((1.35..1.7).contains(&ahead), "0.5 m/s for 3 s and a turn: {ahead}");
    let end = whole.seen.place.lock().unwrap()[2];
    assert!(end < 0.1, "it lies: {end}");
    assert!(whole.clamped * 70 < whole.commands, "{} of {}", whole.clamped, whole.commands);
    assert!(whole.delay.is_some_and(|ms| ms <= 2), "{:?}", whole.delay);

    let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
    assert_eq!(
        (log.joints.as_slice(), log.robot.as_deref()),
        (policy.interface.joints.as_slice(), Some("go2"))
    );
    assert_eq!((log.len(), log.rate_hz), (250, 50.0));
    assert_eq!(log.gains.as_ref().unwrap().kp, policy.interface.kp);
    let commands = log.command.as_ref().unwrap();
    assert_eq!(commands[..3], [0.5, 0.0, 0.0]);
    assert!((commands[3 * 200 + 2] - 0.8).abs() < 1e-6);
    // What the policy did is what it does again on what the log says.
    let interface = &policy.interface;
    let (actions, targets) = (log.action.as_ref().unwrap(), log.target.as_ref().unwrap());
    for (k, (target, action)) in targets.iter().zip(actions).enumerate() {
        let wanted = interface.default_pose[k % 12] + interface.action_scale[k % 12] * action;
        assert!((target - wanted).abs() < 1e-5);
    }
    let base = log.base.as_ref().unwrap();
    let (quaternions, rates) = (base.quaternion.as_ref().unwrap(), base.angular_velocity.as_ref().unwrap());
    let mut pilot = gaitfit_policy::Pilot::new(&policy).unwrap();
    let mut sensed = gaitfit_policy::observation::Sensed::new(12);
    for sample in 0..log.len() {
        sensed.orient(std::array::from_fn(|k| quaternions[4 * sample + k] as f32));
        sensed.base_angular_velocity = std::array::from_fn(|k| rates[3 * sample + k] as f32);
        sensed.command = std::array::from_fn(|k| commands[3 * sample + k] as f32);
        for joint in 0..12 {
            sensed.joint_position[joint] = log.position[12 * sample + joint] as f32;
            sensed.joint_velocity[joint] = log.velocity[12 * sample + joint] as f32;
        }
        let (action, _) = pilot.step(&mut sensed);
        assert!(
            (0..12).all(|joint| f64::from(action[joint]) == actions[12 * sample + joint]),
            "sample {sample}"
        );
    }
    let everything = read_csv(&folder.path().join(WHOLE), &ReadOptions::default()).unwrap();
    assert!(everything.len() > 550, "{}", everything.len());
}

/// At speed, whatever the direction: commands that end so, as random ones do. Lying down from there, a robot falls.
#[test]
fn a_robot_at_full_speed_comes_to_rest_and_lies_down() {
    let policy = walk();
    let speeds = [[1.0, 0.0, 0.0], [-0.4, -0.4, 0.8], [0.2, 0.4, -1.0]];
    for (number, speed) in speeds.into_iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        // Other lengths: the legs are at another point of their step.
        let seconds = 2.0 + 0.08 * number as f64;
        let rows = [(0.0, speed), (seconds, [0.0; 3])];
        let run = session(&policy, &rows, folder.path(), false, Duration::from_secs(20), |_, r| Some(*r));
        assert_eq!(run.board.reason, None, "{speed:?}");
        let stop = run.phases.iter().position(|(_, phase)| *phase == Phase::Stop).unwrap();
        let lasted = run.phases[stop + 1].0 - run.phases[stop].0;
        assert!((900..=1100).contains(&lasted.as_millis()), "{lasted:?}");
        assert!(run.seen.place.lock().unwrap()[2] < 0.1, "it lies: {speed:?}");
        // The log is that of the commands.
        let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
        assert_eq!(log.len(), (seconds * 50.0).round() as usize, "{speed:?}");
        let last = &log.command.as_ref().unwrap()[3 * (log.len() - 1)..];
        assert!(last.iter().zip(speed).all(|(value, wanted)| (*value as f32 - wanted).abs() < 1e-6));
    }
}

#[test]
fn logs_are_made_when_the_robot_is_armed_and_go_when_it_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let interface = walk().interface;
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    let mut recorder = Recorder::new(folder.path(), &interface, &go2()).unwrap().dry();
    assert_eq!(files(), 0, "before it is armed");
    recorder.open().unwrap();
    assert_eq!(files(), 3, "CSV and MCAP of the walk, and everything");
    let text = std::fs::read_to_string(folder.path().join(WALK)).unwrap();
    assert!(text.starts_with("# dry run"), "{text}");
    recorder.remove_empty();
    assert_eq!(files(), 0);
}

#[test]
fn a_file_that_is_there_already_is_named_before_the_robot_moves() {
    let folder = tempfile::tempdir().unwrap();
    let interface = walk().interface;
    std::fs::write(folder.path().join(WHOLE), "an earlier walk").unwrap();
    let error = Recorder::new(folder.path(), &interface, &go2()).unwrap().open().unwrap_err().to_string();
    assert!(error.contains("whole.csv") && error.contains("exists"), "{error}");
    assert_eq!(std::fs::read_to_string(folder.path().join(WHOLE)).unwrap(), "an earlier walk");
}

#[test]
fn a_policy_that_a_go2_may_not_be_given_is_refused_with_what_is_the_matter() {
    assert_eq!(suits(&walk(), &go2()), Ok(()));
    let refused = |change: &dyn Fn(&mut gaitfit_policy::Interface)| {
        let mut policy = walk();
        change(&mut policy.interface);
        suits(&policy, &go2()).unwrap_err().to_string()
    };
    for (error, words) in [
        (refused(&|it| it.kp[3] = 120.0), ["kp = 120", "0 to 100"]),
        (refused(&|it| it.kd[0] = 6.0), ["kd = 6", "0 to 5"]),
        (refused(&|it| it.kd[0] = -1.0), ["kd = -1", "0 to 5"]),
        (refused(&|it| it.robot = "a1".to_owned()), ["`a1`", "robot = \"go2\""]),
        (refused(&|it| it.robot = "go2w".to_owned()), ["`go2w`", "this is a Unitree Go2"]),
        (refused(&|it| it.default_pose[2] = 1.5), ["1.5 rad", "outside its range"]),
        (refused(&|it| it.velocity_joints = vec![it.joints[2].clone()]), ["velocities", "is no wheel"]),
        (refused(&|it| it.control_dt = 0.2), ["every 0.2 s", "control_dt"]),
        (refused(&|it| it.joints[0] = "tail".to_owned()), ["`tail`", "no joint"]),
    ] {
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    let mut policy = walk();
    policy.interface.robot = "Unitree_Go2".to_owned();
    assert_eq!(suits(&policy, &go2()), Ok(()));
    policy.interface.robot.clear();
    assert_eq!(suits(&policy, &go2()), Ok(()));
}

#[test]
fn a_dry_run_computes_and_sends_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let rows = [(0.0, [0.3, 0.0, 0.0]), (1.0, [0.0; 3])];
    let dry = session(&walk(), &rows, folder.path(), true, Duration::from_secs(20), |_, r| Some(*r));
    assert!(dry.board.over && dry.commands == 0 && dry.seen.commands.lock().unwrap().is_empty());
    assert_eq!(dry.board.reason, None);
    assert!(dry.seen.place.lock().unwrap()[2] < 0.16, "it never stood up");
    let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
    assert_eq!(log.len(), 50);
}

/// Faults in the messages of a robot that walks in the engine, drawn at random; what it was sent stays inside its limits.
#[test]
fn a_walking_robot_whose_messages_fail_is_damped_and_its_log_ends_with_the_last_good_row() {
    let policy = walk();
    // Other faults: rules.rs and faults.rs.
    for number in [0, 2, 4, 6] {
        let draws = Stream::new(21, Purpose::RESET).environment(number);
        let at = Duration::from_millis(4000 + u64::from(draws.word(1) % 1500));
        let folder = tempfile::tempdir().unwrap();
        let rows = [(0.0, [0.4, 0.2, -0.3]), (4.0, [0.0; 3])];
        let run = session(&policy, &rows, folder.path(), false, Duration::from_secs(12), |now, reading| {
            let mut reading = *reading;
            if now >= at {
                match number {
                    0 => return None,
                    2 => reading.seal = Seal::Wrong,
                    4 => reading.state.quaternion = [0.0, 1.0, 0.0, 0.0],
                    6 if now < at + Duration::from_millis(100) => return None,
                    _ => {}
                }
            }
            Some(reading)
        });
        let reason = run.board.reason.as_ref();
        let expected = match number {
            0 | 6 => matches!(reason, Some(Reason::StaleState(_))),
            2 => reason == Some(&Reason::WrongChecksum),
            _ => matches!(reason, Some(Reason::Tilt(_))),
        };
        assert!(expected, "{number}: {reason:?} at {at:?} {:?}", run.phases);
        assert_eq!(*run.seen.wrong.lock().unwrap(), None, "{number}");
        let last = *run.seen.commands.lock().unwrap().last().unwrap();
        assert!(last.iter().all(|motor| motor.kp == 0.0 && motor.tau == 0.0));
        let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
        let (stopped, _) = run.phases.last().unwrap();
        let walked = (*stopped - run.phases[3].0).as_millis() / 20;
        assert!((walked..=walked + 2).contains(&(log.len() as u128)), "{number}: {} {walked}", log.len());
    }
}

/// A robot whose remote is what is given for a time; it is walked by it.
fn by_remote(remote: impl Fn(f64) -> Remote + Sync, folder: &Path) -> Session {
    let ranges = [[-1.0, 1.0], [-0.5, 0.5], [-1.0, 1.0]];
    let held = |now: Duration, reading: &Reading| {
        let state = RobotState { remote: remote(now.as_secs_f64()), ..reading.state };
        Some(Reading { state, ..*reading })
    };
    session_under(&walk(), ByRemote(ranges), folder, false, Duration::from_secs(30), held)
}

#[test]
fn the_robots_remote_walks_it_lies_it_down_and_damps_it() {
    let folder = tempfile::tempdir().unwrap();
    let half = Remote { left: [0.0, 0.55], ..Remote::default() };
    let a = Remote { a: true, ..Remote::default() };
    // It walks from 3.8 s on.
    let whole = by_remote(|time| if time < 7.0 { half } else { a }, folder.path());
    use Phase::{Damping, Idle, LieDown, Stand, StandUp, Stop, Walk};
    let phases: Vec<Phase> = whole.phases.iter().map(|(_, phase)| *phase).collect();
    assert_eq!(phases, [Idle, StandUp, Stand, Walk, Stop, LieDown, Damping], "{:?}", whole.board.reason);
    assert_eq!((&whole.board.reason, &*whole.seen.wrong.lock().unwrap()), (&None, &None));
    let ahead = (whole.places[5][0] - whole.places[3][0]).hypot(whole.places[5][1] - whole.places[3][1]);
    assert!((1.0..2.0).contains(&ahead), "half of 1 m/s for 3.2 s: {ahead}");
    let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
    let command = log.command.unwrap();
    assert!((command[0] - 0.5).abs() < 1e-6 && command[1..3] == [0.0, 0.0], "{:?}", &command[..3]);

    let b = Remote { b: true, left: [0.0, 1.0], ..Remote::default() };
    let stopped = by_remote(|time| if time < 5.0 { half } else { b }, &folder.path().join("stopped"));
    assert_eq!(stopped.board.reason, Some(Reason::Operator));
    let (at, phase) = *stopped.phases.last().unwrap();
    assert!(phase == Damping && at >= Duration::from_secs(5) && at <= Duration::from_millis(5004), "{at:?}");
    assert_eq!(*stopped.seen.wrong.lock().unwrap(), None);
    // Held from the beginning it keeps the robot from being armed.
    let held = by_remote(|_| b, &folder.path().join("held"));
    assert_eq!((held.board.phase, &held.board.refused), (Idle, &Some(Reason::Operator)));
    assert_eq!(held.commands, 0);
}

/// A robot that sends one message again and again.
struct Repeats(Reading);

impl Link for Repeats {
    fn receive(&mut self, _: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        each(Duration::ZERO, &self.0);
        Ok(0)
    }

    fn send(&mut self, _: &Command) -> Result<(), String> {
        Ok(())
    }
}

#[test]
fn a_message_that_repeats_a_state_makes_it_no_younger() {
    let robot = go2();
    let supervisor = Supervisor::new(robot.guard(CONTROL), postures(&robot), Times::default());
    let mut sender = Sender::new(Box::new(Repeats(Toy::lying(&robot).reading())), supervisor, false);
    let mut board = Board::default();
    (1..4).for_each(|turn| sender.cycle(turn * TICK, &mut board));
    assert_eq!(board.state.map(|(came, _)| came), Some(TICK));
    assert_eq!(sender.states, 3);
}
