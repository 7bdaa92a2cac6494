//! Volume, centre and moments of inertia of a closed mesh.

use super::Mesh;
use crate::inertia::{Tensor, principal};
use crate::rotation::{Quat, Vec3, cross, dot};

/// A volume below this share of the bounding box means that the surface is not closed.
const THIN: f64 = 1e-4;

/// A solid of density 1 in the mesh's frame and unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measure {
    /// Volume.
    pub volume: f64,
    /// Centre of mass.
    pub centre: Vec3,
    /// Orientation of the principal axes, wxyz.
    pub axes: Quat,
    /// Principal moments of inertia about the centre.
    pub moments: Vec3,
}

impl Measure {
    /// Measures a mesh by sums over the tetrahedra from the origin to its triangles (Mirtich 1996, "Fast and accurate computation of
    /// polyhedral mass properties"). A mesh that encloses next to nothing, as an open one may, counts as its bounding box.
    /// `None` of a flat one.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let (low, high) = bounds(mesh.triangles.iter().flatten());
        let size: Vec3 = std::array::from_fn(|k| high[k] - low[k]);
        let middle: Vec3 = std::array::from_fn(|k| 0.5 * (high[k] + low[k]));
        let whole = size[0] * size[1] * size[2];
        if !(whole > 0.0 && whole.is_finite()) {
            return None;
        }
        let mut volume = 0.0;
        let mut first = [0.0; 3];
        // ∫ x xᵀ: xx, yy, zz, xy, xz, yz.
        let mut second: Tensor = [0.0; 6];
        const PLACES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        for corners in &mesh.triangles {
            // From the middle: a small sum of large numbers loses digits.
            let [a, b, c] = corners.map(|corner| -> Vec3 { std::array::from_fn(|k| corner[k] - middle[k]) });
            // A tetrahedron with a corner at the origin has volume V = six / 6, ∫x = V/4 Σa and ∫x xᵀ = V/20 (Σ a aᵀ
            // + Σa Σaᵀ), with sums over its other corners a.
            let six = dot(a, cross(b, c));
            volume += six / 6.0;
            for (k, sum) in first.iter_mut().enumerate() {
                *sum += six / 24.0 * (a[k] + b[k] + c[k]);
            }
            for (sum, (i, j)) in second.iter_mut().zip(PLACES) {
                let total = |k: usize| a[k] + b[k] + c[k];
                *sum += six / 120.0 * (a[i] * a[j] + b[i] * b[j] + c[i] * c[j] + total(i) * total(j));
            }
        }
        if volume < 0.0 {
            // Its triangles face inwards.
            volume = -volume;
            first = first.map(|x| -x);
            second = second.map(|x| -x);
        }
        let solid = |volume: f64, centre: Vec3, about: Tensor| {
            let (moments, axes) = principal(about);
            // Moments are sorted, so this is the smallest.
            (moments[2] > 0.0).then_some(Self { volume, centre, axes, moments })
        };
        if volume > THIN * whole {
            // Moments about the middle of the box become those about the centre of mass (parallel-axis theorem).
            let offset = first.map(|x| x / volume);
            for (sum, (i, j)) in second.iter_mut().zip(PLACES) {
                *sum -= volume * offset[i] * offset[j];
            }
            let [xx, yy, zz, xy, xz, yz] = second;
            let centre = std::array::from_fn(|k| middle[k] + offset[k]);
            // The tensor of a surface with holes may have a moment of 0 or less: the box counts then too.
            if let Some(found) = solid(volume, centre, [yy + zz, xx + zz, xx + yy, -xy, -xz, -yz]) {
                return Some(found);
            }
        }
        // The bounding box as a solid: m (y² + z²) / 12 about x.
        let [x, y, z] = size.map(|x| x * x * whole / 12.0);
        solid(whole, middle, [y + z, x + z, x + y, 0.0, 0.0, 0.0])
    }
}

/// Lowest and highest coordinates.
pub(crate) fn bounds<'a>(points: impl Iterator<Item = &'a Vec3>) -> (Vec3, Vec3) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), point| {
        (std::array::from_fn(|k| low[k].min(point[k])), std::array::from_fn(|k| high[k].max(point[k])))
    })
}
