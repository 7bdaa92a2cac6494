//! Commands over time.

use std::path::Path;

use crate::RobotError;

/// Max rows of a script.
const MAX_ROWS: usize = 100_000;
/// Largest script, bytes: 160 a row.
const MAX_BYTES: u64 = 16 << 20;
/// Longest walk, s.
pub const MAX_WALK_SECONDS: f64 = 3600.0;
/// Largest part of a command, m/s or rad/s.
const LARGEST: f64 = 5.0;

/// Commands over time: each holds until the next one's time, and the walk ends at the last one's.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// Time since the walk's beginning (s) and command: forward, left (m/s), yaw rate (rad/s).
    rows: Vec<(f64, [f32; 3])>,
    /// Beginning and end of the recording of each walk, s.
    walks: Vec<[f64; 2]>,
    /// Whether it is made of walks that each have a log of their own.
    many: bool,
}

impl Script {
    /// Rows of time (s), forward, left (m/s), yaw rate (rad/s).
    ///
    /// # Errors
    /// Fewer than two rows, times that do not begin at 0 and grow, numbers out of range.
    pub fn new(rows: Vec<(f64, [f32; 3])>) -> Result<Self, RobotError> {
        let refuse = |problem: String| Err(RobotError::Script(problem));
        if rows.len() < 2 || rows.len() > MAX_ROWS {
            return refuse(format!(
                "{} rows; give 2 to {MAX_ROWS}, the last one says when the walk ends",
                rows.len()
            ));
        }
        if rows[0].0 != 0.0 {
            return refuse(format!("the first time is {}; begin at 0", rows[0].0));
        }
        for (index, (time, command)) in rows.iter().enumerate() {
            let line = index + 1;
            // NaN is in no range.
            if !(0.0..=MAX_WALK_SECONDS).contains(time) || index > 0 && *time <= rows[index - 1].0 {
                return refuse(format!(
                    "time {line} is {time}; give seconds up to {MAX_WALK_SECONDS}, each later than the one before"
                ));
            }
            if let Some(bad) = command.iter().find(|x| x.is_nan() || f64::from(x.abs()) > LARGEST) {
                return refuse(format!(
                    "command {line} has {bad}; give numbers from −{LARGEST} to {LARGEST}"
                ));
            }
        }
        let walks = vec![[0.0, rows[rows.len() - 1].0]];
        Ok(Self { rows, walks, many: false })
    }

    /// Several walks, one after another, each recorded by itself; between them the robot stands for `pause`, s, under the
    /// policy. Each walk has rows as [`Script::new`] takes them.
    ///
    /// # Errors
    /// What [`Script::new`] refuses of a walk or of all of them, no walk, and a pause that is not from 0.5 to 60 s.
    pub fn of_walks(recorded: &[Vec<(f64, [f32; 3])>], pause: f64) -> Result<Self, RobotError> {
        if !(0.5..=60.0).contains(&pause) {
            return Err(RobotError::Script(format!("a pause of {pause} s; give 0.5 to 60")));
        }
        let (mut rows, mut walks) = (Vec::new(), Vec::new());
        let mut begin = 0.0;
        for walk in recorded {
            // Each walk is checked by itself, so that an error counts its own rows.
            let walk = Self::new(walk.clone())?;
            let end = begin + walk.seconds();
            // The last row of a walk only says when it ends: a pause takes its place.
            let commands = walk.rows.len() - 1;
            rows.extend(walk.rows[..commands].iter().map(|(time, command)| (begin + time, *command)));
            rows.push((end, [0.0; 3]));
            walks.push([begin, end]);
            begin = end + pause;
        }
        // All walks together are checked like one: their whole time is bounded too.
        Ok(Self { walks, many: true, ..Self::new(rows)? })
    }

    /// A CSV file with the columns `t`, `vx`, `vy`, `wz`, in any order: s, m/s, m/s, rad/s.
    ///
    /// # Errors
    /// A file that cannot be read or lacks a column, a cell that is no number, and what [`Script::new`] refuses.
    pub fn read(path: &Path) -> Result<Self, RobotError> {
        let refuse = |problem: String| RobotError::Script(format!("{}: {problem}", path.display()));
        let text = gaitfit_log::regular_file::read_text(path, MAX_BYTES).map_err(|error| {
            refuse(format!("{error}; name a CSV file with the header t,vx,vy,wz (s, m/s, m/s, rad/s)"))
        })?;
        // Spreadsheets put a byte order mark before the text.
        let text = text.trim_start_matches('\u{feff}');
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
        let header = reader.headers().map_err(|error| refuse(error.to_string()))?.clone();
        let mut columns = [0; 4];
        for (column, name) in columns.iter_mut().zip(["t", "vx", "vy", "wz"]) {
            *column = header.iter().position(|cell| cell == name).ok_or_else(|| {
                refuse(format!("no column `{name}`; the header is t,vx,vy,wz (s, m/s, m/s, rad/s)"))
            })?;
        }
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|error| refuse(error.to_string()))?;
            let mut numbers = [0.0f64; 4];
            for (number, &column) in numbers.iter_mut().zip(&columns) {
                let cell = record.get(column).unwrap_or("");
                *number = cell.parse().map_err(|_| {
                    let line = record.position().map_or(0, csv::Position::line);
                    refuse(format!("line {line}: `{}` is no number", gaitfit_model::shown(cell)))
                })?;
            }
            let [time, vx, vy, wz] = numbers;
            rows.push((time, [vx as f32, vy as f32, wz as f32]));
            // `new` refuses these rows; more need not be read.
            if rows.len() > MAX_ROWS {
                break;
            }
        }
        Self::new(rows).map_err(|error| match error {
            RobotError::Script(problem) => refuse(problem),
            other => other,
        })
    }

    /// The command at `time`, s; `None` once the walk is over.
    pub fn at(&self, time: f64) -> Option<[f32; 3]> {
        let next = self.rows.partition_point(|(begin, _)| *begin <= time);
        // The last row is no command: it only ends the walk.
        (next < self.rows.len()).then(|| self.rows[next.saturating_sub(1)].1)
    }

    /// The walk that is recorded at `time`, s, and when it began; `None` in a pause.
    pub fn walk_at(&self, time: f64) -> Option<(usize, f64)> {
        let number = self.walks.partition_point(|[begin, _]| *begin <= time).checked_sub(1)?;
        let [begin, end] = self.walks[number];
        (time < end).then_some((number, begin))
    }

    /// The least and the largest of each part of the commands that are walked under: forward, left (m/s), yaw rate (rad/s).
    pub fn extremes(&self) -> [[f64; 2]; 3] {
        // The last row is no command.
        let walked = &self.rows[..self.rows.len().saturating_sub(1)];
        std::array::from_fn(|part| {
            walked
                .iter()
                .map(|(_, command)| f64::from(command[part]))
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], speed| {
                    [low.min(speed), high.max(speed)]
                })
        })
    }

    /// Whether it was made of walks that each have a log of their own, if only of one.
    pub fn of_many(&self) -> bool {
        self.many
    }

    /// Number of walks that are recorded.
    pub fn walks(&self) -> usize {
        self.walks.len()
    }

    /// Length of all of it, s.
    pub fn seconds(&self) -> f64 {
        self.rows.last().map_or(0.0, |(time, _)| *time)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Script, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("commands.csv");
        std::fs::write(&path, text).unwrap();
        Script::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn a_command_holds_until_the_next() {
        let script = read("vx, t, vy, wz\n0.5, 0, 0, 0.1\n# a pause\n0,2,0,0\n0,3,0,0\n").unwrap();
        assert_eq!(script.at(0.0), Some([0.5, 0.0, 0.1]));
        assert_eq!(script.at(1.999), Some([0.5, 0.0, 0.1]));
        assert_eq!(script.at(2.0), Some([0.0; 3]));
        assert_eq!((script.at(3.0), script.seconds()), (None, 3.0));
        assert_eq!(script.extremes()[0], [0.0, 0.5]);
    }

    #[test]
    fn walks_follow_each_other_with_pauses_between() {
        let walk = |speed: f32| vec![(0.0, [speed, 0.0, 0.0]), (1.0, [0.0, speed, 0.0]), (4.0, [9.0; 3])];
        let mut last = walk(0.7);
        last[2].1 = [0.0; 3];
        assert!(Script::of_walks(&[walk(0.5)], 2.0).is_err(), "a command of 9");
        let first = vec![(0.0, [0.5, 0.0, 0.0]), (4.0, [0.0; 3])];
        let script = Script::of_walks(&[first, last.clone()], 2.0).unwrap();
        assert_eq!((script.walks(), script.seconds()), (2, 10.0));
        for (time, walk, command) in [
            (0.0, Some((0, 0.0)), Some([0.5, 0.0, 0.0])),
            (3.99, Some((0, 0.0)), Some([0.5, 0.0, 0.0])),
            (4.0, None, Some([0.0; 3])),
            (5.99, None, Some([0.0; 3])),
            (6.0, Some((1, 6.0)), Some([0.7, 0.0, 0.0])),
            (9.5, Some((1, 6.0)), Some([0.0, 0.7, 0.0])),
            (10.0, None, None),
        ] {
            assert_eq!((script.walk_at(time), script.at(time)), (walk, command), "{time}");
        }
        for pause in [0.0, -1.0, f64::NAN, 1e9] {
            assert!(Script::of_walks(&[last.clone(), last.clone()], pause).is_err());
        }
        assert!(Script::of_walks(&[], 2.0).is_err());
        assert!(Script::of_walks(&vec![last; 700], 2.0).is_err(), "longer than an hour");
    }

    #[test]
    fn what_is_no_script_is_refused_and_says_why() {
        for (text, word) in [
            ("t,vx,vy\n0,0,0\n1,0,0\n", "`wz`"),
            ("t,vx,vy,wz\n0,0,0,0\n", "1 rows"),
            ("t,vx,vy,wz\n1,0,0,0\n2,0,0,0\n", "begin at 0"),
            ("t,vx,vy,wz\n0,0,0,0\n2,0,0,0\n2,0,0,0\n", "time 3"),
            ("t,vx,vy,wz\n0,fast,0,0\n2,0,0,0\n", "line 2: `fast`"),
            ("t,vx,vy,wz\n0,NaN,0,0\n2,0,0,0\n", "NaN"),
            ("t,vx,vy,wz\n0,0,9,0\n2,0,0,0\n", "9"),
            ("t,vx,vy,wz\n0,0,0,0\n1e9,0,0,0\n", "1000000000"),
            ("t,vx,vy,wz\n0,0,0\n", ""),
            ("", "`t`"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(word) && error.contains("commands.csv"), "{text}: {error}");
        }
    }
}
