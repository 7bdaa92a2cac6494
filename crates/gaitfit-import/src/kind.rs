//! Which kind of file it is, by its first bytes.

use crate::budget::is_zstd;
use crate::{mcap, sqlite, torch};

/// First and last bytes of a Parquet file.
pub(crate) const PARQUET: &[u8] = b"PAR1";
/// First bytes of an Arrow file.
pub(crate) const ARROW: &[u8] = b"ARROW1\0\0";
/// First bytes of every Arrow message, and so of a stream.
pub(crate) const ARROW_MESSAGE: &[u8] = &[0xff; 4];
/// First bytes of an HDF5 file.
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Mcap,
    Sqlite,
    Zstd,
    Npy,
    Npz,
    Torch,
    Pickle,
    Parquet,
    Arrow,
    Hdf5,
    Feather1,
    Matlab,
    TorchLegacy,
    Ros1,
    Text,
}

impl Kind {
    /// Name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Mcap => "MCAP",
            Kind::Sqlite => "ROS 2 bag (db3)",
            Kind::Zstd => "Zstandard",
            Kind::Npy => "npy",
            Kind::Npz => "npz",
            Kind::Torch | Kind::TorchLegacy => "PyTorch",
            Kind::Pickle => "pickle",
            Kind::Parquet => "Parquet",
            Kind::Arrow => "Arrow",
            Kind::Hdf5 => "HDF5",
            Kind::Feather1 => "Feather",
            Kind::Matlab => "MATLAB",
            Kind::Ros1 => "ROS 1 bag",
            Kind::Text => "CSV",
        }
    }
}

/// The kind of a file that begins so; `None`: not known.
pub(crate) fn kind(bytes: &[u8]) -> Option<Kind> {
    let starts = |magic: &[u8]| bytes.starts_with(magic);
    if starts(mcap::MAGIC) {
        Some(Kind::Mcap)
    } else if starts(sqlite::MAGIC) {
        Some(Kind::Sqlite)
    } else if is_zstd(bytes) {
        Some(Kind::Zstd)
    } else if starts(b"\x93NUMPY") {
        Some(Kind::Npy)
    } else if starts(b"PK\x03\x04") || starts(b"PK\x05\x06") {
        // Both are zip archives.
        Some(if torch::is_torch(bytes) { Kind::Torch } else { Kind::Npz })
    } else if starts(PARQUET) {
        Some(Kind::Parquet)
    } else if starts(ARROW) || starts(ARROW_MESSAGE) {
        Some(Kind::Arrow)
    } else if starts(HDF5) {
        Some(Kind::Hdf5)
    } else if starts(b"FEA1") {
        Some(Kind::Feather1)
    } else if starts(b"MATLAB 5.0") {
        Some(Kind::Matlab)
    } else if starts(b"#ROSBAG V2.0") {
        Some(Kind::Ros1)
    } else if starts(b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19") {
        // The magic number that torch.save wrote before its archives.
        Some(Kind::TorchLegacy)
    // Pickles and texts have no sure mark, so they are looked for last.
    } else if is_pickle(bytes) || is_old_pickle(bytes) {
        Some(Kind::Pickle)
    // A text has no zero bytes.
    } else if !bytes.iter().take(4096).any(|byte| *byte == 0) && !bytes.is_empty() {
        Some(Kind::Text)
    } else {
        None
    }
}

/// Whether the file begins as a pickle of protocol 2 to 5.
fn is_pickle(bytes: &[u8]) -> bool {
    bytes.first() == Some(&0x80) && bytes.get(1).is_some_and(|protocol| *protocol <= 5)
}

/// Whether the file is a pickle of protocol 0 or 1, which has no magic number: it begins with the container's opcodes, or a
/// constructor's module, and ends with the opcode STOP.
fn is_old_pickle(bytes: &[u8]) -> bool {
    let begins =
        [b"(dp".as_slice(), b"(lp", b"(ip", b"(d.", b"(l.", b"}q", b"]q", b"(tp", b"ccopy_reg\n", b"cnumpy"];
    begins.iter().any(|begin| bytes.starts_with(begin)) && bytes.trim_ascii_end().ends_with(b".")
}
