//! The form of drift trials: a row a trial, with empty cells for what a tape measure or a tag says, and what the filled form
//! says of the policy.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::run::{COMMAND, DIRECTIONS, Trial};

/// Furthest that a robot may have come, m: the fastest trial, 5 m/s for 4 s, leads 20 m. What is beyond is likely
/// centimetres.
const FURTHEST: f64 = 30.0;
/// Furthest that it may have turned, rad: a little more than a whole turn. What is beyond is likely degrees.
const MAX_TURNED: f64 = 7.0;
/// Columns that a form must have.
const NEEDED: [&str; 6] = ["trial", "direction", "vx", "vy", "wz", "seconds"];
/// Columns that say where the robot ended, each in two units, with the factor to m or rad.
const ENDS: [[(&str, f64); 2]; 3] = [
    [("x_m", 1.0), ("x_cm", 0.01)],
    [("y_m", 1.0), ("y_cm", 0.01)],
    [("heading_deg", 1f64.to_radians()), ("heading_rad", 1.0)],
];
/// Columns that a form may have.
const OTHERS: [&str; 2] = ["fell", "note"];
/// Largest form, bytes: hundreds of trials with long notes.
const MAX_BYTES: u64 = 1 << 20;

/// The reason why a form cannot be read: one line, with file and line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct FormError {
    /// The form.
    pub path: PathBuf,
    /// The problem, and what to do.
    pub problem: String,
}

/// A filled form.
#[derive(Clone, Debug, PartialEq)]
pub struct Form {
    /// The policy that walked.
    pub policy: String,
    /// Trials that were measured, or fell.
    pub trials: Vec<Measured>,
    /// Rows that nobody filled.
    pub empty: usize,
}

/// A trial that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Where it went, for example `+x`.
    pub direction: String,
    /// Where it ended minus where it should have: ahead and to the left of where the command began, m, and heading, rad, to
    /// the left. None if it fell.
    pub error: Option<[f64; 3]>,
}

impl Measured {
    /// How far from where it should it ended, m.
    pub fn distance(&self) -> Option<f64> {
        self.error.map(|[x, y, _]| x.hypot(y))
    }
}

/// The empty form of trials with a policy.
pub fn form(policy: &str, trials: &[Trial]) -> String {
    let mut text = format!(
        "# policy = {}\n\
         # Mark where the robot stands, and its heading, before each trial. When it stands again, measure from the mark:\n\
         # x_m: metres ahead along the heading that it had; y_m: metres to its left (to the right: negative);\n\
         # heading_deg: degrees that it turned to the left (to the right: negative). fell: yes if it fell; leave the rest empty.\n\
         # Rows of trials that were not made stay empty. Then: gaitfit drift FORM.csv\n\
         {},x_m,y_m,heading_deg,fell,note\n",
        // Text of JSON is one line, and the reader takes its escapes back.
        serde_json::Value::from(policy),
        NEEDED.join(",")
    );
    for (number, Trial { direction, command: [vx, vy, wz] }) in trials.iter().enumerate() {
        // The five empty cells are x_m to note: the reader wants every row as wide as the header.
        let _ = writeln!(text, "{},{direction},{vx},{vy},{wz},{COMMAND},,,,,", number + 1);
    }
    text
}

impl Form {
    /// Reads a filled form.
    ///
    /// # Errors
    /// A file that is none, rows that are half filled, cells that are no numbers or have another unit, no filled row.
    pub fn read(path: &Path) -> Result<Self, FormError> {
        let refuse = |problem: String| FormError { path: path.to_owned(), problem };
        let text = gaitfit_log::regular_file::read_text(path, MAX_BYTES).map_err(|error| {
            refuse(match error.kind() {
                std::io::ErrorKind::InvalidInput => {
                    format!("this is no form ({error}): name the CSV file that `gaitfit run --drift` wrote")
                }
                _ => format!("{error}; save the form as CSV in UTF-8"),
            })
        })?;
        Self::parse(&text, path).map_err(refuse)
    }

    fn parse(text: &str, path: &Path) -> Result<Self, String> {
        // Spreadsheets put a byte order mark before the text.
        let text = unquoted(text.trim_start_matches('\u{feff}'));
        // A form written by hand need not name its policy; then the file's name does.
        let named = text.lines().find_map(|line| line.strip_prefix("# policy = "));
        let policy = named.map(|name| {
            let by_hand = || name.trim().trim_end_matches(',').trim_matches('"').to_owned();
            serde_json::from_str(name).unwrap_or_else(|_| by_hand())
        });
        let policy =
            policy.unwrap_or_else(|| path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
        // Every row must be as wide as the header: a decimal comma makes two cells of one number and shows
        // here.
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
        let header = reader.headers().map_err(|error| error.to_string())?.clone();
        let columns = Columns::from_header(&header)?;
        let mut form = Self { policy, trials: Vec::new(), empty: 0 };
        let mut lines = HashMap::new();
        for record in reader.records() {
            let record = record
                .map_err(|error| format!("{error}. Does a number have a comma? Write a point, as in 0.35"))?;
            let line = record.position().map_or(0, csv::Position::line);
            let number = record.get(columns.needed[0]).unwrap_or("").to_owned();
            // A row that was copied and not renumbered would count one walk twice.
            if let Some(first) = lines.insert(number.clone(), line) {
                return Err(format!(
                    "line {line}: trial `{}` is in line {first} already; number each trial once",
                    number.escape_debug()
                ));
            }
            let trial = columns.trial(&record).map_err(|problem| format!("line {line}: {problem}"))?;
            match trial {
                Some(trial) => form.trials.push(trial),
                None => form.empty += 1,
            }
        }
        if form.trials.is_empty() {
            return Err(
                "no row is filled in: write where the robot ended into x_m, y_m and heading_deg".to_owned()
            );
        }
        Ok(form)
    }
}

/// The text of a form with its comments as they were written: a spreadsheet puts a line that has quotes into quotes, and
/// empty cells behind it.
fn unquoted(text: &str) -> String {
    let line = |line: &str| -> String {
        let cell = || {
            let mut cells = csv::ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
            cells.records().next()?.ok()?.get(0).map(str::to_owned)
        };
        let comment = line.starts_with("\"#").then(cell).flatten();
        comment.unwrap_or_else(|| line.to_owned()) + "\n"
    };
    text.lines().map(line).collect()
}

/// Where the cells are.
struct Columns {
    needed: [usize; 6],
    /// Column, its name, and the factor to m or rad.
    ends: [(usize, &'static str, f64); 3],
    fell: Option<usize>,
}

impl Columns {
    fn from_header(header: &csv::StringRecord) -> Result<Self, String> {
        let at = |name: &str| header.iter().position(|cell| cell == name);
        let names = ENDS.iter().flatten().map(|(name, _)| *name);
        let known: Vec<&str> = NEEDED.into_iter().chain(names).chain(OTHERS).collect();
        // A column that is passed over in silence may hold the numbers in another unit.
        if let Some(unknown) = header.iter().find(|cell| !known.contains(cell)) {
            return Err(format!(
                "column `{}` is none of a form: {}. Units are part of the names",
                unknown.escape_debug(),
                known.join(", ")
            ));
        }
        let mut needed = [0; 6];
        for (column, name) in needed.iter_mut().zip(NEEDED) {
            *column = at(name)
                .ok_or_else(|| format!("no column `{name}`; `gaitfit run --drift` writes the form"))?;
        }
        let mut ends = [(0, "", 1.0); 3];
        for (end, [first, second]) in ends.iter_mut().zip(ENDS) {
            // Of two units exactly one may be there: with both it is not known which one the person filled.
            *end = match (at(first.0), at(second.0)) {
                (Some(column), None) => (column, first.0, first.1),
                (None, Some(column)) => (column, second.0, second.1),
                (None, None) => return Err(format!("no column `{}` or `{}`", first.0, second.0)),
                (Some(_), Some(_)) => {
                    return Err(format!(
                        "columns `{}` and `{}`; keep the one that is filled in",
                        first.0, second.0
                    ));
                }
            };
        }
        Ok(Self { needed, ends, fell: at("fell") })
    }

    /// A row; `None` if nobody filled it.
    fn trial(&self, record: &csv::StringRecord) -> Result<Option<Measured>, String> {
        let cell = |column: usize| record.get(column).unwrap_or("");
        let number = |column: usize, name: &str| -> Result<f64, String> {
            let text = cell(column);
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| {
                format!(
                    "{name} is `{}`; write a number alone, with a point and without its unit, as in 0.35",
                    text.escape_debug()
                )
            })
        };
        // The columns come in the order of `NEEDED`.
        let [_, direction, parts @ .., seconds] = self.needed;
        let seconds = number(seconds, "seconds")?;
        // A trial moves along one axis only, so its ideal end is command times time.
        let mut wanted = [0.0; 3];
        for ((wanted, column), name) in wanted.iter_mut().zip(parts).zip(["vx", "vy", "wz"]) {
            *wanted = number(column, name)? * seconds;
        }
        let direction = cell(direction).to_owned();
        if !DIRECTIONS.as_flattened().contains(&direction.as_str()) {
            return Err(format!(
                "direction is `{}`; it is one of {}",
                direction.escape_debug(),
                DIRECTIONS.as_flattened().join(", ")
            ));
        }
        let fell = match self.fell.map_or("", cell).to_lowercase().as_str() {
            "" | "no" => false,
            "yes" => true,
            other => {
                return Err(format!(
                    "fell is `{}`; write yes or no, or leave it empty",
                    other.escape_debug()
                ));
            }
        };
        let filled = self.ends.iter().filter(|(column, _, _)| !cell(*column).is_empty()).count();
        // A robot that fell has no end to measure, whatever was written.
        match (filled, fell) {
            (0, false) => return Ok(None),
            (_, true) => return Ok(Some(Measured { direction, error: None })),
            (3, false) => {}
            _ => {
                let missing: Vec<&str> = self
                    .ends
                    .iter()
                    .filter(|(column, _, _)| cell(*column).is_empty())
                    .map(|(_, name, _)| *name)
                    .collect();
                return Err(format!("{} is empty: fill it in, or empty the whole row", missing.join(", ")));
            }
        }
        let mut error = [0.0; 3];
        for (part, (column, name, factor)) in self.ends.into_iter().enumerate() {
            let end = factor * number(column, name)?;
            let max = if part < 2 { FURTHEST } else { MAX_TURNED };
            if end.abs() > max {
                let other =
                    ENDS[part].iter().find(|(other, _)| *other != name).map_or("", |(other, _)| other);
                return Err(format!(
                    "{name} is {}, which is further than a robot comes in {seconds} s; is it {other}? Then name the \
                     column so",
                    cell(column)
                ));
            }
            error[part] = end - wanted[part];
        }
        // A heading is the same a turn further.
        error[2] -= std::f64::consts::TAU * (error[2] / std::f64::consts::TAU).round();
        Ok(Some(Measured { direction, error: Some(error) }))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::run::trials;

    fn parse(text: &str) -> Result<Form, String> {
        Form::parse(text, Path::new("walks/first.csv"))
    }

    fn filled(rows: &[(usize, &str)]) -> String {
        let empty = form("go2 \"walk\".safetensors", &trials(1, [1.0, 0.5, 0.3925]).unwrap());
        let line = |(number, line): (usize, &str)| {
            let row = rows.iter().find(|(row, _)| line.starts_with(&format!("{row},")) && number > 4);
            row.map_or(line.to_owned(), |(_, cells)| line.replace(",,,,,", &format!(",{cells}")))
        };
        empty.lines().enumerate().map(line).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn what_was_measured_is_compared_with_what_was_commanded() {
        let form =
            parse(&filled(&[(1, "3.7,-0.2,-10,,"), (2, ",,,yes,"), (5, "0.1,0,100,no,slippery")])).unwrap();
        assert_eq!((form.trials.len(), form.empty), (3, 3));
        assert_eq!(form.policy, "go2 \"walk\".safetensors");
        let [x, y, heading] = form.trials[0].error.unwrap();
        assert!((x + 0.3).abs() < 1e-9 && (y + 0.2).abs() < 1e-9 && (heading + 0.174_533).abs() < 1e-5);
        assert_eq!(form.trials[1], Measured { direction: "-x".to_owned(), error: None });
        let turned = form.trials[2].error.unwrap()[2];
        assert!((turned - (100.0f64.to_radians() - 1.57)).abs() < 1e-9, "{turned}");
        let centimetres =
            filled(&[(1, "370,-20,-0.1745,,")]).replace("x_m,y_m,heading_deg", "x_cm,y_cm,heading_rad");
        let other = parse(&centimetres).unwrap().trials[0].error.unwrap();
        assert!((other[0] + 0.3).abs() < 1e-9 && (other[2] + 0.1745).abs() < 1e-9, "{other:?}");
        // A spreadsheet's own way to write it.
        let saved = filled(&[(1, "3.7,-0.2,-10,,")]);
        let (first, rest) = saved.split_once('\n').unwrap();
        let saved = format!("\"{}\",,,,,,,,,,\r\n{rest}", first.replace('"', "\"\""));
        assert_eq!(parse(&saved).unwrap().policy, "go2 \"walk\".safetensors");
        assert_eq!(parse(&saved).unwrap().empty, 5);
        let by_hand = saved.replace(&saved[..saved.find('\r').unwrap()], "# policy = go2,,,,");
        assert_eq!(parse(&by_hand).unwrap().policy, "go2");
        assert_eq!(
            parse(&format!("\u{feff}{}", filled(&[(1, "3.7,-0.2,-10,,")]).replace('\n', "\r\n")))
                .unwrap()
                .empty,
            5
        );
    }

    #[test]
    fn a_form_that_is_half_filled_or_has_other_units_says_where_and_what() {
        for (text, words) in [
            (filled(&[]), ["no row is filled in", "x_m"]),
            (filled(&[(1, "3.7,,-10,,")]), ["line 7: y_m is empty", "the whole row"]),
            (filled(&[(2, "3.7,0.1 m,-10,,")]), ["line 8: y_m is `0.1 m`", "without its unit"]),
            (filled(&[(1, "370,0,1,,")]), ["line 7: x_m is 370", "x_cm"]),
            (filled(&[(1, "3,0,4000,,")]), ["heading_deg is 4000", "heading_rad"]),
            (filled(&[(1, "3,0,1,perhaps,")]), ["fell is `perhaps`", "yes or no"]),
            (filled(&[(1, "3,70,0,1,,")]), ["comma", "0.35"]),
            (filled(&[(1, "NaN,0,0,,")]), ["x_m is `NaN`", "a number"]),
            (filled(&[(1, "3,0,1,,")]).replace("x_m", "x"), ["column `x`", "x_cm"]),
            (filled(&[(1, "3,0,1,,")]).replace(",note", ",x_cm"), ["`x_m` and `x_cm`", "keep"]),
            (
                filled(&[(1, "3,0,1,,")]).replace(",seconds", ",note").replace("fell,note", "fell,fell"),
                ["`seconds`", "--drift"],
            ),
            (filled(&[(1, "3,0,1,,")]).replace("\n2,", "\n1,"), ["line 8: trial `1`", "line 7"]),
            (filled(&[(1, "3,0,1,,")]).replace(",+yaw,", ",+zzz,"), ["direction is `+zzz`", "+yaw"]),
            (String::new(), ["no column", "trial"]),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}\n{text}");
        }
    }
}
