//! Tracking of random commands: a picture a measure with every policy on every simulator, and all of it as a table.

use super::policies::{Cast, printed};
use super::{Difference, LoopReport, Tracking};
use crate::Estimate;
use crate::chart::Look;
use crate::chart::intervals::{self, Mark, Row};
use crate::format::{UNKNOWN, grouped, with_spread};
use serde::Serialize;

/// Policies on simulators, and differences of policies, shown at most.
const MAX_ROWS: usize = 64;
#[derive(Serialize)]
pub(super) struct TrackingSection {
    cards: Vec<Card>,
    /// One a policy and simulator.
    rows: Vec<TableRow>,
    /// Column headings with units.
    headings: Vec<String>,
    left_out: usize,
    differences: Vec<DifferenceRow>,
    differences_left_out: usize,
    /// Headings of the differences.
    compared: Vec<String>,
}

#[derive(Serialize)]
struct Card {
    name: &'static str,
    unit: &'static str,
    better: &'static str,
    groups: Vec<Group>,
    axis: String,
}

#[derive(Serialize)]
struct Group {
    simulator: String,
    rows: Vec<CardRow>,
}

#[derive(Serialize)]
struct CardRow {
    policy: String,
    color: usize,
    svg: String,
    text: String,
}

#[derive(Serialize)]
struct TableRow {
    policy: String,
    simulator: String,
    trajectories: String,
    color: usize,
    cells: Vec<String>,
}

/// A measure of a policy.
pub(super) struct Column {
    pub name: &'static str,
    pub unit: &'static str,
    /// Whether less is better.
    pub is_error: bool,
    /// The estimate in the unit above.
    pub of: fn(&Tracking) -> Estimate,
    /// The same of a difference; NaN of what is not compared.
    pub difference: fn(&Difference) -> Estimate,
}

/// In the order of the page.
pub(super) const COLUMNS: [Column; 4] = [
    Column {
        name: "Linear-velocity error",
        unit: "m/s",
        is_error: true,
        of: |t| t.linear_velocity_error,
        difference: |d| d.linear_velocity_error,
    },
    Column {
        name: "Angular-velocity error",
        unit: "rad/s",
        is_error: true,
        of: |t| t.angular_velocity_error,
        difference: |d| d.angular_velocity_error,
    },
    Column {
        name: "Summed reward",
        unit: "",
        is_error: false,
        of: |t| t.reward,
        difference: |_| Estimate::default(),
    },
    Column {
        name: "Fall rate",
        unit: "%",
        is_error: true,
        of: |t| percent(t.fall_rate),
        difference: |d| percent(d.fall_rate),
    },
];

fn percent(share: Estimate) -> Estimate {
    Estimate { mean: 100.0 * share.mean, ci95: 100.0 * share.ci95 }
}

/// A policy minus another.
#[derive(Serialize)]
struct DifferenceRow {
    name: String,
    simulator: String,
    cells: Vec<String>,
    paired: bool,
}

fn differences(report: &LoopReport) -> Vec<DifferenceRow> {
    let row = |one: &Difference| DifferenceRow {
        name: format!("{} − {}", printed(&one.policy, UNKNOWN), printed(&one.against, UNKNOWN)),
        simulator: printed(&one.simulator, UNKNOWN),
        // The reward has no difference, so it has no column here.
        cells: COLUMNS.iter().filter(|q| q.is_error).map(|q| text((q.difference)(one))).collect(),
        paired: one.paired,
    };
    report.differences.iter().take(MAX_ROWS).map(row).collect()
}

pub(super) fn build(report: &LoopReport, cast: &Cast) -> Option<TrackingSection> {
    let shown = &report.tracking[..report.tracking.len().min(MAX_ROWS)];
    // A measure that no policy has would be an empty chart and an empty column.
    let known: Vec<&Column> =
        COLUMNS.iter().filter(|q| shown.iter().any(|t| (q.of)(t).mean.is_finite())).collect();
    if known.is_empty() {
        return None;
    }
    let table = |t: &Tracking| TableRow {
        policy: printed(&t.policy, UNKNOWN),
        simulator: printed(&t.simulator, UNKNOWN),
        trajectories: grouped(t.trajectories),
        color: cast.color(&t.policy),
        cells: known.iter().map(|q| text((q.of)(t))).collect(),
    };
    let heading = |q: &&Column| {
        if q.unit.is_empty() { q.name.to_string() } else { format!("{} ({})", q.name, q.unit) }
    };
    Some(TrackingSection {
        cards: known.iter().map(|q| card(q, shown, cast)).collect(),
        rows: shown.iter().map(table).collect(),
        headings: known.iter().map(heading).collect(),
        left_out: report.tracking.len() - shown.len(),
        differences: differences(report),
        differences_left_out: report.differences.len().saturating_sub(MAX_ROWS),
        // The same filter as for the cells of `differences`, so that headings and cells agree.
        compared: COLUMNS.iter().filter(|q| q.is_error).map(|q| heading(&q)).collect(),
    })
}

fn card(column: &Column, shown: &[Tracking], cast: &Cast) -> Card {
    let row = |t: &Tracking| {
        let Estimate { mean, ci95 } = (column.of)(t);
        let look = Look::color(cast.color(&t.policy));
        Row { marks: vec![Mark { value: mean, spread: ci95, look, ..Mark::default() }], ..Row::default() }
    };
    let drawn: Vec<Row> = shown.iter().map(row).collect();
    // Errors begin at zero; rewards may be negative.
    let scale = match column.is_error {
        true => intervals::scale_from_zero(&drawn),
        false => intervals::shared_scale(&drawn),
    };
    let group = |simulator: &&str| {
        let rows =
            shown.iter().zip(&drawn).filter(|(t, _)| t.simulator == **simulator).map(|(t, row)| CardRow {
                policy: printed(&t.policy, UNKNOWN),
                color: cast.color(&t.policy),
                svg: intervals::row(row, &scale),
                text: text((column.of)(t)),
            });
        Group { simulator: printed(simulator, UNKNOWN), rows: rows.collect() }
    };
    Card {
        name: column.name,
        unit: column.unit,
        better: if column.is_error { "less is better" } else { "more is better" },
        groups: cast.simulators.iter().map(group).filter(|g| !g.rows.is_empty()).collect(),
        axis: intervals::axis(&scale),
    }
}

/// The mean with its interval, where known.
pub(super) fn text(estimate: Estimate) -> String {
    let (mean, ci95) = with_spread(estimate.mean, estimate.ci95);
    if ci95 == UNKNOWN { mean } else { format!("{mean} ± {ci95}") }
}
