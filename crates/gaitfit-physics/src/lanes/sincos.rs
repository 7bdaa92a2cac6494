//! Sine and cosine of `f32` lanes.

use crate::Real;

/// Both, by reduction to [−π/4, π/4] (three-part π/2) and the Cephes minimax polynomials (Moshier 1989).
/// `round` rounds to the nearest whole number; `turn(k, s, c)` is (s, c) turned by `k` quarters. Error below 1e-7
/// for |x| < 1,000.
#[inline(always)]
pub(super) fn sin_cos<T: Real>(x: T, round: fn(T) -> T, turn: fn(T, T, T) -> (T, T)) -> (T, T) {
    let k = round(x * T::lit(core::f64::consts::FRAC_2_PI));
    // π/2 in three parts whose products with k are exact, fused or not (Cody and Waite 1980).
    let y = k.fnma(T::lit(1.570_312_5), x);
    let y = k.fnma(T::lit(4.837_512_969_970_703e-4), y);
    let y = k.fnma(T::lit(7.549_789_954_891_882e-8), y);
    let z = y * y;
    let p = z.fma(T::lit(-1.951_529_589_1e-4), T::lit(8.332_160_873_6e-3));
    let p = z.fma(p, T::lit(-1.666_665_461_1e-1));
    let s = (p * z).fma(y, y);
    let c = z.fma(T::lit(2.443_315_711_809_948e-5), T::lit(-1.388_731_625_493_765e-3));
    let c = z.fma(c, T::lit(4.166_664_568_298_827e-2));
    let c = (c * z).fma(z, z.fma(T::lit(-0.5), T::lit(1.0)));
    turn(k, s, c)
}

/// (s, c) turned by `k` quarters, in floating point alone.
#[inline(always)]
pub(super) fn turn<T: Real>(k: T, s: T, c: T, round: fn(T) -> T) -> (T, T) {
    // Quadrant in −2, −1, 0, 1, 2: k − 4·round(k/4).
    let quadrant = round(k * T::lit(0.25)).fnma(T::lit(4.0), k);
    let half = T::lit(0.5);
    let odd = (quadrant.abs() - T::lit(1.0)).abs();
    let (a, b) = (T::select_lt(odd, half, c, s), T::select_lt(odd, half, s, c));
    // sin changes sign in quadrants −2, −1 and 2; cos in 1, −2 and 2.
    let sin_sign = T::select_lt((quadrant - half).abs(), T::lit(1.25), T::lit(1.0), T::lit(-1.0));
    let cos_sign = T::select_lt((quadrant + half).abs(), T::lit(1.25), T::lit(1.0), T::lit(-1.0));
    (a * sin_sign, b * cos_sign)
}
