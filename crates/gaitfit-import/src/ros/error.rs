//! What can be wrong with a message or its definition.

use super::limits::{DEEPEST, MAX_BYTES, MAX_FIELDS, MAX_JSON, MAX_NAME, MAX_TOPICS, MAX_TYPES};
use crate::table::MAX_COLUMNS;
use gaitfit_model::shown;

/// What is wrong with a message or its definition.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MessageError {
    /// A definition that no message needs.
    #[error("a definition of more than {MAX_BYTES} bytes")]
    DefinitionBytes,
    /// The same.
    #[error("a definition of more than {MAX_TYPES} types")]
    DefinitionTypes,
    /// The same.
    #[error("a definition of more than {MAX_FIELDS} fields")]
    DefinitionFields,
    /// The same.
    #[error("a type's name of more than {MAX_NAME} bytes")]
    TypeName,
    /// A line of `=` without `MSG:` in the next line.
    #[error("a separator without the name of a type after it")]
    Separator,
    /// A type that neither the file nor this program defines.
    #[error("no definition of `{}` in the file", shown(.0))]
    NoDefinition(String),
    /// A line of a definition.
    #[error("`{}` is no field", shown(.0))]
    Field(String),
    /// Another encoding than CDR and JSON.
    #[error("messages in encoding `{}`; cdr and json are read", shown(.0))]
    Encoding(String),
    /// Too many topics.
    #[error("more than {MAX_TOPICS} topics; is this a bag?")]
    Topics,
    /// A message without a head.
    #[error("a message of less than four bytes")]
    NoHead,
    /// The first two bytes of a message.
    #[error("encoding {:02x}{:02x} of a message; plain CDR is read", .0[0], .0[1])]
    Cdr([u8; 2]),
    /// Types that hold each other.
    #[error("types in types, more than {DEEPEST} deep")]
    Deep,
    /// A field of a type that the definition lacks.
    #[error("a type that is not there")]
    NoType,
    /// Elements that take no bytes, more of them than any message needs.
    #[error("more elements than bytes")]
    Elements,
    /// A sequence states a length that the message does not have.
    #[error("a sequence longer than its message")]
    Sequence,
    /// A message of CDR version 2 whose sizes are not those of its definition.
    #[error(
        "a message in XCDR2 whose sizes are not those of final types; record with another DDS implementation, or with \
         the first version of CDR"
    )]
    Length,
    /// A text or a type where a number is.
    #[error("no number")]
    NotANumber,
    /// The message ends before its fields do.
    #[error("a message that is cut short, or of another definition")]
    CutShort,
    /// A large message in JSON: decoded it takes many times its size.
    #[error("a message of more than {MAX_JSON} bytes in JSON")]
    LongJson,
    /// A message that is no JSON.
    #[error("{0}")]
    Json(String),
    /// More messages than can be counted.
    #[error("too many messages; cut the bag")]
    ManyMessages,
    /// A topic whose messages name many joints.
    #[error("{}: more than {MAX_COLUMNS} columns", shown(.0))]
    Columns(String),
    /// A topic that the caller asked for is not there.
    #[error(
        "no topic is called `{}`, which `--take` or `streams.take` names; there is {found}",
        shown(wanted)
    )]
    NoTopic {
        /// The topic asked for.
        wanted: String,
        /// Topics that are there.
        found: String,
    },
    /// No topic holds what a log needs.
    #[error("no messages with joints, commands or an IMU; found {found}")]
    NothingKnown {
        /// What was left out, with the reasons.
        found: String,
    },
}
