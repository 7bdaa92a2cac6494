//! A robot over DDS: its states in, commands to it out.

use std::collections::VecDeque;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use futures::StreamExt;
use futures::future::{AbortHandle, Abortable};
use rustdds::no_key::{DataReader, DataWriter};
use rustdds::policy::{History, Reliability};
use rustdds::{
    CDRDeserializerAdapter, CDRSerializerAdapter, DomainParticipant, DomainParticipantBuilder, QosPolicies,
    QosPolicyBuilder, RTPSEntity, Topic, TopicKind,
};

use super::Link;
use crate::RobotError;
use crate::command::Command;
use crate::robot::{Messages, Robot};
use crate::state::{Reading, Seal};
use crate::unitree::{CommandMessage, LowCmd, LowState, StateMessage, hg};

/// Messages that each end keeps; with fewer a writer loses some in its own queue.
const DEPTH: i32 = 16;
/// States that wait for the next call at most; older ones are let go.
const WAITING: usize = 64;
/// Largest domain that DDS has ports for.
const MAX_DOMAIN: u16 = 232;

/// What has arrived.
#[derive(Default)]
struct Inbox {
    states: VecDeque<(Instant, Reading)>,
    others: u64,
    broken: Option<String>,
}

/// Sends a command to the motors of a machine of this kind.
type Sending = Box<dyn Fn(&Command, u8) -> Result<(), String> + Send>;

/// The link to a robot, or to a simulator that speaks as one.
pub struct Dds {
    inbox: Arc<Mutex<Inbox>>,
    writer: Option<Sending>,
    /// What the last state says of the machine; commands repeat it.
    machine: Arc<AtomicU8>,
    listeners: Vec<AbortHandle>,
    // Ends the protocol when it is dropped: last.
    _participant: DomainParticipant,
}

impl Dds {
    /// The address to join `domain` from on a network interface. Nothing is joined.
    ///
    /// # Errors
    /// An interface that is not there or has no IPv4 address; a domain beyond 232.
    pub fn check(interface: &str, domain: u16) -> Result<Ipv4Addr, RobotError> {
        if domain > MAX_DOMAIN {
            return Err(RobotError::Domain { domain });
        }
        address_of(interface)
    }

    /// Joins `domain` on a network interface, for example `eth0`, as the link to `robot`; robots are in domain 0. `silent`: it
    /// listens only.
    ///
    /// # Errors
    /// An interface that is not there or has no IPv4 address; a domain beyond 232; DDS that cannot begin.
    pub fn open(robot: &Robot, interface: &str, domain: u16, silent: bool) -> Result<Self, RobotError> {
        match robot.messages {
            Messages::UnitreeGo => Self::join::<LowState, LowCmd>(robot, interface, domain, silent),
            Messages::UnitreeHg => Self::join::<hg::LowState, hg::LowCmd>(robot, interface, domain, silent),
        }
    }

    fn join<S: StateMessage, C: CommandMessage>(
        robot: &Robot,
        interface: &str,
        domain: u16,
        silent: bool,
    ) -> Result<Self, RobotError> {
        let address = Self::check(interface, domain)?;
        let participant = DomainParticipantBuilder::new(domain)
            .with_only_networks([IpAddr::V4(address)])
            .same_host_loopback(address.is_loopback())
            .build()
            .map_err(failed("join the domain"))?;
        let listening = qos(Reliability::BestEffort);
        let sending = qos(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) });
        let topic = |(name, kind): (&str, &str), qos: &QosPolicies| -> Result<Topic, RobotError> {
            participant
                .create_topic(name.to_owned(), kind.to_owned(), qos, TopicKind::NoKey)
                .map_err(failed("make a topic"))
        };
        let subscriber = participant.create_subscriber(&listening).map_err(failed("listen"))?;
        let states = subscriber
            .create_datareader_no_key_cdr::<S>(
                &topic((&robot.state_topic, S::TYPE), &listening)?,
                Some(listening.clone()),
            )
            .map_err(failed("listen to the robot's state"))?;
        let commands = topic((&robot.command_topic, C::TYPE), &sending)?;
        let others = subscriber
            .create_datareader_no_key_cdr::<C>(&commands, Some(listening))
            .map_err(failed("listen for other controllers"))?;
        let slots = robot.slots();
        let writer: Option<Sending> = if silent {
            None
        } else {
            let publisher = participant.create_publisher(&sending).map_err(failed("send"))?;
            let writer: DataWriter<C, CDRSerializerAdapter<C>> = publisher
                .create_datawriter_no_key_cdr::<C>(&commands, Some(sending))
                .map_err(failed("send commands"))?;
            Some(Box::new(move |command: &Command, machine: u8| {
                writer
                    .write(C::for_motors(command, &slots, machine), None)
                    .map_err(|error| format!("a command was not sent: {error}"))
            }))
        };
        let inbox = Arc::new(Mutex::new(Inbox::default()));
        let prefix = participant.guid().prefix;
        let machine = Arc::new(AtomicU8::new(0));
        let (into, kind) = (Arc::clone(&inbox), Arc::clone(&machine));
        let heard = listen(states, "states", Arc::clone(&inbox), move |state: S, _| {
            let reading = state.reading(&slots);
            if reading.seal != Seal::Wrong {
                kind.store(state.machine(), Ordering::Relaxed);
            }
            let mut inbox = into.lock().unwrap_or_else(PoisonError::into_inner);
            if inbox.states.len() == WAITING {
                inbox.states.pop_front();
            }
            inbox.states.push_back((Instant::now(), reading));
        })?;
        let into = Arc::clone(&inbox);
        let overheard = listen(others, "others", Arc::clone(&inbox), move |_: C, writer| {
            if writer.prefix != prefix {
                into.lock().unwrap_or_else(PoisonError::into_inner).others += 1;
            }
        })?;
        Ok(Self { inbox, writer, machine, listeners: vec![heard, overheard], _participant: participant })
    }
}

impl Link for Dds {
    fn receive(&mut self, _: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        let (states, others) = {
            let mut inbox = self.inbox.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(problem) = inbox.broken.take() {
                return Err(problem);
            }
            (std::mem::take(&mut inbox.states), std::mem::take(&mut inbox.others))
        };
        for (came, reading) in &states {
            each(came.elapsed(), reading);
        }
        Ok(others)
    }

    fn send(&mut self, command: &Command) -> Result<(), String> {
        let Some(writer) = &self.writer else { return Ok(()) };
        writer(command, self.machine.load(Ordering::Relaxed))
    }
}

impl Drop for Dds {
    fn drop(&mut self) {
        self.listeners.iter().for_each(AbortHandle::abort);
    }
}

pub(super) fn qos(reliability: Reliability) -> QosPolicies {
    QosPolicyBuilder::new().reliability(reliability).history(History::KeepLast { depth: DEPTH }).build()
}

pub(crate) fn failed<E: std::fmt::Display>(what: &'static str) -> impl FnOnce(E) -> RobotError {
    move |error| RobotError::Dds { what, problem: error.to_string() }
}

/// A thread that hands every message of `reader` to `take`, until it is aborted.
fn listen<M: serde::de::DeserializeOwned + Send + 'static>(
    reader: DataReader<M, CDRDeserializerAdapter<M>>,
    name: &'static str,
    inbox: Arc<Mutex<Inbox>>,
    take: impl Fn(M, rustdds::GUID) + Send + 'static,
) -> Result<AbortHandle, RobotError> {
    let (handle, registration) = AbortHandle::new_pair();
    let work = async move {
        let mut stream = reader.async_sample_stream();
        while let Some(message) = stream.next().await {
            match message {
                Ok(sample) => {
                    let writer = sample.sample_info().writer_guid();
                    take(sample.into_value(), writer);
                }
                // A message that cannot be read is not ours to answer for; its checksum would be wrong.
                Err(error) => {
                    let mut inbox = inbox.lock().unwrap_or_else(PoisonError::into_inner);
                    inbox.broken.get_or_insert(format!("a message could not be read: {error}"));
                }
            }
        }
    };
    std::thread::Builder::new()
        .name(format!("dds {name}"))
        .spawn(move || {
            let _ = futures::executor::block_on(Abortable::new(work, registration));
        })
        .map_err(failed("start a thread"))?;
    Ok(handle)
}

/// The IPv4 address of a network interface.
fn address_of(interface: &str) -> Result<Ipv4Addr, RobotError> {
    let all = netdev::get_interfaces();
    let found = all.iter().find(|one| one.name == interface);
    let address = found.and_then(|one| one.ipv4.first()).map(|network| network.addr());
    address.ok_or_else(|| RobotError::Interface {
        interface: interface.to_owned(),
        there: found.is_some(),
        names: all.iter().filter(|one| !one.ipv4.is_empty()).map(|one| one.name.clone()).collect(),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn an_interface_that_is_not_there_is_refused_with_those_that_are() {
        let robot = Robot::built_in("unitree-go2").unwrap();
        let error = Dds::open(&robot, "no-such-interface", 1, true).err().map(|error| error.to_string());
        assert!(error.is_some_and(|error| error.contains("no-such-interface")));
        assert!(matches!(Dds::open(&robot, "lo", 233, true).err(), Some(RobotError::Domain { domain: 233 })));
    }
}
