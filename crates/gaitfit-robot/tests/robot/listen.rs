//! ROS 2 topics without ROS, from another DDS implementation and from one that sends damaged messages, to a log.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gaitfit_import::{Bag, Imported, Mapping, Options, import};
use gaitfit_robot::listen::{Listener, topics};
use rustdds::policy::{History, Reliability};
use rustdds::{DomainParticipantBuilder, QosPolicyBuilder, TopicKind};
use serde::Serialize;

const TOPICS: &str = r#"
robot = "three joints"
kp = 20
kd = 0.5

[streams]
target = ["/joint_commands"]

[topics]
"/joint_states" = "sensor_msgs/msg/JointState"
"/imu/data" = "sensor_msgs/msg/Imu"
"/joint_commands" = "sensor_msgs/msg/JointState"
"/cmd_vel" = "geometry_msgs/msg/Twist"
"#;

/// Records until `enough` messages of the topic `/joint_states` came, or for a minute; how many messages were lost.
fn record(listener: &mut Listener, table: &BTreeMap<String, String>, path: &Path, enough: usize) -> u64 {
    let wanted = topics(table).unwrap();
    let names: Vec<(&str, &str)> = wanted.iter().map(|topic| (&*topic.name, &*topic.kind)).collect();
    let mut bag = Bag::new(File::create(path).unwrap(), &names).unwrap();
    let (begin, mut states, mut lost) = (Instant::now(), 0, 0);
    while states < enough {
        assert!(begin.elapsed() < Duration::from_secs(60), "{states} messages; {:?}", listener.published());
        std::thread::sleep(Duration::from_millis(5));
        let (heard, more) = listener.take();
        lost += more;
        for message in heard {
            states += usize::from(names[message.topic].0 == "/joint_states");
            bag.message(message.topic, message.ns, &message.bytes).unwrap();
        }
    }
    // Without its end, as after a power cut.
    lost
}

fn read(path: &Path, mapping: Mapping) -> Imported {
    import(&[path], &Options { mapping, ..Options::default() }).unwrap()
}

fn publisher(
    domain: u16,
    more: &[&str],
) -> Option<(std::process::Child, BufReader<std::process::ChildStdout>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut child = Command::new(crate::messages::python_with(&root, "cyclonedds")?)
        .arg(root.join("tools/ros2_robot.py"))
        .args(["--domain", &domain.to_string()])
        .args(more)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let mut ready = String::new();
    lines.read_line(&mut ready).unwrap();
    assert!(ready.contains("ready"), "{ready}");
    Some((child, lines))
}

#[test]
#[ignore = "needs cyclonedds in .venv"]
fn python_topics_of_another_dds_become_a_log() {
    let mapping = Mapping::parse(TOPICS).unwrap();
    for (domain, more) in [(121, &["--seconds", "40"][..]), (122, &["--seconds", "40", "--best-effort"])] {
        let Some((mut child, _lines)) = publisher(domain, more) else { return };
        let mut listener = Listener::open("lo", domain, &topics(&mapping.topics).unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("walk.mcap");
        let lost = record(&mut listener, &mapping.topics, &path, 800);
        drop(child.stdin.take());
        child.wait().unwrap();
        let Imported { trajectory: log, report } = read(&path, mapping.clone());
        eprintln!("{} samples at {} Hz, {lost} lost; {:?}", log.len(), log.rate_hz, report.assumed);
        assert_eq!(lost, 0);
        assert_eq!(
            (log.joints.as_slice(), log.rate_hz),
            (&["hip", "thigh", "calf"].map(String::from)[..], 200.0)
        );
        assert!(log.len() > 700, "{}", log.len());
        assert_eq!(log.gains.as_ref().unwrap().kp, [20.0; 3]);
        // Joint 0 gives the phase; the others, the velocities and the targets follow from it.
        let (q, dq, targets) = (&log.position, &log.velocity, log.target.as_ref().unwrap());
        let turn = std::f64::consts::TAU;
        for row in 0..log.len() {
            let phase = (q[3 * row] * turn).atan2(dq[3 * row]);
            for joint in 0..3 {
                let at = phase + joint as f64;
                assert!((q[3 * row + joint] - 0.3 * at.sin()).abs() < 1e-3, "row {row}");
                assert!((dq[3 * row + joint] - 0.3 * turn * at.cos()).abs() < 1e-2, "row {row}");
                let ahead = 0.3 * (at + turn * 0.02).sin();
                assert!((targets[3 * row + joint] - ahead).abs() < 1e-3, "row {row}");
            }
        }
        let lead = log.lead.unwrap().seconds;
        assert!((lead - 0.0005).abs() < 1e-4, "targets are stamped 0.5 ms after the states: {lead}");
        let base = log.base.as_ref().unwrap();
        let rates = base.angular_velocity.as_ref().unwrap();
        assert!(rates.chunks(3).all(|rate| (rate[2] - 0.2).abs() < 1e-6));
        let command = log.command.as_ref().unwrap();
        // Ten messages a second; before the first one an import takes 0.
        let known = command.chunks(3).skip(40);
        assert!(known.len() > 600 && known.clone().all(|one| one == [0.5, 0.0, 0.1]), "{command:?}");
    }
}

#[test]
#[ignore = "needs cyclonedds in .venv"]
fn python_a_gap_of_another_dds_is_seen_in_the_log() {
    let mapping = Mapping::parse(TOPICS).unwrap();
    let Some((mut child, _lines)) = publisher(123, &["--seconds", "16", "--gap", "0.5"]) else { return };
    let mut listener = Listener::open("lo", 123, &topics(&mapping.topics).unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    record(&mut listener, &mapping.topics, &path, 2200);
    drop(child.stdin.take());
    child.wait().unwrap();
    let log = read(&path, mapping).trajectory;
    let largest = log.time.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!((0.45..0.6).contains(&largest), "{largest}");
    let findings = gaitfit_log::check(&log, &gaitfit_log::CheckSpec::default());
    assert!(findings.iter().any(|finding| finding.kind == gaitfit_log::FindingKind::TimeGap), "{findings:?}");
}

#[derive(Debug, Serialize)]
struct JointState {
    sec: i32,
    nanosec: u32,
    frame: String,
    name: Vec<String>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
}

/// Words in the place of a message: lengths that no message has, among others.
#[derive(Debug, Serialize)]
struct Words([u32; 16]);

#[test]
fn damaged_messages_beside_good_ones_do_not_spoil_the_log() {
    const DOMAIN: u16 = 124;
    let table: BTreeMap<String, String> =
        [("/joint_states".to_owned(), "sensor_msgs/msg/JointState".to_owned())].into();
    let topic = topics(&table).unwrap().remove(0);
    let loopback: std::net::IpAddr = std::net::Ipv4Addr::LOCALHOST.into();
    let participant = DomainParticipantBuilder::new(DOMAIN).with_only_networks([loopback]).build().unwrap();
    let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) };
    let qos = QosPolicyBuilder::new().reliability(reliable).history(History::KeepLast { depth: 16 }).build();
    let made = participant.create_topic(topic.dds_name(), topic.dds_type(), &qos, TopicKind::NoKey).unwrap();
    let publish = participant.create_publisher(&qos).unwrap();
    let good = publish.create_datawriter_no_key_cdr::<JointState>(&made, Some(qos.clone())).unwrap();
    let bad = publish.create_datawriter_no_key_cdr::<Words>(&made, Some(qos.clone())).unwrap();
    let done = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.mcap");
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut tick = 0u32;
            while !done.load(Ordering::SeqCst) {
                let at = f64::from(tick) * 0.005;
                let message = JointState {
                    sec: 1000 + (at as i32),
                    nanosec: ((at % 1.0) * 1e9) as u32,
                    frame: String::new(),
                    name: vec!["knee".to_owned()],
                    position: vec![at.sin()],
                    velocity: vec![at.cos()],
                    effort: Vec::new(),
                };
                good.write(message, None).unwrap();
                let mut words = [tick.wrapping_mul(2_654_435_761); 16];
                // A name's length, a number of names, and a number of positions beyond all messages.
                words[2 + (tick % 4) as usize] = u32::MAX - tick % 3;
                if tick.is_multiple_of(2) {
                    bad.write(Words(words), None).unwrap();
                }
                tick += 1;
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        let mut listener = Listener::open("lo", DOMAIN, std::slice::from_ref(&topic)).unwrap();
        record(&mut listener, &table, &path, 900);
        done.store(true, Ordering::SeqCst);
        // A topic's name and type are told to who listens for another.
        assert!(listener.published().contains(&topic), "{:?}", listener.published());
    });
    let Imported { trajectory: log, report } = read(&path, Mapping::default());
    assert!(log.len() > 500 && log.joints == ["knee"], "{} {:?}", log.len(), log.joints);
    assert!(log.position.iter().zip(&log.velocity).all(|(q, dq)| (q * q + dq * dq - 1.0).abs() < 1e-3));
    assert!(report.left_out.iter().any(|line| line.contains("messages")), "{:?}", report.left_out);
}
