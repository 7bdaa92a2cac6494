//! STL, binary and as a text.

use std::io::Cursor;

use super::ContentError;
use crate::rotation::Vec3;

/// Bytes before the triangles of a binary file (80 of text and a 32-bit count), and of each triangle (normal and
/// three corners as 12 floats, and 16 bits of attributes).
const HEADER: usize = 84;
const FACET: usize = 50;

/// Triangles of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, ContentError> {
    let mut bytes = bytes.to_vec();
    if bytes.starts_with(b"solid") && is_binary(&bytes) {
        // The reader would take a file that begins with "solid" for a text.
        bytes[0] = b' ';
    }
    let mut cursor = Cursor::new(bytes);
    let mut triangles = Vec::new();
    for triangle in stl_io::create_stl_reader(&mut cursor).map_err(ContentError::Stl)? {
        if triangles.len() >= super::MAX_TRIANGLES {
            return Err(ContentError::Triangles);
        }
        triangles.push(triangle.map_err(ContentError::Stl)?.vertices.map(|vertex| vertex.0.map(f64::from)));
    }
    Ok(triangles)
}

/// Whether a file has the size that a binary file's count of triangles says.
fn is_binary(bytes: &[u8]) -> bool {
    let count = bytes.get(HEADER - 4..HEADER).and_then(|word| <[u8; 4]>::try_from(word).ok());
    count.is_some_and(|word| {
        bytes.len() as u64 == HEADER as u64 + FACET as u64 * u64::from(u32::from_le_bytes(word))
    })
}
