//! A robot over DDS: its states in, commands to it out.

use std::collections::VecDeque;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use futures::StreamExt;
use futures::future::{AbortHandle, Abortable};
use rustdds::no_key::{DataReader, DataWriter};
use rustdds::policy::{History, Reliability};
use rustdds::{
    CDRDeserializerAdapter, CDRSerializerAdapter, DomainParticipant, DomainParticipantBuilder, QosPolicies,
    QosPolicyBuilder, RTPSEntity, Subscriber, Topic, TopicKind,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::Link;
use crate::RobotError;
use crate::command::Command;
use crate::robot::{Messages, Robot};
use crate::state::Reading;
use crate::unitree::{LowCmd, LowState, hg};

/// Messages that each end keeps: 32 ms at 500 Hz. With fewer a writer loses some in its own queue.
const DEPTH: i32 = 16;
/// States that wait for the next call at most; older ones are let go.
const WAITING: usize = 64;
/// Largest domain that DDS has ports for: 7400 + 250 · domain (DDSI-RTPS, port mapping) must fit into 16 bits.
const MAX_DOMAIN: u16 = 232;

/// How old a part of a state may be, as old as the guard lets a whole state be; see [`Dds::with_patience`].
const PATIENCE: Duration = Duration::from_millis(20);

/// States and problems that wait for the next call.
pub(super) struct Inbox {
    states: VecDeque<(Instant, Reading)>,
    others: u64,
    broken: Option<String>,
    pub(super) lacks: Option<String>,
    pub(super) patience: Duration,
}

impl Default for Inbox {
    fn default() -> Self {
        Self { states: VecDeque::new(), others: 0, broken: None, lacks: None, patience: PATIENCE }
    }
}

impl Inbox {
    pub(super) fn push(&mut self, reading: Reading) {
        if self.states.len() == WAITING {
            self.states.pop_front();
        }
        self.states.push_back((Instant::now(), reading));
    }

    /// The first problem stays.
    pub(super) fn break_off(&mut self, problem: String) {
        self.broken.get_or_insert(problem);
    }
}

/// Sends a command.
pub(super) type Sending = Box<dyn Fn(&Command) -> Result<(), String> + Send>;

/// The link to a robot, or to a simulator that speaks as one.
pub struct Dds {
    inbox: Arc<Mutex<Inbox>>,
    writer: Option<Sending>,
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
        let joining = Joining::new(interface, domain)?;
        match robot.messages {
            Messages::UnitreeGo => joining.unitree::<LowState, LowCmd>(robot, silent),
            Messages::UnitreeHg => joining.unitree::<hg::LowState, hg::LowCmd>(robot, silent),
            Messages::Ros2 => joining.ros2(robot, silent),
        }
    }

    /// How old a part of a robot's state may be when another part comes, for messages that state it in parts; 20 ms if this
    /// is not called.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        lock(&self.inbox).patience = patience;
        self
    }
}

/// A link that is being made.
pub(super) struct Joining {
    participant: DomainParticipant,
    subscriber: Subscriber,
    listening: QosPolicies,
    inbox: Arc<Mutex<Inbox>>,
    listeners: Vec<AbortHandle>,
}

impl Joining {
    pub(super) fn new(interface: &str, domain: u16) -> Result<Self, RobotError> {
        let address = Dds::check(interface, domain)?;
        let participant = DomainParticipantBuilder::new(domain)
            // Only the robot's network: commands must not leave by another one.
            .with_only_networks([IpAddr::V4(address)])
            .same_host_loopback(address.is_loopback())
            .build()
            .map_err(failed("join the domain"))?;
        // A lost state that is sent again comes too late: the next one has newer numbers.
        let listening = qos(Reliability::BestEffort);
        let subscriber = participant.create_subscriber(&listening).map_err(failed("listen"))?;
        Ok(Self {
            participant,
            subscriber,
            listening,
            inbox: Arc::new(Mutex::new(Inbox::default())),
            listeners: Vec::new(),
        })
    }

    pub(super) fn inbox(&self) -> Arc<Mutex<Inbox>> {
        Arc::clone(&self.inbox)
    }

    fn topic(&self, (name, kind): (&str, &str), qos: &QosPolicies) -> Result<Topic, RobotError> {
        self.participant
            .create_topic(name.to_owned(), kind.to_owned(), qos, TopicKind::NoKey)
            .map_err(failed("make a topic"))
    }

    /// Hands every message of a topic (its name and type) to `take`, on a thread.
    pub(super) fn hear<M: DeserializeOwned + Send + 'static>(
        &mut self,
        topic: (&str, &str),
        thread: &'static str,
        take: impl Fn(M) + Send + 'static,
    ) -> Result<(), RobotError> {
        let reader = self
            .subscriber
            .create_datareader_no_key_cdr::<M>(
                &self.topic(topic, &self.listening)?,
                Some(self.listening.clone()),
            )
            .map_err(failed("listen to the robot's state"))?;
        self.listeners.push(listen(reader, thread, self.inbox(), move |message, _| take(message))?);
        Ok(())
    }

    /// Counts the commands `C` of other programs, and makes the writer of ours: `None` if it is to be silent.
    pub(super) fn commands<C: Serialize + Send + 'static>(
        &mut self,
        topic: (&str, &str),
        silent: bool,
    ) -> Result<Option<Writer<C>>, RobotError> {
        // A robot that asks for reliable commands does not match a writer that offers less (DDS, requested
        // against offered).
        let sending = qos(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) });
        let commands = self.topic(topic, &sending)?;
        // Best effort matches writers of both kinds, so no other controller is missed for its settings.
        let others = self
            .subscriber
            .create_datareader_no_key_cdr::<Anything>(&commands, Some(self.listening.clone()))
            .map_err(failed("listen for other controllers"))?;
        let (into, prefix) = (self.inbox(), self.participant.guid().prefix);
        self.listeners.push(listen(others, "others", self.inbox(), move |_: Anything, writer| {
            // The prefix is that of the participant, so it marks all writers of this program.
            if writer.prefix != prefix {
                lock(&into).others += 1;
            }
        })?);
        // Other controllers are still listened for.
        if silent {
            return Ok(None);
        }
        let publisher = self.participant.create_publisher(&sending).map_err(failed("send"))?;
        let writer = publisher
            .create_datawriter_no_key_cdr::<C>(&commands, Some(sending))
            .map_err(failed("send commands"))?;
        Ok(Some(Writer(writer)))
    }

    pub(super) fn link(self, writer: Option<Sending>) -> Dds {
        let Self { participant, inbox, listeners, .. } = self;
        Dds { inbox, writer, listeners, _participant: participant }
    }
}

/// Sends commands.
pub(super) struct Writer<C: Serialize>(DataWriter<C, CDRSerializerAdapter<C>>);

impl<C: Serialize> Writer<C> {
    pub(super) fn send(&self, command: C) -> Result<(), String> {
        self.0.write(command, None).map_err(|error| format!("a command was not sent: {error}"))
    }
}

/// A message whose content does not matter.
struct Anything;

impl<'de> serde::Deserialize<'de> for Anything {
    fn deserialize<D: serde::Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
        Ok(Self)
    }
}

pub(super) fn lock(inbox: &Mutex<Inbox>) -> MutexGuard<'_, Inbox> {
    inbox.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Link for Dds {
    fn receive(&mut self, _: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        // The lock is free again before `each` runs, so that the threads that hear are not held up.
        let (states, others) = {
            let mut inbox = lock(&self.inbox);
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
        writer(command)
    }

    fn lacks(&self) -> Option<String> {
        lock(&self.inbox).lacks.clone()
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
fn listen<M: DeserializeOwned + Send + 'static>(
    reader: DataReader<M, CDRDeserializerAdapter<M>>,
    name: &'static str,
    inbox: Arc<Mutex<Inbox>>,
    take: impl Fn(M, rustdds::GUID) + Send + 'static,
) -> Result<AbortHandle, RobotError> {
    let (handle, registration) = AbortHandle::new_pair();
    let work = async move {
        let mut stream = reader.async_sample_stream();
        // Aborted from outside, as the stream itself never ends.
        while let Some(message) = stream.next().await {
            match message {
                Ok(sample) => {
                    let writer = sample.sample_info().writer_guid();
                    take(sample.into_value(), writer);
                }
                // A message that cannot be read is not ours to answer for; its checksum would be wrong.
                Err(error) => {
                    lock(&inbox).break_off(format!("a message could not be read: {error}"));
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
    let interfaces = netdev::get_interfaces();
    let adapter = interfaces.iter().find(|one| one.name == interface);
    let address = adapter.and_then(|one| one.ipv4.first()).map(|network| network.addr());
    address.ok_or_else(|| RobotError::Interface {
        interface: interface.to_owned(),
        there: adapter.is_some(),
        names: interfaces.iter().filter(|one| !one.ipv4.is_empty()).map(|one| one.name.clone()).collect(),
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
