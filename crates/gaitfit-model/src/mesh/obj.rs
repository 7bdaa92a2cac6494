//! Wavefront OBJ.

use tobj::{LoadError, LoadOptions};

use crate::rotation::Vec3;

/// Triangles of all objects of a file; faces of more corners are cut into triangles, materials are not read.
pub(super) fn read(text: &str) -> Result<Vec<[Vec3; 3]>, super::ContentError> {
    let options =
        LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..LoadOptions::default() };
    // Materials only colour, and their file is often missing: none is opened.
    let no_materials = |_: &std::path::Path| Err(LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials)?;
    let mut triangles = Vec::new();
    for mesh in models.iter().map(|model| &model.mesh) {
        let points: Vec<Vec3> =
            mesh.positions.as_chunks::<3>().0.iter().map(|point| point.map(f64::from)).collect();
        for corners in mesh.indices.as_chunks::<3>().0 {
            if triangles.len() >= super::MAX_TRIANGLES {
                return Err(super::ContentError::Triangles);
            }
            triangles.push(super::indexed(&points, corners.map(|corner| corner as usize))?);
        }
    }
    Ok(triangles)
}
