//! What can be wrong with NumPy's and PyTorch's files.

use gaitfit_model::shown;

/// Largest pickle in the archive, bytes: it holds names and shapes, not numbers.
pub(crate) const MAX_PICKLE: u64 = 64 << 20;

/// What is wrong with an archive of arrays, or with an array.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArchiveError {
    /// An archive that is damaged.
    #[error("zip: {0}")]
    Zip(String),
    /// An archive of something else.
    #[error("{0} files in it; is this a log?")]
    ManyFiles(usize),
    /// An array of NumPy.
    #[error("{}: {problem}", shown(name))]
    Array {
        /// Its name.
        name: String,
        /// The fault, and what to do.
        problem: ArrayProblem,
    },
    /// An archive that PyTorch did not write.
    #[error("it has no data.pkl")]
    NoPickle,
    /// Numbers in the other order of bytes.
    #[error("it was saved on a big-endian machine; save it again on this one")]
    BigEndian,
    /// A pickle that holds more than names and shapes.
    #[error("its data.pkl is larger than {MAX_PICKLE} bytes; save plain tensors")]
    LargePickle,
}

/// What is wrong with an array of NumPy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArrayProblem {
    /// No NumPy file.
    #[error("no NumPy array: its header is missing or too long")]
    NoHeader,
    /// What NumPy's header says is not understood.
    #[error("{0}")]
    Header(std::io::Error),
    /// Several quantities in one array.
    #[error("a structured array; save plain arrays, one a quantity")]
    Structured,
    /// More numbers than any file holds.
    #[error("its shape is too large")]
    Shape,
    /// A pickle in the array.
    #[error("an array of Python objects; save numbers: np.asarray(x, dtype=float)")]
    Objects,
    /// Numbers that logs do not have.
    #[error("a type of numbers that is not read; save it as float: np.asarray(x, dtype=float)")]
    Type,
    /// The file ends early.
    #[error("cut short: fewer numbers than its shape says")]
    CutShort,
    /// Words in no known encoding.
    #[error("words that are no text")]
    Words,
    /// The file ends within a number.
    #[error("cut short")]
    Torn,
}
