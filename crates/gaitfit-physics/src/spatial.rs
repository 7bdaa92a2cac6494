//! Spatial inertias about one common reference point, in world axes.
//!
//! Motion vectors are (angular, linear at the reference point), wrenches (moment about it, force).

use crate::Real;
use crate::vec3::*;

/// A motion vector or wrench: angular part, linear part.
pub(crate) type V6<T> = [V3<T>; 2];

#[inline(always)]
pub(crate) fn zero6<T: Real>() -> V6<T> {
    [zero3(); 2]
}
#[inline(always)]
pub(crate) fn add6<T: Real>(a: V6<T>, b: V6<T>) -> V6<T> {
    [add(a[0], b[0]), add(a[1], b[1])]
}
/// `c + s·a`.
#[inline(always)]
pub(crate) fn axpy6<T: Real>(s: T, a: V6<T>, c: V6<T>) -> V6<T> {
    [axpy(s, a[0], c[0]), axpy(s, a[1], c[1])]
}
/// After a region that changed `v`: see [`Real::merge`].
#[inline(always)]
pub(crate) fn merge6<T: Real>(v: &mut V6<T>, guard: T::Guard, before: &V6<T>) {
    merge_all(&mut v[0], guard, &before[0]);
    merge_all(&mut v[1], guard, &before[1]);
}
/// `c + a·b`.
#[inline(always)]
pub(crate) fn dot6_add<T: Real>(a: V6<T>, b: V6<T>, c: T) -> T {
    dot_add(a[0], b[0], dot_add(a[1], b[1], c))
}
#[inline(always)]
pub(crate) fn dot6<T: Real>(a: V6<T>, b: V6<T>) -> T {
    dot_add(a[0], b[0], dot(a[1], b[1]))
}

/// Inertia of a rigid body about the reference point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rigid<T> {
    /// Mass, kg.
    pub m: T,
    /// Mass times the centre of mass from the reference point, kg·m.
    pub h: V3<T>,
    /// Rotational inertia about the reference point, kg·m².
    pub i: Sym3<T>,
}

impl<T: Real> Rigid<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self { m: T::zero(), h: zero3(), i: [T::zero(); 6] }
    }

    #[inline(always)]
    pub fn add(&self, o: &Self) -> Self {
        let (a, b) = (&self.i, &o.i);
        Self {
            m: self.m + o.m,
            h: add(self.h, o.h),
            i: [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]],
        }
    }

    /// Wrench that gives the motion `a`: `n = I α + h × a`, `f = m a + α × h`.
    #[inline(always)]
    pub fn mul(&self, a: V6<T>) -> V6<T> {
        [cross_add(self.h, a[1], sym_mul(&self.i, a[0])), cross_add(a[0], self.h, scale(self.m, a[1]))]
    }
}

/// Row and column of each element of a [`Sym3`].
const PLACES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// A symmetric 6 × 6 inertia: an articulated body's, or a rigid body's with contacts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Articulated<T> {
    /// Angular–angular block.
    pub aa: Sym3<T>,
    /// Angular–linear block, rows angular.
    pub al: M3<T>,
    /// Linear–linear block.
    pub ll: Sym3<T>,
}

impl<T: Real> Articulated<T> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self { aa: [T::zero(); 6], al: [zero3(); 3], ll: [T::zero(); 6] }
    }

    #[inline(always)]
    pub fn from_rigid(r: &Rigid<T>) -> Self {
        // The mixed block is the matrix of the cross product with h.
        let (z, m, h) = (T::zero(), r.m, r.h);
        Self { aa: r.i, al: [[z, -h[2], h[1]], [h[2], z, -h[0]], [-h[1], h[0], z]], ll: [m, m, m, z, z, z] }
    }

    #[inline(always)]
    pub fn add(&mut self, o: &Self) {
        for k in 0..6 {
            self.aa[k] = self.aa[k] + o.aa[k];
            self.ll[k] = self.ll[k] + o.ll[k];
        }
        for i in 0..3 {
            self.al[i] = add(self.al[i], o.al[i]);
        }
    }

    /// After a region that added to the inertia: see [`Real::merge`].
    #[inline(always)]
    pub fn merge(&mut self, guard: T::Guard, before: &Self) {
        merge_all(&mut self.aa, guard, &before.aa);
        merge_all(&mut self.ll, guard, &before.ll);
        for i in 0..3 {
            merge_all(&mut self.al[i], guard, &before.al[i]);
        }
    }

    /// Adds `Jᵀ W J` of a point at `x` (from the reference point) with translational weight `w`, world axes.
    #[inline(always)]
    pub fn add_point(&mut self, x: V3<T>, w: &Sym3<T>) {
        // G = [x]× W, by rows; the angular block is G [x]×ᵀ, whose row i is x × G_i.
        let c0 = cross(x, [w[0], w[3], w[4]]);
        let c1 = cross(x, [w[3], w[1], w[5]]);
        let c2 = cross(x, [w[4], w[5], w[2]]);
        let g: M3<T> = each3!(i => [c0[i], c1[i], c2[i]]);
        let a = &mut self.aa;
        a[0] = x[2].fnma(g[0][1], x[1].fma(g[0][2], a[0]));
        a[1] = x[0].fnma(g[1][2], x[2].fma(g[1][0], a[1]));
        a[2] = x[1].fnma(g[2][0], x[0].fma(g[2][1], a[2]));
        a[3] = x[0].fnma(g[0][2], x[2].fma(g[0][0], a[3]));
        a[4] = x[1].fnma(g[0][0], x[0].fma(g[0][1], a[4]));
        a[5] = x[1].fnma(g[1][0], x[0].fma(g[1][1], a[5]));
        for i in 0..3 {
            self.al[i] = add(self.al[i], g[i]);
        }
        for k in 0..6 {
            self.ll[k] = self.ll[k] + w[k];
        }
    }

    /// Product with a motion vector.
    #[inline(always)]
    pub fn mul(&self, s: V6<T>) -> V6<T> {
        let [a, l] = s;
        let n = each3!(i => dot(self.al[i], l));
        let f = sym_mul(&self.ll, l);
        [
            sym_mul_add(&self.aa, a, n),
            axpy(a[0], self.al[0], axpy(a[1], self.al[1], axpy(a[2], self.al[2], f))),
        ]
    }

    /// Subtracts the first `N` of `u vᵀ`, each `v` a multiple of its `u`. Element by element, so that the
    /// accumulator needs no registers of its own. `u` carries the minus sign: `v` is a product, and the compiler would spend an
    /// instruction on its sign.
    #[inline(always)]
    pub fn sub_outers<const N: usize>(&mut self, u: &[V6<T>], v: &[V6<T>]) {
        // In the order in which `solve_neg` reads them.
        for k in 0..6 {
            let (i, j) = PLACES[k];
            for n in 0..N {
                self.ll[k] = u[n][1][j].fnma(v[n][1][i], self.ll[k]);
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                for n in 0..N {
                    self.al[i][j] = u[n][1][j].fnma(v[n][0][i], self.al[i][j]);
                }
            }
        }
        for k in 0..6 {
            let (i, j) = PLACES[k];
            for n in 0..N {
                self.aa[k] = u[n][0][j].fnma(v[n][0][i], self.aa[k]);
            }
        }
    }

    /// Adds `u vᵀ`, one term of a sum that is symmetric as a whole.
    #[inline(always)]
    pub fn add_outer(&mut self, u: V6<T>, v: V6<T>) {
        // `sym_sub` subtracts, so the sign is turned.
        let minus = [scale(T::lit(-1.0), v[0]), scale(T::lit(-1.0), v[1])];
        sym_sub(&mut self.aa, u[0], minus[0]);
        sym_sub(&mut self.ll, u[1], minus[1]);
        for i in 0..3 {
            self.al[i] = axpy(u[0][i], v[1], self.al[i]);
        }
    }

    /// Solves `self · x = −p` by blocks: the linear block first, its Schur complement, back.
    #[inline(always)]
    pub fn solve_neg(&self, p: V6<T>) -> V6<T> {
        // [aa al; alᵀ ll] [x; y] = −[n; f].
        let inverse = sym_inverse(&self.ll);
        // Y = al · ll⁻¹, by rows; y = −Yᵀ x − ll⁻¹ f.
        let y = each3!(i => sym_mul(&inverse, self.al[i]));
        let forced = sym_mul(&inverse, p[1]);
        let mut schur = self.aa;
        for k in 0..6 {
            let (i, j) = PLACES[k];
            for c in 0..3 {
                schur[k] = y[i][c].fnma(self.al[j][c], schur[k]);
            }
        }
        let right = each3!(i => dot(y[i], p[1]) - p[0][i]);
        let x = sym_mul(&sym_inverse(&schur), right);
        let linear = axpy(x[0], y[0], axpy(x[1], y[1], axpy(x[2], y[2], forced)));
        [x, [-linear[0], -linear[1], -linear[2]]]
    }
}

/// Inverse of a symmetric positive definite matrix by cofactors.
#[inline(always)]
fn sym_inverse<T: Real>(s: &Sym3<T>) -> Sym3<T> {
    let [xx, yy, zz, xy, xz, yz] = *s;
    // Cofactors over the determinant, which is expanded along the first row.
    let c0 = yz.fnma(yz, yy * zz);
    let c3 = xy.fnma(zz, xz * yz);
    let c4 = xz.fnma(yy, xy * yz);
    // The determinant of a positive definite matrix is above 0, as `recip` needs it.
    let by = xx.fma(c0, xy.fma(c3, xz * c4)).recip();
    [
        by * c0,
        by * xz.fnma(xz, xx * zz),
        by * xy.fnma(xy, xx * yy),
        by * c3,
        by * c4,
        by * xx.fnma(yz, xy * xz),
    ]
}

#[inline(always)]
fn sym_sub<T: Real>(s: &mut Sym3<T>, v: V3<T>, u: V3<T>) {
    s[0] = v[0].fnma(u[0], s[0]);
    s[1] = v[1].fnma(u[1], s[1]);
    s[2] = v[2].fnma(u[2], s[2]);
    s[3] = v[0].fnma(u[1], s[3]);
    s[4] = v[0].fnma(u[2], s[4]);
    s[5] = v[1].fnma(u[2], s[5]);
}
