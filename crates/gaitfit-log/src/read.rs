//! The CSV reader. Bounded memory, no panic on any input; every refusal names file, line, column and remedy.

use crate::columns::{Layout, layout};
use crate::metadata::{Metadata, Statements, read_sidecars};
use crate::{BaseState, Gains, LogError, PerJoint, Trajectory};
use serde::Serialize;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

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
    /// Largest file taken, bytes. Memory use is about 8 bytes a cell read, below the file's size.
    pub max_bytes: u64,
    /// Largest number of columns taken.
    pub max_columns: usize,
}

impl Default for ReadOptions {
    fn default() -> Self {
        ReadOptions {
            robot: None,
            rate_hz: None,
            kp: None,
            kd: None,
            sidecar: true,
            max_bytes: 1 << 30,
            max_columns: 4096,
        }
    }
}

/// A column that the reader left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct IgnoredColumn {
    /// Its number in the file, from 1.
    pub column: usize,
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// What reading left out and where it found what.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ReadReport {
    /// Columns left out, in file order.
    pub ignored: Vec<IgnoredColumn>,
    /// Keys of header comments that mean nothing here.
    pub unknown_keys: Vec<String>,
    /// Sidecar files used.
    pub sidecars: Vec<PathBuf>,
    /// Where the gains were stated.
    pub gains_from: Option<String>,
    /// Where the sample rate was stated; absent: measured from `time`.
    pub rate_from: Option<String>,
}

/// Longest line, bytes: 4096 columns of the longest numbers fit.
const LINE_LIMIT: usize = 1 << 20;

/// Reads a log. See [`read_csv_report`] for what it leaves out.
pub fn read_csv(path: &Path, options: &ReadOptions) -> Result<Trajectory, LogError> {
    read_csv_report(path, options).map(|(trajectory, _)| trajectory)
}

/// Reads a log and says what was left out.
///
/// The file: optional `#` comment lines (of these, `key = value` lines in TOML give `robot`, `rate_hz`, `kp`,
/// `kd`), a header line that names the quantities (`time`, `q_FL_hip`, `dq_FL_hip`, `qdes_FL_hip`,
/// `act_FL_hip`, `vx_cmd`, …; in any order; table in `columns.rs`), then one row of numbers a sample. Joints
/// keep the order of the `q_` columns. `nan` and `inf` are read as they are, for the checks to report; an empty cell is NaN in base columns and an error elsewhere; a base channel with nothing but NaN
/// is left out.
///
/// Gains, rate and robot come from `options`, else the comments, else `<stem>.toml`, else `log.toml` in the
/// log's folder. Unknown columns are left out and reported.
pub fn read_csv_report(path: &Path, options: &ReadOptions) -> Result<(Trajectory, ReadReport), LogError> {
    let io = |source| LogError::Io {
        path: path.to_owned(),
        action: "read the log",
        source,
        remedy: "check the path and its permissions",
    };
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(LogError::NotAFile { path: path.to_owned() });
    }
    let mut lines = Lines {
        path,
        input: BufReader::new(File::open(path).map_err(io)?),
        line: 0,
        bytes: 0,
        max_bytes: options.max_bytes,
        buffer: Vec::new(),
    };

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
    let (header_line, names) = loop {
        let Some((line, text)) = lines.next()? else { return Err(LogError::Empty { path: path.to_owned() }) };
        if let Some(comment) = text.strip_prefix('#') {
            let place = format!("{}:{line}", path.display());
            report.unknown_keys.extend(comments.add_comment(comment, &place)?);
        } else if !text.trim().is_empty() {
            break (line, header_cells(path, line, text, options.max_columns)?);
        }
    };
    let layout = layout(path, header_line, names)?;
    let samples = read_rows(path, &mut lines, &layout)?;

    let (sidecar, sidecars) = if options.sidecar { read_sidecars(path)? } else { Default::default() };
    report.sidecars = sidecars;
    assemble(path, layout, samples, stated.or(comments).or(sidecar), report)
}

/// The file's lines with their numbers, within the limits.
struct Lines<'a> {
    path: &'a Path,
    input: BufReader<File>,
    line: u64,
    bytes: u64,
    max_bytes: u64,
    buffer: Vec<u8>,
}

impl Lines<'_> {
    /// Next line without its end, and its number from 1.
    fn next(&mut self) -> Result<Option<(u64, &str)>, LogError> {
        self.buffer.clear();
        let read = (&mut self.input)
            .take(LINE_LIMIT as u64 + 1)
            .read_until(b'\n', &mut self.buffer)
            .map_err(|source| LogError::Io {
                path: self.path.to_owned(),
                action: "read the log",
                source,
                remedy: "check the disk",
            })?;
        if read == 0 {
            return Ok(None);
        }
        self.line += 1;
        self.bytes += read as u64;
        if self.bytes > self.max_bytes {
            return Err(LogError::TooLarge { path: self.path.to_owned(), limit: self.max_bytes });
        }
        if self.line == 1
            && let Some(hint) = binary_hint(&self.buffer)
        {
            return Err(LogError::NotUtf8 { path: self.path.to_owned(), line: 1, hint });
        }
        if read > LINE_LIMIT {
            return Err(LogError::LineTooLong {
                path: self.path.to_owned(),
                line: self.line,
                limit: LINE_LIMIT,
            });
        }
        let mut text = std::str::from_utf8(&self.buffer).map_err(|_| LogError::NotUtf8 {
            path: self.path.to_owned(),
            line: self.line,
            hint: "save the log as UTF-8 CSV text; if it was, the file is damaged here",
        })?;
        text = text.strip_suffix('\n').unwrap_or(text);
        text = text.strip_suffix('\r').unwrap_or(text);
        if self.line == 1 {
            text = text.strip_prefix('\u{feff}').unwrap_or(text);
        }
        Ok(Some((self.line, text)))
    }
}

fn binary_hint(start: &[u8]) -> Option<&'static str> {
    match start {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Some("it looks like UTF-16; save the log as UTF-8"),
        [0x1f, 0x8b, ..] => Some("it is compressed with gzip; decompress it first"),
        [b'P', b'K', 3, 4, ..] => Some("it is a zip archive or a spreadsheet; export it as CSV"),
        _ => None,
    }
}

fn header_cells(path: &Path, line: u64, text: &str, limit: usize) -> Result<Vec<String>, LogError> {
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
            place: format!("{}:{line}", path.display()),
            problem: error.to_string(),
        }),
    }
}

/// Sample arrays by channel.
struct Samples {
    time: Vec<f64>,
    channels: Vec<Vec<f64>>,
}

/// Where a channel's cells are and whether they may be empty.
struct Channel<'a> {
    columns: &'a [usize],
    optional: bool,
}

fn channels(layout: &Layout) -> [Channel<'_>; 10] {
    fn some(columns: &Option<Vec<usize>>) -> &[usize] {
        columns.as_deref().unwrap_or_default()
    }
    let needed = |columns| Channel { columns, optional: false };
    let base = |columns| Channel { columns: some(columns), optional: true };
    [
        needed(&layout.position),
        needed(&layout.velocity),
        needed(some(&layout.target)),
        needed(some(&layout.action)),
        needed(some(&layout.command)),
        base(&layout.base_position),
        base(&layout.base_quaternion),
        base(&layout.roll_pitch_yaw),
        base(&layout.base_velocity),
        base(&layout.base_rates),
    ]
}

fn read_rows(path: &Path, lines: &mut Lines, layout: &Layout) -> Result<Samples, LogError> {
    let plan = channels(layout);
    let mut samples = Samples { time: Vec::new(), channels: plan.iter().map(|_| Vec::new()).collect() };
    let width = layout.names.len();
    let mut cells: Vec<std::ops::Range<usize>> = Vec::with_capacity(width);
    while let Some((line, text)) = lines.next()? {
        if text.trim().is_empty() {
            continue;
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
        let number = |column: usize, optional: bool| -> Result<f64, LogError> {
            let cell = unquote(&text[cells[column].clone()]);
            let problem = match cell.parse::<f64>() {
                Ok(value) => return Ok(value),
                Err(_) if cell.is_empty() && optional => return Ok(f64::NAN),
                Err(_) if cell.is_empty() => {
                    "empty; write `nan` for a sample that was lost, or delete the row"
                }
                Err(_) => "not a number; numbers here look like -0.25 or 1.5e-3",
            };
            Err(LogError::Cell {
                path: path.to_owned(),
                line,
                column: column + 1,
                name: layout.names[column].clone(),
                text: cell.chars().take(40).collect(),
                problem,
            })
        };
        let time = number(layout.time, false)?;
        if !time.is_finite() {
            return Err(LogError::Cell {
                path: path.to_owned(),
                line,
                column: layout.time + 1,
                name: "time".into(),
                text: time.to_string(),
                problem: "no sample time; delete the row, or give its time in seconds",
            });
        }
        samples.time.push(time);
        for (channel, values) in plan.iter().zip(&mut samples.channels) {
            for &column in channel.columns {
                values.push(number(column, channel.optional)?);
            }
        }
    }
    if samples.time.is_empty() {
        return Err(LogError::NoSamples { path: path.to_owned() });
    }
    Ok(samples)
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

fn unquote(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|inner| inner.strip_suffix('"')).map_or(cell, str::trim)
}

fn assemble(
    path: &Path,
    layout: Layout,
    samples: Samples,
    metadata: Metadata,
    mut report: ReadReport,
) -> Result<(Trajectory, ReadReport), LogError> {
    report.ignored = layout.ignored;
    let joints = layout.joints;
    let gains = resolve_gains(&metadata, &joints, &mut report)?;
    let rate_hz = match &metadata.rate_hz {
        Some(rate) if rate.value.is_finite() && rate.value > 0.0 => {
            report.rate_from = Some(rate.place.clone());
            rate.value
        }
        Some(rate) => {
            return Err(LogError::Metadata {
                place: rate.place.clone(),
                problem: format!("rate_hz is {}; give a positive sample rate in Hz", rate.value),
            });
        }
        None => measured_rate(&samples.time).ok_or_else(|| LogError::Metadata {
            place: path.display().to_string(),
            problem: "time does not say the sample rate (one sample, or time stands still); state it as \
                      `# rate_hz = 200` above the header or in the sidecar"
                .into(),
        })?,
    };

    let mut channels = samples.channels.into_iter();
    let mut next = || channels.next().unwrap_or_default();
    let (position, velocity, target, action, command) = (next(), next(), next(), next(), next());
    let mut base_channel = |name: &'static str, columns: Option<Vec<usize>>| {
        let values = next();
        if values.iter().all(|value| value.is_nan()) {
            for column in columns.unwrap_or_default() {
                report.ignored.push(IgnoredColumn {
                    column: column + 1,
                    name: layout.names[column].clone(),
                    reason: format!("every {name} cell is NaN"),
                });
            }
            return None;
        }
        Some(values)
    };
    let base_position = base_channel("base position", layout.base_position);
    let quaternion = base_channel("base orientation", layout.base_quaternion);
    let from_angles = base_channel("roll, pitch, yaw", layout.roll_pitch_yaw).map(|angles| {
        angles.chunks_exact(3).flat_map(|rpy| quaternion_from_rpy(rpy[0], rpy[1], rpy[2])).collect()
    });
    let base = BaseState {
        position: base_position,
        quaternion: quaternion.or(from_angles),
        linear_velocity: base_channel("base velocity", layout.base_velocity),
        angular_velocity: base_channel("body rate", layout.base_rates),
    };
    report.ignored.sort_by_key(|ignored| ignored.column);
    let trajectory = Trajectory {
        source: Some(path.to_owned()),
        robot: metadata.robot.map(|robot| robot.value),
        joints,
        time: samples.time,
        rate_hz,
        position,
        velocity,
        target: layout.target.map(|_| target),
        action: layout.action.map(|_| action),
        command: layout.command.map(|_| command),
        base: (base != BaseState::default()).then_some(base),
        gains,
    };
    trajectory.validate()?;
    Ok((trajectory, report))
}

fn resolve_gains(
    metadata: &Metadata,
    joints: &[String],
    report: &mut ReadReport,
) -> Result<Option<Gains>, LogError> {
    let (kp, kd) = match (&metadata.kp, &metadata.kd) {
        (Some(kp), Some(kd)) => (kp, kd),
        (None, None) => return Ok(None),
        (Some(given), None) => return Err(lone_gain(&given.place, "kp", "kd")),
        (None, Some(given)) => return Err(lone_gain(&given.place, "kd", "kp")),
    };
    let refuse = |place: &str, problem| LogError::Metadata { place: place.to_owned(), problem };
    let gains = Gains {
        kp: kp.value.resolve("kp", joints).map_err(|problem| refuse(&kp.place, problem))?,
        kd: kd.value.resolve("kd", joints).map_err(|problem| refuse(&kd.place, problem))?,
    };
    report.gains_from = Some(if kp.place == kd.place {
        kp.place.clone()
    } else {
        format!("kp: {}, kd: {}", kp.place, kd.place)
    });
    Ok(Some(gains))
}

fn lone_gain(place: &str, given: &str, lacking: &str) -> LogError {
    LogError::Metadata {
        place: place.to_owned(),
        problem: format!("{given} without {lacking}; state both gains of the PD controller"),
    }
}

/// 1 / median sample interval, rounded to a whole number of hertz where that is within 0.5 %: recorders run
/// at round rates and write rounded times. `None` when the median interval is not positive.
fn measured_rate(time: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let (_, median, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    let rate = 1.0 / *median;
    if !(rate.is_finite() && rate > 0.0) {
        return None;
    }
    let whole = rate.round();
    Some(if (rate - whole).abs() <= 0.005 * whole { whole } else { rate })
}

/// Unit quaternion, wxyz, of R = Rz(yaw)·Ry(pitch)·Rx(roll) (Diebel 2006, "Representing Attitude", eq. 290
/// with the ZYX sequence); NaN in, NaN out.
fn quaternion_from_rpy(roll: f64, pitch: f64, yaw: f64) -> [f64; 4] {
    let (sr, cr) = (0.5 * roll).sin_cos();
    let (sp, cp) = (0.5 * pitch).sin_cos();
    let (sy, cy) = (0.5 * yaw).sin_cos();
    [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
}
