//! A Go2's motion service, which walks the robot by its own program until it is released: the vendor's motion switcher, asked
//! over DDS as the vendor's SDK asks it.

use std::net::IpAddr;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rustdds::no_key::{DataReaderCdr, DataWriterCdr};
use rustdds::policy::Reliability;
use rustdds::{DomainParticipant, DomainParticipantBuilder, ReadCondition, TopicKind};

use super::dds::{Dds, failed, qos};
use crate::RobotError;
use crate::unitree::rpc::{Identity, Request, RequestHeader, Response};

/// Topic and type of requests to the vendor's motion switcher.
const REQUEST: (&str, &str) = ("rt/api/motion_switcher/request", "unitree_api::msg::dds_::Request_");
/// Topic and type of its answers.
const RESPONSE: (&str, &str) = ("rt/api/motion_switcher/response", "unitree_api::msg::dds_::Response_");
/// Number of the request for the service's mode, from the vendor's SDK. The answer is for example
/// `{"form":"0","name":"normal"}`. After a release the name is empty.
const CHECK_MODE: i64 = 1001;
/// Number of the request to release the mode, from the same SDK.
const RELEASE_MODE: i64 = 1003;
/// A request is sent again so often: a service that is discovered later hears the next one.
const AGAIN: Duration = Duration::from_millis(250);
/// Time between two looks for an answer.
const LOOK: Duration = Duration::from_millis(5);

/// Answer of the motion service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MotionMode {
    /// It walks the robot, in the mode of this name.
    Active(String),
    /// It leaves the motors to others.
    Released,
    /// It did not answer: there is none, as in simulators, or it is not heard.
    Silent,
    /// It answered with an error of this number.
    Error(i32),
}

/// Asks a robot's motion switcher.
pub struct MotionSwitcher {
    requests: DataWriterCdr<Request>,
    responses: DataReaderCdr<Response>,
    /// Number of the last request.
    number: i64,
    // Ends the protocol when it is dropped: last.
    _participant: DomainParticipant,
}

impl MotionSwitcher {
    /// Joins `domain` on a network interface. Nothing is asked yet.
    ///
    /// # Errors
    /// As [`Dds::open`].
    pub fn open(interface: &str, domain: u16) -> Result<Self, RobotError> {
        let address = Dds::check(interface, domain)?;
        let participant = DomainParticipantBuilder::new(domain)
            .with_only_networks([IpAddr::V4(address)])
            .same_host_loopback(address.is_loopback())
            .build()
            .map_err(failed("join the domain"))?;
        let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) };
        let (sending, listening) = (qos(reliable), qos(Reliability::BestEffort));
        let topic = |(name, kind): (&str, &str), qos| {
            participant
                .create_topic(name.to_owned(), kind.to_owned(), qos, TopicKind::NoKey)
                .map_err(failed("make a topic"))
        };
        // The answers' reader is made before the first question, or an early answer would be missed.
        let subscriber = participant.create_subscriber(&listening).map_err(failed("listen"))?;
        let responses = subscriber
            .create_datareader_no_key_cdr(&topic(RESPONSE, &listening)?, Some(listening.clone()))
            .map_err(failed("listen to the motion service"))?;
        let publisher = participant.create_publisher(&sending).map_err(failed("send"))?;
        let requests = publisher
            .create_datawriter_no_key_cdr(&topic(REQUEST, &sending)?, Some(sending.clone()))
            .map_err(failed("ask the motion service"))?;
        // As the SDK: numbers that no earlier program used.
        let number = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |time| time.as_nanos() as i64);
        Ok(Self { requests, responses, number, _participant: participant })
    }

    /// Asks for the mode of the service; it has `patience` to answer.
    ///
    /// # Errors
    /// DDS that does not send.
    pub fn check(&mut self, patience: Duration) -> Result<MotionMode, RobotError> {
        let Some(response) = self.ask(CHECK_MODE, patience)? else { return Ok(MotionMode::Silent) };
        Ok(match response.header.status.code {
            0 => mode(&response.data),
            code => MotionMode::Error(code),
        })
    }

    /// Asks it to leave the motors to others, and then which mode it is in: again until it says that it did, or `patience`
    /// is over. A robot that stands sinks to the ground.
    ///
    /// # Errors
    /// DDS that does not send.
    pub fn release(&mut self, patience: Duration) -> Result<MotionMode, RobotError> {
        let begin = Instant::now();
        let left = || patience.saturating_sub(begin.elapsed());
        loop {
            // A release may take seconds, and its answer says nothing: what counts is the mode.
            // At most 1 s for the answer, which need not come.
            self.ask(RELEASE_MODE, left().min(4 * AGAIN))?;
            // The last look has 250 ms, also where the patience is over.
            let mode = self.check(left().max(AGAIN))?;
            if mode == MotionMode::Released || left().is_zero() {
                return Ok(mode);
            }
            std::thread::sleep(AGAIN.min(left()));
        }
    }

    /// The answer to a request without arguments; `None` where none came in time.
    fn ask(&mut self, api_id: i64, patience: Duration) -> Result<Option<Response>, RobotError> {
        let begin = Instant::now();
        let mut asked: Vec<Identity> = Vec::new();
        let mut due = Duration::ZERO;
        loop {
            if begin.elapsed() >= due {
                self.number += 1;
                let identity = Identity { id: self.number, api_id };
                let header = RequestHeader { identity, ..RequestHeader::default() };
                let request = Request { header, parameter: "{}".to_owned(), binary: Vec::new() };
                self.requests.write(request, None).map_err(failed("ask the motion service"))?;
                asked.push(identity);
                due += AGAIN;
            }
            // What cannot be read is none of ours.
            // 16 are all that the reader keeps (`DEPTH`).
            for sample in self.responses.take(16, ReadCondition::any()).unwrap_or_default() {
                let response = sample.into_value();
                // An answer to any of the questions will do, also a late one.
                if asked.contains(&response.header.identity) {
                    return Ok(Some(response));
                }
            }
            if begin.elapsed() >= patience {
                return Ok(None);
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// The mode of an answer.
fn mode(data: &str) -> MotionMode {
    let name = |value: serde_json::Value| value.get("name").and_then(|name| name.as_str().map(str::to_owned));
    match serde_json::from_str(data).ok().and_then(name) {
        Some(name) if name.is_empty() => MotionMode::Released,
        Some(name) => MotionMode::Active(name),
        // The SDK's example takes an answer without a name for a mode too.
        None => MotionMode::Active("without a name".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_read_and_what_is_no_answer_is_not_taken_for_a_release() {
        let active = |name: &str| MotionMode::Active(name.to_owned());
        assert_eq!(mode(r#"{"form":"0","name":"normal"}"#), active("normal"));
        assert_eq!(mode(r#"{"form":"0","name":""}"#), MotionMode::Released);
        for nothing in ["", "{}", "[1]", "{\"name\": 3}", "\u{0}"] {
            assert_eq!(mode(nothing), active("without a name"), "{nothing}");
        }
    }
}
