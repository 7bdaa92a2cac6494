//! What every reader makes of its file: tables of columns with times.

use gaitfit_log::{Lead, Stated};
use indexmap::IndexMap;

/// Max columns of a table, as many as the reader of logs takes.
pub(crate) const MAX_COLUMNS: usize = 4096;

/// Columns that share their times.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    /// Topic, file or group of columns, for messages.
    pub name: String,
    /// Clock that the times are of, for the report.
    pub clock: &'static str,
    /// s since the source's origin; one a row. Empty: the file has no times.
    pub time: Vec<f64>,
    /// Name of the time column, which may say its unit; absent: seconds.
    pub time_name: Option<String>,
    /// Values by column name, one a row.
    pub columns: IndexMap<String, Vec<f64>>,
    /// How exact the times are beside those of the positions, s: what comes so much after a sample came with it.
    pub slack: f64,
}

impl Table {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.values().next().map_or(self.time.len(), Vec::len)
    }

    /// Keeps these rows, in this order.
    pub fn pick(&mut self, rows: &[usize]) {
        let pick = |values: &mut Vec<f64>| {
            *values = rows.iter().filter_map(|row| values.get(*row).copied()).collect();
        };
        pick(&mut self.time);
        self.columns.values_mut().for_each(pick);
    }
}

/// Content of one file.
#[derive(Debug, Default)]
pub(crate) struct Source {
    /// Kind of file, for the report.
    pub kind: &'static str,
    /// Its tables.
    pub tables: Vec<Table>,
    /// Times are since this moment, ns since 1970; 0 where times are as the file has them.
    pub origin_ns: i64,
    /// Joint names in order, where the file says them.
    pub joints: Option<Vec<String>>,
    /// Joints in the order of the file's numbers, where the kind of file is known to have that order.
    pub usual_joints: Option<&'static [&'static str]>,
    /// Position and velocity gains, one a joint, where the file says them.
    pub gains: Option<(Vec<f64>, Vec<f64>)>,
    /// How long after their rows targets were stamped, where the file says it.
    pub lead: Option<Lead>,
    /// What comment lines above a text's header, and the files beside it, state.
    pub stated: Stated,
    /// Joints whose targets are velocities, where the file says it.
    pub velocity_joints: Vec<String>,
    /// Physics step of the simulator that made it, s.
    pub simulated_step: Option<f64>,
    /// The robot's name, where the file says it.
    pub robot: Option<String>,
    /// Whether it is of messages on topics.
    pub messages: bool,
    /// Whether one row of `Mapping::every` was taken already.
    pub thinned: bool,
    /// The recording ends because the robot fell.
    pub fell: bool,
    /// What reading noticed, as the log's checks would put it.
    pub noticed: Vec<gaitfit_log::Finding>,
    /// What was assumed, in sentences.
    pub assumed: Vec<String>,
    /// What was left out, with the reason.
    pub left_out: Vec<String>,
    /// Names of `streams.take` that match a stream of this file.
    pub taken: Vec<String>,
    /// What `streams.take` leaves out has been left out.
    pub chosen: bool,
    /// Names and templates of `[columns]` that match a column of this file.
    pub fitted: Vec<String>,
    /// Names of columns as the file has them, some of them.
    pub columns: Vec<String>,
    /// Names of `[joint_names]` that match a joint of this file.
    pub renamed: Vec<String>,
    /// Whether the file numbers joints.
    pub numbered: bool,
    /// What `streams.take` could have named, some of it.
    pub takeable: Vec<String>,
}

/// Columns that may be empty in some rows.
#[derive(Debug, Default)]
pub(crate) struct Sparse {
    /// Times, s; one a row.
    pub time: Vec<f64>,
    /// For each column the rows that it has a value in, and the values.
    pub columns: IndexMap<String, (Vec<u32>, Vec<f64>)>,
}

impl Sparse {
    /// Tables of the columns that have values in the same rows. Columns without a value are left out.
    pub fn split(self, name: &str, clock: &'static str, time_name: Option<&str>) -> Vec<Table> {
        // Columns with values in the same rows share their times, so a list of rows is the key.
        let mut groups: IndexMap<Vec<u32>, IndexMap<String, Vec<f64>>> = IndexMap::new();
        for (column, (rows, values)) in self.columns {
            if !rows.is_empty() {
                groups.entry(rows).or_default().insert(column, values);
            }
        }
        let single = groups.len() == 1;
        groups
            .into_iter()
            .map(|(rows, columns)| {
                let time = rows.iter().filter_map(|&row| self.time.get(row as usize).copied()).collect();
                let first = columns.keys().next().map_or("", String::as_str);
                let name = if single { name.to_owned() } else { format!("{name} ({first} …)") };
                Table { name, clock, time, time_name: time_name.map(str::to_owned), columns, slack: 0.0 }
            })
            .collect()
    }
}
