//! Which kind of file it is, by its first bytes.

use crate::{mcap, sqlite, torch};

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
    } else if starts(&[0x28, 0xb5, 0x2f, 0xfd]) {
        Some(Kind::Zstd)
    } else if starts(b"\x93NUMPY") {
        Some(Kind::Npy)
    } else if starts(b"PK\x03\x04") || starts(b"PK\x05\x06") {
        Some(if torch::is_torch(bytes) { Kind::Torch } else { Kind::Npz })
    } else if starts(b"PAR1") {
        Some(Kind::Parquet)
    } else if starts(b"ARROW1") {
        Some(Kind::Arrow)
    } else if starts(b"\x89HDF\r\n\x1a\n") {
        Some(Kind::Hdf5)
    } else if starts(b"MATLAB 5.0") {
        Some(Kind::Matlab)
    } else if starts(b"#ROSBAG V2.0") {
        Some(Kind::Ros1)
    } else if starts(b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19") {
        // The magic number that torch.save wrote before its archives.
        Some(Kind::TorchLegacy)
    } else if bytes.first() == Some(&0x80) && bytes.get(1).is_some_and(|protocol| *protocol <= 5) {
        Some(Kind::Pickle)
    } else if !bytes.iter().take(4096).any(|byte| *byte == 0) && !bytes.is_empty() {
        Some(Kind::Text)
    } else {
        None
    }
}
