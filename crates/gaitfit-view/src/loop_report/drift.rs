//! Constant-command trials of the policies side by side: a table and a plan view a simulator.

use super::policies::{Cast, printed};
use super::{DriftTrials, LoopReport};
use crate::Drift;
use crate::chart::Look;
use crate::chart::plan::{Track, plan};
use crate::evaluation::drift::{MAX_TRIALS, error};
use crate::format::{UNKNOWN, fixed};
use serde::Serialize;

/// Policies side by side at most.
const MAX_POLICIES: usize = 6;

/// Drift on one simulator.
#[derive(Serialize)]
pub(super) struct DriftSection {
    simulator: String,
    policies: Vec<Column>,
    rows: Vec<DriftRow>,
    svg: Option<String>,
}

#[derive(Serialize)]
struct Column {
    name: String,
    color: usize,
    /// Over all commands: mean distance from where the command leads (m), and mean absolute yaw error (rad).
    distance: String,
    yaw: String,
    falls: String,
}

#[derive(Serialize)]
struct DriftRow {
    command: String,
    /// x and y (m), yaw (rad) of each policy in turn.
    cells: Vec<Cell>,
}

#[derive(Serialize)]
struct Cell {
    text: String,
    /// Whether a new policy begins here.
    first: bool,
}

pub(super) fn build(report: &LoopReport, cast: &Cast) -> Vec<DriftSection> {
    cast.simulators.iter().filter_map(|simulator| section(report, cast, simulator)).collect()
}

fn section(report: &LoopReport, cast: &Cast, simulator: &str) -> Option<DriftSection> {
    let here = |d: &&DriftTrials| d.simulator == simulator && !d.trials.is_empty();
    let sets: Vec<&DriftTrials> = report.drift.iter().filter(here).take(MAX_POLICIES).collect();
    // Policies may have run different commands: the union, in order of appearance.
    let mut commands: Vec<&str> = Vec::new();
    for trial in sets.iter().flat_map(|s| &s.trials) {
        if commands.len() < MAX_TRIALS && !commands.contains(&trial.name.as_str()) {
            commands.push(&trial.name);
        }
    }
    let row = |command: &&str| DriftRow {
        command: printed(command, UNKNOWN),
        cells: sets.iter().flat_map(|set| cells(find(set, command))).collect(),
    };
    (!sets.is_empty()).then(|| DriftSection {
        simulator: printed(simulator, UNKNOWN),
        policies: sets.iter().map(|set| column(set, cast)).collect(),
        rows: commands.iter().map(row).collect(),
        svg: picture(&sets, &commands, cast),
    })
}

fn find<'a>(set: &'a DriftTrials, command: &str) -> Option<&'a Drift> {
    set.trials.iter().find(|trial| trial.name == command)
}

fn cells(trial: Option<&Drift>) -> [Cell; 3] {
    std::array::from_fn(|k| Cell {
        text: trial.map_or(UNKNOWN.to_string(), |t| error(t.error[k], t.ci95[k])),
        first: k == 0,
    })
}

/// Mean distance from where the command leads, m, and mean absolute yaw error, rad, over the trials that have both.
pub(super) fn summary(set: &DriftTrials) -> (f64, f64) {
    let known = || set.trials.iter().map(|t| t.error).filter(|e| e.iter().all(|x| x.is_finite()));
    // Without any known trial both means are 0/0, which pages show as unknown.
    let count = known().count() as f64;
    let distance = known().map(|e| e[0].hypot(e[1])).sum::<f64>() / count;
    // Absolute values: turns to the left and to the right must not cancel.
    let yaw = known().map(|e| e[2].abs()).sum::<f64>() / count;
    (distance, yaw)
}

fn column(set: &DriftTrials, cast: &Cast) -> Column {
    let (distance, yaw) = summary(set);
    let sum = |count: fn(&Drift) -> u32| set.trials.iter().map(|t| u64::from(count(t))).sum::<u64>();
    Column {
        name: printed(&set.policy, UNKNOWN),
        color: cast.color(&set.policy),
        distance: fixed(distance, 3),
        yaw: fixed(yaw, 3),
        falls: format!("{} of {}", sum(|t| t.falls), sum(|t| t.trials)),
    }
}

/// Where the commands lead, grey, and where the policies went.
fn picture(sets: &[&DriftTrials], commands: &[&str], cast: &Cast) -> Option<String> {
    let intended = commands.iter().filter_map(|command| {
        let points = sets.iter().filter_map(|s| find(s, command)).map(|t| &t.intended);
        // The command leads all policies to the same place, so one of them is enough.
        let points = points.into_iter().find(|points| !points.is_empty())?;
        // The ring is larger than the discs, so that it shows around a robot that arrives.
        Some(Track { points, look: Look::TARGET.dashed(), radius: 6.0, ring: true })
    });
    let gone = sets.iter().flat_map(|set| {
        let color = cast.color(&set.policy);
        // Only the commands of the table: paths without a row could not be read.
        let shown = commands.iter().filter_map(|command| find(set, command));
        shown.map(move |trial| Track {
            points: &trial.path,
            look: Look::color(color),
            radius: 3.5,
            ring: false,
        })
    });
    plan("Paths under constant commands, from above", 290.0, &intended.chain(gone).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_drift_is_of_what_is_known() {
        let trial = |error| Drift { error, ..Drift::default() };
        let trials = vec![trial([3.0, -4.0, -0.5]), trial([0.0, 1.0, 0.1]), trial([f64::NAN, 0.0, 0.0])];
        let (distance, yaw) = summary(&DriftTrials { trials, ..DriftTrials::default() });
        assert!((distance - 3.0).abs() < 1e-12 && (yaw - 0.3).abs() < 1e-12);
        assert!(summary(&DriftTrials::default()).0.is_nan());
    }
}
