//! Shapes of values, and which numbers of them meet.

use super::MAX_NUMBERS;
use crate::onnx::node_error::{NodeError, misfit};
use gaitfit_policy::graph::Reach;

/// Max number of axes.
pub(super) const MAX_AXES: usize = 6;

/// Numbers of a shape; `None` for too many of them or of axes.
pub(super) fn count(dims: &[usize]) -> Option<usize> {
    let count = dims.iter().try_fold(1_usize, |count, &length| count.checked_mul(length))?;
    // Shapes come from a file, so both limits are checked before memory is taken.
    (dims.len() <= MAX_AXES && count <= MAX_NUMBERS).then_some(count)
}

/// The place of an axis, which a negative number counts from the end.
pub(super) fn axis(number: i64, dims: &[usize]) -> Result<usize, NodeError> {
    let many = dims.len() as i64;
    let place = if number < 0 { number.saturating_add(many) } else { number };
    if (0..many).contains(&place) {
        Ok(place as usize)
    } else {
        Err(misfit(format!("it names axis {number} of {dims:?}")))
    }
}

/// The shape of numbers that meet: axes are aligned at the end, and axes of length one are repeated.
pub(super) fn broadcast(all: &[&[usize]]) -> Result<Vec<usize>, NodeError> {
    let many = all.iter().map(|dims| dims.len()).max().unwrap_or(0);
    let mut dims = vec![1; many];
    for one in all {
        // Shapes are aligned at their last axes, as in NumPy.
        for (to, &length) in dims[many - one.len()..].iter_mut().zip(*one) {
            if *to == 1 {
                *to = length;
            } else if length != 1 && length != *to {
                return Err(misfit(format!(
                    "its inputs have the shapes {all:?}, which do not fit each other"
                )));
            }
        }
    }
    Ok(dims)
}

/// Returns the number of `from` for each place of `to`, whose shape [`broadcast`] gave.
pub(super) fn reach(from: &[usize], to: &[usize]) -> Reach {
    let count: usize = from.iter().product();
    let total: usize = to.iter().product();
    // As many numbers on both sides: only axes of length one can differ.
    if count == total {
        return Reach::Same;
    }
    if count == 1 {
        return Reach::One;
    }
    // Axes that `from` lacks come first, and their stride is 0: the numbers repeat along them.
    let ahead = to.len() - from.len();
    let mut strides = vec![0; to.len()];
    let mut stride = 1;
    for (place, &length) in from.iter().enumerate().rev() {
        // A length of one is repeated along the axis: its number stays the same.
        strides[ahead + place] = if length == 1 { 0 } else { stride };
        stride *= length;
    }
    let place = |number: usize| {
        // The last axis varies fastest, so indices are taken off from the back.
        let (mut rest, mut place) = (number, 0);
        for (&length, &stride) in to.iter().zip(&strides).rev() {
            place += rest % length * stride;
            rest /= length;
        }
        place as u32
    };
    Reach::Listed((0..total).map(place).collect())
}

/// Where each number goes if the axes `gone` are summed over, and the shape with them as axes of length one.
pub(super) fn reduced(dims: &[usize], gone: &[usize]) -> (Vec<u32>, Vec<usize>) {
    let kept: Vec<usize> = dims
        .iter()
        .enumerate()
        .map(|(axis, &length)| if gone.contains(&axis) { 1 } else { length })
        .collect();
    match reach(&kept, dims) {
        Reach::Same => ((0..dims.iter().product::<usize>() as u32).collect(), kept),
        Reach::One => (vec![0; dims.iter().product()], kept),
        Reach::Listed(places) => (places, kept),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn shapes_meet_at_their_ends() {
        assert_eq!(broadcast(&[&[1, 3], &[3], &[2, 1]]).unwrap(), [2, 3]);
        assert!(broadcast(&[&[2, 3], &[2]]).is_err());
        assert_eq!(reach(&[3], &[1, 3]), Reach::Same);
        assert_eq!(reach(&[1, 1], &[2, 3]), Reach::One);
        assert_eq!(reach(&[2, 1], &[2, 3]), Reach::Listed(vec![0, 0, 0, 1, 1, 1]));
        assert_eq!(reach(&[3], &[2, 3]), Reach::Listed(vec![0, 1, 2, 0, 1, 2]));
        assert_eq!(reduced(&[2, 3], &[0]), (vec![0, 1, 2, 0, 1, 2], vec![1, 3]));
        assert_eq!(reduced(&[1, 2], &[0]), (vec![0, 1], vec![1, 2]));
        assert_eq!(axis(-1, &[4, 5]), Ok(1));
        assert!(axis(2, &[4, 5]).is_err() && axis(i64::MIN, &[4]).is_err());
    }
}
