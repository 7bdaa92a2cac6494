//! A recording of ROS 2 topics as it is made: messages as they came, in an MCAP file that may end at any moment.

use crate::ImportError;
use crate::ros::{is_known, whole_definition};
use gaitfit_model::shown;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use std::collections::BTreeMap;
use std::io::Write;

/// A recording that is being made. `sink` is given whole records and told to flush after each message.
pub struct Bag<W: Write> {
    writer: mcap::Writer<NoSeek<W>>,
    channels: Vec<u16>,
    sequence: u32,
}

impl<W: Write> Bag<W> {
    /// A recording of topics, each with its type, such as `/imu` and `sensor_msgs/msg/Imu`.
    ///
    /// # Errors
    /// A type that is not known here; what `sink` refuses.
    pub fn new(sink: W, topics: &[(&str, &str)]) -> Result<Self, ImportError> {
        // Written as it comes: a recording that is cut off must be readable up to there, so nothing waits in
        // a chunk for its end.
        let options = mcap::WriteOptions::new().use_chunks(false).disable_seeking(true).compression(None);
        let options = options.profile("ros2").library("gaitfit");
        let mut writer = options.create(NoSeek::new(sink)).map_err(|error| unwritten(&error))?;
        let mut channels = Vec::with_capacity(topics.len());
        for (topic, kind) in topics {
            let Some(definition) = whole_definition(kind).filter(|_| is_known(kind)) else {
                return Err(ImportError::Mapping {
                    problem: format!("topics: the type `{}` of `{}` is not known", shown(kind), shown(topic)),
                });
            };
            let schema = writer.add_schema(kind, "ros2msg", definition.as_bytes());
            let channel =
                schema.and_then(|schema| writer.add_channel(schema, topic, "cdr", &BTreeMap::new()));
            channels.push(channel.map_err(|error| unwritten(&error))?);
        }
        Ok(Self { writer, channels, sequence: 0 })
    }

    /// A message of the topic of this number, received `ns` after 1970. `bytes` are its CDR with the four bytes of its head.
    ///
    /// # Errors
    /// What the sink refuses.
    pub fn message(&mut self, topic: usize, ns: u64, bytes: &[u8]) -> Result<(), ImportError> {
        let Some(&channel_id) = self.channels.get(topic) else { return Ok(()) };
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time: ns, publish_time: ns };
        self.sequence = self.sequence.wrapping_add(1);
        let written = self.writer.write_to_known_channel(&header, bytes);
        written.and_then(|()| self.writer.flush()).map_err(|error| unwritten(&error))
    }

    /// Writes the end of the file; without it the file is read as well.
    ///
    /// # Errors
    /// What the sink refuses.
    pub fn finish(&mut self) -> Result<(), ImportError> {
        self.writer.finish().map(|_| ()).map_err(|error| unwritten(&error))
    }
}

fn unwritten(error: &mcap::McapError) -> ImportError {
    ImportError::Clock { stream: "the recording".into(), problem: error.to_string() }
}
