//! STL, binary and as a text.

use crate::rotation::Vec3;

/// Bytes before the triangles of a binary file, and of each.
const HEADER: usize = 84;
const FACET: usize = 50;

/// Triangles of a file. A text begins with `solid`; some binary files do so too, and have the size that their count says.
pub(super) fn read(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, String> {
    let count =
        bytes.get(80..HEADER).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]) as usize);
    let whole = count
        .is_some_and(|count| bytes.len() as u64 >= (HEADER + FACET) as u64 * u64::from(count > 0))
        && count.is_some_and(|count| bytes.len() as u64 >= HEADER as u64 + FACET as u64 * count as u64);
    if bytes.starts_with(b"solid")
        && !(whole && count.is_some_and(|count| bytes.len() == HEADER + FACET * count))
    {
        return read_text(bytes);
    }
    let Some(count) = count.filter(|_| whole) else {
        return Err("not STL: the file is shorter than its count of triangles says".to_owned());
    };
    if count > super::MAX_TRIANGLES {
        return Err(super::too_many());
    }
    let float = |facet: &[u8], place: usize| {
        let at = 12 + 4 * place;
        f64::from(f32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]]))
    };
    let corner = |facet: &[u8], corner: usize| std::array::from_fn(|k| float(facet, 3 * corner + k));
    let facets = bytes[HEADER..].chunks_exact(FACET).take(count);
    Ok(facets.map(|facet| std::array::from_fn(|index| corner(facet, index))).collect())
}

fn read_text(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, String> {
    let text = super::text(bytes)?;
    let mut triangles = Vec::new();
    let mut corners: Vec<Vec3> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let Some(rest) = line.trim_start().strip_prefix("vertex") else { continue };
        let numbers: Vec<f64> = rest.split_whitespace().map_while(|word| word.parse().ok()).collect();
        let [x, y, z] = numbers[..] else {
            return Err(format!("line {}: a vertex without three numbers", number + 1));
        };
        corners.push([x, y, z]);
        if let [a, b, c] = corners[..] {
            if triangles.len() >= super::MAX_TRIANGLES {
                return Err(super::too_many());
            }
            triangles.push([a, b, c]);
            corners.clear();
        }
    }
    if !corners.is_empty() {
        return Err("its last triangle is not complete".to_owned());
    }
    Ok(triangles)
}
