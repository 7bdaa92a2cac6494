//! Distributions of the joints' signals, robot against simulators.

use super::cumulative::{Quantiles, cumulative};
use super::{Signal, SignalDistribution};
use crate::chart::Look;
use crate::format::{clean, significant};
use serde::Serialize;

/// Joints drawn at most.
const MAX_JOINTS: usize = 48;

#[derive(Serialize)]
pub(crate) struct DistributionGroup {
    title: &'static str,
    cards: Vec<Card>,
    left_out: usize,
}

#[derive(Serialize)]
struct Card {
    joint: String,
    /// Distances to the log; none when unknown.
    before: Option<String>,
    after: Option<String>,
    /// Unit of the distances; empty without one.
    unit: &'static str,
    svg: String,
}

/// One group a signal that has any.
pub(crate) fn build(distributions: &[SignalDistribution]) -> Vec<DistributionGroup> {
    let titled = [
        (Signal::Position, "Joint position"),
        (Signal::Velocity, "Joint velocity"),
        (Signal::Action, "Action"),
    ];
    titled
        .into_iter()
        .map(|(signal, title)| {
            let of_signal = || distributions.iter().filter(|d| d.signal == signal);
            DistributionGroup {
                title,
                cards: of_signal().take(MAX_JOINTS).filter_map(|d| card(d, title)).collect(),
                left_out: of_signal().count().saturating_sub(MAX_JOINTS),
            }
        })
        .filter(|group| !group.cards.is_empty())
        .collect()
}

fn card(data: &SignalDistribution, title: &str) -> Option<Card> {
    let unit = if data.slides { data.signal.unit_of_slides() } else { data.signal.unit() };
    let x_title = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
    let curve = |label, look, values| Quantiles { label, look, values };
    let curves = [
        curve("log", Look::MEASURED, &data.log[..]),
        curve("nominal", Look::NOMINAL, &data.nominal),
        curve("fitted", Look::FITTED, &data.fitted),
    ];
    let known = |x: f64| x.is_finite().then(|| significant(x, 2));
    Some(Card {
        joint: clean(&data.joint),
        before: known(data.distance_nominal),
        after: known(data.distance_fitted),
        unit,
        svg: cumulative(
            &format!("{title} of {}", data.joint),
            &format!("{}{x_title}", title.to_lowercase()),
            &curves,
        )?,
    })
}
