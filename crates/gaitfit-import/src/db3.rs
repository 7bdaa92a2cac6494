//! ROS 2 bags of the kind db3 (`rosbag2_storage_sqlite3`).

use crate::budget::{Budget, unzstd};
use crate::problem::Problem;
use crate::ros::{Channel, Messages};
use crate::sqlite::{Database, TableInfo, needed};
use crate::sqlite_error::SqliteError;
use std::collections::HashMap;
use std::rc::Rc;

/// The first bytes of a Zstandard frame: messages that were packed one by one.
const ZSTD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// Adds all messages of a bag. Bags before Iron do not hold the definitions of their types; those of ROS and Unitree are
/// known here.
pub(crate) fn read(bytes: &[u8], messages: &mut Messages<'_>, budget: &mut Budget) -> Result<(), Problem> {
    let database = Database::open(bytes)?;
    let mut definitions: HashMap<String, Rc<str>> = HashMap::new();
    if let Some(table) = database.table("message_definitions")?
        && let (Some(kind), Some(encoding), Some(text)) =
            (table.column("topic_type"), table.column("encoding"), table.column("encoded_message_definition"))
    {
        database.each(&table, &mut |cells| {
            let word = |column: usize| cells.get(column).and_then(|cell| cell.text());
            // Other encodings (IDL) are not understood. Types that are known here need no definition.
            if let (Some(kind), Some("ros2msg"), Some(text)) = (word(kind), word(encoding), word(text)) {
                budget.take_bytes(text.len())?;
                definitions.insert(kind.to_owned(), text.into());
            }
            Ok(())
        })?;
    }

    // Topics before messages, which name them by number.
    let table = needed(&database, "topics")?;
    let column =
        |table: &TableInfo, name: &'static str| table.column(name).ok_or(SqliteError::NoColumn(name));
    let (id, name, kind) = (column(&table, "id")?, column(&table, "name")?, column(&table, "type")?);
    let format = table.column("serialization_format");
    let mut topics: HashMap<i64, usize> = HashMap::new();
    database.each(&table, &mut |cells| {
        let word = |column: usize| cells.get(column).and_then(|cell| cell.text());
        let number = cells.get(id).and_then(|cell| cell.integer());
        if let (Some(number), Some(topic), Some(kind)) = (number, word(name), word(kind)) {
            let definition = definitions.get(kind).cloned().unwrap_or_default();
            let encoding = format.and_then(word).unwrap_or("cdr").to_owned();
            let channel = Channel { topic: topic.to_owned(), kind: kind.into(), encoding, definition };
            topics.insert(number, messages.channel(channel, budget)?);
        }
        Ok(())
    })?;

    let table = needed(&database, "messages")?;
    let (topic, time, data) =
        (column(&table, "topic_id")?, column(&table, "timestamp")?, column(&table, "data")?);
    database.each(&table, &mut |cells| {
        let number = |column: usize| cells.get(column).and_then(|cell| cell.integer());
        let (Some(topic), Some(time)) = (number(topic), number(time)) else { return Ok(()) };
        let (Some(topic), Some(crate::sqlite::Cell::Blob(data))) = (topics.get(&topic), cells.get(data))
        else {
            return Ok(());
        };
        // Bags may pack each message by itself.
        if data.starts_with(ZSTD) {
            let unpacked = unzstd(data, budget)?;
            return messages.message(*topic, time, &unpacked, budget);
        }
        messages.message(*topic, time, data, budget)
    })
}
