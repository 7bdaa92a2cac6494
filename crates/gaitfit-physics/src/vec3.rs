//! Three-vectors, rotations and symmetric 3 × 3 matrices over [`Real`].

use crate::Real;

/// A vector of three.
pub type V3<T> = [T; 3];
/// A rotation matrix, rows first.
pub type M3<T> = [V3<T>; 3];
/// A symmetric 3 × 3 matrix: xx, yy, zz, xy, xz, yz.
pub type Sym3<T> = [T; 6];

/// `[f(0), f(1), …]` without a closure, so that the element expression is compiled in its caller's context.
macro_rules! each3 {
    ($i:ident => $e:expr) => {
        [
            {
                let $i = 0;
                $e
            },
            {
                let $i = 1;
                $e
            },
            {
                let $i = 2;
                $e
            },
        ]
    };
}
pub(crate) use each3;

#[inline(always)]
pub(crate) fn zero3<T: Real>() -> V3<T> {
    [T::zero(); 3]
}
#[inline(always)]
pub(crate) fn k3<T: Real>(v: &[T::K; 3]) -> V3<T> {
    [T::k(v[0]), T::k(v[1]), T::k(v[2])]
}
#[inline(always)]
pub(crate) fn add<T: Real>(a: V3<T>, b: V3<T>) -> V3<T> {
    each3!(i => a[i] + b[i])
}
#[inline(always)]
pub(crate) fn sub<T: Real>(a: V3<T>, b: V3<T>) -> V3<T> {
    each3!(i => a[i] - b[i])
}
#[inline(always)]
pub(crate) fn scale<T: Real>(s: T, a: V3<T>) -> V3<T> {
    each3!(i => s * a[i])
}
/// `c + s·a`.
#[inline(always)]
pub(crate) fn axpy<T: Real>(s: T, a: V3<T>, c: V3<T>) -> V3<T> {
    each3!(i => s.fma(a[i], c[i]))
}
#[inline(always)]
pub(crate) fn dot<T: Real>(a: V3<T>, b: V3<T>) -> T {
    a[0].fma(b[0], a[1].fma(b[1], a[2] * b[2]))
}
/// `c + a·b`.
#[inline(always)]
pub(crate) fn dot_add<T: Real>(a: V3<T>, b: V3<T>, c: T) -> T {
    a[0].fma(b[0], a[1].fma(b[1], a[2].fma(b[2], c)))
}
#[inline(always)]
pub(crate) fn cross<T: Real>(a: V3<T>, b: V3<T>) -> V3<T> {
    [a[2].fnma(b[1], a[1] * b[2]), a[0].fnma(b[2], a[2] * b[0]), a[1].fnma(b[0], a[0] * b[1])]
}
/// `c + a × b`.
#[inline(always)]
pub(crate) fn cross_add<T: Real>(a: V3<T>, b: V3<T>, c: V3<T>) -> V3<T> {
    [
        b[1].fnma(a[2], a[1].fma(b[2], c[0])),
        b[2].fnma(a[0], a[2].fma(b[0], c[1])),
        b[0].fnma(a[1], a[0].fma(b[1], c[2])),
    ]
}
/// After a region that changed the numbers: see [`Real::merge`].
#[inline(always)]
pub(crate) fn merge_all<T: Real, const N: usize>(all: &mut [T; N], guard: T::Guard, before: &[T; N]) {
    for k in 0..N {
        all[k] = all[k].merge(guard, before[k]);
    }
}
/// `R v`.
#[inline(always)]
pub(crate) fn rotate<T: Real>(r: &M3<T>, v: V3<T>) -> V3<T> {
    each3!(i => dot(r[i], v))
}
/// `c + R v`.
#[inline(always)]
pub(crate) fn rotate_add<T: Real>(r: &M3<T>, v: V3<T>, c: V3<T>) -> V3<T> {
    each3!(i => dot_add(r[i], v, c[i]))
}
/// `c + R v` with a constant vector.
#[inline(always)]
pub(crate) fn rotate_k_add<T: Real>(r: &M3<T>, v: &[T::K; 3], c: V3<T>) -> V3<T> {
    let v = k3::<T>(v);
    each3!(i => dot_add(r[i], v, c[i]))
}
/// `Rᵀ v`.
#[inline(always)]
pub(crate) fn rotate_back<T: Real>(r: &M3<T>, v: V3<T>) -> V3<T> {
    axpy(v[0], r[0], axpy(v[1], r[1], scale(v[2], r[2])))
}
/// `S v` for a symmetric matrix.
#[inline(always)]
pub(crate) fn sym_mul<T: Real>(s: &Sym3<T>, v: V3<T>) -> V3<T> {
    [
        s[0].fma(v[0], s[3].fma(v[1], s[4] * v[2])),
        s[3].fma(v[0], s[1].fma(v[1], s[5] * v[2])),
        s[4].fma(v[0], s[5].fma(v[1], s[2] * v[2])),
    ]
}
/// `c + S v` for a symmetric matrix.
#[inline(always)]
pub(crate) fn sym_mul_add<T: Real>(s: &Sym3<T>, v: V3<T>, c: V3<T>) -> V3<T> {
    [
        s[0].fma(v[0], s[3].fma(v[1], s[4].fma(v[2], c[0]))),
        s[3].fma(v[0], s[1].fma(v[1], s[5].fma(v[2], c[1]))),
        s[4].fma(v[0], s[5].fma(v[1], s[2].fma(v[2], c[2]))),
    ]
}
/// `R S Rᵀ` for a symmetric matrix.
#[inline(always)]
pub(crate) fn sym_rotate<T: Real>(r: &M3<T>, s: &Sym3<T>) -> Sym3<T> {
    let y: M3<T> = each3!(i => sym_mul(s, r[i]));
    [dot(r[0], y[0]), dot(r[1], y[1]), dot(r[2], y[2]), dot(r[0], y[1]), dot(r[0], y[2]), dot(r[1], y[2])]
}
/// `R S Rᵀ` for a rotational inertia, whose trace is at least twice its largest element: the last diagonal element
/// comes from the trace, at no loss of the others' accuracy.
#[inline(always)]
pub(crate) fn inertia_rotate<T: Real>(r: &M3<T>, s: &Sym3<T>) -> Sym3<T> {
    let (x, y) = (sym_mul(s, r[0]), sym_mul(s, r[1]));
    let (xx, yy) = (dot(r[0], x), dot(r[1], y));
    let zz = ((s[0] + s[1]) + s[2]) - (xx + yy);
    [xx, yy, zz, dot(r[1], x), dot(r[2], x), dot(r[2], y)]
}
/// Rotation matrix of a unit quaternion (wxyz).
#[inline(always)]
pub(crate) fn quat_matrix<T: Real>(q: &[T; 4]) -> M3<T> {
    let [w, x, y, z] = *q;
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let (xx, yy, zz) = (x * x2, y * y2, z * z2);
    let (xy, xz, yz) = (x * y2, x * z2, y * z2);
    let (wx, wy, wz) = (w * x2, w * y2, w * z2);
    let one = T::lit(1.0);
    [
        [one - (yy + zz), xy - wz, xz + wy],
        [xy + wz, one - (xx + zz), yz - wx],
        [xz - wy, yz + wx, one - (xx + yy)],
    ]
}
/// Hamilton product of quaternions (wxyz).
#[inline(always)]
pub(crate) fn quat_mul<T: Real>(a: &[T; 4], b: &[T; 4]) -> [T; 4] {
    [
        a[1].fnma(b[1], a[2].fnma(b[2], a[3].fnma(b[3], a[0] * b[0]))),
        a[0].fma(b[1], a[1].fma(b[0], a[2].fma(b[3], -(a[3] * b[2])))),
        a[0].fma(b[2], a[2].fma(b[0], a[3].fma(b[1], -(a[1] * b[3])))),
        a[0].fma(b[3], a[3].fma(b[0], a[1].fma(b[2], -(a[2] * b[1])))),
    ]
}
