//! A joint that the fit predicts far worse than all others: no parameter of its group mends it.

use gaitfit_model::JointKind;
use gaitfit_view::{Doubt, DoubtKind};

/// Error of a joint over the median of the others, and in rad, from which on it stands out. On logs of a real Go2 the worst
/// joint has three times the median. An error of a slide counts as the
/// hinge error that [`JointKind::like`] gives for it.
const TIMES: f64 = 8.0;
const MIN_RAD: f64 = 0.02;
/// The sentence of the doubt about each such joint.
const PREDICTED: &str = "is predicted far worse than the other joints";

/// The joints that stand out among `errors`, position errors (rad RMS, of slides m) by name; `None` if none does.
/// `kind`: whether a joint turns or slides.
pub(super) fn doubt(errors: &[(String, f64)], kind: impl Fn(&str) -> JointKind) -> Option<Doubt> {
    // A hinge has 1 here.
    let scale = |name: &str| kind(name).like("rad", 1.0);
    let usual = |but: usize| {
        let others = errors.iter().enumerate().filter(|(at, _)| *at != but);
        let mut others: Vec<f64> = others.map(|(_, (name, error))| error / scale(name)).collect();
        others.sort_by(f64::total_cmp);
        others.get(others.len() / 2).copied()
    };
    // Both limits are needed: between errors that are all tiny, a ratio says nothing.
    let stands_out = |(at, (name, error)): (usize, &(String, f64))| {
        let (usual, unit) = (usual(at)? * scale(name), kind(name).unit("rad"));
        (*error > MIN_RAD * scale(name) && *error > TIMES * usual).then(|| {
            format!(
                "{name} {PREDICTED}: by {error:.4} {unit}, and the median of the others is {usual:.4} {unit}"
            )
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

    fn doubt(errors: &[(String, f64)]) -> Option<Doubt> {
        super::doubt(errors, |_| JointKind::Hinge)
    }

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

    #[test]
    fn errors_of_slides_count_by_their_unit() {
        let slide = |name: &str| if name == "j1" { JointKind::Slide } else { JointKind::Hinge };
        // 0.01 m is as far off as 0.1 rad.
        let text = super::doubt(&errors(&[0.004, 0.01, 0.004, 0.005]), slide).map(|doubt| doubt.text);
        let text = text.unwrap_or_default();
        let wanted = "j1 is predicted far worse than the other joints: by 0.0100 m, \
                      and the median of the others is 0.0004 m";
        assert!(text.starts_with(wanted), "{text}");
    }
}
