//! The CSV reader. Bounded memory, no panic on any input; every refusal names file, line, column and remedy.

use crate::assemble::{Samples, assemble};
use crate::columns::{Layout, layout};
use crate::imu;
use crate::lines::Lines;
use crate::metadata::{Metadata, Statements, read_sidecars};
use crate::{Hole, LogError, PerJoint, ReadReport, Trajectory, motion};
use gaitfit_model::shown_path;
use std::path::Path;

/// What the caller knows about a log, stronger than anything the files say, and the reader's limits.
#[derive(Clone, Debug)]
pub struct ReadOptions {
    /// Robot name.
    pub robot: Option<String>,
    /// Nominal sample rate, Hz. Where nobody states it, the median sample interval gives it.
    pub rate_hz: Option<f64>,
    /// Position gains, N·m/rad.
    pub kp: Option<PerJoint>,
    /// Velocity gains, N·m·s/rad.
    pub kd: Option<PerJoint>,
    /// Whether to read `<stem>.toml` and `log.toml` beside the log.
    pub sidecar: bool,
    /// Largest file taken, bytes. Each cell read takes 8 bytes of memory: usually less than its text, at worst
    /// (one digit a cell) four times as much.
    pub max_bytes: u64,
    /// Largest number of columns taken.
    pub max_columns: usize,
    /// Max count of numbers taken: rows times columns that are read. Each takes 8 bytes.
    pub max_values: usize,
    /// Take one row of so many, the first among them. The rate is that of the rows that are taken.
    pub every: usize,
}

impl Default for ReadOptions {
    fn default() -> Self {
        ReadOptions {
            robot: None,
            rate_hz: None,
            kp: None,
            kd: None,
            sidecar: true,
            max_bytes: 512 << 20,
            max_columns: 4096,
            max_values: usize::MAX,
            every: 1,
        }
    }
}

/// Reads a log. See [`read_csv_report`] for what it leaves out.
pub fn read_csv(path: &Path, options: &ReadOptions) -> Result<Trajectory, LogError> {
    read_csv_report(path, options).map(|(trajectory, _)| trajectory)
}

/// Reads a log and says what was left out.
///
/// The file: optional `#` comment lines (of these, `key = value` lines in TOML give `robot`, `rate_hz`, `kp`,
/// `kd`, `fell`, `target_lead_s`), a header line that names the quantities (`time`, `q_FL_hip`, `dq_FL_hip`, `qdes_FL_hip`,
/// `act_FL_hip`, `vx_cmd`, …; in any order; table in the [crate documentation](crate)), then one row of numbers a sample. Joints
/// keep the order of the `q_` columns. `nan` and `inf` are read as they are, for the checks to report; an empty cell is
/// NaN in base columns and an error elsewhere; a base channel with nothing but NaN is left out. What no inertial unit
/// reads is refused: quaternions that are not unit, infinite or absurd angles and rates.
///
/// Gains, rate and robot come from `options`, else the comments, else `<stem>.toml`, else `log.toml` in the
/// log's folder. Unknown columns are left out and reported.
pub fn read_csv_report(path: &Path, options: &ReadOptions) -> Result<(Trajectory, ReadReport), LogError> {
    let mut lines = Lines::open(path, options.max_bytes)?;
    // Sources of settings in the order in which they win: the caller, the comments, files beside the log.
    let mut stated = Metadata::default();
    stated.add(
        Statements {
            robot: options.robot.clone(),
            rate_hz: options.rate_hz,
            kp: options.kp.clone(),
            kd: options.kd.clone(),
            ..Statements::default()
        },
        "read options",
    );
    let mut comments = Metadata::default();
    let mut report = ReadReport::default();
    // Comments may stand before the header and between empty lines.
    let (header_line, names) = loop {
        let Some((line, text)) = lines.next()? else { return Err(LogError::Empty { path: path.to_owned() }) };
        if let Some(comment) = text.strip_prefix('#') {
            let place = format!("{}:{line}", shown_path(path));
            report.unknown_keys.extend(comments.add_comment(comment, &place)?);
        } else if !text.trim().is_empty() {
            break (line, header_cells(path, line, text, options.max_columns)?);
        }
    };
    let layout = layout(path, header_line, names)?;
    let Rows { samples, hole, too_fast, too_far } = read_rows(path, &mut lines, &layout, options)?;
    report.imu_hole = hole;

    // Files beside the log are read last: a log that cannot be read needs none.
    let (sidecar, sidecars) = if options.sidecar { read_sidecars(path)? } else { Default::default() };
    report.sidecars = sidecars;
    let assembled = assemble(path, layout, samples, stated.or(comments).or(sidecar), options.every, report);
    let (log, report) = match assembled {
        Ok(assembled) => assembled,
        // A number in the wrong unit is the likelier cause, and its place is known.
        Err(error) => return Err(too_fast.or(too_far).unwrap_or(error)),
    };
    let rates = log.base.as_ref().and_then(|base| base.angular_velocity.as_deref());
    // Rates in degrees have been converted by now; only those that are still too fast are refused.
    let too_fast = too_fast.filter(|_| rates.is_some_and(|rates| imu::fast(rates).is_some()));
    match too_fast.or(too_far.filter(|_| !report.angles_in_degrees)) {
        Some(refused) => Err(refused),
        None => Ok((log, report)),
    }
}

fn header_cells(path: &Path, line: u64, text: &str, limit: usize) -> Result<Vec<String>, LogError> {
    // Counted before the header is parsed, so that a huge one takes no memory.
    let columns = text.bytes().filter(|&byte| byte == b',').count() + 1;
    if columns > limit {
        return Err(LogError::TooManyColumns { path: path.to_owned(), line, columns, limit });
    }
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(text.as_bytes());
    let mut record = csv::StringRecord::new();
    match reader.read_record(&mut record) {
        Ok(_) => Ok(record.iter().map(|name| name.trim().to_owned()).collect()),
        // The text is UTF-8 and in memory: only the csv crate itself could fail here.
        Err(error) => Err(LogError::Metadata {
            place: format!("{}:{line}", shown_path(path)),
            problem: error.to_string(),
        }),
    }
}

/// Where a channel's cells are, whether they may be empty, and which of a row's cannot be.
struct Channel<'a> {
    columns: &'a [usize],
    optional: bool,
    refuse: Option<Refuse>,
}

/// The first cell of a row that cannot be, and why.
type Refuse = fn(&[f64]) -> Option<(usize, &'static str)>;

fn channels(layout: &Layout) -> [Channel<'_>; 16] {
    fn some(columns: &Option<Vec<usize>>) -> &[usize] {
        columns.as_deref().unwrap_or_default()
    }
    let needed = |columns| Channel { columns, optional: false, refuse: None };
    let base = |columns| Channel { columns: some(columns), optional: true, refuse: None };
    let sensed = |columns, refuse| Channel { columns: some(columns), optional: true, refuse: Some(refuse) };
    // In the order in which `assemble` takes them. `ANGLES` and `RATES` are places in it.
    [
        needed(&layout.position),
        needed(&layout.velocity),
        needed(some(&layout.target)),
        needed(some(&layout.action)),
        needed(some(&layout.command)),
        Channel { columns: some(&layout.motion), optional: false, refuse: Some(motion::place as Refuse) },
        base(&layout.base_position),
        sensed(&layout.base_quaternion, imu::orientation),
        sensed(&layout.roll_pitch_yaw, imu::angles),
        base(&layout.base_velocity),
        sensed(&layout.base_rates, imu::rates),
        sensed(&layout.gravity, imu::gravity),
        needed(some(&layout.kp)),
        needed(some(&layout.kd)),
        needed(some(&layout.target_velocity)),
        needed(some(&layout.feed_forward)),
    ]
}

/// Place of roll, pitch and yaw in the list of [`channels`].
const ANGLES: usize = 8;
/// Place of the body rates in that list.
const RATES: usize = 10;

/// Content of the rows of a file.
struct Rows {
    samples: Samples,
    /// The first hole in a channel of the inertial unit that has numbers elsewhere.
    hole: Option<Hole>,
    /// The first body rate that none in rad/s can be.
    too_fast: Option<LogError>,
    /// The first roll or pitch that none in rad can be.
    too_far: Option<LogError>,
}

fn read_rows(
    path: &Path,
    lines: &mut Lines,
    layout: &Layout,
    options: &ReadOptions,
) -> Result<Rows, LogError> {
    let plan = channels(layout);
    let (mut too_fast, mut too_far) = (None, None);
    let mut samples = Samples { time: Vec::new(), channels: plan.iter().map(|_| Vec::new()).collect() };
    let width = layout.names.len();
    let mut cells: Vec<std::ops::Range<usize>> = Vec::with_capacity(width);
    let mut holes: Vec<Option<Hole>> = plan.iter().map(|_| None).collect();
    // The limit is one of numbers, so wide logs may have fewer rows.
    let columns = 1 + plan.iter().map(|channel| channel.columns.len()).sum::<usize>();
    let max_rows = options.max_values / columns;
    let mut count = 0;
    while let Some((line, text)) = lines.next()? {
        if text.trim().is_empty() {
            continue;
        }
        // Rows are counted with those that are left out, so that every n-th of the file is taken.
        count += 1;
        if !(count - 1usize).is_multiple_of(options.every.max(1)) {
            continue;
        }
        if samples.time.len() >= max_rows {
            return Err(LogError::TooManyRows { path: path.to_owned(), limit: max_rows, columns });
        }
        split_cells(text, &mut cells);
        if cells.len() != width {
            return Err(LogError::RowLength {
                path: path.to_owned(),
                line,
                found: cells.len(),
                expected: width,
                remedy: if cells.len() < width {
                    "the row is cut short, as by a recorder stopped while writing; delete the line or record again"
                } else {
                    "a comma too many, or a decimal comma; numbers here have a decimal point"
                },
            });
        }
        let row = Row { path, line, text, cells: &cells, layout };
        let time = row.number(layout.time, false)?;
        if !time.is_finite() {
            return Err(
                row.refused(layout.time, "no sample time; delete the row, or give its time in seconds")
            );
        }
        samples.time.push(time);
        for ((channel, values), hole) in plan.iter().zip(&mut samples.channels).zip(&mut holes) {
            let start = values.len();
            for &column in channel.columns {
                values.push(row.number(column, channel.optional)?);
            }
            let Some(refuse) = channel.refuse.filter(|_| !channel.columns.is_empty()) else { continue };
            let refused = |(at, problem): (usize, &'static str)| row.refused(channel.columns[at], problem);
            if let Some(cell) = refuse(&values[start..]) {
                return Err(refused(cell));
            }
            // Kept and not refused at once: the whole log may show that the unit is a degree.
            if channel.columns == plan[RATES].columns && too_fast.is_none() {
                too_fast = imu::fast(&values[start..]).map(refused);
            } else if channel.columns == plan[ANGLES].columns && too_far.is_none() {
                too_far = imu::far(&values[start..]).map(refused);
            }
            if let Some(at) = values[start..].iter().position(|value| value.is_nan())
                && hole.is_none()
            {
                let column = channel.columns[at];
                *hole = Some(Hole { line, column: column + 1, name: layout.names[column].clone() });
            }
        }
    }
    if samples.time.is_empty() {
        return Err(LogError::NoSamples { path: path.to_owned() });
    }
    // A channel without any number is left out as a whole; that is no hole.
    let partly = |values: &Vec<f64>| values.iter().any(|value| !value.is_nan());
    let channels = samples.channels.iter().zip(holes).filter(|(values, _)| partly(values));
    let hole = channels.filter_map(|(_, hole)| hole).min_by_key(|hole| hole.line);
    Ok(Rows { samples, hole, too_fast, too_far })
}

/// A row of a file.
struct Row<'a> {
    path: &'a Path,
    line: u64,
    text: &'a str,
    cells: &'a [std::ops::Range<usize>],
    layout: &'a Layout,
}

impl<'a> Row<'a> {
    fn cell(&self, column: usize) -> &'a str {
        unquote(&self.text[self.cells[column].clone()])
    }

    /// The number in a cell; NaN for an empty one that is `optional`.
    fn number(&self, column: usize, optional: bool) -> Result<f64, LogError> {
        let cell = self.cell(column);
        let problem = match cell.parse::<f64>() {
            Ok(value) => return Ok(value),
            Err(_) if cell.is_empty() && optional => return Ok(f64::NAN),
            Err(_) if cell.is_empty() => "empty; write `nan` for a sample that was lost, or delete the row",
            Err(_) => "not a number; numbers here look like -0.25 or 1.5e-3",
        };
        Err(self.refused(column, problem))
    }

    fn refused(&self, column: usize, problem: &'static str) -> LogError {
        LogError::Cell {
            path: self.path.to_owned(),
            line: self.line,
            column: column + 1,
            name: self.layout.names[column].clone(),
            text: short_cell(self.cell(column)),
            problem,
        }
    }
}

/// Byte ranges of the comma-separated cells. Cells hold numbers, so a comma inside quotes is not one.
fn split_cells(text: &str, cells: &mut Vec<std::ops::Range<usize>>) {
    cells.clear();
    let mut start = 0;
    for (at, byte) in text.bytes().enumerate() {
        if byte == b',' {
            cells.push(start..at);
            start = at + 1;
        }
    }
    cells.push(start..text.len());
}

/// The start of a cell, for a message.
fn short_cell(cell: &str) -> String {
    cell.chars().take(40).collect()
}

fn unquote(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|inner| inner.strip_suffix('"')).map_or(cell, str::trim)
}
