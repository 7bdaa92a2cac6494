//! What can be wrong with the bytes of a mesh.

use super::{MAX_BYTES, MAX_COORDINATE, MAX_TRIANGLES};

/// Max depth of nodes.
pub(super) const MAX_DEPTH: usize = 64;
/// Max number of numbers and nodes that are read: a scene may name one geometry, or itself, many times.
pub(super) const MAX_WORK: usize = 1 << 24;

/// What is wrong with a mesh's bytes.
#[derive(Debug, thiserror::Error)]
pub enum ContentError {
    /// A folder, a device, or too many bytes.
    #[error("not a regular file of at most {} MiB", MAX_BYTES >> 20)]
    Size,
    /// An ending that is read by nobody.
    #[error("not one of the mesh formats STL, OBJ, Collada (.dae) and MSH")]
    Format,
    /// No triangles.
    #[error("a mesh without triangles")]
    Empty,
    /// Corners that are nowhere near a robot.
    #[error("coordinates that are no numbers, or beyond {MAX_COORDINATE} units")]
    Coordinates,
    /// Too many triangles.
    #[error("more than {MAX_TRIANGLES} triangles; decimate it")]
    Triangles,
    /// Bytes that are no text.
    #[error("not a text in UTF-8")]
    Text,
    /// A corner that is no vertex.
    #[error("a face names no vertex")]
    Vertex,
    /// MSH whose counts are not its size.
    #[error("not MuJoCo's format: counts, vertices, normals, texture coordinates, faces")]
    Msh,
    /// Damaged STL.
    #[error("not STL: {0}")]
    Stl(std::io::Error),
    /// Damaged OBJ.
    #[error(transparent)]
    Obj(#[from] tobj::LoadError),
    /// Collada that is no XML.
    #[error(transparent)]
    Xml(#[from] roxmltree::Error),
    /// A face of a Collada file with fewer numbers than it has corners.
    #[error("a face without its corners")]
    Corners,
    /// Triangles of a Collada file whose vertices are not there.
    #[error("triangles without positions")]
    Positions,
    /// Faces of a Collada file with holes.
    #[error("polygons with holes (<ph>); save the mesh as triangles")]
    Holes,
    /// A word among the numbers of a Collada file.
    #[error("a list with a word that is no number")]
    Number,
    /// Collada nodes within nodes without an end.
    #[error("nodes deeper than {MAX_DEPTH}")]
    Depth,
    /// A Collada file with too many attributes, namespaces, nodes, or too deep.
    #[error("{0}")]
    Tags(String),
    /// A Collada scene that is far larger than its file.
    #[error("more than {MAX_WORK} numbers and nodes; decimate it")]
    Work,
    /// A transform of a Collada file with another count of numbers than it needs.
    #[error("<{element}> with {numbers} numbers")]
    Transform {
        /// The element.
        element: String,
        /// How many numbers it has.
        numbers: usize,
    },
}
