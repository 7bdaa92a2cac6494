//! The base's frames in a control step: written once for the CPU and for the kernels of GPUs, which are recorded from this.
//!
//! Formulas, and their bits in `f32`, are those of [`gaitfit_model::rotation`], whose numbers cannot be recorded.

use gaitfit_physics::Real;

/// The x, y and z axes of the body of orientation `q` (wxyz, unit), in the world: the columns of its matrix.
fn axes<R: Real>([w, x, y, z]: [R; 4]) -> [[R; 3]; 3] {
    let (one, two) = (R::lit(1.0), R::lit(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)],
        [two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)],
        [two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)],
    ]
}

/// Scalar product.
pub fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The world's z axis in the frame of a body of orientation `q` (wxyz, unit): against gravity.
pub fn up<R: Real>(q: [R; 4]) -> [R; 3] {
    axes(q).map(|axis| axis[2])
}

/// A world vector in the frame of a body of orientation `q` (wxyz, unit).
pub fn to_body<R: Real>(q: [R; 4], v: [R; 3]) -> [R; 3] {
    axes(q).map(|axis| dot(axis, v))
}

/// A world vector in the frame of the heading of a body of orientation `q` (wxyz, unit): forward, left, up.
pub fn to_heading<R: Real>(q: [R; 4], v: [R; 3]) -> [R; 3] {
    // The left axis is taken and not the forward one, which points straight up if a robot stands on its hind legs.
    let [_, left, _] = axes(q);
    let length = (left[0] * left[0] + left[1] * left[1]).sqrt();
    // The left axis points straight up or down if the robot lies exactly on its side: it has no heading then,
    // and nothing must be divided by 0.
    let least = R::lit(1e-6);
    let length = R::select_lt(least, length, length, least);
    let (x, y) = (left[0].div(length), left[1].div(length));
    [y * v[0] - x * v[1], x * v[0] + y * v[1], v[2]]
}

/// Cosine of the angle between gravity (`−up`) and `posture`, where it is wanted; both in the body frame, unit.
pub fn uprightness<R: Real>(up: [R; 3], posture: [R; 3]) -> R {
    dot(up.map(|x| -x), posture)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_model::rotation;
    use gaitfit_random::{Purpose, Stream};

    #[test]
    fn frames_have_the_bits_of_the_models_rotations() {
        let noise = Stream::new(2, Purpose::BOOTSTRAP);
        for draw in 0..200u32 {
            let q: [f32; 4] = std::array::from_fn(|k| noise.normal(8 * draw + k as u32) as f32);
            let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            let q = if draw == 0 { [0.5, 0.5, 0.5, 0.5] } else { q.map(|x| x / norm) };
            let v: [f32; 3] = std::array::from_fn(|k| noise.normal(8 * draw + 4 + k as u32) as f32);
            let bits = |v: [f32; 3]| v.map(f32::to_bits);
            assert_eq!(bits(up(q)), bits(rotation::up(q)));
            assert_eq!(bits(to_body(q, v)), bits(rotation::rotate_back(q, v)));
            assert_eq!(bits(to_heading(q, v)), bits(rotation::to_heading(q, v)));
        }
    }
}
