//! Joint by joint: traces, residuals, and a close look at the worst moment.

use super::JointTrace;
use super::traces::{self, MAX_JOINTS, POINT_BUDGET};
use crate::format::{clean, significant};
use serde::Serialize;

/// Lines of a joint: four traces and two residuals, in two charts.
const LINES_A_JOINT: usize = 12;
/// Length of the close look, s.
const CLOSE_LOOK: f64 = 4.0;

#[derive(Serialize)]
pub(super) struct Traces {
    cards: Vec<TraceCard>,
    left_out: usize,
}

#[derive(Serialize)]
struct TraceCard {
    joint: String,
    file: String,
    before: String,
    after: String,
    unit: &'static str,
    svg: String,
    close: Option<String>,
    checked: bool,
}

pub(super) fn build(joints: &[JointTrace]) -> Traces {
    let shown = &joints[..joints.len().min(MAX_JOINTS)];
    // Fewer than 60 points hide the motion. More than 400 do not show in a chart of 420 units.
    let points = (POINT_BUDGET / (LINES_A_JOINT * shown.len().max(1))).clamp(60, 400);
    let mut cards: Vec<(f64, TraceCard)> = shown.iter().filter_map(|t| card(t, points)).collect();
    // The close look opens on the joint that is fitted worst.
    let worst =
        cards.iter().enumerate().filter(|(_, c)| c.0.is_finite()).max_by(|a, b| a.1.0.total_cmp(&b.1.0));
    let worst = worst.map_or(0, |(i, _)| i);
    if let Some((_, card)) = cards.get_mut(worst) {
        card.checked = true;
    }
    Traces { cards: cards.into_iter().map(|(_, card)| card).collect(), left_out: joints.len() - shown.len() }
}

/// The joint's card with its fitted RMSE; `None` when there is nothing to draw.
fn card(trace: &JointTrace, points: usize) -> Option<(f64, TraceCard)> {
    // Small charts for all joints, and a large one of the worst moment, in which the nominal error would hide the
    // fitted one.
    let whole = traces::Size { width: 420.0, height: 276.0, residual: 66.0, nominal_residual: true, points };
    let close = traces::Size { width: 960.0, height: 400.0, residual: 90.0, nominal_residual: false, points };
    let rmse = |simulated: &[f64]| root_mean_square(&traces::residual(simulated, &trace.measured));
    let after = rmse(&trace.fitted);
    let card = TraceCard {
        joint: clean(&trace.joint),
        file: clean(&trace.file),
        before: significant(rmse(&trace.nominal), 3),
        after: significant(after, 3),
        unit: trace.unit(),
        svg: traces::trace(trace, 0..trace.time_s.len(), &whole)?,
        close: traces::trace(trace, traces::worst_window(trace, CLOSE_LOOK), &close),
        checked: false,
    };
    Some((after, card))
}

/// NaN without any finite value.
pub(crate) fn root_mean_square(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|x| x.is_finite());
    // Without any value it is 0/0, which is NaN.
    (finite().map(|x| x * x).sum::<f64>() / finite().count() as f64).sqrt()
}
