//! Signals as bytes: for each matrix its length and one more, or 0 where there is none, then its numbers, little-endian.

use gaitfit_adapt::SimulatorError;
use gaitfit_adapt::fit::Predicted;

/// The signals of rollouts, one list of recordings each.
pub(super) fn write(predictions: &[Vec<Predicted>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for one in predictions.iter().flatten() {
        let fell = one.fell_at.map_or(0, |sample| sample as u64 + 1);
        // 0 is no fall, so the number of the sample is one more.
        bytes.extend(fell.to_le_bytes());
        let optional = [&one.action, &one.base_position, &one.base_velocity];
        let matrices =
            [Some(&one.position), Some(&one.velocity)].into_iter().chain(optional.map(Option::as_ref));
        for matrix in matrices {
            bytes.extend(matrix.map_or(0, |matrix| matrix.len() as u64 + 1).to_le_bytes());
            matrix.into_iter().flatten().for_each(|number| bytes.extend(number.to_le_bytes()));
        }
    }
    bytes
}

/// Reads the signals that [`write`] wrote of `rollouts`, of as many recordings each, in their order.
///
/// # Errors
/// Bytes that are something else.
pub(super) fn read(
    bytes: &[u8],
    rollouts: usize,
    recordings: usize,
    mut take: impl FnMut(usize, usize, &Predicted),
) -> Result<(), SimulatorError> {
    let mut rest = bytes;
    for rollout in 0..rollouts {
        for recording in 0..recordings {
            let one = predicted(&mut rest)
                .ok_or_else(|| SimulatorError::failed("signals were cut short on their way"))?;
            take(rollout, recording, &one);
        }
    }
    if rest.is_empty() {
        Ok(())
    } else {
        Err(SimulatorError::failed("more signals came than were asked for"))
    }
}

fn predicted(rest: &mut &[u8]) -> Option<Predicted> {
    let fell_at = number(rest)?.checked_sub(1);
    let [position, velocity, action, base_position, base_velocity] =
        [matrix(rest)?, matrix(rest)?, matrix(rest)?, matrix(rest)?, matrix(rest)?];
    let (position, velocity) = (position?, velocity?);
    Some(Predicted { position, velocity, action, base_position, base_velocity, fell_at })
}

fn number(rest: &mut &[u8]) -> Option<usize> {
    let (first, others) = rest.split_first_chunk::<8>()?;
    *rest = others;
    usize::try_from(u64::from_le_bytes(*first)).ok()
}

fn matrix(rest: &mut &[u8]) -> Option<Option<Vec<f32>>> {
    let Some(count) = number(rest)?.checked_sub(1) else { return Some(None) };
    // The length comes from another process. Both checks refuse a length that the bytes do not hold.
    let (bytes, others) = rest.split_at_checked(count.checked_mul(size_of::<f32>())?)?;
    *rest = others;
    let (numbers, _) = bytes.as_chunks::<4>();
    Some(Some(numbers.iter().map(|number| f32::from_le_bytes(*number)).collect()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn signals_come_back_bit_by_bit_and_others_are_refused() {
        let one = |first: f32, fell_at| Predicted {
            position: vec![first, -0.0, f32::MIN_POSITIVE],
            velocity: vec![f32::NAN],
            action: None,
            base_position: Some(Vec::new()),
            base_velocity: Some(vec![2.5]),
            fell_at,
        };
        let sent = vec![vec![one(1.0, None), one(2.0, Some(0))], vec![one(3.0, Some(7)), one(4.0, None)]];
        let bytes = write(&sent);
        let mut received = Vec::new();
        read(&bytes, 2, 2, |rollout, recording, one| received.push((rollout, recording, one.clone())))
            .unwrap();
        let bits = |one: &Predicted| {
            (format!("{one:?}"), one.position.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
        };
        for (rollout, recording, one) in &received {
            assert_eq!(bits(one), bits(&sent[*rollout][*recording]));
        }
        assert_eq!(received.len(), 4);
        for wrong in [&bytes[..bytes.len() - 1], &[bytes.as_slice(), &[0]].concat(), &[255; 64]] {
            assert!(read(wrong, 2, 2, |_, _, _| ()).is_err());
        }
    }
}
