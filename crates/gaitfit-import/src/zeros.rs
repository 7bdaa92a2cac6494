//! Zeros that a second publisher writes between a robot's positions.

use crate::ImportError;
use crate::mapping::Mapping;
use crate::table::Table;
use gaitfit_log::zero_rows;
use gaitfit_model::{shown, shown_number};

/// Runs of zeros from which on they are no single damaged message.
const SEVERAL: usize = 2;

/// Refuses a stream whose positions jump to exactly 0 and back, or leaves these rows out where the mapping says so.
pub(crate) fn of_second_publisher(
    table: &mut Table,
    mapping: &Mapping,
    assumed: &mut Vec<String>,
) -> Result<(), ImportError> {
    let positions: Vec<&Vec<f64>> =
        table.columns.iter().filter(|(name, _)| name.starts_with("q_")).map(|(_, values)| values).collect();
    let (width, samples) = (positions.len(), table.time.len());
    if width == 0 || positions.iter().any(|values| values.len() != samples) {
        return Ok(());
    }
    // `zero_rows` wants the positions row by row.
    let rows: Vec<f64> =
        (0..samples).flat_map(|row| positions.iter().map(move |values| values[row])).collect();
    let runs = zero_rows(&rows, width);
    if runs.len() < SEVERAL {
        return Ok(());
    }
    let zero: usize = runs.iter().map(|run| run.len()).sum();
    if !mapping.streams.drop_zeros {
        let from = table.time.first().copied().unwrap_or_default();
        let times: Vec<String> =
            runs.iter().take(3).map(|run| shown_number(table.time[run.start] - from)).collect();
        return Err(ImportError::TwoPublishers {
            stream: table.name.clone(),
            zero,
            samples,
            times: times.join(", "),
        });
    }
    assumed.push(format!(
        "{}: {zero} of {samples} samples with positions of exactly 0 are a second publisher's and were left out",
        shown(&table.name)
    ));
    let mut keep = vec![true; samples];
    runs.into_iter().flatten().for_each(|row| keep[row] = false);
    // At the ends of the recording a zero has a row of the robot on one side only.
    let is_zero = |row: &usize| rows[row * width..(row + 1) * width].iter().all(|q| *q == 0.0);
    for row in (0..samples).take_while(is_zero).chain((0..samples).rev().take_while(is_zero)) {
        keep[row] = false;
    }
    let mut kept = keep.iter();
    table.time.retain(|_| kept.next().copied().unwrap_or(true));
    for values in table.columns.values_mut() {
        let mut kept = keep.iter();
        values.retain(|_| kept.next().copied().unwrap_or(true));
    }
    Ok(())
}
