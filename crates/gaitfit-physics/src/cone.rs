//! Contact forces and Hessians of the friction cones (MuJoCo, "Friction cones" and "Primal problem").
//!
//! Components are (normal, tangent, tangent | spin, roll, roll); results are the NEGATIVE force and the
//! Hessian of the constraint cost.

use crate::Real;
use crate::vec3::*;

/// Frictionless and pyramidal contact of three dimensions: negative force and weight
/// (nn, 11, 22, n1, n2, 12; the last is zero).
#[inline(always)]
pub(crate) fn pyramid3<T: Real>(condim: usize, mu: &[T; 5], d: T, j: V3<T>) -> (V3<T>, Sym3<T>) {
    let z = T::zero();
    // Without friction there is one row: the normal.
    if condim == 1 {
        let s = T::select_lt(j[0], z, d, z);
        return ([s * j[0], z, z], [s, z, z, z, z, z]);
    }
    let (m1, m2) = (mu[0], mu[1]);
    // Residuals of the four edges n ± μt. An edge acts only while its residual is negative.
    let e = [m1.fma(j[1], j[0]), m1.fnma(j[1], j[0]), m2.fma(j[2], j[0]), m2.fnma(j[2], j[0])];
    let s0 = T::select_lt(e[0], z, d, z);
    let s1 = T::select_lt(e[1], z, d, z);
    let s2 = T::select_lt(e[2], z, d, z);
    let s3 = T::select_lt(e[3], z, d, z);
    let (f0, f1, f2, f3) = (s0 * e[0], s1 * e[1], s2 * e[2], s3 * e[3]);
    let (s01, s23) = (s0 + s1, s2 + s3);
    (
        [(f0 + f1) + (f2 + f3), m1 * (f0 - f1), m2 * (f2 - f3)],
        [s01 + s23, (m1 * m1) * s01, (m2 * m2) * s23, m1 * (s0 - s1), m2 * (s2 - s3), z],
    )
}

/// First and second derivative along `step` of the three-dimensional pyramid's cost at residual `j + alpha·step`.
#[inline(always)]
pub(crate) fn pyramid3_line<T: Real>(
    condim: usize,
    mu: &[T; 5],
    d: T,
    j: V3<T>,
    step: V3<T>,
    alpha: T,
    g: (T, T),
) -> (T, T) {
    let z = T::zero();
    let j = axpy(alpha, step, j);
    if condim == 1 {
        let p = T::select_lt(j[0], z, d * step[0], z);
        return (p.fma(j[0], g.0), p.fma(step[0], g.1));
    }
    let (m1, m2) = (mu[0], mu[1]);
    // The cost is a sum over the four edges, each a parabola on its negative side and zero on the other.
    let (mut first, mut second) = (z, z);
    for (m, k, sign) in [(m1, 1, true), (m1, 1, false), (m2, 2, true), (m2, 2, false)] {
        let (e, p) = if sign {
            (m.fma(j[k], j[0]), m.fma(step[k], step[0]))
        } else {
            (m.fnma(j[k], j[0]), m.fnma(step[k], step[0]))
        };
        first = p.fma(e.min(z), first);
        let active = T::select_lt(e, z, p, z);
        second = active.fma(active, second);
    }
    (d.fma(first, g.0), d.fma(second, g.1))
}

/// Pyramidal contact of `condim` dimensions.
#[inline(always)]
pub(crate) fn pyramid<T: Real>(condim: usize, mu: &[T; 5], d: T, j: &[T; 6]) -> ([T; 6], [[T; 6]; 6]) {
    let z = T::zero();
    let mut force = [z; 6];
    let mut w = [[z; 6]; 6];
    // Each tangent brings two edges: n + μt and n − μt.
    for k in 1..condim {
        let m = mu[k - 1];
        let plus = m.fma(j[k], j[0]);
        let minus = m.fnma(j[k], j[0]);
        let sp = T::select_lt(plus, z, d, z);
        let sm = T::select_lt(minus, z, d, z);
        force[0] = sp.fma(plus, sm.fma(minus, force[0]));
        force[k] = m * (sp * plus - sm * minus);
        w[0][0] = w[0][0] + (sp + sm);
        w[0][k] = m * (sp - sm);
        w[k][0] = w[0][k];
        w[k][k] = (m * m) * (sp + sm);
    }
    (force, w)
}

/// First and second derivative along `step` of the pyramidal contact's cost at residual `j + alpha·step`.
#[inline(always)]
pub(crate) fn pyramid_line<T: Real>(
    condim: usize,
    mu: &[T; 5],
    d: T,
    (j, step): (&[T; 6], &[T; 6]),
    alpha: T,
    mut g: (T, T),
) -> (T, T) {
    let mut j = *j;
    for k in 0..condim {
        j[k] = alpha.fma(step[k], j[k]);
    }
    // Within a piece the cost is quadratic: its slope is force · step, its curvature stepᵀ W step.
    let (force, w) = pyramid(condim, mu, d, &j);
    for k in 0..condim {
        let mut row = T::zero();
        for l in 0..condim {
            row = w[k][l].fma(step[l], row);
        }
        g.0 = force[k].fma(step[k], g.0);
        g.1 = row.fma(step[k], g.1);
    }
    g
}

/// What an elliptic contact's force and Hessian are made of, by the zone that its residual lies in.
///
/// With u = μ·(tangential residual), t = |u| and e = u/t the negative force is (`normal`, μ·`along`·u) and the Hessian
/// [`nn`, μ·`cross`·e; ·, μμ(`round`·1 + `radial`·e eᵀ)].
struct Ellipse<T> {
    inverse: T,
    normal: T,
    along: T,
    nn: T,
    cross: T,
    round: T,
    radial: T,
}

/// Constants of an elliptic contact: √(μ₁²/impratio), stiffness of the cone, and that of the tangents at its bottom.
#[inline(always)]
fn ellipse_stiffness<T: Real>(mu: T, impratio: f64, d: T) -> (T, T, T) {
    let regular = mu * T::lit(impratio.sqrt().recip());
    let reg2 = regular * regular;
    // Bottom zone: plain quadratic with D_k·mu_1² = D_1·mu_k².
    (regular, d.div(reg2.fma(reg2, reg2)), (d * T::lit(impratio)).div(mu * mu))
}

impl<T: Real> Ellipse<T> {
    /// At normal residual `j0` and squared length `t2` of u; `d` belongs to the normal row.
    #[inline(always)]
    fn new(mu: T, impratio: f64, d: T, j0: T, t2: T) -> Self {
        let z = T::zero();
        let (regular, dm, bottom) = ellipse_stiffness(mu, impratio, d);
        // n, t and the signs of n − μt and μn + t, which tell the zone ([`zone`]).
        let n = regular * j0;
        let t = t2.sqrt();
        // A tangential residual of 0 has no direction; the bound keeps 1/t finite.
        let inverse = t.max(T::lit(1e-12)).recip();
        let (mt, mn_t) = (regular * t, regular.fma(n, t));
        // Middle zone: the cost is ½ dm (n − mt)². These are parts of its first and second derivatives.
        let stiff = (dm * regular) * regular;
        let middle = (dm * regular) * (n - mt);
        let turn = ((dm * regular) * n) * inverse;
        let zone = |middle: T, bottom: T| zone(n, mt, mn_t, middle, bottom);
        Self {
            inverse,
            normal: zone(middle, d * j0),
            along: zone(-(middle * inverse), bottom),
            nn: zone(stiff, d),
            cross: zone(-stiff, z),
            round: zone(stiff - turn, bottom),
            radial: zone(turn, z),
        }
    }
}

/// Elliptic contact of three dimensions: negative force and weight (nn, 11, 22, n1, n2, 12).
#[inline(always)]
pub(crate) fn ellipse3<T: Real>(mu: &[T; 5], impratio: f64, d: T, j: V3<T>) -> (V3<T>, Sym3<T>) {
    let (u1, u2) = (mu[0] * j[1], mu[1] * j[2]);
    let c = Ellipse::new(mu[0], impratio, d, j[0], u1.fma(u1, u2 * u2));
    let (e1, e2) = (mu[0] * (c.inverse * u1), mu[1] * (c.inverse * u2));
    (
        [c.normal, mu[0] * (c.along * u1), mu[1] * (c.along * u2)],
        [
            c.nn,
            (c.radial * e1).fma(e1, c.round * (mu[0] * mu[0])),
            (c.radial * e2).fma(e2, c.round * (mu[1] * mu[1])),
            c.cross * e1,
            c.cross * e2,
            (c.radial * e1) * e2,
        ],
    )
}

/// Elliptic contact of `condim` ≥ 3 dimensions; `d` belongs to the normal row.
#[inline(always)]
pub(crate) fn ellipse<T: Real>(
    condim: usize,
    mu: &[T; 5],
    impratio: f64,
    d: T,
    j: &[T; 6],
) -> ([T; 6], [[T; 6]; 6]) {
    let z = T::zero();
    let mut u = [z; 6];
    let mut t2 = z;
    for k in 1..condim {
        // Each tangent scaled by its coefficient: the ellipse becomes a circle.
        u[k] = mu[k - 1] * j[k];
        t2 = u[k].fma(u[k], t2);
    }
    let c = Ellipse::new(mu[0], impratio, d, j[0], t2);
    let mut force = [z; 6];
    let mut w = [[z; 6]; 6];
    let mut e = [z; 6];
    force[0] = c.normal;
    w[0][0] = c.nn;
    for k in 1..condim {
        let m = mu[k - 1];
        e[k] = m * (c.inverse * u[k]);
        force[k] = m * (c.along * u[k]);
        w[0][k] = c.cross * e[k];
        w[k][0] = w[0][k];
        for l in 1..k {
            w[k][l] = (c.radial * e[k]) * e[l];
            w[l][k] = w[k][l];
        }
        w[k][k] = (c.radial * e[k]).fma(e[k], c.round * (m * m));
    }
    (force, w)
}

/// Where along a step the contacts change between slipping one way and the other, around the place that was looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kinks<T> {
    /// The nearest one before it, below zero if there is none.
    pub below: T,
    /// The nearest one after it, very large if there is none.
    pub above: T,
}

impl<T: Real> Kinks<T> {
    /// None found.
    #[inline(always)]
    pub fn none() -> Self {
        Self { below: T::lit(-1.0), above: T::lit(1e30) }
    }

    /// After a region that found some: see [`Real::merge`].
    #[inline(always)]
    pub fn merge(&mut self, guard: T::Guard, before: &Self) {
        self.below = self.below.merge(guard, before.below);
        self.above = self.above.merge(guard, before.above);
    }
}

/// First and second derivative along `step` of the elliptic contact's cost at residual `j + alpha·step`. Where the
/// tangential residual is smallest along the step the cost has a kink, as narrow as `impratio` is large; `kinks` learns
/// of it if the contact presses there.
#[inline(always)]
pub(crate) fn ellipse_line<T: Real>(
    condim: usize,
    mu: &[T; 5],
    impratio: f64,
    d: T,
    (j, step): (&[T; 6], &[T; 6]),
    alpha: T,
    g: (T, T),
    kinks: &mut Kinks<T>,
) -> (T, T) {
    let z = T::zero();
    // u is the scaled tangential residual at `alpha`, v its derivative along the step.
    let (mut t2, mut uv, mut vv) = (z, z, z);
    for k in 1..condim {
        let u = mu[k - 1] * alpha.fma(step[k], j[k]);
        let v = mu[k - 1] * step[k];
        t2 = u.fma(u, t2);
        uv = u.fma(v, uv);
        vv = v.fma(v, vv);
    }
    let (regular, dm, bottom) = ellipse_stiffness(mu[0], impratio, d);
    let j0 = alpha.fma(step[0], j[0]);
    let n = regular * j0;
    let t = t2.sqrt();
    // As in [`Ellipse::new`].
    let inverse = t.max(T::lit(1e-12)).recip();
    let (mt, mn_t) = (regular * t, regular.fma(n, t));
    // The length t and its derivatives along the step; the second one is never negative.
    let t1 = uv * inverse;
    let t11 = t1.fnma(t1, vv).max(z) * inverse;
    // Middle zone: half of dm times the squared gap n − mt, derived twice along the step.
    let (gap, gap1) = (n - mt, regular * (step[0] - t1));
    let first = dm * (gap * gap1);
    let second = dm * gap1.fma(gap1, -((gap * regular) * t11));

    // |u| is smallest where u · v = 0. The bound serves steps without a tangential part.
    let ahead = -(uv.div(vv.max(T::lit(1e-30))));
    let kink = alpha + ahead;
    // Positive stiffness and a negative normal residual: it presses.
    let presses = d * ahead.fma(step[0], j0);
    // A largest and a smallest value over all contacts, in a form that code generators can share among limbs.
    let none = Kinks::none();
    // A kink within 1 % of `alpha` is not told: the search is there already.
    let below = T::select_lt(kink, T::lit(0.99) * alpha, kink, none.below);
    kinks.below = T::select_lt(presses, z, below, none.below).max(kinks.below);
    let above = T::select_lt(T::lit(1.01) * alpha, kink, kink, none.above);
    kinks.above = T::select_lt(presses, z, above, none.above).min(kinks.above);
    (
        g.0 + zone(n, mt, mn_t, first, (d * j0).fma(step[0], bottom * uv)),
        g.1 + zone(n, mt, mn_t, second, (d * step[0]).fma(step[0], bottom * vv)),
    )
}

/// Zero above the cone, `middle` on it, `bottom` below its dual.
#[inline(always)]
fn zone<T: Real>(n: T, mt: T, mn_t: T, middle: T, bottom: T) -> T {
    T::select_lt(n, mt, T::select_lt(T::zero(), mn_t, middle, bottom), T::zero())
}
