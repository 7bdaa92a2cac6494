//! A joint that the fit predicts far worse than all others: no parameter of its group mends it.

use gaitfit_view::{Doubt, DoubtKind};

/// Error of a joint over the median of the others, and in rad, from which on it stands out. On logs of a real Go2 the worst
/// joint has three times the median.
const TIMES: f64 = 8.0;
const MIN_RAD: f64 = 0.02;
/// The sentence of the doubt about each such joint.
const PREDICTED: &str = "is predicted far worse than the other joints";

/// The joints that stand out among `errors`, position errors (rad RMS) by name; `None` if none does.
pub(super) fn doubt(errors: &[(String, f64)]) -> Option<Doubt> {
    let usual = |but: usize| {
        let mut others: Vec<f64> =
            errors.iter().enumerate().filter(|(at, _)| *at != but).map(|(_, (_, error))| *error).collect();
        others.sort_by(f64::total_cmp);
        others.get(others.len() / 2).copied()
    };
    // Both limits are needed: between errors that are all tiny, a ratio says nothing.
    let stands_out = |(at, (name, error)): (usize, &(String, f64))| {
        let usual = usual(at)?;
        (*error > MIN_RAD && *error > TIMES * usual).then(|| {
            format!("{name} {PREDICTED}: by {error:.4} rad, and the median of the others is {usual:.4} rad")
        })
    };
    let named: Vec<String> = errors.iter().enumerate().filter_map(stands_out).collect();
    let text = format!(
        "{}. Check its sign, zero, unit and gear in the log, and whether its columns are another joint's.",
        named.join("; ")
    );
    (!named.is_empty()).then(|| Doubt::new(DoubtKind::Misfit, text))
}

/// The sentences of `doubts` about joints that stand out.
pub(super) fn sentence(doubts: &[Doubt]) -> Option<String> {
    doubts.iter().find(|doubt| doubt.text.contains(PREDICTED)).map(|doubt| doubt.text.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(values: &[f64]) -> Vec<(String, f64)> {
        values.iter().enumerate().map(|(at, error)| (format!("j{at}"), *error)).collect()
    }

    #[test]
    fn a_joint_of_wrong_sign_is_named_and_uneven_joints_are_not() {
        let text =
            doubt(&errors(&[0.0004, 0.1002, 0.0004, 0.0005])).map(|doubt| doubt.text).unwrap_or_default();
        assert!(text.starts_with("j1 is predicted far worse than the other joints: by 0.1002 rad"), "{text}");
        assert_eq!(sentence(&[Doubt::new(DoubtKind::Misfit, text.clone())]), Some(text));
        assert!(doubt(&errors(&[0.004, 0.012, 0.02, 0.006])).is_none());
        assert!(doubt(&errors(&[0.0001, 0.003, 0.0001, 0.0002])).is_none());
        assert!(doubt(&errors(&[0.3])).is_none() && doubt(&[]).is_none());
    }
}
