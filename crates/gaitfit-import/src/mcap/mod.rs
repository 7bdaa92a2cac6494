//! MCAP files: records of an operation code, a length and a body (<https://mcap.dev/spec>). All numbers are little-endian.

mod log;
mod read;
mod records;

pub use log::{McapHead, McapLog, McapRow, McapState, mcap_bytes};
pub(crate) use read::read;

/// The first and last bytes of a file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Name of the metadata record that holds what messages do not contain.
const METADATA: &str = "gaitfit";

/// Operation codes of records.
mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const STATISTICS: u8 = 0x0b;
    pub const METADATA: u8 = 0x0c;
    pub const METADATA_INDEX: u8 = 0x0d;
    pub const SUMMARY_OFFSET: u8 = 0x0e;
    pub const DATA_END: u8 = 0x0f;
}
