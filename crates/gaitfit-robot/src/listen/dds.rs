//! Listening over DDS: bytes as they come, in a queue that is bounded.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use futures::StreamExt;
use futures::future::{AbortHandle, Abortable};
use rustdds::no_key::{DataReader, Decode, DefaultDecoder, DeserializerAdapter};
use rustdds::policy::{History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, QosPolicyBuilder, RepresentationIdentifier, TopicKind,
};

use super::{Heard, MAX_MESSAGE, Topic};
use crate::RobotError;
use crate::link::{Dds, failed};

/// Messages of a topic that DDS keeps for us.
const DEPTH: i32 = 256;
/// Max number of messages that wait, 40 s of a topic at 500 Hz; later ones are lost and counted.
const MAX_WAITING: usize = 20_000;
/// Max number of bytes that wait; later messages are lost and counted.
const MAX_BYTES: usize = 64 << 20;

/// A message whose encoding or length is refused.
#[derive(Clone, Debug, thiserror::Error)]
#[error("a message is longer than {MAX_MESSAGE} bytes")]
struct TooLong;

/// Leaves a message as it came.
struct AsItCame;

impl DeserializerAdapter<Vec<u8>> for AsItCame {
    type Error = TooLong;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[
            RepresentationIdentifier::CDR_LE,
            RepresentationIdentifier::CDR_BE,
            RepresentationIdentifier::XCDR2_LE,
            RepresentationIdentifier::XCDR2_BE,
        ]
    }

    fn transform_decoded(decoded: Vec<u8>) -> Vec<u8> {
        decoded
    }
}

impl DefaultDecoder<Vec<u8>> for AsItCame {
    type Decoder = Head;
    const DECODER: Head = Head;
}

/// Puts the head before a message's bytes again.
#[derive(Clone)]
struct Head;

impl Decode<'_, Vec<u8>> for Head {
    type Error = TooLong;

    fn decode_bytes(self, bytes: &[u8], encoding: RepresentationIdentifier) -> Result<Vec<u8>, TooLong> {
        if bytes.len() > MAX_MESSAGE {
            return Err(TooLong);
        }
        let head = match encoding {
            // The numbers of DDS-XTypes 1.3 for the encodings; MCAP files of ROS 2 keep this head before each
            // message.
            RepresentationIdentifier::CDR_BE => 0,
            RepresentationIdentifier::XCDR2_BE => 6,
            RepresentationIdentifier::XCDR2_LE => 7,
            // CDR_LE is the only encoding left of those that are supported.
            _ => 1,
        };
        // Two bytes have the encoding's number and two its options (RTPS, head of a serialised payload).
        Ok([&[0, head, 0, 0], bytes].concat())
    }
}

/// Messages that have arrived and wait.
#[derive(Default)]
struct Inbox {
    heard: Vec<Heard>,
    bytes: usize,
    lost: u64,
}

/// Listens to topics.
pub struct Listener {
    inbox: Arc<Mutex<Inbox>>,
    threads: Vec<AbortHandle>,
    // Ends the protocol when it is dropped: last.
    participant: DomainParticipant,
}

impl Listener {
    /// Joins `domain` on a network interface and listens. Nothing is ever sent on a topic.
    ///
    /// # Errors
    /// An interface that is not there or has no IPv4 address; a domain beyond 232; DDS that cannot begin.
    pub fn open(interface: &str, domain: u16, topics: &[Topic]) -> Result<Self, RobotError> {
        let address = Dds::check(interface, domain)?;
        let participant = DomainParticipantBuilder::new(domain)
            .with_only_networks([IpAddr::V4(address)])
            .same_host_loopback(address.is_loopback())
            .build()
            .map_err(failed("join the domain"))?;
        // Publishers that are reliable serve readers that are not, too.
        let qos = QosPolicyBuilder::new()
            .reliability(Reliability::BestEffort)
            .history(History::KeepLast { depth: DEPTH })
            .build();
        let subscriber = participant.create_subscriber(&qos).map_err(failed("listen"))?;
        let (inbox, begin) = (Arc::<Mutex<Inbox>>::default(), Instant::now());
        // The clock is read once: a computer whose time is set meanwhile must not make times jump.
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut threads = Vec::with_capacity(topics.len());
        // Each topic has a thread of its own, so that a busy one does not hold up the others.
        for (number, topic) in topics.iter().enumerate() {
            let made = participant
                .create_topic(topic.dds_name(), topic.dds_type(), &qos, TopicKind::NoKey)
                .map_err(failed("make a topic"))?;
            let reader: DataReader<Vec<u8>, AsItCame> = subscriber
                .create_datareader_no_key::<Vec<u8>, AsItCame>(&made, Some(qos.clone()))
                .map_err(failed("listen to a topic"))?;
            let (handle, registration) = AbortHandle::new_pair();
            let into = Arc::clone(&inbox);
            let work = async move {
                let mut stream = reader.async_sample_stream();
                while let Some(message) = stream.next().await {
                    let ns = (since_1970 + begin.elapsed()).as_nanos() as u64;
                    let mut inbox = into.lock().unwrap_or_else(PoisonError::into_inner);
                    match message {
                        // What the caller fetches too slowly is counted and let go, so memory stays bounded.
                        Ok(sample) if inbox.heard.len() < MAX_WAITING && inbox.bytes < MAX_BYTES => {
                            let bytes = sample.into_value();
                            inbox.bytes += bytes.len();
                            inbox.heard.push(Heard { topic: number, ns, bytes });
                        }
                        _ => inbox.lost += 1,
                    }
                }
            };
            std::thread::Builder::new()
                .name("dds topic".to_owned())
                .spawn(move || {
                    let _ = futures::executor::block_on(Abortable::new(work, registration));
                })
                .map_err(failed("start a thread"))?;
            threads.push(handle);
        }
        Ok(Self { inbox, threads, participant })
    }

    /// What has come since the last call, and how many messages were lost since then: too long, unreadable, or too many.
    pub fn take(&mut self) -> (Vec<Heard>, u64) {
        let mut inbox = self.inbox.lock().unwrap_or_else(PoisonError::into_inner);
        inbox.bytes = 0;
        (std::mem::take(&mut inbox.heard), std::mem::take(&mut inbox.lost))
    }

    /// Topics that others in the domain publish, by name.
    pub fn published(&self) -> Vec<Topic> {
        let writers = self.participant.discovered_writers();
        let mut topics: Vec<Topic> = writers
            .iter()
            .map(|writer| &writer.publication_topic_data)
            .filter_map(|data| Topic::from_dds(&data.topic_name, &data.type_name))
            .collect();
        // By name and type: `dedup` drops only neighbours.
        topics.sort();
        topics.dedup();
        topics
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.threads.iter().for_each(AbortHandle::abort);
    }
}
