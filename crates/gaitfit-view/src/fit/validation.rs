//! Errors on logs the fit did not see, joint by joint.

use super::Validation;
use crate::chart::extent;
use crate::format::{clean, significant};
use serde::Serialize;
use std::collections::BTreeSet;

/// Max number of logs that are shown.
const MAX_FILES: usize = 30;
/// Max number of joints that are shown.
const MAX_JOINTS: usize = 100;
/// Shades of the table.
const SHADES: f64 = 9.0;

#[derive(Serialize)]
pub(super) struct ValidationTable {
    files: Vec<String>,
    totals: Option<Vec<String>>,
    nominal: Option<Vec<String>>,
    cost: Option<Vec<String>>,
    nominal_cost: Option<Vec<String>>,
    joints: Vec<JointRow>,
    files_left_out: usize,
    joints_left_out: usize,
}

#[derive(Serialize)]
struct JointRow {
    joint: String,
    cells: Vec<Cell>,
}

#[derive(Serialize)]
struct Cell {
    text: String,
    /// 0 (smallest) to 9 (largest of the table).
    shade: u8,
}

pub(super) fn build(validation: &[Validation]) -> Option<ValidationTable> {
    let shown = &validation[..validation.len().min(MAX_FILES)];
    if shown.is_empty() {
        return None;
    }
    // Logs may name different joints: the union, in order of appearance.
    let mut names: Vec<&str> = Vec::new();
    let mut left_out = BTreeSet::new();
    for (name, _) in shown.iter().flat_map(|v| &v.rmse_per_joint) {
        if names.contains(&name.as_str()) {
            continue;
        }
        if names.len() < MAX_JOINTS {
            names.push(name);
        } else {
            // A set: every log may name the joint.
            left_out.insert(name);
        }
    }
    let joints_left_out = left_out.len();
    let of_joint = |v: &Validation, joint: &str| {
        v.rmse_per_joint.iter().find(|(name, _)| name == joint).map_or(f64::NAN, |(_, rmse)| *rmse)
    };
    // One shade scale for the whole table, so that logs and joints compare.
    let all = shown.iter().flat_map(|v| v.rmse_per_joint.iter().map(|(_, rmse)| *rmse));
    // Without a finite error every cell has shade 0, whatever the scale is.
    let largest = extent(all).map_or(1.0, |(_, high)| high);
    let cell = |rmse: f64| Cell {
        text: significant(rmse, 3),
        shade: if rmse.is_finite() && largest > 0.0 { (SHADES * rmse / largest).round() as u8 } else { 0 },
    };
    let joints = names
        .iter()
        .map(|name| JointRow {
            joint: clean(name),
            cells: shown.iter().map(|v| cell(of_joint(v, name))).collect(),
        })
        .collect();
    // A row without a number is left out.
    let texts = |get: fn(&Validation) -> f64| {
        let known = shown.iter().any(|v| get(v).is_finite());
        known.then(|| shown.iter().map(|v| significant(get(v), 3)).collect::<Vec<_>>())
    };
    Some(ValidationTable {
        files: shown.iter().map(|v| clean(&v.file)).collect(),
        totals: texts(|v| v.rmse_rad),
        nominal: texts(|v| v.nominal_rmse_rad),
        cost: texts(|v| v.cost),
        nominal_cost: texts(|v| v.nominal_cost),
        joints,
        files_left_out: validation.len() - shown.len(),
        joints_left_out,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_are_matched_by_name() {
        let log = |joints: &[(&str, f64)]| Validation {
            rmse_per_joint: joints.iter().map(|(n, x)| (n.to_string(), *x)).collect(),
            ..Validation::default()
        };
        let table = build(&[log(&[("a", 0.01), ("b", 0.02)]), log(&[("b", 0.04), ("c", f64::NAN)])]);
        let rows: Vec<(String, Vec<(String, u8)>)> = table
            .into_iter()
            .flat_map(|t| t.joints)
            .map(|r| (r.joint, r.cells.into_iter().map(|c| (c.text, c.shade)).collect()))
            .collect();
        let cell = |text: &str, shade: u8| (text.to_string(), shade);
        assert_eq!(rows[0], ("a".into(), vec![cell("0.0100", 2), cell("–", 0)]));
        assert_eq!(rows[1], ("b".into(), vec![cell("0.0200", 5), cell("0.0400", 9)]));
        assert_eq!(rows[2], ("c".into(), vec![cell("–", 0), cell("–", 0)]));
        assert!(build(&[]).is_none());
    }

    #[test]
    fn rows_without_a_number_are_left_out() {
        let table = build(&[Validation { cost: 0.25, ..Validation::default() }]);
        let rows = table.map(|t| (t.totals, t.nominal, t.cost, t.nominal_cost));
        assert_eq!(rows, Some((None, None, Some(vec!["0.250".to_string()]), None)));
    }
}
