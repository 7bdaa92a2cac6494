//! The link over DDS on the loopback interface: a robot's side in the same process.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gaitfit_robot::link::{Dds, Link};
use gaitfit_robot::unitree::{LowCmd, LowState};
use gaitfit_robot::{PerMotor, Seal, damping};
use rustdds::no_key::{DataReaderCdr, DataWriterCdr};
use rustdds::policy::{History, Reliability};
use rustdds::{DomainParticipant, DomainParticipantBuilder, QosPolicyBuilder, ReadCondition, TopicKind};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::toy::go2;

/// Runs on the real clock have little time to answer: one at a time.
pub fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A domain that no robot or simulator uses.
const DOMAIN: u16 = 77;

/// What a program at the other end writes and reads, on the loopback interface. Both live as long as the participant.
pub type Side<W, R> = (DomainParticipant, DataWriterCdr<W>, DataReaderCdr<R>);

/// The other end of a link: it writes to one topic and reads another. A topic is a name and a kind of messages.
pub fn side<W: Serialize, R: DeserializeOwned + 'static>(
    domain: u16,
    written: (&str, &str),
    read: (&str, &str),
) -> Side<W, R> {
    let loopback: std::net::IpAddr = std::net::Ipv4Addr::LOCALHOST.into();
    let participant = DomainParticipantBuilder::new(domain).with_only_networks([loopback]).build().unwrap();
    let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) };
    let qos = QosPolicyBuilder::new().reliability(reliable).history(History::KeepLast { depth: 16 }).build();
    let topic = |(name, kind): (&str, &str)| {
        participant.create_topic(name.to_owned(), kind.to_owned(), &qos, TopicKind::NoKey).unwrap()
    };
    let (written, read) = (topic(written), topic(read));
    let publisher = participant.create_publisher(&qos).unwrap();
    let writer = publisher.create_datawriter_no_key_cdr(&written, Some(qos.clone())).unwrap();
    let subscriber = participant.create_subscriber(&qos).unwrap();
    let reader = subscriber.create_datareader_no_key_cdr(&read, Some(qos.clone())).unwrap();
    (participant, writer, reader)
}

/// A robot's side of the link: its states and the commands to it. `package`: that of the messages.
pub fn robot_side<S: Serialize, C: DeserializeOwned + 'static>(domain: u16, package: &str) -> Side<S, C> {
    let [state, command] = ["LowState_", "LowCmd_"].map(|name| format!("{package}::msg::dds_::{name}"));
    side(domain, ("rt/lowstate", &state), ("rt/lowcmd", &command))
}

#[test]
fn states_and_commands_cross_the_loopback_interface_and_another_controller_is_seen() {
    let done = Arc::new(AtomicBool::new(false));
    let stop = Arc::clone(&done);
    let robot = std::thread::spawn(move || {
        let (_participant, states, mut commands) = robot_side::<LowState, LowCmd>(DOMAIN, "unitree_go");
        let (mut tick, mut right, mut wrong) = (0, 0, 0);
        while !stop.load(Ordering::SeqCst) {
            tick += 2;
            states.write(LowState { tick, ..LowState::default() }.sealed(), None).unwrap();
            for command in commands.take(100, ReadCondition::any()).unwrap() {
                let command = command.into_value();
                *(if command.checksum() == command.crc { &mut right } else { &mut wrong }) += 1;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        (right, wrong)
    });
    let mut link = Dds::open(&go2(), "lo", DOMAIN, false).unwrap();
    let begin = Instant::now();
    let mut ticks = Vec::new();
    let mut receive = |link: &mut Dds| {
        let others = link.receive(begin.elapsed(), &mut |age, reading| {
            assert!(reading.seal == Seal::Right && age < Duration::from_secs(5));
            ticks.push(reading.state.tick);
        });
        std::thread::sleep(Duration::from_millis(2));
        (others.unwrap(), ticks.len())
    };
    while receive(&mut link).1 < 500 {
        link.send(&damping(&PerMotor::new(12, 2.0))).unwrap();
        assert!(begin.elapsed() < Duration::from_secs(60), "no states over the loopback interface");
    }
    assert_eq!(receive(&mut link).0, 0, "its own commands are not another controller's");
    let mut other = Dds::open(&go2(), "lo", DOMAIN, false).unwrap();
    let mut seen = 0;
    while seen == 0 {
        other.send(&damping(&PerMotor::new(12, 2.0))).unwrap();
        seen += receive(&mut link).0;
        assert!(begin.elapsed() < Duration::from_secs(90), "the other controller is not seen");
    }
    done.store(true, Ordering::SeqCst);
    let (right, wrong) = robot.join().unwrap();
    assert!(right > 100 && wrong == 0, "{right} {wrong}");
    assert!(ticks.windows(2).all(|pair| pair[0] < pair[1]));
}
