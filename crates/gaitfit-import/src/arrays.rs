//! Files of named arrays (npz, pickles, PyTorch): from arrays to a table.

use crate::budget::Budget;
use crate::known::{Role, role};
use crate::mapping::{ColumnNames, Mapping, Names};
use crate::problem::Problem;
use crate::table::{MAX_COLUMNS, Source, Table};
use crate::table_error::TableError;
use gaitfit_model::shown;
use indexmap::IndexMap;

/// An array, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Array {
    /// Sizes; empty for one number.
    pub shape: Vec<usize>,
    /// Values; as many as the product of the sizes.
    pub data: Vec<f64>,
}

impl Array {
    /// Rows and columns: the first axis, and all others together.
    fn rows_and_width(&self) -> (usize, usize) {
        let rows = self.shape.first().copied().unwrap_or(1);
        // An array without rows has no width.
        (rows, self.data.len().checked_div(rows).unwrap_or(0))
    }
}

/// Named arrays and lists of words.
#[derive(Debug, Default)]
pub(crate) struct Arrays {
    /// Numbers.
    pub numbers: IndexMap<String, Array>,
    /// Words, such as joint names.
    pub words: IndexMap<String, Vec<String>>,
}

/// Number of values of a shape, if it is one.
pub(crate) fn count(shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(1usize, |product, size| product.checked_mul(*size))
}

/// What `name` holds by the mapping, or by its usual meaning where the mapping does not speak of that quantity.
fn role_of(name: &str, mapping: &Mapping) -> Option<Role> {
    if mapping.time.column.as_deref() == Some(name) {
        return Some(Role::Time);
    }
    let said = named(&mapping.columns);
    if let Some((role, _)) =
        said.iter().find(|(_, names)| matches!(names, Some(Names::One(one)) if one == name))
    {
        return Some(*role);
    }
    let usual = role(name)?;
    let is_said = said.iter().any(|(role, names)| *role == usual && names.is_some());
    let other_time = usual == Role::Time && mapping.time.column.is_some();
    (!is_said && !other_time).then_some(usual)
}

/// The mapping's columns with their roles.
pub(crate) fn named(columns: &ColumnNames) -> [(Role, &Option<Names>); 8] {
    [
        (Role::Position, &columns.position),
        (Role::Velocity, &columns.velocity),
        (Role::Target, &columns.target),
        (Role::Action, &columns.action),
        (Role::Command, &columns.command),
        (Role::Quaternion, &columns.quaternion),
        (Role::RollPitchYaw, &columns.rpy),
        (Role::AngularVelocity, &columns.angular_velocity),
    ]
}

/// Refuses two arrays of one quantity, such as those of several recordings in one file.
fn one_each(arrays: &Arrays, mapping: &Mapping) -> Result<(), Problem> {
    let mut seen: Vec<(Role, &str)> = Vec::new();
    for (name, array) in &arrays.numbers {
        let Some(role) = role_of(name, mapping).filter(|role| *role != Role::Time) else { continue };
        let width = array.rows_and_width().1;
        // A single number, or a width that the role does not have, makes no column of this quantity.
        if array.shape.is_empty() || role.columns(width).is_none() {
            continue;
        }
        if let Some((_, other)) = seen.iter().find(|(own, _)| *own == role) {
            return Err(TableError::SameQuantity((*other).to_owned(), name.clone()).into());
        }
        seen.push((role, name));
    }
    Ok(())
}

/// Refuses positions with another number of rows than there are times.
fn differing(arrays: &Arrays, mapping: &Mapping, rows: usize) -> Result<(), Problem> {
    let array = |wanted: Role| {
        let entry = arrays.numbers.iter().find(|(name, _)| role_of(name, mapping) == Some(wanted));
        entry.filter(|(_, array)| !array.shape.is_empty())
    };
    let (Some((time, _)), Some((position, array))) = (array(Role::Time), array(Role::Position)) else {
        return Ok(());
    };
    if array.shape[0] == rows {
        return Ok(());
    }
    let (time, position, position_rows) = (time.clone(), position.clone(), array.shape[0]);
    Err(TableError::Rows { time, rows, position, position_rows }.into())
}

/// One table of all arrays that have a row a sample.
pub(crate) fn source(
    name: &str,
    kind: &'static str,
    mut arrays: Arrays,
    mapping: &Mapping,
    budget: &mut Budget,
) -> Result<Source, Problem> {
    let mut source = Source { kind, ..Source::default() };
    let take = &mapping.streams.take;
    if !take.is_empty() {
        let begins = |array: &String, wanted: &String| array.starts_with(wanted.as_str());
        source.takeable = arrays.numbers.keys().take(20).cloned().collect();
        source.taken = take
            .iter()
            .filter(|wanted| arrays.numbers.keys().any(|array| begins(array, wanted)))
            .cloned()
            .collect();
        let whole = take.iter().any(|wanted| begins(&name.to_owned(), wanted));
        source.taken.extend(take.iter().filter(|wanted| begins(&name.to_owned(), wanted)).cloned());
        // The names may choose whole files or arrays of one; a file that is chosen as a whole keeps all its
        // arrays.
        if !whole && !source.taken.is_empty() {
            arrays.numbers.retain(|array, _| take.iter().any(|wanted| begins(array, wanted)));
            // The joints' names stay whatever is taken: they name the columns of all arrays.
            arrays.words.retain(|array, _| {
                role(array) == Some(Role::JointNames) || take.iter().any(|wanted| begins(array, wanted))
            });
        }
        source.chosen = true;
    }
    // First what cannot be read as one log is refused.
    one_each(&arrays, mapping)?;
    let mut table = Table { name: name.to_owned(), clock: "the file's times", ..Table::default() };
    // How many arrays have each number of rows.
    let mut widest: IndexMap<usize, usize> = IndexMap::new();
    for array in arrays.numbers.values().filter(|array| !array.shape.is_empty()) {
        *widest.entry(array.shape[0]).or_default() += 1;
    }
    // The samples: as many as there are times, or positions, or as most arrays have rows.
    let rows_of = |wanted: Role| {
        let mut all = arrays.numbers.iter();
        all.find(|(name, array)| role_of(name, mapping) == Some(wanted) && !array.shape.is_empty())
            .map(|(_, array)| array.shape[0])
    };
    let rows = rows_of(Role::Time)
        .or_else(|| rows_of(Role::Position))
        .or_else(|| widest.iter().max_by_key(|(_, count)| **count).map(|(rows, _)| *rows))
        .ok_or(TableError::NoArrays)?;
    if let Some(column) = &mapping.time.column
        && !arrays.numbers.contains_key(column)
    {
        let names = arrays.numbers.keys().take(30).map(|name| shown(name)).collect::<Vec<_>>().join(", ");
        return Err(TableError::NoTimeArray { wanted: column.clone(), arrays: names }.into());
    }
    differing(&arrays, mapping, rows)?;
    let mut gains: [Option<Vec<f64>>; 2] = [None, None];
    // Arrays with a row a sample become columns; the others are gains, or are left out by name.
    for (name, array) in &arrays.numbers {
        let role = role_of(name, mapping);
        let (length, width) = array.rows_and_width();
        match role {
            // One gain a joint, or one for all; gains of every sample are columns.
            Some(Role::Kp) if length != rows || array.shape.len() < 2 => gains[0] = Some(array.data.clone()),
            Some(Role::Kd) if length != rows || array.shape.len() < 2 => gains[1] = Some(array.data.clone()),
            _ if length != rows || array.shape.is_empty() => {
                source.left_out.push(format!("{}: shape {:?}, not {rows} rows", shown(name), array.shape));
            }
            Some(Role::Time) if width == 1 && table.time.is_empty() => {
                table.time.clone_from(&array.data);
                // Only the last part of a path can name the unit.
                table.time_name = Some(name.rsplit('/').next().unwrap_or(name).to_owned());
            }
            _ => {
                let columns = role.and_then(|role| role.columns(width)).unwrap_or_else(|| match width {
                    1 => vec![name.clone()],
                    _ => (0..width).map(|i| format!("{name}[{i}]")).collect(),
                });
                budget.take_values(rows.saturating_mul(columns.len()))?;
                for (i, column) in columns.into_iter().enumerate() {
                    if table.columns.len() >= MAX_COLUMNS {
                        return Err(TableError::MoreColumns { what: "arrays" }.into());
                    }
                    let values = array.data.iter().skip(i).step_by(width).copied().collect();
                    table.columns.insert(column, values);
                }
            }
        }
    }
    for (name, words) in arrays.words {
        match role(&name) {
            Some(Role::JointNames) => source.joints = Some(words),
            _ => source.left_out.push(format!("{}: text", shown(&name))),
        }
    }
    if let [Some(kp), Some(kd)] = gains {
        source.gains = Some((kp, kd));
    }
    source.tables.push(table);
    Ok(source)
}
