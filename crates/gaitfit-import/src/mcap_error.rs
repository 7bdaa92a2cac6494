//! What can be wrong with an MCAP file.

use gaitfit_model::shown;

/// What is wrong with an MCAP file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum McapError {
    /// Other first bytes.
    #[error("it does not begin as MCAP files do")]
    NotMcap,
    /// Chunks that are packed by another program.
    #[error("chunks packed by `{}`; zstd and lz4 are read", shown(.0))]
    Packer(String),
    /// A record states a length that it does not have.
    #[error("a record is damaged: a text in it is longer than the record")]
    TextBeyond,
    /// A record that cannot be read.
    #[error("a record is damaged: {0}")]
    Damaged(String),
}
