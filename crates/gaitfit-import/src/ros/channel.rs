//! The messages of a bag's topics: from bytes to tables, on one clock.

use super::limits::{MAX_JSON, MAX_TOPICS};
use super::value::Value;
use super::{MessageError, cdr, message, schema};
use crate::budget::Budget;
use crate::known::{Role, UNITREE_GO, UNITREE_HG, is_action, is_command};
use crate::mapping::Mapping;
use crate::problem::Problem;
use crate::table::{MAX_COLUMNS, Source, Sparse, Table};
use gaitfit_model::shown;
use indexmap::IndexMap;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Memory of a field of a definition, in numbers of 8 bytes.
const FIELD_VALUES: usize = 10;

/// A topic as a bag describes it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Channel {
    pub topic: String,
    /// Type, such as `sensor_msgs/msg/JointState`.
    pub kind: Rc<str>,
    /// `cdr` or `json`.
    pub encoding: String,
    /// Definition of the type, if the bag has it.
    pub definition: Rc<str>,
}

struct Stream {
    channel: Channel,
    schema: Result<schema::Schema, MessageError>,
    joints: Role,
    /// Recorder's times, ns.
    logged: Vec<i64>,
    /// Times of the messages' headers, ns; as many as `logged`, or some messages have none.
    stamped: Vec<i64>,
    sparse: Sparse,
    /// Messages that could not be decoded, and why the first could not.
    damaged: (usize, String),
    /// Messages whose fields are not known.
    unknown: usize,
}

/// Collects the messages of a bag.
pub(crate) struct Messages<'a> {
    mapping: &'a Mapping,
    streams: IndexMap<(String, Rc<str>), Stream>,
    /// Metadata of a file that this program wrote.
    metadata: BTreeMap<String, String>,
}

impl<'a> Messages<'a> {
    pub fn new(mapping: &'a Mapping) -> Self {
        Messages { mapping, streams: IndexMap::new(), metadata: BTreeMap::new() }
    }

    /// Takes the metadata of a file that this program wrote.
    pub fn take_metadata(&mut self, entries: BTreeMap<String, String>) {
        self.metadata = entries;
    }

    /// The number to give with the topic's messages.
    pub fn channel(&mut self, channel: Channel, budget: &mut Budget) -> Result<usize, Problem> {
        let key = (channel.topic.clone(), channel.kind.clone());
        if let Some(number) = self.streams.get_index_of(&key) {
            return Ok(number);
        }
        if self.streams.len() >= MAX_TOPICS {
            return Err(MessageError::Topics.into());
        }
        let parts: Vec<&str> = channel.topic.split('/').collect();
        let streams = &self.mapping.streams;
        // What the mapping says, then what the topic's name suggests; anything else is a state.
        let joints = if streams.action.contains(&channel.topic) {
            Role::Action
        } else if streams.target.contains(&channel.topic) || is_command(&parts) {
            Role::Target
        } else if is_action(&parts) {
            Role::Action
        } else {
            Role::Position
        };
        let schema = match channel.encoding.as_str() {
            "json" => Ok(schema::Schema { types: Vec::new() }),
            "cdr" | "" => schema::parse(&channel.kind, &channel.definition),
            other => Err(MessageError::Encoding(other.to_owned())),
        };
        // Each topic has its own fields, though thousands may share one text.
        let fields = schema.as_ref().map_or(0, |schema| schema.types.iter().map(Vec::len).sum());
        budget.take_values(fields * FIELD_VALUES)?;
        let stream = Stream {
            channel,
            schema,
            joints,
            logged: Vec::new(),
            stamped: Vec::new(),
            sparse: Sparse::default(),
            damaged: (0, String::new()),
            unknown: 0,
        };
        self.streams.insert(key, stream);
        Ok(self.streams.len() - 1)
    }

    /// Whether a topic's messages are looked at.
    fn wanted(&self, topic: &str) -> bool {
        let take = &self.mapping.streams.take;
        take.is_empty() || take.iter().any(|name| name == topic)
    }

    /// Adds a message of the topic with that number, received at `log_ns`.
    pub fn message(
        &mut self,
        number: usize,
        log_ns: i64,
        bytes: &[u8],
        budget: &mut Budget,
    ) -> Result<(), Problem> {
        let named = self.mapping.streams.take.len();
        let Some((_, stream)) = self.streams.get_index(number) else { return Ok(()) };
        if !self.wanted(&stream.channel.topic) {
            return Ok(());
        }
        let Some((_, stream)) = self.streams.get_index_mut(number) else { return Ok(()) };
        // A topic of which 100 messages could not be read is not tried again: decoding is the slow part.
        if stream.sparse.columns.is_empty() && stream.unknown + stream.damaged.0 >= 100 {
            return Ok(());
        }
        let Ok(schema) = &stream.schema else { return Ok(()) };
        let decoded = match stream.channel.encoding.as_str() {
            "json" if bytes.len() > MAX_JSON => Err(MessageError::LongJson),
            "json" => serde_json::from_slice(bytes)
                .map(|json| Value::from_json(&json))
                .map_err(|e| MessageError::Json(e.to_string())),
            _ => cdr::decode(schema, bytes),
        };
        let value = match decoded {
            Ok(value) => value,
            Err(problem) => {
                if stream.damaged.0 == 0 {
                    stream.damaged.1 = problem.to_string();
                }
                stream.damaged.0 += 1;
                return Ok(());
            }
        };
        let mut columns = message::columns(&value, stream.joints);
        // A topic that was asked for by name is taken with all its numbers, known or not.
        if columns.is_empty() && named > 0 {
            columns = message::flat(&value);
        }
        if columns.is_empty() {
            stream.unknown += 1;
            return Ok(());
        }
        // A number takes 8 bytes and its row 4; two times and the bookkeeping of the row take the rest.
        budget.take_values(columns.len() + columns.len() / 2 + 3)?;
        let row = u32::try_from(stream.logged.len()).map_err(|_| MessageError::ManyMessages)?;
        stream.logged.push(log_ns);
        // A message without a stamp adds none; then the stream goes by the recorder's times.
        stream.stamped.extend(message::stamp_ns(&value));
        for (name, number) in columns {
            if stream.sparse.columns.len() >= MAX_COLUMNS && !stream.sparse.columns.contains_key(&name) {
                return Err(MessageError::Columns(stream.channel.topic.clone()).into());
            }
            let (rows, values) = stream.sparse.columns.entry(name).or_default();
            // A name that is there twice counts once.
            if rows.last() != Some(&row) {
                rows.push(row);
                values.push(number);
            }
        }
        Ok(())
    }

    /// Tables of all topics on the clock of the joints' positions.
    pub fn finish(self, kind: &'static str) -> Result<Source, Problem> {
        let mut source = Source { kind, messages: true, ..Source::default() };
        let topics = || self.streams.keys().map(|(topic, _)| topic);
        let wanted = self.mapping.streams.take.iter();
        source.taken = wanted.filter(|wanted| topics().any(|topic| topic == *wanted)).cloned().collect();
        source.takeable = topics().take(20).cloned().collect();
        if let Some(missing) =
            self.mapping.streams.take.iter().find(|wanted| !topics().any(|topic| topic == *wanted))
            && source.taken.is_empty()
        {
            let found = source.takeable.iter().map(|topic| shown(topic)).collect::<Vec<_>>().join(", ");
            return Err(MessageError::NoTopic { wanted: missing.clone(), found }.into());
        }
        // Lists as Rust prints them are JSON too.
        let numbers = |name: &str| serde_json::from_str::<Vec<f64>>(self.metadata.get(name)?).ok();
        source.gains = numbers("kp").zip(numbers("kd"));
        source.robot = self.metadata.get("robot").cloned();
        source.fell = self.metadata.get("fell").is_some_and(|text| text == "true");
        let mut read: Vec<Stream> = Vec::new();
        for ((topic, kind), stream) in self.streams {
            let take = &self.mapping.streams.take;
            let count = stream.logged.len();
            let reason = match &stream.schema {
                _ if !take.is_empty() && !take.contains(&topic) => {
                    "not named by `--take` or `streams.take`".to_owned()
                }
                Err(problem) => problem.to_string(),
                Ok(_) if count == 0 && stream.damaged.0 > 0 => stream.damaged.1.clone(),
                Ok(_) if count == 0 => "nothing of a log in it".to_owned(),
                Ok(_) => {
                    if stream.damaged.0 + stream.unknown > 0 {
                        let reason =
                            if stream.damaged.0 > 0 { &stream.damaged.1 } else { "no joints in them" };
                        let lost = stream.damaged.0 + stream.unknown;
                        source.left_out.push(format!("{topic}: {lost} messages: {reason}"));
                    }
                    read.push(stream);
                    continue;
                }
            };
            source.left_out.push(format!("{} ({}): {reason}", shown(&topic), shown(&kind)));
        }
        if read.is_empty() {
            let found = source.left_out.iter().take(20).cloned().collect::<Vec<_>>().join("; ");
            return Err(MessageError::NothingKnown { found }.into());
        }
        let unitree = |package: &str| {
            read.iter().any(|stream| schema::short_name(&stream.channel.kind).starts_with(package))
        };
        source.usual_joints = match () {
            () if unitree("unitree_hg/") => Some(&UNITREE_HG),
            () if unitree("unitree_go/") => Some(&UNITREE_GO),
            () => None,
        };
        // All streams onto the clock of the joints' positions, with the time of their first sample as 0.
        let clocks: Vec<Clock> = read.iter().map(Clock::from_stream).collect();
        let state =
            read.iter().position(|stream| stream.sparse.columns.keys().any(|name| name.starts_with("q_")));
        let state = state.unwrap_or(0);
        // Messages may come out of order.
        let origin = clocks[state].times(&read[state]).iter().copied().min().unwrap_or(0);
        source.origin_ns = origin;
        // Half an interval of the states: a smaller difference of clocks does not move a message to another
        // row.
        let half =
            median(clocks[state].times(&read[state]).windows(2).map(|pair| pair[1].saturating_sub(pair[0])))
                .unwrap_or(0)
                / 2;
        for (i, (mut stream, clock)) in read.into_iter().zip(&clocks).enumerate() {
            // On the recorder's clock both streams are `behind` later than their stamps.
            let behind = clock.behind.saturating_sub(clocks[state].behind);
            let same = clock.stamped == clocks[state].stamped;
            let shift = match self.mapping.clock_offset_s {
                // `import` adds the stated offset, for files of all kinds.
                Some(_) => 0,
                None if i == state || (same && behind.abs() <= half) => 0,
                None => behind,
            };
            if shift != 0 {
                source.assumed.push(format!(
                    "{}: its clock is {:.3} ms ahead of that of {} by the recorder's times; corrected",
                    stream.channel.topic,
                    -(shift as f64) / 1e6,
                    clocks[state].topic
                ));
            }
            let seconds = |ns: &i64| ns.saturating_add(shift).saturating_sub(origin) as f64 / 1e9;
            stream.sparse.time = clock.times(&stream).iter().map(seconds).collect();
            let named = if clock.stamped { "header stamps" } else { "the recorder's times" };
            let mut tables: Vec<Table> =
                std::mem::take(&mut stream.sparse).split(&stream.channel.topic, named, None);
            if shift != 0 {
                // The middle of the recorder's delays is not exact.
                // A quarter of an interval, s.
                tables.iter_mut().for_each(|table| table.slack = half as f64 / 2e9);
            }
            source.tables.extend(tables);
        }
        Ok(source)
    }
}

/// The times of a stream that are taken.
struct Clock {
    topic: String,
    /// Header stamps, not the recorder's times.
    stamped: bool,
    /// Time by which the recorder's times are later, ns; the middle one.
    behind: i64,
}

impl Clock {
    fn from_stream(stream: &Stream) -> Clock {
        let topic = stream.channel.topic.clone();
        let whole = stream.stamped.len() == stream.logged.len();
        let backward = stream.stamped.windows(2).filter(|pair| pair[1] <= pair[0]).count();
        // Stamps that stand still or jump back are not measured times.
        if !whole || backward * 10 > stream.stamped.len() {
            return Clock { topic, stamped: false, behind: 0 };
        }
        let behind = stream.logged.iter().zip(&stream.stamped).map(|(log, stamp)| log.saturating_sub(*stamp));
        Clock { topic, stamped: true, behind: median(behind).unwrap_or(0) }
    }

    fn times<'a>(&self, stream: &'a Stream) -> &'a [i64] {
        if self.stamped { &stream.stamped } else { &stream.logged }
    }
}

/// The middle value.
fn median(values: impl Iterator<Item = i64>) -> Option<i64> {
    let mut values: Vec<i64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() { None } else { Some(*values.select_nth_unstable(middle).1) }
}
