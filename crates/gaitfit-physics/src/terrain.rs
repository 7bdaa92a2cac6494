//! Ground that is not flat: static boxes and height fields, and the point of them that is nearest to a point.
//!
//! A sphere, or an end of a capsule, touches each of them in one point: the nearest of the surface. For a sphere and a box
//! that is what MuJoCo computes (`mjraw_SphereBox`). MuJoCo cuts a height field into prisms and gives a sphere one contact
//! with each prism that it meets; that is the same where it meets one, away from the edges of the triangles, and is more
//! contacts at edges. A cell's diagonal runs as MuJoCo's does, from the vertex of lower row and column to that of higher
//! ones.

use crate::Real;
use crate::vec3::*;

/// Below this a distance has no direction.
pub(crate) const TINY: f64 = 1e-15;

/// A static box.
#[derive(Clone, Debug)]
pub(crate) struct Block<K> {
    /// Its axes in the world: columns.
    pub rotation: [[K; 3]; 3],
    pub position: [K; 3],
    pub half: [K; 3],
}

/// A static height field over a grid in its x and y, row by row from the lowest y, each row from the lowest x.
#[derive(Clone, Debug)]
pub(crate) struct Field<K> {
    /// Its axes in the world: columns.
    pub rotation: [[K; 3]; 3],
    pub position: [K; 3],
    /// x and y of the first vertex, m.
    pub corner: [K; 2],
    /// Distance of neighbouring vertices along x and y, m, and its reciprocal.
    pub step: [K; 2],
    pub per_step: [K; 2],
    /// Numbers of the last column and row that have a neighbour on both sides.
    pub last: [K; 2],
    /// Vertices of a row.
    pub columns: K,
    /// The greatest height, m.
    pub top: K,
    /// Heights, m.
    pub heights: Vec<K>,
    /// The greatest heights about each place.
    pub ceiling: Ceiling<K>,
}

/// Greatest heights of a field by blocks of its cells, each block with those around it.
#[derive(Clone, Debug)]
pub(crate) struct Ceiling<K> {
    /// Reciprocals of a block's edges, 1/m.
    pub per_edge: [K; 2],
    /// The shorter edge, m: what is nearer to a point of a block than this lies under its ceiling.
    pub edge: K,
    /// Numbers of the last column and row of blocks.
    pub last: [K; 2],
    /// Blocks of a row.
    pub columns: K,
    /// Heights, m.
    pub heights: Vec<K>,
}

/// Where a surface is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearest<T> {
    /// Of the point from the surface, m; negative inside.
    pub distance: T,
    /// Unit vector from the surface to the point, world axes.
    pub normal: V3<T>,
}

/// The point `x` of the world in the frame of a thing at `position` whose axes are the columns of `rotation`.
#[inline(always)]
fn local<T: Real>(rotation: &[[T::K; 3]; 3], position: &[T::K; 3], x: V3<T>) -> V3<T> {
    let d = sub(x, k3::<T>(position));
    axpy(d[0], k3::<T>(&rotation[0]), axpy(d[1], k3::<T>(&rotation[1]), scale(d[2], k3::<T>(&rotation[2]))))
}

/// A direction of such a frame in world axes.
#[inline(always)]
fn turned<T: Real>(rotation: &[[T::K; 3]; 3], v: V3<T>) -> V3<T> {
    each3!(i => dot(k3::<T>(&rotation[i]), v))
}

impl<K: Copy> Block<K> {
    /// A number that the distance of the world's point `x` does not fall below.
    #[inline(always)]
    pub fn at_least<T: Real<K = K>>(&self, x: V3<T>) -> T {
        let c = local::<T>(&self.rotation, &self.position, x);
        let over: V3<T> = each3!(i => c[i].abs() - T::k(self.half[i]));
        // How far a point is beyond the sides of one axis is never more than its distance.
        over[0].max(over[1]).max(over[2])
    }

    /// The point nearest to the world's point `x`; inside, of the nearest side.
    #[inline(always)]
    pub fn nearest<T: Real<K = K>>(&self, x: V3<T>) -> Nearest<T> {
        let c = local::<T>(&self.rotation, &self.position, x);
        let (distance, normal) = nearest_of_box(c, k3::<T>(&self.half));
        Nearest { distance, normal: turned(&self.rotation, normal) }
    }
}

/// Distance of the point `c` from a box with the half sizes `half`, and the unit vector from its surface to the point,
/// in the box's frame; inside, of the nearest side.
#[inline(always)]
pub(crate) fn nearest_of_box<T: Real>(c: V3<T>, half: V3<T>) -> (T, V3<T>) {
    let (zero, one) = (T::zero(), T::lit(1.0));
    // Zero on an axis on which the point lies between the sides; zero on all of them inside the box.
    let d: V3<T> = each3!(i => c[i] - c[i].clamp(-half[i], half[i]));
    let length2 = dot(d, d);
    let tiny = T::lit(TINY * TINY);
    let length = length2.max(tiny).sqrt();
    let by = one.div(length);
    // Inside: along the axis of the smallest gap.
    let gap: V3<T> = each3!(i => half[i] - c[i].abs());
    let smallest = gap[0].min(gap[1]).min(gap[2]);
    let sign: V3<T> = each3!(i => T::select_lt(c[i], zero, -one, one));
    // One axis alone, also where two gaps are equal.
    let x_side = T::select_lt(smallest, gap[0], zero, one);
    let y_side = T::select_lt(smallest, gap[1], zero, one - x_side);
    let z_side = (one - x_side) - y_side;
    let side = [x_side * sign[0], y_side * sign[1], z_side * sign[2]];
    let normal = each3!(i => T::select_lt(length2, tiny, side[i], by * d[i]));
    (T::select_lt(length2, tiny, -smallest, length), normal)
}

/// The nearest point so far: what leads from it to the point, and the square of that.
#[derive(Clone, Copy)]
struct Best<T> {
    d: V3<T>,
    square: T,
}

impl<T: Real> Best<T> {
    #[inline(always)]
    fn offer(&mut self, d: V3<T>, square: T) {
        self.d = each3!(i => T::select_lt(square, self.square, d[i], self.d[i]));
        self.square = square.min(self.square);
    }

    /// The nearest point of the segment from the vertex that `w` leads from, along `edge`.
    #[inline(always)]
    fn offer_edge(&mut self, w: V3<T>, edge: V3<T>) {
        // An edge is never of length zero: its part in the grid is a step.
        let along = dot(w, edge).div(dot(edge, edge)).clamp(T::zero(), T::lit(1.0));
        let d = axpy(-along, edge, w);
        self.offer(d, dot(d, d));
    }

    /// The point's foot on a triangle's plane, where it lies in the triangle. `w` leads from the cell's corner (0, 0);
    /// `upper` says which of the two triangles it is: the one with the corner (0, 1).
    #[inline(always)]
    fn offer_triangle(&mut self, field: &Field<T::K>, w: V3<T>, slope: [T; 2], upper: bool) {
        let one = T::lit(1.0);
        // The height above the triangle's plane at the same x and y, then the foot of the perpendicular.
        let above = w[2] - slope[0].fma(w[0], slope[1] * w[1]);
        let square = slope[0].fma(slope[0], slope[1].fma(slope[1], one));
        let by = above.div(square);
        let d = [-(slope[0] * by), -(slope[1] * by), by];
        let u = (w[0] - d[0]) * T::k(field.per_step[0]);
        let v = (w[1] - d[1]) * T::k(field.per_step[1]);
        // 0 ≤ u ≤ v ≤ 1 in the upper one, 0 ≤ v ≤ u ≤ 1 in the lower.
        let (low, high) = if upper { (u, v) } else { (v, u) };
        let inside = low.min(high - low).min(one - high);
        self.offer(d, T::select_lt(inside, T::zero(), T::lit(FAR), by * above));
    }
}

/// What is no candidate.
const FAR: f64 = 1e30;

impl<K: Copy> Field<K> {
    /// A number that the distance of the world's point `x` does not fall below.
    #[inline(always)]
    pub fn at_least<T: Real<K = K>>(&self, x: V3<T>) -> T {
        let c = local::<T>(&self.rotation, &self.position, x);
        let ceiling = &self.ceiling;
        let half = T::lit(0.5);
        let block = |k: usize| {
            // Rounding of the number less a half is its whole part; there is no other rounding in [`Real`].
            let along = (c[k] - T::k(self.corner[k])) * T::k(ceiling.per_edge[k]);
            (along - half).round().clamp(T::zero(), T::k(ceiling.last[k]))
        };
        let above = c[2] - T::gather(&ceiling.heights, block(1).fma(T::k(ceiling.columns), block(0)));
        // Both bounds hold: that of the blocks around, as far as they reach, and that of the whole field.
        above.min(T::k(ceiling.edge)).max(c[2] - T::k(self.top))
    }

    /// The point nearest to the world's point `x` among the four cells about the vertex nearest to `x`: any point of the
    /// surface within half a cell is in them. Below the surface, the triangle above counts as a plane.
    #[inline(always)]
    pub fn nearest<T: Real<K = K>>(&self, x: V3<T>) -> Nearest<T> {
        // The field's address names it, so that a recording holds these operations once for all points.
        let key = std::ptr::from_ref(self) as usize;
        let [distance, x, y, z] = T::call(key, x, |x| {
            let Nearest { distance, normal: [x, y, z] } = self.nearest_inline(x);
            [distance, x, y, z]
        });
        Nearest { distance, normal: [x, y, z] }
    }

    #[inline(always)]
    fn nearest_inline<T: Real<K = K>>(&self, x: V3<T>) -> Nearest<T> {
        let (zero, one) = (T::zero(), T::lit(1.0));
        let c = local::<T>(&self.rotation, &self.position, x);
        let (dx, dy) = (T::k(self.step[0]), T::k(self.step[1]));
        let (x0, y0) = (c[0] - T::k(self.corner[0]), c[1] - T::k(self.corner[1]));
        // A vertex at the rim has no cells on one side, so the nearest inner one stands for it.
        let column = (x0 * T::k(self.per_step[0])).round().clamp(one, T::k(self.last[0]));
        let row = (y0 * T::k(self.per_step[1])).round().clamp(one, T::k(self.last[1]));
        // From the middle vertex, at height zero.
        let p = [column.fnma(dx, x0), row.fnma(dy, y0), c[2]];
        let columns = T::k(self.columns);
        let middle = row.fma(columns, column);
        let mut z = [[zero; 3]; 3];
        let mut b = 0;
        while b < 3 {
            let first = middle + T::lit(b as f64 - 1.0) * columns;
            z[b] = [
                T::gather(&self.heights, first - one),
                T::gather(&self.heights, first),
                T::gather(&self.heights, first + one),
            ];
            b += 1;
        }

        // Edges and triangles of the four cells. Vertices need no offer of their own: they are the ends of
        // edges.
        // The root of `FAR`, so that the vector and its square agree and neither overflows in single precision.
        let mut best = Best { d: [zero, zero, T::lit(FAR.sqrt())], square: T::lit(FAR) };
        let mut b = 0;
        while b < 3 {
            let mut a = 0;
            while a < 3 {
                let vertex = [T::lit(a as f64 - 1.0) * dx, T::lit(b as f64 - 1.0) * dy, z[b][a]];
                let w = sub(p, vertex);
                if a < 2 {
                    best.offer_edge(w, [dx, zero, z[b][a + 1] - z[b][a]]);
                }
                if b < 2 {
                    best.offer_edge(w, [zero, dy, z[b + 1][a] - z[b][a]]);
                }
                if a < 2 && b < 2 {
                    best.offer_edge(w, [dx, dy, z[b + 1][a + 1] - z[b][a]]);
                    let rises = self.rises::<T>([z[b][a], z[b][a + 1], z[b + 1][a], z[b + 1][a + 1]]);
                    best.offer_triangle(self, w, rises[0], false);
                    best.offer_triangle(self, w, rises[1], true);
                }
                a += 1;
            }
            b += 1;
        }

        // The triangle above or below the point.
        let mut cell = [zero; 4];
        let mut k = 0;
        while k < 4 {
            let (a, b) = (k % 2, k / 2);
            let low = T::select_lt(p[0], zero, z[b][a], z[b][a + 1]);
            let high = T::select_lt(p[0], zero, z[b + 1][a], z[b + 1][a + 1]);
            cell[k] = T::select_lt(p[1], zero, low, high);
            k += 1;
        }
        // From the corner (0, 0) of the point's cell, which lies a step back where the point is left of or
        // below the vertex.
        let across = p[0] + T::select_lt(p[0], zero, dx, zero);
        let along = p[1] + T::select_lt(p[1], zero, dy, zero);
        let [under, over] = self.rises::<T>(cell);
        let (u, v) = (across * T::k(self.per_step[0]), along * T::k(self.per_step[1]));
        let slope = [T::select_lt(u, v, over[0], under[0]), T::select_lt(u, v, over[1], under[1])];
        let surface = slope[0].fma(across, slope[1].fma(along, cell[0]));
        let above = p[2] - surface;
        let by = one.div(slope[0].fma(slope[0], slope[1].fma(slope[1], one)).sqrt());
        let plane = [-(slope[0] * by), -(slope[1] * by), by];

        // Outside of the grid there is no surface to be below of.
        let outside = (p[0].abs() - dx).max(p[1].abs() - dy);
        let above = T::select_lt(zero, outside, one, above);
        let tiny = T::lit(TINY * TINY);
        let length = best.square.max(tiny).sqrt();
        let per_length = one.div(length);
        // A point on the surface has no direction to it: the plane's normal counts there, as below the
        // surface.
        let open = T::select_lt(best.square, tiny, -one, above);
        let normal: V3<T> = each3!(i => T::select_lt(zero, open, per_length * best.d[i], plane[i]));
        Nearest {
            distance: T::select_lt(zero, open, length, above * by),
            normal: turned(&self.rotation, normal),
        }
    }

    /// Slopes along x and y of the two triangles of a cell with the heights of its corners (0, 0), (1, 0), (0, 1), (1, 1):
    /// of the one with the corner (1, 0), then of the other.
    #[inline(always)]
    fn rises<T: Real<K = K>>(&self, z: [T; 4]) -> [[T; 2]; 2] {
        let (per_x, per_y) = (T::k(self.per_step[0]), T::k(self.per_step[1]));
        [[(z[1] - z[0]) * per_x, (z[3] - z[1]) * per_y], [(z[3] - z[2]) * per_x, (z[2] - z[0]) * per_y]]
    }
}
