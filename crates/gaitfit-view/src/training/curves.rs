//! One chart a series, with a thin line a seed and their mean.

use super::{SeedCurve, Series};
use crate::charts::curves::{Curves, Line};
use crate::format::{clean, escape, significant};
use serde::Serialize;

/// Charts of one kind at most, and seeds drawn at most.
const MOST_CHARTS: usize = 60;
pub(crate) const MOST_SEEDS: usize = 40;
/// Iterations kept at most; longer runs are drawn from every nth.
const MOST_ITERATIONS: usize = 4000;

/// A chart with its caption.
#[derive(Serialize)]
pub(crate) struct Card {
    name: String,
    /// Mean of the seeds' last values, with its unit.
    last: String,
    svg: String,
}

/// The charts of one kind of series, in the order in which names first appear.
pub(crate) fn cards(seeds: &[SeedCurve], kind: fn(&SeedCurve) -> &[Series], size: (f64, f64)) -> Vec<Card> {
    let seeds = &seeds[..seeds.len().min(MOST_SEEDS)];
    let mut names: Vec<&str> = Vec::new();
    for series in seeds.iter().flat_map(kind) {
        if names.len() < MOST_CHARTS && !names.contains(&series.name.as_str()) {
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
            let step = count.div_ceil(MOST_ITERATIONS).max(1);
            let x = seed.iteration[..count].iter().step_by(step).map(|n| f64::from(*n)).collect();
            let y = series.values[..count].iter().step_by(step).copied().collect();
            Some((i, format!("seed {}", seed.seed), x, y))
        })
        .collect();
    let several = tracks.len() > 1;
    let mut lines: Vec<Line> = tracks
        .iter()
        .map(|(i, label, x, y)| {
            let class = if several { format!("c{} thin", i % 8) } else { "c0".to_string() };
            Line { label, class, x, y }
        })
        .collect();
    let (mean_x, mean_y) = mean(&tracks);
    if several {
        lines.push(Line { label: "mean", class: "mean".to_string(), x: &mean_x, y: &mean_y });
    }
    let svg = Curves {
        title: &format!("{name} over iterations"),
        x_title: "iteration",
        y_title: &first.unit,
        size,
        log: first.log,
        goal: first.goal,
        lines,
    }
    .draw()?;
    let last = mean_y.iter().rev().copied().find(|x| x.is_finite()).unwrap_or(f64::NAN);
    Some(Card { name: clean(name), last: format!("{} {}", significant(last, 3), escape(&first.unit)), svg })
}

/// The mean over seeds at every iteration that any has, of those that have it and have not stopped before.
fn mean(tracks: &[(usize, String, Vec<f64>, Vec<f64>)]) -> (Vec<f64>, Vec<f64>) {
    let mut points: Vec<(f64, f64)> = tracks
        .iter()
        .flat_map(|(_, _, x, y)| x.iter().copied().zip(y.iter().copied()))
        .filter(|(_, y)| y.is_finite())
        .collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
        .chunk_by(|a, b| a.0 == b.0)
        .map(|same| (same[0].0, same.iter().map(|(_, y)| y).sum::<f64>() / same.len() as f64))
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_of_the_seeds_that_are_there() {
        let track = |x: &[f64], y: &[f64]| (0, String::new(), x.to_vec(), y.to_vec());
        let (x, y) = mean(&[
            track(&[0.0, 1.0, 2.0], &[1.0, f64::NAN, 5.0]),
            track(&[0.0, 1.0], &[3.0, 4.0]),
            track(&[], &[]),
        ]);
        assert_eq!(x, [0.0, 1.0, 2.0]);
        assert_eq!(y, [2.0, 4.0, 5.0]);
    }
}
