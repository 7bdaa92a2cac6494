//! Masses and inertias: from shapes, moved, summed, and brought to principal axes.

use std::f64::consts::PI;

use crate::rotation::{IDENTITY, Quat, Vec3, matrix, normalize, product};

/// Below this a moving mass or inertia counts as none (`mjMINVAL`).
pub(crate) const MIN_MASS: f64 = 1e-15;

/// Symmetric inertia tensor: xx, yy, zz, xy, xz, yz (MJCF's `fullinertia` order), kg·m².
pub(crate) type Tensor = [f64; 6];

/// Mass, centre of mass, principal axes and moments of a body, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Inertial {
    pub mass: f64,
    pub pos: Vec3,
    pub quat: Quat,
    pub inertia: Vec3,
}

/// No mass at the frame's origin.
pub(crate) const MASSLESS: Inertial =
    Inertial { mass: 0.0, pos: [0.0; 3], quat: IDENTITY, inertia: [0.0; 3] };

/// A shape whose volume and inertia are known; sizes are MuJoCo's `geom size`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Solid {
    Sphere { radius: f64 },
    Capsule { radius: f64, half_length: f64 },
    Cylinder { radius: f64, half_length: f64 },
    Ellipsoid { semi_axes: Vec3 },
    Box { half_size: Vec3 },
}

impl Solid {
    /// Volume, m³.
    pub fn volume(&self) -> f64 {
        match *self {
            Solid::Sphere { radius: r } => 4.0 / 3.0 * PI * r.powi(3),
            Solid::Capsule { radius: r, half_length: h } => PI * r * r * (2.0 * h + 4.0 / 3.0 * r),
            Solid::Cylinder { radius: r, half_length: h } => 2.0 * PI * r * r * h,
            Solid::Ellipsoid { semi_axes: [a, b, c] } => 4.0 / 3.0 * PI * a * b * c,
            Solid::Box { half_size: [a, b, c] } => 8.0 * a * b * c,
        }
    }

    /// Principal moments about the centre for a homogeneous solid of this mass, kg·m².
    pub fn inertia(&self, mass: f64) -> Vec3 {
        match *self {
            Solid::Sphere { radius: r } => [0.4 * mass * r * r; 3],
            Solid::Cylinder { radius: r, half_length: h } => {
                let side = mass * (3.0 * r * r + 4.0 * h * h) / 12.0;
                [side, side, mass * r * r / 2.0]
            }
            Solid::Capsule { radius: r, half_length: h } => {
                // Cylinder of length 2h and two half-spheres whose centres of mass lie 3r/8 beyond it.
                let caps = mass * 4.0 * r / (4.0 * r + 6.0 * h);
                let middle = mass - caps;
                let side =
                    middle * (3.0 * r * r + 4.0 * h * h) / 12.0 + caps * (0.4 * r * r + h * h + 0.75 * h * r);
                [side, side, middle * r * r / 2.0 + 0.4 * caps * r * r]
            }
            Solid::Ellipsoid { semi_axes: [a, b, c] } => {
                [b * b + c * c, a * a + c * c, a * a + b * b].map(|s| mass * s / 5.0)
            }
            Solid::Box { half_size: [a, b, c] } => {
                [b * b + c * c, a * a + c * c, a * a + b * b].map(|s| mass * s / 3.0)
            }
        }
    }
}

/// Tensor in the outer frame of principal moments given in a frame rotated by `quat`: R diag(I) Rᵀ.
pub(crate) fn rotated(inertia: Vec3, quat: Quat) -> Tensor {
    let r = matrix(quat);
    let entry = |i: usize, j: usize| (0..3).map(|k| r[i][k] * inertia[k] * r[j][k]).sum::<f64>();
    [entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)]
}

/// Tensor of a point mass at `d`: m (|d|² 1 − d dᵀ) (parallel-axis theorem).
fn parallel_axis(mass: f64, d: Vec3) -> Tensor {
    [
        mass * (d[1] * d[1] + d[2] * d[2]),
        mass * (d[0] * d[0] + d[2] * d[2]),
        mass * (d[0] * d[0] + d[1] * d[1]),
        -mass * d[0] * d[1],
        -mass * d[0] * d[2],
        -mass * d[1] * d[2],
    ]
}

/// Sum of rigidly joined parts; parts without mass are skipped. One part keeps its own axes, as in MuJoCo.
pub(crate) fn combine(parts: &[Inertial]) -> Inertial {
    // MuJoCo's `mjEPS`.
    let parts: Vec<&Inertial> = parts.iter().filter(|p| p.mass > 1e-14).collect();
    match parts.as_slice() {
        [] => MASSLESS,
        [one] => **one,
        many => {
            let mass = many.iter().map(|p| p.mass).sum::<f64>();
            let mut pos = [0.0; 3];
            for part in many {
                for (sum, x) in pos.iter_mut().zip(part.pos) {
                    *sum += part.mass * x;
                }
            }
            let pos = pos.map(|x| x / mass);
            let mut total = [0.0; 6];
            for part in many {
                let offset = [part.pos[0] - pos[0], part.pos[1] - pos[1], part.pos[2] - pos[2]];
                let turned = rotated(part.inertia, part.quat);
                let moved = parallel_axis(part.mass, offset);
                for k in 0..6 {
                    total[k] += turned[k] + moved[k];
                }
            }
            let (inertia, quat) = principal(total);
            Inertial { mass, pos, quat, inertia }
        }
    }
}

/// Principal moments (largest first) and axes of a symmetric tensor, by cyclic Jacobi rotations
/// (Golub and Van Loan, Matrix Computations, section 8.5).
pub(crate) fn principal(tensor: Tensor) -> (Vec3, Quat) {
    let [xx, yy, zz, xy, xz, yz] = tensor;
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut quat = IDENTITY;
    // Jacobi's method converges quadratically, so a few sweeps are enough; the bound ends the loop on NaN.
    for _ in 0..60 {
        let off = a[0][1].abs().max(a[0][2].abs()).max(a[1][2].abs());
        let scale = a[0][0].abs().max(a[1][1].abs()).max(a[2][2].abs());
        // What is left is a hundredth of the rounding error of the largest entry: more sweeps gain nothing.
        if off <= f64::EPSILON * scale * 0.01 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate_away(&mut a, &mut quat, p, q);
        }
    }
    let mut values = [a[0][0], a[1][1], a[2][2]];
    // Bubble sort by quarter turns about the third axis keeps the frame right-handed.
    for i in [0, 1, 0] {
        if values[i] < values[i + 1] {
            values.swap(i, i + 1);
            let mut turn = [std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, 0.0];
            turn[(i + 2) % 3 + 1] = std::f64::consts::FRAC_1_SQRT_2;
            quat = normalize(product(quat, turn));
        }
    }
    (values, quat)
}

/// One Jacobi rotation in the plane of axes `p` < `q`: makes `a[p][q]` zero, accumulates the turn.
fn rotate_away(a: &mut [[f64; 3]; 3], quat: &mut Quat, p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let tau = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    // The smaller root of t² + 2 τ t − 1 = 0: a turn of at most 45°.
    // Where τ² overflows, t becomes 0: the entry is so small then that no turn is needed.
    let t = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    // A ← Jᵀ A J with J = [c s; −s c] in the plane (p, q).
    for k in 0..3 {
        let (akp, akq) = (a[k][p], a[k][q]);
        a[k][p] = c * akp - s * akq;
        a[k][q] = s * akp + c * akq;
    }
    for k in 0..3 {
        let (apk, aqk) = (a[p][k], a[q][k]);
        a[p][k] = c * apk - s * aqk;
        a[q][k] = s * apk + c * aqk;
    }
    // J is a rotation by −atan(t) about the third axis when (p, q) is (0,1) or (1,2), by +atan(t) for
    // (0,2), whose positive sense runs from z to x.
    let angle = t.atan() * if (p, q) == (0, 2) { 1.0 } else { -1.0 };
    let (half_sine, half_cosine) = (angle / 2.0).sin_cos();
    let mut turn = [half_cosine, 0.0, 0.0, 0.0];
    turn[4 - p - q] = half_sine;
    *quat = normalize(product(*quat, turn));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_rebuild_the_tensor() {
        for tensor in [
            [3.0, 2.0, 1.0, 0.3, -0.2, 0.1],
            [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            [0.02448, 0.098077, 0.107, 0.00012166, 0.0014849, -3.12e-5],
            [1.0, 2.0, 3.0, 1e-9, 0.0, 0.5],
        ] {
            let (values, quat) = principal(tensor);
            assert!(values[0] >= values[1] && values[1] >= values[2]);
            for (rebuilt, given) in rotated(values, quat).iter().zip(tensor) {
                assert!((rebuilt - given).abs() < 1e-14, "{rebuilt} {given}");
            }
        }
    }

    #[test]
    fn two_half_boxes_are_one_box() {
        let half = Solid::Box { half_size: [0.1, 0.2, 0.15] };
        let part = |z| Inertial { mass: 2.0, pos: [0.0, 0.0, z], quat: IDENTITY, inertia: half.inertia(2.0) };
        let whole = combine(&[part(0.15), part(-0.15)]);
        let want = Solid::Box { half_size: [0.1, 0.2, 0.3] }.inertia(4.0);
        let tensor = rotated(whole.inertia, whole.quat);
        for k in 0..3 {
            assert!((tensor[k] - want[k]).abs() < 1e-14);
        }
        assert_eq!(whole.mass, 4.0);
    }
}
