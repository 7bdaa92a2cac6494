//! Renames a file's columns, joints, units and times to those of a log.

use crate::ImportError;
use crate::arrays::named;
use crate::known::{PER_JOINT, Role, UNITREE_GO, UNITREE_HG, canonical};
use crate::mapping::{Mapping, Names};
use crate::observation;
use crate::table::{Source, Table};
use crate::used::{MAX_SHOWN, no_column, note_taken};
use gaitfit_log::column_names::{BASE_QUATERNION, BASE_RATES, ROLL_PITCH_YAW};
use gaitfit_log::{TimeUnit, recognise_time_unit};
use gaitfit_model::patterns::plain;
use gaitfit_model::{listed, shown};
use indexmap::IndexMap;
use std::collections::{BTreeMap, BTreeSet};

/// Gives every column of a source its name here. Columns without one are left out and listed.
pub(crate) fn rename(source: &mut Source, mapping: &Mapping) -> Result<(), ImportError> {
    let (said, fitted) = said(&source.tables, mapping)?;
    source.fitted = fitted;
    let columns = source.tables.iter().flat_map(|table| table.columns.keys());
    source.columns = columns.take(MAX_SHOWN).cloned().collect();
    let take = &mapping.streams.take;
    note_taken(source, mapping);
    let mut unknown = Vec::new();
    for table in &mut source.tables {
        let mut columns: IndexMap<String, Vec<f64>> = IndexMap::new();
        let mut observed: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        let unmeasured = unmeasured(&table.columns);
        let mut left = BTreeSet::new();
        for (name, values) in std::mem::take(&mut table.columns) {
            let taken = source.chosen
                || take.is_empty()
                || take.iter().any(|wanted| {
                    table.name.starts_with(wanted.as_str()) || name.starts_with(wanted.as_str())
                });
            let within = |begin: &&String| {
                name.strip_prefix(begin.as_str()).is_some_and(|rest| rest.starts_with(['/', '.']))
            };
            if let Some(begin) = unmeasured.iter().find(within).filter(|_| taken && !said.contains_key(&name))
            {
                left.insert(begin.clone());
                continue;
            }
            // What the mapping says wins, and takes the quantity away from columns that only look like it.
            let known = match said.get(&name) {
                Some(known) => Some(known.clone()),
                None => canonical(&name).filter(|known| !is_said(known, mapping)),
            };
            let Some(mut known) = known.filter(|_| taken) else {
                unknown.push(name);
                continue;
            };
            // A stream of joint states may carry targets or actions: the mapping says so by its name.
            if let Some(joint) = known.strip_prefix("q_") {
                let begins = |list: &[String]| list.iter().any(|stream| name.starts_with(stream.as_str()));
                let named = |list: &[String]| list.contains(&table.name) || begins(list);
                if named(&mapping.streams.target) {
                    known = format!("qdes_{joint}");
                } else if named(&mapping.streams.action) {
                    known = format!("act_{joint}");
                }
            }
            known = renamed(known, mapping, &mut source.renamed);
            if let Some(number) = known.strip_prefix("obs_#") {
                // A number that does not fit is beyond every policy, so `unpack` refuses it.
                observed.insert(number.parse::<usize>().unwrap_or(usize::MAX), values);
                continue;
            }
            // Two columns of one quantity: which one is meant cannot be guessed.
            if columns.contains_key(&known) {
                return Err(ImportError::Ambiguous {
                    what: known,
                    first: table.name.clone(),
                    second: format!("column {name} of the same"),
                });
            }
            columns.insert(known, values);
        }
        if !observed.is_empty() {
            observation::unpack(&table.name, observed, mapping, &mut columns, &mut source.left_out)?;
        }
        table.columns = columns;
        let not = "not measured, because its covariance begins with -1";
        source.left_out.extend(left.iter().map(|begin| format!("{}: {not}", shown(begin))));
    }
    if !unknown.is_empty() {
        let names = listed(unknown.iter().map(|name| shown(name)), 12);
        source.left_out.push(format!("columns of no known name: {names}"));
    }
    // A table without known columns takes no part in the join.
    source.tables.retain(|table| !table.columns.is_empty());
    Ok(())
}

/// Names of quantities that are not measured: by `sensor_msgs/Imu`, their covariance begins with -1. PlotJuggler
/// exports both.
fn unmeasured(columns: &IndexMap<String, Vec<f64>>) -> Vec<String> {
    let firsts = ["[0]", "[0;0]", ".0", "/0"].map(|place| format!("_covariance{place}"));
    let quantity = |name: &str| {
        let begin = firsts.iter().find_map(|end| name.strip_suffix(end.as_str()))?;
        let known = ["orientation", "angular_velocity"].iter().any(|known| begin.ends_with(known));
        known.then(|| begin.to_owned())
    };
    let missing = columns.iter().filter(|(_, values)| values.first() == Some(&-1.0));
    missing.filter_map(|(name, _)| quantity(name)).collect()
}

/// The log's column `known` under the robot's name of its joint; `found` gains the name that it had.
fn renamed(known: String, mapping: &Mapping, found: &mut Vec<String>) -> String {
    let parts = known.split_once('_').filter(|(prefix, _)| PER_JOINT.contains(prefix));
    match parts.and_then(|(prefix, joint)| Some((prefix, joint, mapping.joint_names.get(joint)?))) {
        Some((prefix, joint, robot)) => {
            found.push(joint.to_owned());
            format!("{prefix}_{robot}")
        }
        None => known,
    }
}

/// Whether a column of this name would be taken, by the mapping or by its usual name.
pub(crate) fn wanted(name: &str, mapping: &Mapping) -> bool {
    let mapped = named(&mapping.columns).into_iter().any(|(role, names)| match names {
        None => false,
        Some(Names::Each(list)) => list.iter().any(|one| one == name),
        Some(Names::One(pattern)) => by_pattern(pattern, name, role).is_some(),
    });
    mapped || canonical(name).is_some_and(|known| !is_said(&known, mapping))
}

/// Whether the mapping names other columns for the quantity of `known`.
fn is_said(known: &str, mapping: &Mapping) -> bool {
    named(&mapping.columns).into_iter().any(|(role, names)| {
        names.is_some()
            && match role.prefix() {
                Some(prefix) => known.strip_prefix(prefix).is_some(),
                None => role
                    .columns(match role {
                        Role::Quaternion => 4,
                        _ => 3,
                    })
                    .is_some_and(|columns| columns.iter().any(|column| column == known)),
            }
    })
}

/// Returns the log's names of the columns that the mapping's `[columns]` names, and the names and templates that fit one.
fn said(tables: &[Table], mapping: &Mapping) -> Result<(IndexMap<String, String>, Vec<String>), ImportError> {
    let mut out = IndexMap::new();
    let mut fitted = Vec::new();
    let present: Vec<&String> = tables.iter().flat_map(|table| table.columns.keys()).collect();
    let refuse = |problem: String| Err(ImportError::Mapping { problem });
    for (role, names) in named(&mapping.columns) {
        match names {
            None => {}
            // A list names each component. A pattern may fit any number of columns.
            Some(Names::Each(list)) => {
                let Some(columns) = role.columns(list.len()).filter(|columns| columns.len() == list.len())
                else {
                    return refuse(format!("columns: {} names are not the right number of them", list.len()));
                };
                for (name, column) in list.iter().zip(columns) {
                    if !present.contains(&name) {
                        return refuse(format!("no column `{}` in the file", shown(name)));
                    }
                    if out.insert(name.clone(), column).is_some() {
                        return refuse(format!("column `{}` is named for two quantities", shown(name)));
                    }
                }
            }
            Some(Names::One(pattern)) => {
                let before = out.len();
                for name in &present {
                    if let Some(column) = by_pattern(pattern, name, role) {
                        out.insert((*name).clone(), column);
                    }
                }
                // An array's elements have names of their own already, so a pattern may fit none of them.
                let is_array =
                    present.iter().any(|name| canonical(name).is_some()) && role.prefix().is_some();
                if out.len() == before && !is_array {
                    return Err(no_column(pattern, &present));
                }
                let is_template = pattern.contains("{joint}") || pattern.contains("{index}");
                // Another file of the recording may have the columns of a template.
                if out.len() > before || !is_template {
                    fitted.push(pattern.clone());
                }
            }
        }
    }
    Ok((out, fitted))
}

/// Returns the log's name of column `name` by a pattern with `{joint}` or `{index}`, or as an element of an array.
fn by_pattern(pattern: &str, name: &str, role: Role) -> Option<String> {
    let place = |number: usize| match role.prefix() {
        Some(prefix) => Some(format!("{prefix}#{number}")),
        // Wide enough for a quaternion. Roles of exactly three numbers follow.
        None => role.columns(4.max(number + 1)).or_else(|| role.columns(3))?.get(number).cloned(),
    };
    let between = |(before, after): (&str, &str)| {
        let inner = name.strip_prefix(before)?.strip_suffix(after)?;
        (!inner.is_empty()).then(|| inner.to_owned())
    };
    if let Some(ends) = pattern.split_once("{index}") {
        return place(between(ends)?.parse().ok()?);
    }
    if let Some(ends) = pattern.split_once("{joint}") {
        return Some(format!("{}{}", role.prefix()?, between(ends)?));
    }
    let rest = name.strip_prefix(pattern)?;
    if rest.is_empty() {
        return place(0);
    }
    place(rest.strip_prefix('[')?.strip_suffix(']')?.parse().ok()?)
}

/// Joints by name instead of by number; without a final `_joint`, which says nothing.
pub(crate) fn name_joints(source: &mut Source, mapping: &Mapping) -> Result<(), ImportError> {
    let number = |name: &str| -> Option<(bool, usize)> {
        let (_, number) = name.split_once("_#")?;
        match number.strip_prefix('m') {
            Some(number) => Some((true, number.parse().ok()?)),
            None => Some((false, number.parse().ok()?)),
        }
    };
    let numbers: Vec<(bool, usize)> =
        source.tables.iter().flat_map(|table| table.columns.keys()).filter_map(|name| number(name)).collect();
    source.numbered = !numbers.is_empty();
    // How many motors (of Unitree's messages) or joints are numbered.
    let slots =
        |motors: bool| numbers.iter().filter(|(is, _)| *is == motors).map(|(_, number)| number + 1).max();
    let given: Option<Vec<String>> = mapping.joints.clone().or_else(|| source.joints.clone());
    let usual = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let motors: Vec<String> = match (&given, slots(true)) {
        (_, None) => Vec::new(),
        (Some(given), Some(_)) => given.clone(),
        (None, Some(count)) => {
            // Messages of unitree_go have 20 slots, those of unitree_hg 35.
            let names = source.usual_joints.unwrap_or(if count > 20 { &UNITREE_HG } else { &UNITREE_GO });
            source.assumed.push(format!(
                "motors are those of a Unitree {} in its order, {} to {}",
                if names.len() == UNITREE_HG.len() { "G1" } else { "Go2" },
                names[0],
                names[names.len() - 1]
            ));
            usual(names)
        }
    };
    let joints: Vec<String> = match (slots(false), given) {
        (None, _) => Vec::new(),
        (Some(count), Some(given)) if given.len() == count => {
            source.assumed.push(format!(
                "joints 0 to {} are, in this order, {}",
                count - 1,
                given.join(", ")
            ));
            given
        }
        (Some(count), Some(given)) => {
            let problem = format!("{} joint names for {count} numbered joints; name each", given.len());
            return Err(ImportError::Mapping { problem });
        }
        (Some(count), None) => match source.usual_joints.filter(|names| names.len() == count) {
            Some(names) => usual(names),
            None => return Err(ImportError::NoJointNames { count }),
        },
    };
    // Checked while the numbers are still in the names.
    let spare = spare_motors(source, &motors, mapping)?;
    missing_number(source, &motors, &joints)?;
    for table in &mut source.tables {
        let mut columns = IndexMap::with_capacity(table.columns.len());
        for (name, values) in std::mem::take(&mut table.columns) {
            let prefix = name.split_once('_').map_or("", |(prefix, _)| prefix).to_owned();
            let name = match number(&name) {
                None => name,
                Some((motor, number)) => match (if motor { &motors } else { &joints }).get(number) {
                    Some(joint) => format!("{prefix}_{joint}"),
                    None => continue,
                },
            };
            // Names of other quantities keep the ending.
            let is_joint = PER_JOINT.contains(&prefix.as_str());
            let name = if is_joint { name.strip_suffix("_joint").unwrap_or(&name).to_owned() } else { name };
            columns.insert(name, values);
        }
        table.columns = columns;
    }
    if spare > 0 {
        let still = "no joints of the robot; none of them moves";
        source.left_out.push(format!("motors {} to {}: {still}", motors.len(), spare - 1));
    }
    Ok(())
}

/// A motor whose readings spread by more than this moves, rad: encoders of idle slots give one number.
const MOVES: f64 = 1e-3;

/// How many motors there are, where some have no name; refuses those that move.
fn spare_motors(source: &Source, motors: &[String], mapping: &Mapping) -> Result<usize, ImportError> {
    let mut count = 0;
    let mut moving: Vec<usize> = Vec::new();
    for (name, values) in source.tables.iter().flat_map(|table| &table.columns) {
        let Some((prefix, number)) = name.split_once("_#m") else { continue };
        let Ok(number) = number.parse::<usize>() else { continue };
        if number < motors.len() {
            continue;
        }
        count = count.max(number + 1);
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        let span = finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min);
        // A slot that never moves is an empty place in the message, not a joint.
        if prefix == "q" && span > MOVES {
            moving.push(number);
        }
    }
    moving.sort_unstable();
    let (Some(first), Some(last)) = (moving.first(), moving.last()) else { return Ok(count) };
    let numbers = if first == last { first.to_string() } else { format!("{first} to {last}") };
    let from = match (&mapping.robot, motors.first(), motors.last()) {
        (Some(robot), Some(a), Some(b)) => format!("those of {robot}, {a} to {b}"),
        (None, Some(a), Some(b)) => format!("{a} to {b}"),
        _ => "none".to_owned(),
    };
    Err(ImportError::MotorsBeyond { motors: numbers, named: motors.len(), names: from })
}

/// Refuses numbered positions among which a number is missing that other positions or other quantities have.
fn missing_number(source: &Source, motors: &[String], joints: &[String]) -> Result<(), ImportError> {
    for (mark, names) in [("q_#m", motors), ("q_#", joints)] {
        let columns = || source.tables.iter().flat_map(|table| table.columns.keys());
        let numbers = columns().filter_map(|name| name.strip_prefix(mark)?.parse::<usize>().ok());
        let there: std::collections::HashSet<usize> =
            // Numbers beyond the names are spare motors, which were judged before.
            numbers.filter(|number| *number < names.len()).collect();
        if there.is_empty() {
            continue;
        }
        let missing: Vec<String> = names
            .iter()
            .enumerate()
            .filter(|(number, _)| !there.contains(number))
            .map(|(number, name)| format!("joint {number}, {name}"))
            .collect();
        if !missing.is_empty() {
            return Err(ImportError::JointMissing {
                have: there.len(),
                joint: format!("{},", missing.join("; ")),
                why: format!("{} joints are named or have other quantities", names.len()),
            });
        }
    }
    Ok(())
}

/// Angles in rad, times in s.
pub(crate) fn convert(source: &mut Source, mapping: &Mapping) -> Result<(), ImportError> {
    for table in &mut source.tables {
        for (name, values) in &mut table.columns {
            let is_imu = ROLL_PITCH_YAW.contains(&name.as_str()) || BASE_RATES.contains(&name.as_str());
            let prefixes = ["q_", "dq_", "qdes_", "dqdes_"];
            let joint = prefixes.iter().find_map(|prefix| name.strip_prefix(prefix));
            // A slide's numbers are in m, whatever the unit of angles is.
            let slides = |joint| mapping.slides.iter().flatten().any(|slide| plain(slide) == plain(joint));
            if joint.is_some_and(slides) {
                continue;
            }
            let is_joint = joint.is_some();
            let factor = match (is_joint, is_imu) {
                (true, _) => mapping.unit.radians(),
                (_, true) => mapping.imu_unit.radians(),
                _ => 1.0,
            };
            if factor != 1.0 && !BASE_QUATERNION.contains(&name.as_str()) {
                values.iter_mut().for_each(|value| *value *= factor);
            }
        }
        // A table without times needs a rate that somebody states.
        if table.time.is_empty() {
            let rate = mapping.rate_hz.or(mapping.usual_rate_hz).ok_or_else(|| ImportError::Clock {
                stream: table.name.clone(),
                problem: "it has no times; give `rate_hz` in a mapping file".into(),
            })?;
            table.time = (0..table.rows()).map(|row| row as f64 / rate).collect();
            table.clock = "the stated rate";
        } else if let Some(name) = &table.time_name {
            // Times without a name are in seconds already.
            let problem = |problem| ImportError::Clock { stream: table.name.clone(), problem };
            if table.time.iter().any(|time| !time.is_finite()) {
                return Err(problem("a sample without a time".into()));
            }
            // What is stated wins, then what the column's name says, then what its numbers suggest.
            let unit = match mapping.time.unit {
                Some(unit) => TimeUnit::from(unit),
                None => match TimeUnit::ALL.into_iter().find(|unit| name.ends_with(suffix(*unit))) {
                    Some(unit) => unit,
                    None => {
                        match recognise_time_unit(&table.time, mapping.rate_hz, || None).map_err(problem)? {
                            Some(converted) => {
                                source.assumed.push(format!(
                                    "{}: times are {}: {}",
                                    table.name, converted.unit, converted.because
                                ));
                                converted.unit
                            }
                            None => TimeUnit::Seconds,
                        }
                    }
                },
            };
            table.time.iter_mut().for_each(|time| *time /= unit.per_second());
        }
    }
    Ok(())
}

fn suffix(unit: TimeUnit) -> &'static str {
    match unit {
        TimeUnit::Seconds => "time_s",
        TimeUnit::Milliseconds => "_ms",
        TimeUnit::Microseconds => "_us",
        TimeUnit::Nanoseconds => "_ns",
    }
}
