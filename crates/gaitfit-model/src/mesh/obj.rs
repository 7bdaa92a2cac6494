//! Wavefront OBJ: vertices and faces, which may have any number of corners.

use crate::rotation::Vec3;

/// Max number of vertices.
const MAX_VERTICES: usize = 3 * super::MAX_TRIANGLES;

pub(super) fn read(text: &str) -> Result<Vec<[Vec3; 3]>, String> {
    let mut points: Vec<Vec3> = Vec::new();
    let mut triangles = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let wrong = |what: &str| format!("line {}: {what}", number + 1);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                // A fourth number is a weight, or the first of a colour.
                let numbers: Vec<f64> = words.take(3).map_while(|word| word.parse().ok()).collect();
                let [x, y, z] = numbers[..] else { return Err(wrong("a vertex without three numbers")) };
                if points.len() >= MAX_VERTICES {
                    return Err(super::too_many());
                }
                points.push([x, y, z]);
            }
            Some("f") => {
                let corner = |word: &str| -> Option<usize> {
                    let index: i64 = word.split('/').next()?.parse().ok()?;
                    // Negative numbers count from the last vertex so far.
                    let from_zero = if index < 0 { points.len() as i64 + index } else { index - 1 };
                    usize::try_from(from_zero).ok()
                };
                let corners: Option<Vec<usize>> = words.map(corner).collect();
                let corners = corners.ok_or_else(|| wrong("a face with a corner that is no number"))?;
                let [first, rest @ ..] = &corners[..] else { return Err(wrong("a face without corners")) };
                if triangles.len() + rest.len() > super::MAX_TRIANGLES {
                    return Err(super::too_many());
                }
                for pair in rest.windows(2) {
                    let triangle = super::indexed(&points, [*first, pair[0], pair[1]]);
                    triangles.push(triangle.map_err(|what| wrong(&what))?);
                }
            }
            _ => {}
        }
    }
    Ok(triangles)
}
