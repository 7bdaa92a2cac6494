//! Observations of a policy, unpacked by what its interface says.

use crate::ImportError;
use crate::mapping::Mapping;
use gaitfit_model::shown;
use indexmap::IndexMap;
use std::collections::BTreeMap;

/// How an observation without its policy is reported.
pub(crate) const UNPACK: &str = "an observation, which `--policy` with the policy that observed them unpacks";

/// Adds the log's columns that are in the numbers `observed` of an observation to `columns`, those that are there already
/// excepted. Without a policy in `mapping` it is noted that one is needed.
pub(crate) fn unpack(
    table: &str,
    observed: BTreeMap<usize, Vec<f64>>,
    mapping: &Mapping,
    columns: &mut IndexMap<String, Vec<f64>>,
    left_out: &mut Vec<String>,
) -> Result<(), ImportError> {
    let Some(parts) = &mapping.observation else {
        left_out.push(format!("{}: {} numbers of {UNPACK}", shown(table), observed.len()));
        return Ok(());
    };
    if !observed.keys().copied().eq(0..parts.len()) {
        return Err(ImportError::Mapping {
            problem: format!(
                "{}: the observation has {} numbers, and the policy of `--policy` observes {}; give the policy that made the \
                 recording",
                shown(table),
                observed.len(),
                parts.len()
            ),
        });
    }
    // Columns that the recording has itself are more exact than an observation, which was scaled and perhaps
    // noisy.
    for (part, mut values) in parts.iter().zip(observed.into_values()) {
        let Some(part) = part.as_ref().filter(|part| !columns.contains_key(&part.column)) else { continue };
        // The inverse of what the policy's interface does.
        values.iter_mut().for_each(|value| *value = *value / part.scale + part.offset);
        columns.insert(part.column.clone(), values);
    }
    Ok(())
}
