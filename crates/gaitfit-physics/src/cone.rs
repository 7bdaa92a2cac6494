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
    if condim == 1 {
        let s = T::select_lt(j[0], z, d, z);
        return ([s * j[0], z, z], [s, z, z, z, z, z]);
    }
    let (m1, m2) = (mu[0], mu[1]);
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

/// First and second derivative along `step` of the three-dimensional pyramid's cost at residual `j`.
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
    let regular = mu[0] * T::lit(impratio.sqrt().recip());
    // Bottom zone: plain quadratic with D_k·mu_1² = D_1·mu_k².
    let tangent_d = (d * T::lit(impratio)).div(mu[0] * mu[0]);
    let n = regular * j[0];
    let mut u = [z; 6];
    let mut t2 = z;
    for k in 1..condim {
        u[k] = mu[k - 1] * j[k];
        t2 = u[k].fma(u[k], t2);
    }
    let t = t2.sqrt();
    let ts = t.max(T::lit(1e-12));
    let inv_t = ts.recip();
    let (mt, mn_t) = (regular * t, regular.fma(n, t));
    let reg2 = regular * regular;
    let dm = d.div(reg2.fma(reg2, reg2));
    let middle_n = (dm * (n - mt)) * regular;
    let radial = (regular * n) * ((inv_t * inv_t) * inv_t);
    let round = reg2 - (regular * n) * inv_t;

    let mut force = [z; 6];
    let mut w = [[z; 6]; 6];
    force[0] = zone(n, mt, mn_t, middle_n, d * j[0]);
    w[0][0] = zone(n, mt, mn_t, dm * reg2, d);
    for k in 1..condim {
        let dk = tangent_d * (mu[k - 1] * mu[k - 1]);
        let uk = u[k] * mu[k - 1];
        force[k] = zone(n, mt, mn_t, -((middle_n * inv_t) * uk), dk * j[k]);
        w[0][k] = zone(n, mt, mn_t, -((dm * reg2) * (inv_t * uk)), z);
        w[k][0] = w[0][k];
        for l in 1..=k {
            let ul = u[l] * mu[l - 1];
            let mut h = radial * (uk * ul);
            if l == k {
                h = round.fma(mu[k - 1] * mu[k - 1], h);
            }
            w[k][l] = zone(n, mt, mn_t, dm * h, if l == k { dk } else { z });
            w[l][k] = w[k][l];
        }
    }
    (force, w)
}

/// Zero above the cone, `middle` on it, `bottom` below its dual.
#[inline(always)]
fn zone<T: Real>(n: T, mt: T, mn_t: T, middle: T, bottom: T) -> T {
    T::select_lt(n, mt, T::select_lt(T::zero(), mn_t, middle, bottom), T::zero())
}
