//! The vendor's simulator server in another process, its bridge unchanged, over DDS on the loopback interface.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use gaitfit_log::{ReadOptions, read_csv};
use gaitfit_robot::guard::{GuardSettings, Reason};
use gaitfit_robot::link::{Dds, Link};
use gaitfit_robot::run::{Controller, Live, Recorder, Script, Sender, Summary, WALK, live, real_time};
use gaitfit_robot::{PerMotor, Phase, RobotError, Supervisor, Times, damping};

use crate::messages::sdk_python;
use crate::session::walk;
use crate::toy::go2;

/// The server; it ends when its standard input is closed.
pub struct Server {
    child: Child,
    lines: BufReader<ChildStdout>,
}

impl Server {
    /// The vendor's Go2 on a floor, in a domain of its own; `None` where the vendor's software or its needs are missing.
    fn start(domain: u16, seconds: f64) -> Option<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let file = |path: &str| root.join(path).display().to_string();
        let model = file("../../../shared/third_party/unitree_mujoco/unitree_robots/go2/go2.xml");
        Self::start_with(&[file("robots/go2.toml"), "--model".to_owned(), model], domain, seconds)
    }

    /// `tools/link_server.py` with these arguments.
    pub fn start_with(arguments: &[String], domain: u16, seconds: f64) -> Option<Self> {
        // A robot's own computer has nothing else to do: where the system allows it the server goes first, as the run does.
        real_time();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut child = Command::new(sdk_python(&root)?)
            .arg(root.join("tools/link_server.py"))
            .args(arguments)
            .args(["--domain", &domain.to_string(), "--seconds", &(seconds + 60.0).to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        let mut ready = String::new();
        lines.read_line(&mut ready).unwrap();
        assert!(ready.contains("ready"), "{ready}");
        Some(Self { child, lines })
    }

    pub fn signal(&self, signal: &str) {
        assert!(
            Command::new("kill").args([signal, &self.child.id().to_string()]).status().unwrap().success()
        );
    }

    /// What the robot felt.
    pub fn end(mut self) -> serde_json::Value {
        drop(self.child.stdin.take());
        let mut last = String::new();
        self.lines.read_to_string(&mut last).unwrap();
        self.child.wait().unwrap();
        serde_json::from_str(last.trim()).unwrap_or_default()
    }
}

/// A run on the server; `told` is called at each new phase.
fn run_on(
    domain: u16,
    folder: &Path,
    rows: Vec<(f64, [f32; 3])>,
    told: &mut dyn FnMut(Phase),
) -> Result<Summary, RobotError> {
    let policy = walk();
    let script = Script::new(rows).unwrap();
    let control = Duration::from_secs_f64(policy.interface.control_dt);
    // The machine of a test is busy, and a simulator in Python is slow.
    let patience = Duration::from_millis(300);
    let guard = GuardSettings {
        stale: patience,
        late: patience,
        simulator: true,
        ..GuardSettings::new(&go2(), control)
    };
    let guard = GuardSettings { late_policy: patience, ..guard };
    let limits = guard.limits;
    let recorder = Recorder::new(folder, &policy.interface, &go2()).unwrap();
    let controller = Controller::new(&go2(), &policy, &script, recorder).unwrap();
    let real_time = real_time();
    let link = Box::new(Dds::open(&go2(), "lo", domain, false).unwrap());
    let postures = go2().postures(&policy.interface).unwrap();
    let sender = Sender::new(link, Supervisor::new(guard, postures, Times::default()), false);
    let ask = Live { confirm: &mut |_| true, phase: told, stop: &|| None, control, real_time, limits };
    live(sender, controller, ask)
}

#[test]
#[ignore = "needs ../shared with the vendor's simulator, and cyclonedds and mujoco in .venv"]
fn shared_the_vendors_server_is_walked() {
    let seconds = std::env::var("GAITFIT_SERVER_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(10.0);
    let Some(server) = Server::start(41, seconds) else { return };
    let folder = tempfile::tempdir().unwrap();
    let directions =
        [[0.5, 0.0, 0.0], [-0.4, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [0.0, 0.0, 0.6], [0.0; 3]];
    let mut rows: Vec<(f64, [f32; 3])> =
        directions.iter().enumerate().map(|(k, command)| (k as f64 * seconds / 6.0, *command)).collect();
    rows.push((seconds, [0.0; 3]));
    let mut phases = Vec::new();
    let summary = run_on(41, folder.path(), rows, &mut |phase| phases.push(phase)).unwrap();
    let felt = server.end();
    eprintln!(
        "{}\n{} of {} commands taken; {} of {} states heard; held up {}; least up {}, highest {}",
        serde_json::to_string_pretty(&summary).unwrap(),
        felt["commands"],
        summary.commands,
        summary.armed_states,
        felt["states_commanded"],
        felt["held_up"],
        felt["least_up"],
        felt["highest"]
    );
    assert_eq!(summary.reason, None);
    use Phase::{Damping, LieDown, Stand, StandUp, Stop, Walk};
    assert_eq!(phases, [StandUp, Stand, Walk, Stop, LieDown, Damping]);
    assert_eq!(felt["wrong"], 0, "checksums that the SDK refuses");
    let taken = felt["commands"].as_f64().unwrap();
    assert!(taken > 0.9 * summary.commands as f64, "{taken} of {} commands", summary.commands);
    assert!(felt["highest"].as_f64().unwrap() > 0.25 && felt["least_up"].as_f64().unwrap() > 0.8, "{felt}");
    let path: Vec<Vec<f64>> = serde_json::from_value(felt["path"].clone()).unwrap();
    // It turns as it walks: what counts is the way it went, of 1.5 m/s over the six directions.
    let step = |pair: &[Vec<f64>]| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
    let way: f64 = path.windows(2).map(step).sum();
    assert!(way > 0.6 * 1.5 * seconds / 6.0, "{way} m");
    assert!(path.last().unwrap()[2] < 0.18, "it lies: {:?}", path.last());
    let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
    // The last second, in which it stops, is not in the log.
    assert!((20..=51).contains(&(summary.outputs - log.len() as u64)), "{} {}", log.len(), summary.outputs);
}

#[test]
#[ignore = "needs ../shared with the vendor's simulator, and cyclonedds and mujoco in .venv"]
fn shared_a_server_that_is_killed_or_held_up_and_a_second_controller_are_noticed() {
    let rows = || vec![(0.0, [0.3, 0.0, 0.0]), (20.0, [0.0; 3])];
    for (domain, signal) in [(42, "-KILL"), (43, "-STOP")] {
        // A folder that holds a walk is refused.
        let folder = tempfile::tempdir().unwrap();
        let Some(server) = Server::start(domain, 60.0) else { return };
        let mut told = |phase| {
            if phase == Phase::Walk {
                server.signal(signal);
            }
        };
        let summary = run_on(domain, folder.path(), rows(), &mut told).unwrap();
        assert!(summary.reason.as_ref().unwrap().contains("last state is"), "{:?}", summary.reason);
        if signal == "-STOP" {
            server.signal("-CONT");
        }
        server.end();
    }
    let folder = tempfile::tempdir().unwrap();
    let Some(server) = Server::start(44, 60.0) else { return };
    let other = Mutex::new(Dds::open(&go2(), "lo", 44, false).unwrap());
    let begin = Instant::now();
    // Heard before it is armed.
    std::thread::scope(|scope| {
        let sending = scope.spawn(|| {
            while begin.elapsed() < Duration::from_secs(20) {
                other.lock().unwrap().send(&damping(&PerMotor::new(12, 2.0))).unwrap();
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let refused = run_on(44, folder.path(), rows(), &mut |_| ()).unwrap_err();
        assert_eq!(refused, RobotError::NotArmed(Reason::SecondController));
        sending.join().unwrap();
    });
    server.end();
}
