//! What can be wrong when a file is unpacked: it would take too much memory, or is damaged.

/// A file needs more memory than the caller allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BudgetError {
    /// Numbers beyond [`crate::Options::max_values`].
    #[error("more than {limit} numbers; cut the recording, or raise `max_values`")]
    Values {
        /// How many are allowed.
        limit: usize,
    },
    /// Bytes beyond four times [`crate::Options::max_bytes`].
    #[error("more than {limit} bytes when unpacked; cut the recording, or raise `max_bytes`")]
    Bytes {
        /// How many are allowed.
        limit: usize,
    },
}

/// A packed part of a file is damaged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnpackError {
    /// It ends early, or its content does not fit.
    #[error("{packer}: {source}; the file is damaged")]
    Damaged {
        /// How it is packed.
        packer: &'static str,
        /// What the unpacker says.
        source: std::io::Error,
    },
    /// A Zstandard frame that does not begin as one.
    #[error("zstd: {0}")]
    NoFrame(String),
}
