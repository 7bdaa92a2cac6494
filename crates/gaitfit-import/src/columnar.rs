//! Files of columns (Parquet, Arrow): from columns that may have gaps, or a list in every row, to tables.

use crate::arrays::{self, Array, Arrays};
use crate::budget::Budget;
use crate::mapping::Mapping;
use crate::problem::Problem;
use crate::table::{MAX_COLUMNS, Source, Sparse};
use crate::table_error::TableError;
use crate::text::time_column;
use gaitfit_model::shown;
use indexmap::IndexMap;

/// Numbers as their file has them: times of nanoseconds do not fit into floating point.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Values {
    Integers(Vec<i64>),
    Reals(Vec<f64>),
}

impl Values {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Values::Integers(values) => values.len(),
            Values::Reals(values) => values.len(),
        }
    }

    /// Puts others behind; those of another type become real numbers.
    pub fn append(&mut self, other: Values) {
        match (&mut *self, other) {
            (Values::Integers(own), Values::Integers(other)) => own.extend(other),
            (Values::Reals(own), other) => own.extend(other.reals()),
            (Values::Integers(own), Values::Reals(other)) => {
                let all = own.iter().map(|value| *value as f64).chain(other).collect();
                *self = Values::Reals(all);
            }
        }
    }

    /// Converts to floating point.
    pub fn reals(self) -> Vec<f64> {
        match self {
            Values::Integers(values) => values.into_iter().map(|value| value as f64).collect(),
            Values::Reals(values) => values,
        }
    }
}

/// A column over all parts of a file.
#[derive(Debug)]
pub(crate) struct Column {
    /// The rows that have a value; one a value. Unused of lists.
    pub rows: Vec<u32>,
    /// For a column of lists: the number of values of each row.
    pub lengths: Option<Vec<u32>>,
    /// All values, row after row.
    pub values: Values,
    /// For times: the number of units in a second.
    pub per_second: Option<f64>,
}

impl Column {
    /// An empty column; with lists, if it has one in every row.
    pub fn new(lists: bool, per_second: Option<f64>) -> Self {
        let lengths = lists.then(Vec::new);
        Column { rows: Vec::new(), lengths, values: Values::Integers(Vec::new()), per_second }
    }

    /// The values; times in s since the first.
    fn reals(values: Values, per_second: Option<f64>) -> Vec<f64> {
        match (values, per_second) {
            (Values::Integers(values), Some(unit)) => {
                // Subtracted as integers: nanoseconds since 1970 have 19 digits, and an f64 has 16.
                let first = values.first().copied().unwrap_or(0);
                values.iter().map(|value| value.saturating_sub(first) as f64 / unit).collect()
            }
            (values, _) => values.reals(),
        }
    }
}

/// A file's columns.
#[derive(Debug, Default)]
pub(crate) struct Frame {
    /// Number of rows.
    pub rows: usize,
    /// Columns by name.
    pub columns: IndexMap<String, Column>,
    /// Columns that were not read, with the reason.
    pub left_out: Vec<String>,
    /// The file ends before it should.
    pub cut: bool,
}

impl Frame {
    /// Adds a column that is to be read.
    pub fn add(&mut self, name: String, column: Column) -> Result<(), Problem> {
        if self.columns.len() >= MAX_COLUMNS {
            return Err(TableError::MoreColumns { what: "columns" }.into());
        }
        match self.columns.insert(name.clone(), column) {
            Some(_) => Err(TableError::Twice(name).into()),
            None => Ok(()),
        }
    }

    /// Tables: of columns of numbers as of a CSV file, with lists as of arrays.
    pub fn source(
        mut self,
        name: &str,
        kind: &'static str,
        mapping: &Mapping,
        budget: &mut Budget,
    ) -> Result<Source, Problem> {
        let left_out = std::mem::take(&mut self.left_out);
        // One column of lists makes arrays of all.
        let has_lists = self.columns.values().any(|column| column.lengths.is_some());
        let cut = self.cut;
        let mut source = match has_lists {
            true => self.arrays(name, kind, mapping, budget)?,
            false => self.cells(name, kind, mapping)?,
        };
        source.left_out.splice(0..0, left_out);
        if cut {
            source.assumed.push("the file was cut off; it is read as far as it goes".into());
        }
        Ok(source)
    }

    /// Columns of numbers: a row without a value is no sample of that column.
    fn cells(self, name: &str, kind: &'static str, mapping: &Mapping) -> Result<Source, Problem> {
        let names: Vec<String> = self.columns.keys().cloned().collect();
        let time = time_column(&names, mapping)?;
        let mut sparse = Sparse::default();
        let mut typed = false;
        for (place, (label, column)) in self.columns.into_iter().enumerate() {
            if Some(place) != time {
                sparse.columns.insert(label, (column.rows, column.values.reals()));
                continue;
            }
            // A row without a time has no place.
            if column.values.len() != self.rows {
                return Err(TableError::NoTime(label).into());
            }
            typed = column.per_second.is_some();
            sparse.time = Column::reals(column.values, column.per_second);
        }
        // Rows need some time until they are split; it is taken away again below, where a stated rate gives
        // the real one.
        if time.is_none() {
            sparse.time = (0..self.rows).map(|row| row as f64).collect();
        }
        let clock = if time.is_some() { "the time column" } else { "the rows' numbers" };
        // A typed time says its unit itself.
        let time_name = time.filter(|_| !typed).map(|place| names[place].as_str());
        let mut source = Source { kind, ..Source::default() };
        source.tables = sparse.split(name, clock, time_name);
        if time.is_none() {
            source.tables.iter_mut().for_each(|table| table.time.clear());
        }
        if source.tables.is_empty() {
            return Err(TableError::NoColumns.into());
        }
        Ok(source)
    }

    /// Columns of which some have a list in every row.
    fn arrays(
        self,
        name: &str,
        kind: &'static str,
        mapping: &Mapping,
        budget: &mut Budget,
    ) -> Result<Source, Problem> {
        let mut arrays = Arrays::default();
        let (mut left_out, mut typed) = (Vec::new(), Vec::new());
        for (label, column) in self.columns {
            let Column { lengths, values, per_second, .. } = column;
            let rows = self.rows;
            let shape = match lengths {
                // An array has a number in every row.
                None if values.len() == rows => vec![rows],
                None => {
                    left_out.push(format!("{}: rows without a value", shown(&label)));
                    continue;
                }
                Some(lengths) => {
                    let width = lengths.first().copied().unwrap_or(0);
                    // An array is rectangular.
                    if lengths.len() != rows || width == 0 || lengths.iter().any(|length| *length != width) {
                        left_out.push(format!("{}: lists of different lengths, or none", shown(&label)));
                        continue;
                    }
                    vec![rows, width as usize]
                }
            };
            if per_second.is_some() {
                typed.push(label.clone());
            }
            arrays.numbers.insert(label, Array { shape, data: Column::reals(values, per_second) });
        }
        let mut source = arrays::source(name, kind, arrays, mapping, budget)?;
        // A typed time says its unit itself, so its name must not suggest another.
        for table in &mut source.tables {
            let is_typed = |name: &String| typed.iter().any(|typed| typed.rsplit('/').next() == Some(name));
            table.time_name = table.time_name.take().filter(|name| !is_typed(name));
        }
        source.left_out.append(&mut left_out);
        Ok(source)
    }
}
