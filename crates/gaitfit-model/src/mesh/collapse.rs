//! Edges of meshes become points, first the one that moves the surface least (Garland and Heckbert, Surface simplification
//! using quadric error metrics, 1997).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::thin::Pool;
use crate::rotation::{Vec3, add, cross, dot, sub, unit};

// Without this weight a flat open surface could shrink from its border at almost no cost.
/// Weight of the borders of open surfaces beside their faces.
const BORDER: f64 = 3.0;
/// Share of a collapse's cost that is its edge's length: on a plane short edges go first.
const SHORT: f64 = 1e-4;
/// How much a new corner is drawn to the middle of its edge where the faces leave it open.
const MIDDLE: f64 = 1e-3;
// About 78°. Beyond 90° a face would show its back.
/// Cosine up to which a face may turn.
const TURNED: f64 = 0.2;

/// The sum of squared distances from planes, weighted: x·Ax + 2b·x + c.
#[derive(Clone, Copy, Debug, Default)]
struct Quadric {
    a: [Vec3; 3],
    b: Vec3,
    c: f64,
}

impl Quadric {
    /// The squared distance from the plane through `point` with the unit normal `normal`, times `weight`.
    fn of_plane(normal: Vec3, point: Vec3, weight: f64) -> Self {
        let d = -dot(normal, point);
        Self {
            a: normal.map(|x| normal.map(|y| weight * x * y)),
            b: normal.map(|x| weight * d * x),
            c: weight * d * d,
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            a: std::array::from_fn(|row| add(self.a[row], other.a[row])),
            b: add(self.b, other.b),
            c: self.c + other.c,
        }
    }

    /// The best point for the edge between two points, and what it costs.
    fn best(&self, ends: [Vec3; 2]) -> (Vec3, f64) {
        let middle = add(ends[0], ends[1]).map(|x| x / 2.0);
        let trace: f64 = (0..3).map(|k| self.a[k][k]).sum();
        // On a plane, and along a straight edge, many points are equally good and the matrix is singular. A pull
        // towards the middle makes it regular; the trace gives it the matrix's own scale.
        let drawn = MIDDLE * trace;
        let mut rows = self.a;
        (0..3).for_each(|k| rows[k][k] += drawn);
        let right: Vec3 = std::array::from_fn(|k| drawn * middle[k] - self.b[k]);
        let volume = dot(rows[0], cross(rows[1], rows[2]));
        // Cramer's rule; the matrix is its own transpose.
        let solved = [
            dot(right, cross(rows[1], rows[2])) / volume,
            dot(rows[0], cross(right, rows[2])) / volume,
            dot(rows[0], cross(rows[1], right)) / volume,
        ];
        let edge = sub(ends[1], ends[0]);
        let length = dot(edge, edge);
        let away = sub(solved, middle);
        // A point farther from the middle than the edge is long is not used, nor is one that is NaN.
        let near = dot(away, away) <= length;
        let point = if near { solved } else { middle };
        let error: f64 =
            (0..3).map(|k| point[k] * dot(self.a[k], point)).sum::<f64>() + 2.0 * dot(self.b, point) + self.c;
        // Rounding may bring the squared distance of a point that lies on all its planes below 0.
        (point, error.max(0.0) + SHORT * trace * length)
    }
}

/// An edge that may collapse.
#[derive(Debug)]
struct Edge {
    cost: f64,
    ends: [u32; 2],
    /// How often its ends had changed when the cost was computed.
    seen: u32,
    point: Vec3,
}

impl Ord for Edge {
    /// The cheapest is the greatest.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then_with(|| other.ends.cmp(&self.ends))
    }
}

impl PartialOrd for Edge {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Edge {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Edge {}

/// Meshes at work.
struct Work<'a> {
    pool: &'a mut Pool,
    quadrics: Vec<Quadric>,
    /// Faces about each vertex.
    faces: Vec<Vec<u32>>,
    /// How often each vertex has changed.
    changes: Vec<u32>,
    alive: Vec<bool>,
    edges: BinaryHeap<Edge>,
}

/// Lets edges collapse until at most `max` triangles are left, or every further collapse would turn a face over.
pub(super) fn collapse(pool: &mut Pool, max: usize) {
    let mut left = pool.len();
    if left <= max {
        return;
    }
    let mut work = Work::new(pool);
    while left > max
        && let Some(edge) = work.edges.pop()
    {
        // A heap cannot remove entries inside it, so entries with an outdated cost are skipped as they come out.
        if work.seen(edge.ends) == edge.seen && work.fits(&edge) {
            left -= work.join(&edge);
        }
    }
    let mut alive = work.alive.into_iter();
    pool.triangles.retain(|_| alive.next() == Some(true));
}

impl<'a> Work<'a> {
    fn new(pool: &'a mut Pool) -> Self {
        let (vertices, triangles) = (pool.vertices.len(), pool.len());
        let mut faces = vec![Vec::new(); vertices];
        let mut quadrics = vec![Quadric::default(); vertices];
        let mut sides = Vec::with_capacity(3 * triangles);
        for (number, triangle) in pool.triangles.iter().enumerate() {
            let across = across(triangle.map(|corner| pool.vertices[corner as usize]));
            let area = dot(across, across).sqrt() / 2.0;
            // A face without area has no normal; its quadric has the weight 0 in any case.
            let normal = unit(across).unwrap_or_default();
            // Weighted by area, so that a finer triangulation of the same surface weighs no more.
            let plane = Quadric::of_plane(normal, pool.vertices[triangle[0] as usize], area);
            for k in 0..3 {
                let corner = triangle[k] as usize;
                faces[corner].push(number as u32);
                quadrics[corner] = quadrics[corner].plus(plane);
                let mut ends = [triangle[k], triangle[(k + 1) % 3]];
                ends.sort_unstable();
                sides.push((ends, number));
            }
        }
        // Sorted, all faces of one edge stand next to each other.
        sides.sort_unstable();
        for same in sides.chunk_by(|(one, _), (other, _)| one == other) {
            // An edge of one face is a border. A plane through it, square to the face, keeps it in place.
            let &[(ends, face)] = same else { continue };
            let points = ends.map(|end| pool.vertices[end as usize]);
            let along = sub(points[1], points[0]);
            let normal = across(pool.triangles[face].map(|corner| pool.vertices[corner as usize]));
            let Some(side) = unit(cross(along, normal)) else { continue };
            // The edge's squared length is an area, as the weights of faces are.
            let border = Quadric::of_plane(side, points[0], BORDER * dot(along, along));
            for end in ends {
                quadrics[end as usize] = quadrics[end as usize].plus(border);
            }
        }
        sides.dedup_by_key(|(ends, _)| *ends);
        let (changes, alive) = (vec![0; vertices], vec![true; triangles]);
        let mut work = Self { pool, quadrics, faces, changes, alive, edges: BinaryHeap::new() };
        // Every edge is offered once, whatever the number of its faces.
        for (ends, _) in sides {
            work.offer(ends);
        }
        work
    }

    /// How often the ends of an edge have changed.
    fn seen(&self, ends: [u32; 2]) -> u32 {
        // Numbers are only compared for equality, so one that wraps around does no harm.
        ends.iter().fold(0, |sum, &end| sum.wrapping_add(self.changes[end as usize]))
    }

    fn offer(&mut self, ends: [u32; 2]) {
        let [first, second] = ends.map(|end| end as usize);
        let sum = self.quadrics[first].plus(self.quadrics[second]);
        let (point, cost) = sum.best([self.pool.vertices[first], self.pool.vertices[second]]);
        self.edges.push(Edge { cost, ends, seen: self.seen(ends), point });
    }

    /// Whether no face turns over, or loses its area, as an edge collapses.
    fn fits(&self, edge: &Edge) -> bool {
        let stays = |end: u32, other: u32| {
            self.faces[end as usize].iter().all(|&face| {
                let triangle = self.pool.triangles[face as usize];
                // A face with both ends of the edge vanishes with it, so its direction does not matter.
                if triangle.contains(&other) {
                    return true;
                }
                let before = triangle.map(|corner| self.pool.vertices[corner as usize]);
                let mut after = before;
                (0..3).filter(|&k| triangle[k] == end).for_each(|k| after[k] = edge.point);
                // A face that has no area has no normal to keep.
                match (unit(across(before)), unit(across(after))) {
                    (Some(before), Some(after)) => dot(before, after) > TURNED,
                    (before, _) => before.is_none(),
                }
            })
        };
        let [first, second] = edge.ends;
        stays(first, second) && stays(second, first)
    }

    /// Makes the ends of an edge one vertex; returns how many triangles that removes.
    fn join(&mut self, edge: &Edge) -> usize {
        // The first end keeps its number, and faces of the other one are renamed.
        let [kept, gone] = edge.ends.map(|end| end as usize);
        self.pool.vertices[kept] = edge.point;
        self.quadrics[kept] = self.quadrics[kept].plus(self.quadrics[gone]);
        let mut removed = 0;
        for face in std::mem::take(&mut self.faces[gone]) {
            let triangle = &mut self.pool.triangles[face as usize];
            // A face with both ends of the edge becomes a line.
            if triangle.contains(&edge.ends[0]) {
                self.alive[face as usize] = false;
                removed += 1;
                continue;
            }
            triangle
                .iter_mut()
                .filter(|corner| **corner == edge.ends[1])
                .for_each(|corner| *corner = edge.ends[0]);
            self.faces[kept].push(face);
        }
        let alive = &self.alive;
        self.faces[kept].retain(|&face| alive[face as usize]);
        let about = self.faces[kept].iter().flat_map(|&face| self.pool.triangles[face as usize]);
        let mut about: Vec<u32> = about.filter(|&corner| corner != edge.ends[0]).collect();
        about.sort_unstable();
        about.dedup();
        // The vertices around still list faces that are gone.
        for &end in &about {
            let alive = &self.alive;
            self.faces[end as usize].retain(|&face| alive[face as usize]);
        }
        // Offers of edges at either end are out of date: those in the queue have an older number.
        self.changes[kept] = self.changes[kept].wrapping_add(1);
        self.changes[gone] = self.changes[gone].wrapping_add(1);
        for end in about {
            self.offer([edge.ends[0].min(end), edge.ends[0].max(end)]);
        }
        removed
    }
}

/// A vector across a triangle, as long as twice its area.
fn across([a, b, c]: [Vec3; 3]) -> Vec3 {
    cross(sub(b, a), sub(c, a))
}
