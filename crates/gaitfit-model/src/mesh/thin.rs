//! Meshes with few triangles, for pictures.
//!
//! Corners in one cell of a grid become one (Rossignac and Borrel, Multi-resolution 3D approximations for rendering complex
//! scenes, 1993). This joins what files keep apart and drops what is smaller than a cell. Of what is left, edges collapse
//! ([`super::collapse`]).

use std::collections::{HashMap, HashSet};

use super::Mesh;
use super::collapse::collapse;
use crate::rotation::{Vec3, add};

// 4096 cells are 0.1 mm each on a mesh of 0.4 m: no picture shows less.
/// Cells along the diagonal of a mesh as it comes in.
const CELLS: f64 = 4096.0;
/// Before edges collapse: max number of cells along the largest mesh's diagonal, and of triangles. More would take too long.
const FINE_CELLS: f64 = 1500.0;
const MAX_FINE: usize = 60_000;
// From a width of 0 the loop of `shrink` would multiply 0 for ever.
/// The narrowest cell, m.
const NARROWEST: f64 = 1e-9;
// Near 1 `shrink` would go over the mesh many times. Much more would drop more triangles than needed.
/// Smallest factor by which cells grow while too much is left.
const WIDER: f64 = 1.4;
// A closed surface has half as many vertices as triangles. Triangles that share no corners have three each.
/// Max number of vertices per triangle that is kept, on average.
const MAX_CORNERS: usize = 2;

/// A mesh whose triangles share corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThinMesh {
    /// Corners, m.
    pub vertices: Vec<Vec3>,
    /// Corners of each triangle.
    pub triangles: Vec<[u16; 3]>,
}

/// Meshes that are made thin together, so that each gets as many triangles as its shape needs.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    pub vertices: Vec<Vec3>,
    /// The mesh of each vertex.
    mesh: Vec<usize>,
    pub triangles: Vec<[u32; 3]>,
    meshes: usize,
    /// Diagonal of the largest mesh's box, m.
    largest: f64,
}

impl Pool {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Takes a mesh in; returns its number.
    pub fn add(&mut self, mesh: &Mesh) -> usize {
        let number = self.meshes;
        self.meshes += 1;
        let diagonal = diagonal(mesh.triangles.iter().flatten());
        self.largest = self.largest.max(diagonal);
        // Cells so narrow join only corners that the file meant to be one.
        let mut grid = Grid::new(diagonal / CELLS);
        let start = self.vertices.len();
        for triangle in &mesh.triangles {
            self.triangles.extend(distinct(triangle.map(|point| (start + grid.put(number, point)) as u32)));
        }
        self.vertices.extend(grid.means());
        self.mesh.resize(self.vertices.len(), number);
        number
    }

    /// Empties the meshes that are not to be kept.
    pub fn keep(&mut self, kept: impl Fn(usize) -> bool) {
        let kept: Vec<bool> = (0..self.meshes).map(kept).collect();
        // A triangle's corners are of one mesh, so the first of them tells which.
        self.triangles.retain(|triangle| kept[self.mesh[triangle[0] as usize]]);
    }

    /// The meshes by their numbers, with at most `max` triangles together. A mesh may end without any.
    pub fn thinned(mut self, max: usize) -> Vec<ThinMesh> {
        // More triangles than that are clustered by `shrink` in any case.
        if self.len() <= MAX_FINE {
            // Some files have each triangle twice, once for either side.
            self.cluster(0.0);
        }
        // The time that collapses take grows with the triangles; spare vertices cost next to nothing.
        self.shrink(MAX_FINE, usize::MAX);
        collapse(&mut self, max);
        // Collapses leave vertices without triangles, and triangles that are there twice.
        self.cluster(0.0);
        // Triangles of a picture have 16-bit indices.
        self.shrink(max, MAX_CORNERS * max.min(usize::from(u16::MAX) / MAX_CORNERS));
        self.parts()
    }

    /// Widens the cells of a grid until no more than so many triangles and corners are left.
    fn shrink(&mut self, max: usize, corners: usize) {
        let mut cell = (self.largest / FINE_CELLS).max(NARROWEST);
        while self.len() > max || self.vertices.len() > corners {
            self.cluster(cell);
            // A surface meets cells in proportion to 1 / width².
            cell *= (self.len() as f64 / max as f64).sqrt().max(WIDER);
        }
    }

    /// Joins the vertices of each cell. Vertices without a triangle go, as do triangles that are there twice.
    fn cluster(&mut self, cell: f64) {
        let mut grid = Grid::new(cell);
        let mut seen = HashSet::new();
        let mut triangles = Vec::new();
        let mut mesh = Vec::new();
        for triangle in &self.triangles {
            let corners = triangle.map(|corner| {
                let number = self.mesh[corner as usize];
                let place = grid.put(number, self.vertices[corner as usize]);
                // A place is at most one beyond the list: cells are numbered as they appear.
                mesh.resize(mesh.len().max(place + 1), number);
                place as u32
            });
            // The same corners in another order are the same triangle.
            let mut sorted = corners;
            sorted.sort_unstable();
            triangles.extend(distinct(corners).filter(|_| seen.insert(sorted)));
        }
        (self.vertices, self.mesh, self.triangles) = (grid.means().collect(), mesh, triangles);
    }

    /// The meshes one by one.
    fn parts(&self) -> Vec<ThinMesh> {
        let mut parts = vec![ThinMesh::default(); self.meshes];
        // Place of each vertex in its own mesh, given where it is first used.
        let mut places = vec![None; self.vertices.len()];
        for triangle in &self.triangles {
            let part = &mut parts[self.mesh[triangle[0] as usize]];
            let corners = triangle.map(|corner| {
                *places[corner as usize].get_or_insert_with(|| {
                    part.vertices.push(self.vertices[corner as usize]);
                    (part.vertices.len() - 1) as u16
                })
            });
            part.triangles.push(corners);
        }
        parts
    }
}

/// A triangle whose corners differ.
fn distinct(corners: [u32; 3]) -> Option<[u32; 3]> {
    let [a, b, c] = corners;
    (a != b && b != c && c != a).then_some(corners)
}

/// Length of the diagonal of the box of points.
fn diagonal<'a>(points: impl Iterator<Item = &'a Vec3>) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in points {
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(point[k]), high[k].max(point[k]));
        }
    }
    // Without points `low` is above `high`: the diagonal is 0.
    (0..3).map(|k| (high[k] - low[k]).max(0.0).powi(2)).sum::<f64>().sqrt()
}

/// Points by the cells of a grid.
struct Grid {
    cell: f64,
    places: HashMap<(usize, [i64; 3]), usize>,
    /// Sum and number of the points of each cell.
    sums: Vec<(Vec3, f64)>,
}

impl Grid {
    /// A grid of cells of this width, m; without a width only equal points share a cell.
    fn new(cell: f64) -> Self {
        Self { cell, places: HashMap::new(), sums: Vec::new() }
    }

    /// The number of a point's cell, in the order in which cells appear.
    fn put(&mut self, mesh: usize, point: Vec3) -> usize {
        let key = match self.cell > 0.0 {
            true => point.map(|x| (x / self.cell).floor() as i64),
            // The bits of a float are a key as good as any.
            false => point.map(|x| x.to_bits() as i64),
        };
        let place = *self.places.entry((mesh, key)).or_insert(self.sums.len());
        match self.sums.get_mut(place) {
            Some((sum, count)) => (*sum, *count) = (add(*sum, point), *count + 1.0),
            None => self.sums.push((point, 1.0)),
        }
        place
    }

    /// The mean of each cell's points.
    fn means(self) -> impl Iterator<Item = Vec3> {
        self.sums.into_iter().map(|(sum, count)| sum.map(|x| x / count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    /// A ball of radius 1 about a point in this many rings.
    fn ball(middle: Vec3, rings: u32) -> Mesh {
        let point = |ring: u32, step: u32| {
            let (z, round) =
                (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(step) / f64::from(rings));
            add(middle, [z.sin() * round.cos(), z.sin() * round.sin(), z.cos()])
        };
        let cells = (0..rings).flat_map(|ring| (0..rings).map(move |step| (ring, step)));
        let triangles = cells.flat_map(|(ring, step)| {
            let corners =
                [point(ring, step), point(ring + 1, step), point(ring + 1, step + 1), point(ring, step + 1)];
            [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]
        });
        Mesh { triangles: triangles.collect() }
    }

    #[test]
    fn fewer_triangles_keep_the_shape() {
        let middles = [[0.0; 3], [5.0, -3.0, 2.0]];
        let thin = |max: usize| {
            let mut pool = Pool::default();
            for middle in middles {
                pool.add(&ball(middle, 60));
            }
            pool.thinned(max)
        };
        let found = thin(2000);
        assert_eq!(found, thin(2000), "always the same");
        let count: usize = found.iter().map(|mesh| mesh.triangles.len()).sum();
        assert!((1800..=2000).contains(&count), "{count}");
        for (mesh, middle) in found.iter().zip(middles) {
            for vertex in &mesh.vertices {
                let radius = (0..3).map(|k| (vertex[k] - middle[k]).powi(2)).sum::<f64>().sqrt();
                assert!((radius - 1.0).abs() < 0.01, "{radius}");
            }
            for k in 0..3 {
                let high = mesh.vertices.iter().map(|vertex| vertex[k] - middle[k]).fold(f64::MIN, f64::max);
                let low = mesh.vertices.iter().map(|vertex| vertex[k] - middle[k]).fold(f64::MAX, f64::min);
                assert!((high - 1.0).abs() < 0.02 && (low + 1.0).abs() < 0.02, "{low} {high}");
            }
        }
    }

    /// Triangles that share nothing and cannot collapse, degenerate ones, and a mesh without size.
    #[test]
    fn any_mesh_fits() {
        let apart = (0..5000).map(|k| {
            let at = f64::from(k);
            [[at, 0.0, 0.0], [at + 0.3, 0.0, 0.0], [at, 0.3, 0.1]]
        });
        let flat = [[[0.0; 3]; 3], [[1e-300, 0.0, 0.0], [0.0; 3], [0.0, 1e-300, 0.0]]];
        let mut pool = Pool::default();
        pool.add(&Mesh { triangles: apart.chain(flat).collect() });
        pool.add(&Mesh { triangles: flat.to_vec() });
        let found = pool.thinned(100);
        assert_eq!(found.len(), 2);
        assert!(found.iter().map(|mesh| mesh.triangles.len()).sum::<usize>() <= 100);
        assert!(Pool::default().thinned(100).is_empty());
    }
}
