//! Triangles of mesh files: STL, OBJ, Collada and MuJoCo's MSH.
//!
//! The engine collides no meshes. They are read to fit spheres, capsules, cylinders and boxes to feet ([`crate::Outline`]),
//! to weigh links without inertia, and to draw robots ([`crate::Looks`]). Only positions count; normals, colours and
//! textures are passed over.

mod collada;
mod collapse;
mod content;
mod measure;
mod obj;
mod stl;
mod thin;

use std::path::Path;

use crate::rotation::Vec3;
use crate::shown::shown_path;

pub use content::ContentError;
pub use measure::Measure;
pub(crate) use thin::Pool;
pub use thin::ThinMesh;

// A binary STL of `MAX_TRIANGLES` triangles has 25 MiB.
/// Max size of a mesh file, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Max number of triangles that are kept of a file.
const MAX_TRIANGLES: usize = 1 << 19;
/// Coordinates beyond this are no part of a robot, in the file's unit: 10 m of a file in millimetres.
pub(crate) const MAX_COORDINATE: f64 = 1e4;

/// A mesh: the corners of its triangles, in the file's unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Three corners each.
    pub triangles: Vec<[Vec3; 3]>,
}

/// Why a mesh cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Io {
        /// The file.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// It is no mesh that can be read.
    #[error("{file}: {source}")]
    Content {
        /// The file.
        file: String,
        /// What is wrong.
        source: ContentError,
    },
}

/// Reads a mesh file; its ending names the format.
///
/// # Errors
/// A file that is missing, too large, of another format, damaged, or without triangles.
pub fn read(path: &Path) -> Result<Mesh, MeshError> {
    let file = || shown_path(path);
    let io = |source| MeshError::Io { file: file(), source };
    let metadata = std::fs::metadata(path).map_err(io)?;
    let content = |source| MeshError::Content { file: file(), source };
    // A device or a pipe may never end.
    if !metadata.is_file() || metadata.len() > MAX_BYTES {
        return Err(content(ContentError::Size));
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    let bytes = std::fs::read(path).map_err(io)?;
    parse(&ending, &bytes).map_err(content)
}

/// Reads the bytes of a mesh file with the ending `ending`, in small letters.
///
/// # Errors
/// The fault of the bytes.
pub fn parse(ending: &str, bytes: &[u8]) -> Result<Mesh, ContentError> {
    let triangles = match ending {
        "stl" => stl::read(bytes)?,
        "obj" => obj::read(text(bytes)?)?,
        "dae" => collada::read(text(bytes)?)?,
        "msh" => msh(bytes)?,
        _ => return Err(ContentError::Format),
    };
    if triangles.is_empty() {
        return Err(ContentError::Empty);
    }
    // NaN fails the comparison too.
    let plausible = |point: &Vec3| point.iter().all(|x| x.abs() < MAX_COORDINATE);
    if !triangles.iter().flatten().all(plausible) {
        return Err(ContentError::Coordinates);
    }
    Ok(Mesh { triangles })
}

fn text(bytes: &[u8]) -> Result<&str, ContentError> {
    std::str::from_utf8(bytes).map_err(|_| ContentError::Text)
}

/// Triangles of the corners `faces`, with indices into `points`.
fn indexed(points: &[Vec3], corners: [usize; 3]) -> Result<[Vec3; 3], ContentError> {
    let point = |index: usize| points.get(index).copied().ok_or(ContentError::Vertex);
    Ok([point(corners[0])?, point(corners[1])?, point(corners[2])?])
}

/// MuJoCo's own format: four counts as 32-bit integers (vertices, normals, texture coordinates, faces), then as many vertices
/// as three 32-bit floats each, normals, texture coordinates, and faces as three 32-bit integers, all little-endian.
fn msh(bytes: &[u8]) -> Result<Vec<[Vec3; 3]>, ContentError> {
    let words: Vec<[u8; 4]> =
        bytes.chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]]).collect();
    let count = |place: usize| {
        let word = words.get(place).copied().map(i32::from_le_bytes);
        word.and_then(|count| usize::try_from(count).ok()).ok_or(ContentError::Msh)
    };
    let (vertices, normals, texture, faces) = (count(0)?, count(1)?, count(2)?, count(3)?);
    if faces > MAX_TRIANGLES {
        return Err(ContentError::Triangles);
    }
    // In 64 bits, because counts of a damaged file may add up to more than 32.
    let begins = [3 * vertices as u64, 3 * normals as u64, 2 * texture as u64, 3 * faces as u64];
    if begins.iter().sum::<u64>() + 4 != words.len() as u64 {
        return Err(ContentError::Msh);
    }
    let float = |word: &[u8; 4]| f64::from(f32::from_le_bytes(*word));
    // The counts add up to the file's size, so these slices stay inside of it.
    let points: Vec<Vec3> = words[4..4 + 3 * vertices]
        .chunks_exact(3)
        .map(|point| [float(&point[0]), float(&point[1]), float(&point[2])])
        .collect();
    // Faces come last: normals and texture coordinates before them are skipped.
    let last = &words[words.len() - 3 * faces..];
    // A negative index becomes one that no vertex has.
    let index = |word: &[u8; 4]| usize::try_from(i32::from_le_bytes(*word)).unwrap_or(usize::MAX);
    last.chunks_exact(3)
        .map(|face| indexed(&points, [index(&face[0]), index(&face[1]), index(&face[2])]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube with corners at 0 and 1, as vertices and faces counted from zero.
    fn cube() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let corner = |index: usize| [index & 1, index >> 1 & 1, index >> 2 & 1].map(|bit| bit as f32);
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        ((0..8).map(corner).collect(), faces)
    }

    fn in_format(ending: &str) -> Vec<u8> {
        let (points, faces) = cube();
        let of_face = |face: &[u32; 3]| face.map(|index| points[index as usize]);
        let mut bytes = Vec::new();
        match ending {
            "stl" => {
                bytes.extend([0; 80]);
                bytes.extend((faces.len() as u32).to_le_bytes());
                for face in &faces {
                    bytes.extend([0; 12]);
                    bytes.extend(of_face(face).iter().flatten().flat_map(|x| x.to_le_bytes()));
                    bytes.extend([0; 2]);
                }
            }
            "obj" => {
                let lines = points.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
                bytes.extend(lines.collect::<String>().bytes());
                let lines = faces.iter().map(|[a, b, c]| format!("f {}/1 {}//2 {}\n", a + 1, b + 1, c + 1));
                bytes.extend(lines.collect::<String>().bytes());
            }
            "dae" => {
                let numbers: String = points.iter().flatten().map(|x| format!("{x} ")).collect();
                let corners: String = faces.iter().flatten().map(|index| format!("{index} 0 ")).collect();
                bytes.extend(format!(
                    "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\"><asset><unit meter=\"0.5\"/></asset>\
                     <library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"a\" \
                     count=\"24\">{numbers}</float_array></source><vertices id=\"v\"><input semantic=\"POSITION\" \
                     source=\"#p\"/></vertices><triangles count=\"12\"><input semantic=\"VERTEX\" source=\"#v\" \
                     offset=\"0\"/><input semantic=\"NORMAL\" source=\"#n\" offset=\"1\"/><p>{corners}</p></triangles>\
                     </mesh></geometry></library_geometries><library_visual_scenes><visual_scene><node><scale>2 2 \
                     2</scale><instance_geometry url=\"#g\"/></node></visual_scene></library_visual_scenes></COLLADA>"
                ).bytes());
            }
            _ => {
                let counts = [8, 0, 0, faces.len() as i32];
                bytes.extend(counts.iter().flat_map(|count| count.to_le_bytes()));
                bytes.extend(points.iter().flatten().flat_map(|x| x.to_le_bytes()));
                bytes.extend(faces.iter().flatten().flat_map(|index| index.to_le_bytes()));
            }
        }
        bytes
    }

    #[test]
    #[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
    fn a_cube_is_the_same_in_every_format() {
        let cube = parse("stl", &in_format("stl")).unwrap();
        assert_eq!(cube.triangles.len(), 12);
        for ending in ["obj", "dae", "msh"] {
            assert_eq!(parse(ending, &in_format(ending)).unwrap(), cube, "{ending}");
        }
        let facet = |[a, b, c]: &[Vec3; 3]| {
            let vertex = |[x, y, z]: &Vec3| format!("vertex {x} {y} {z}\n");
            format!(
                "facet normal 0 0 0\nouter loop\n{}{}{}endloop\nendfacet\n",
                vertex(a),
                vertex(b),
                vertex(c)
            )
        };
        let text = format!("solid cube\n{}endsolid", cube.triangles.iter().map(facet).collect::<String>());
        assert_eq!(parse("stl", text.as_bytes()).unwrap(), cube);
        let measure = Measure::new(&cube).unwrap();
        assert!((measure.volume - 1.0).abs() < 1e-12);
        assert!(measure.centre.iter().all(|x| (x - 0.5).abs() < 1e-12));
        // A cube of density 1: m a²/6 about each axis.
        assert!(measure.moments.iter().all(|moment| (moment - 1.0 / 6.0).abs() < 1e-12), "{measure:?}");
    }

    #[test]
    fn damaged_meshes_are_refused() {
        for ending in ["stl", "obj", "dae", "msh"] {
            let whole = in_format(ending);
            for cut in [0, 3, 20, 85, whole.len() - 1] {
                if let Ok(mesh) = parse(ending, &whole[..cut]) {
                    // A shorter text may be a mesh of its own.
                    assert!(ending == "obj" && !mesh.triangles.is_empty(), "{ending} {cut}");
                }
            }
        }
        for text in
            ["v 0 0 0\nf 1 2 3", "v 0 nan 0\nf 1 1 1", "v 0 0 1e30\nf 1 1 1", "v 0 0\nf 1 1 1", "f -1 -2 -3"]
        {
            assert!(parse("obj", text.as_bytes()).is_err(), "{text}");
        }
        let mut huge = vec![0; 80];
        huge.extend(u32::MAX.to_le_bytes());
        assert!(parse("stl", &huge).is_err() && parse("blend", &huge).is_err());
    }
}
