//! The motion service, asked over DDS: a service in this process, and the vendor's own RPC server in another.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gaitfit_robot::link::{MotionMode, MotionSwitcher};
use gaitfit_robot::unitree::rpc::{Identity, Request, Response, ResponseHeader, Status};
use rustdds::ReadCondition;

use crate::dds::side;
use crate::messages::sdk_python;

const PATIENCE: Duration = Duration::from_secs(10);

/// A service whose mode is `name`, until it is released once more than `stubborn` times. Its calls by number.
fn service(domain: u16, code: i32, mut stubborn: u32, calls: &Mutex<Vec<i64>>, done: &AtomicBool) {
    let (_participant, responses, mut requests) = side::<Response, Request>(
        domain,
        ("rt/api/motion_switcher/response", "unitree_api::msg::dds_::Response_"),
        ("rt/api/motion_switcher/request", "unitree_api::msg::dds_::Request_"),
    );
    let mut name = "normal";
    while !done.load(Ordering::SeqCst) {
        for sample in requests.take(16, ReadCondition::any()).unwrap() {
            let request = sample.into_value();
            assert_eq!((request.parameter.as_str(), request.header.policy.noreply), ("{}", false));
            let identity = request.header.identity;
            calls.lock().unwrap().push(identity.api_id);
            match (identity.api_id, stubborn) {
                (1003, 0) => name = "",
                (1003, _) => stubborn -= 1,
                _ => {}
            }
            let data = match identity.api_id {
                1001 if code == 0 => format!(r#"{{"form":"0","name":"{name}"}}"#),
                _ => String::new(),
            };
            let answer = |identity, data| {
                let header = ResponseHeader { identity, status: Status { code } };
                responses.write(Response { header, data, binary: Vec::new() }, None).unwrap();
            };
            // Another program's answer, which is not for us.
            answer(Identity { id: 7, ..identity }, r#"{"name":""}"#.to_owned());
            answer(identity, data);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_motion_service_is_found_and_released_and_one_that_fails_or_stays_is_not_taken_for_released() {
    for (domain, code, stubborn, mode, then) in [
        (61, 0, 1, MotionMode::Active("normal".to_owned()), MotionMode::Released),
        (62, 0, u32::MAX, MotionMode::Active("normal".to_owned()), MotionMode::Active("normal".to_owned())),
        (63, 3203, 0, MotionMode::Error(3203), MotionMode::Error(3203)),
    ] {
        let (calls, done) = (Mutex::new(Vec::new()), AtomicBool::new(false));
        std::thread::scope(|scope| {
            scope.spawn(|| service(domain, code, stubborn, &calls, &done));
            let mut switcher = MotionSwitcher::open("lo", domain).unwrap();
            let first = switcher.check(PATIENCE).unwrap();
            // Before anybody asks for it nothing is released.
            let asked = calls.lock().unwrap().clone();
            let patience = if then == MotionMode::Released { PATIENCE } else { Duration::from_secs(2) };
            let released = switcher.release(patience).unwrap();
            done.store(true, Ordering::SeqCst);
            assert_eq!((&first, &released), (&mode, &then), "{domain}");
            assert!(asked.iter().all(|call| *call == 1001), "{asked:?}");
        });
        assert!(calls.lock().unwrap().contains(&1003));
    }
    let mut nobody = MotionSwitcher::open("lo", 64).unwrap();
    let begin = Instant::now();
    assert_eq!(nobody.check(Duration::from_secs(1)).unwrap(), MotionMode::Silent);
    assert!(begin.elapsed() >= Duration::from_secs(1) && begin.elapsed() < Duration::from_secs(20));
}

#[test]
#[ignore = "needs ../shared with the vendor's Python SDK, and cyclonedds in .venv"]
fn shared_the_vendors_rpc_server_is_asked_and_released() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let Some(python) = sdk_python(&root) else { return };
    for (domain, options, mode, then) in [
        ("65", &["--stubborn", "1"][..], MotionMode::Active("normal".to_owned()), MotionMode::Released),
        ("66", &["--mode", ""], MotionMode::Released, MotionMode::Released),
        ("67", &["--code", "3205"], MotionMode::Error(3205), MotionMode::Error(3205)),
    ] {
        let mut child = Command::new(&python)
            .arg(root.join("tools/motion_switcher.py"))
            .args(["--domain", domain])
            .args(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.any(|line| line.contains("\"ready\"")), "it did not start");
        let mut switcher = MotionSwitcher::open("lo", domain.parse().unwrap()).unwrap();
        assert_eq!(switcher.check(PATIENCE).unwrap(), mode, "{options:?}");
        let patience = if then == MotionMode::Released { PATIENCE } else { Duration::from_secs(2) };
        assert_eq!(switcher.release(patience).unwrap(), then, "{options:?}");
        drop(child.stdin.take());
        assert!(child.wait().unwrap().success());
        assert!(lines.any(|line| line.contains("\"release\"")), "the server was never asked");
    }
}
