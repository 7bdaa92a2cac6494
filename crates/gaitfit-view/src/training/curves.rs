//! One chart a series, with a thin line a seed and their mean.

use super::{SeedCurve, Series};
use crate::chart::{Axis, Look, Plot, Series as Drawn};
use crate::format::{clean, significant};
use serde::Serialize;

/// Max number of charts of one kind.
const MAX_CHARTS: usize = 60;
/// Max number of seeds that are drawn.
pub(crate) const MAX_SEEDS: usize = 40;
/// Iterations kept at most; longer runs are drawn from every nth.
const MAX_ITERATIONS: usize = 4000;

/// A chart with its caption.
#[derive(Serialize)]
pub(crate) struct Card {
    name: String,
    /// Mean of the seeds' last values, with its unit.
    last: String,
    svg: String,
}

/// An entry of the charts' legend.
#[derive(Serialize)]
pub(crate) struct LegendEntry {
    look: Look,
    text: String,
}

/// A line a seed, and their mean where there are several.
pub(crate) fn legend(seeds: &[SeedCurve]) -> Vec<LegendEntry> {
    let shown = seeds.iter().take(MAX_SEEDS).enumerate();
    let mut legend: Vec<LegendEntry> =
        shown.map(|(i, s)| LegendEntry { look: Look::color(i), text: format!("seed {}", s.seed) }).collect();
    if legend.len() > 1 {
        legend.push(LegendEntry { look: Look::MEAN, text: "mean".into() });
    }
    legend
}

/// The charts of one kind of series, in the order in which names first appear.
pub(crate) fn cards(seeds: &[SeedCurve], kind: fn(&SeedCurve) -> &[Series], size: (f64, f64)) -> Vec<Card> {
    let seeds = &seeds[..seeds.len().min(MAX_SEEDS)];
    let mut names: Vec<&str> = Vec::new();
    for series in seeds.iter().flat_map(kind) {
        if names.len() < MAX_CHARTS && !names.contains(&series.name.as_str()) {
            names.push(&series.name);
        }
    }
    names.into_iter().filter_map(|name| card(seeds, kind, name, size)).collect()
}

fn card(
    seeds: &[SeedCurve],
    kind: fn(&SeedCurve) -> &[Series],
    name: &str,
    size: (f64, f64),
) -> Option<Card> {
    let named = |seed| kind(seed).iter().find(|s| s.name == name);
    let first = seeds.iter().find_map(named)?;
    let tracks: Vec<(usize, String, Vec<f64>, Vec<f64>)> = seeds
        .iter()
        .enumerate()
        .filter_map(|(i, seed)| {
            let series = named(seed)?;
            let count = seed.iteration.len().min(series.values.len());
            // Every nth: seeds with equal iterations keep the same ones, which their mean needs.
            let step = count.div_ceil(MAX_ITERATIONS).max(1);
            let x = seed.iteration[..count].iter().step_by(step).map(|n| f64::from(*n)).collect();
            let y = series.values[..count].iter().step_by(step).copied().collect();
            Some((i, format!("seed {}", seed.seed), x, y))
        })
        .collect();
    let several = tracks.len() > 1;
    let mut series = Vec::new();
    let mean = mean(&tracks);
    if several {
        // The band of all seeds lies below their lines, the mean above them.
        let area = Look::AREA.thin();
        series.push(Drawn::Band { look: area, x: &mean.x, low: &mean.low, high: &mean.high });
    }
    series.extend(tracks.iter().map(|(i, name, x, y)| {
        let look = if several { Look::color(*i).thin() } else { Look::color(0) };
        Drawn::Line { name, look, x, y }
    }));
    if several {
        series.push(Drawn::Line { name: "mean", look: Look::MEAN, x: &mean.x, y: &mean.y });
    }
    let plot = Plot {
        // A number of iterations is less than 80 units wide.
        x: Axis { title: "iteration", ticks: (size.0 / 80.0) as usize, ..Axis::default() },
        y: Axis {
            title: &first.unit,
            log: first.log,
            pad: 0.04,
            // 50 units of height for each number.
            ticks: (size.1 / 50.0) as usize,
            ..Axis::default()
        },
        series,
        // One for each user unit, which is about a pixel.
        points: size.0 as usize,
    };
    let svg = plot.figure(&format!("{name} over iterations"), size.0, size.1)?.inline();
    // The last value that is a number: the end of a run may be NaN.
    let last = mean.y.iter().rev().copied().find(|x| x.is_finite()).unwrap_or(f64::NAN);
    Some(Card { name: clean(name), last: format!("{} {}", significant(last, 3), clean(&first.unit)), svg })
}

/// Over seeds, at every iteration that any has: mean, smallest and largest value.
struct Mean {
    x: Vec<f64>,
    y: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
}

/// Computes the mean over the seeds that have an iteration and have not stopped before.
fn mean(tracks: &[(usize, String, Vec<f64>, Vec<f64>)]) -> Mean {
    let mut points: Vec<(f64, f64)> = tracks
        .iter()
        .flat_map(|(_, _, x, y)| x.iter().copied().zip(y.iter().copied()))
        .filter(|(_, y)| y.is_finite())
        .collect();
    // Values of one iteration become neighbours, whichever seeds have it.
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut mean = Mean { x: Vec::new(), y: Vec::new(), low: Vec::new(), high: Vec::new() };
    // Iterations are whole numbers in f64, so equal ones compare as equal.
    for same in points.chunk_by(|a, b| a.0 == b.0) {
        let values = || same.iter().map(|(_, y)| *y);
        mean.x.push(same[0].0);
        mean.y.push(values().sum::<f64>() / same.len() as f64);
        mean.low.push(values().fold(f64::INFINITY, f64::min));
        mean.high.push(values().fold(f64::NEG_INFINITY, f64::max));
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_of_the_seeds_that_are_there() {
        let track = |x: &[f64], y: &[f64]| (0, String::new(), x.to_vec(), y.to_vec());
        let mean = mean(&[
            track(&[0.0, 1.0, 2.0], &[1.0, f64::NAN, 5.0]),
            track(&[0.0, 1.0], &[3.0, 4.0]),
            track(&[], &[]),
        ]);
        assert_eq!(mean.x, [0.0, 1.0, 2.0]);
        assert_eq!(mean.y, [2.0, 4.0, 5.0]);
        assert_eq!((mean.low[0], mean.high[0]), (1.0, 3.0));
    }
}
