//! Files of command sequences: one row wherever a command changes.

use gaitfit_run::files;
use gaitfit_settings::Error;
use std::fmt::Write;
use std::path::Path;

/// The header.
const COLUMNS: &str = "trajectory,time,vx_cmd,vy_cmd,wz_cmd";
/// Max number of bytes of a file, and of sequences in it.
const MAX_BYTES: u64 = 64 << 20;
const MAX_SEQUENCES: usize = 100_000;
/// Largest command, m/s or rad/s, and latest time, s.
const MAX_COMMAND: f64 = 100.0;
const LATEST: f64 = 3600.0;

/// Commands over time: each holds until the next one's time, the last to the end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sequence {
    /// Time, s, from 0 on, and command: m/s ahead, m/s to the left, rad/s.
    pub steps: Vec<(f64, [f64; 3])>,
}

impl Sequence {
    /// The command at a time, s.
    pub fn at(&self, time: f64) -> [f64; 3] {
        // A nanosecond of tolerance: times are multiples of a control period, with rounding.
        let next = self.steps.partition_point(|(begin, _)| *begin <= time + 1e-9);
        self.steps.get(next.saturating_sub(1)).map_or([0.0; 3], |(_, command)| *command)
    }
}

/// The text of a file.
pub fn text(sequences: &[Sequence]) -> String {
    let mut text = format!("{COLUMNS}\n");
    for (number, sequence) in sequences.iter().enumerate() {
        for (time, [x, y, yaw]) in &sequence.steps {
            let _ = writeln!(text, "{number},{time:?},{x:?},{y:?},{yaw:?}");
        }
    }
    text
}

/// Reads a file.
///
/// # Errors
/// A file that cannot be read, or is not one of commands, with the line.
pub fn read(path: &Path) -> Result<Vec<Sequence>, Error> {
    let text = files::read_text(path, MAX_BYTES).map_err(|source| Error::unreadable(path, source))?;
    parse(&text).map_err(|wrong| Error::content(path, wrong))
}

fn parse(text: &str) -> Result<Vec<Sequence>, String> {
    // Spreadsheets begin their files with a byte order mark.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    if lines.next().is_none_or(|(_, header)| !header.split(',').map(str::trim).eq(COLUMNS.split(','))) {
        return Err(format!("no file of commands; its header is {COLUMNS}"));
    }
    let mut sequences: Vec<Sequence> = Vec::new();
    for (number, line) in lines {
        let wrong = |what: &str| Err(format!("line {}: {what}", number + 1));
        let numbers: Option<Vec<f64>> = line.split(',').map(|word| word.trim().parse().ok()).collect();
        let Some([trajectory, time, command @ ..]) = numbers.as_deref() else {
            return wrong("five numbers are needed, with commas between");
        };
        let Ok(command) = <[f64; 3]>::try_from(command) else {
            return wrong("five numbers are needed, with commas between");
        };
        // NaN fails this comparison too.
        if !command.iter().all(|value| value.abs() <= MAX_COMMAND) {
            return wrong("a command is a number of at most 100 m/s or rad/s");
        }
        // The next number begins the next sequence; every other must be the present one.
        if *trajectory == sequences.len() as f64 && sequences.len() < MAX_SEQUENCES {
            sequences.push(Sequence::default());
        }
        let last = sequences.len() as f64 - 1.0;
        let Some(sequence) = sequences.last_mut().filter(|_| *trajectory == last) else {
            return wrong("trajectories are numbered 0, 1, 2, one after another, and are at most 100000");
        };
        let rises = match sequence.steps.last() {
            Some((before, _)) => time > before,
            None => *time == 0.0,
        };
        if !rises || !(0.0..=LATEST).contains(time) {
            return wrong("times of a trajectory begin at 0 and rise, to 3600 s at most");
        }
        sequence.steps.push((*time, command));
    }
    if sequences.is_empty() { Err("it holds no commands".to_owned()) } else { Ok(sequences) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_bad_lines_are_named() {
        let one = Sequence { steps: vec![(0.0, [0.5, -0.25, 1.0]), (1.5, [0.0; 3])] };
        let all = vec![one.clone(), Sequence { steps: vec![(0.0, [1.0; 3])] }];
        assert_eq!(parse(&text(&all)).unwrap(), all);
        // As a spreadsheet writes it.
        let spaced = format!("\u{feff}{}", text(&all).replace(',', ", ").replace('\n', "\r\n"));
        assert_eq!(parse(&spaced).unwrap(), all);
        assert_eq!(
            (one.at(0.0), one.at(1.49), one.at(1.5), one.at(99.0)),
            ([0.5, -0.25, 1.0], [0.5, -0.25, 1.0], [0.0; 3], [0.0; 3])
        );
        let cases = [
            ("", "header"),
            ("time,vx\n", "header"),
            ("0,0,1,1\n", "line 2: five"),
            ("0,0,1,1,x\n", "line 2: five"),
            ("0,0,1,1,NaN\n", "at most 100"),
            ("0,0,1,1,1e9\n", "at most 100"),
            ("1,0,1,1,1\n", "numbered"),
            ("NaN,0,1,1,1\n", "numbered"),
            ("0,1,1,1,1\n", "begin at 0"),
            ("0,0,1,1,1\n0,0,1,1,1\n", "line 3: times"),
            ("0,0,1,1,1\n0,inf,1,1,1\n", "line 3: times"),
            ("\n", "no commands"),
        ];
        for (rows, words) in cases {
            let whole = if words == "header" { rows.to_owned() } else { format!("{COLUMNS}\n{rows}") };
            let error = parse(&whole).unwrap_err();
            assert!(error.contains(words), "`{words}` is not in `{error}`");
        }
    }
}
