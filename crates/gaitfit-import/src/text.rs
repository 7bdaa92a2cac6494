//! CSV files of other programs, PlotJuggler's among them.

use crate::budget::Budget;
use crate::known::{Role, canonical, role};
use crate::mapping::Mapping;
use crate::problem::Problem;
use crate::resolve::wanted;
use crate::table::{MAX_COLUMNS, Source, Sparse};
use crate::table_error::TableError;
use gaitfit_model::shown;
use std::collections::HashSet;

/// Longest line, bytes.
const MAX_LINE: usize = 1 << 20;

/// Reads a CSV file: a header and rows of numbers, separated by commas, semicolons (then with decimal commas, if there are
/// some) or tabs. An empty cell is no sample of its column: columns with samples in the same rows are one stream.
pub(crate) fn read(
    name: &str,
    bytes: &[u8],
    mapping: &Mapping,
    budget: &mut Budget,
) -> Result<Source, Problem> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|_| TableError::NotUtf8)?;
    let header = text
        .lines()
        .find(|line| !line.trim().is_empty() && !line.starts_with('#'))
        .ok_or(TableError::Empty)?;
    // A file of another kind may look like text of very long lines.
    if text.lines().take(100).any(|line| line.len() > MAX_LINE) {
        return Err(TableError::LongLines.into());
    }
    let count = |c: char| header.matches(c).count();
    // The most frequent separator of the header; a comma wins a tie.
    let separator = [',', ';', '\t'].into_iter().max_by_key(|c| (count(*c), *c == ',')).unwrap_or(',');
    let decimal_comma = separator != ',';
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator as u8)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        // Rows of other lengths are judged below, with the line in the message.
        .flexible(true)
        .from_reader(text.as_bytes());
    let damaged = |error: csv::Error| TableError::Csv(error.to_string());
    let names: Vec<String> = reader.headers().map_err(damaged)?.iter().map(str::to_owned).collect();
    check_names(&names)?;

    let time = time_column(&names, mapping)?;
    let mut sparse = Sparse::default();
    let mut columns: Vec<(Vec<u32>, Vec<f64>)> = vec![Default::default(); names.len()];
    let mut words: Vec<Option<(u64, String)>> = vec![None; names.len()];
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(damaged)? {
        let line = || record.position().map_or(0, |start| line_at(text, start.byte()));
        if record.len() != names.len() {
            // PlotJuggler ends lines with a separator in some versions; a last line may be cut short.
            let spare = record.len() == names.len() + 1 && record.get(names.len()).is_some_and(str::is_empty);
            if !spare && reader.is_done() {
                break;
            }
            if !spare {
                let (cells, names) = (record.len(), names.len());
                return Err(TableError::Cells { line: line(), cells, names }.into());
            }
        }
        let row = u32::try_from(sparse.time.len()).map_err(|_| TableError::ManyRows)?;
        let number = |cell: &str| match decimal_comma {
            true => cell.replace(',', ".").parse::<f64>(),
            false => cell.parse::<f64>(),
        };
        budget.take_values(names.len())?;
        let at = match time {
            Some(column) => {
                let cell = record.get(column).unwrap_or("");
                let at = number(cell).ok().filter(|at| at.is_finite());
                at.ok_or_else(|| TableError::Time { line: line(), cell: cell.to_owned() })?
            }
            None => f64::from(row),
        };
        sparse.time.push(at);
        // A spare cell at the end of a row is left out.
        for (column, cell) in record.iter().enumerate().take(names.len()) {
            if cell.is_empty() || Some(column) == time {
                continue;
            }
            match number(cell) {
                Ok(value) => {
                    columns[column].0.push(row);
                    columns[column].1.push(value);
                }
                // Only the first word is kept: it decides about the column, and the message names it.
                Err(_) => {
                    words[column].get_or_insert_with(|| (line(), cell.to_owned()));
                }
            }
        }
    }
    let mut source = Source { kind: "CSV", ..Source::default() };
    let filled = names.iter().zip(columns).zip(words).enumerate().filter(|(column, _)| Some(*column) != time);
    for (_, ((name, filled), words)) in filled {
        put_column(&mut sparse, &mut source, mapping, name, filled, words)?;
    }
    let clock = if time.is_some() { "the time column" } else { "the rows' numbers" };
    source.tables = sparse.split(name, clock, time.map(|column| names[column].as_str()));
    // The numbers of rows served to split them; a rate gives the times later.
    if time.is_none() {
        source.tables.iter_mut().for_each(|table| table.time.clear());
    }
    if source.tables.is_empty() {
        return Err(TableError::NoNumbers.into());
    }
    Ok(source)
}

/// Refuses names that no table has.
fn check_names(names: &[String]) -> Result<(), Problem> {
    if names.len() > MAX_COLUMNS {
        return Err(TableError::ManyColumns { count: names.len() }.into());
    }
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        return Err(TableError::NoHeader.into());
    }
    let mut seen = HashSet::new();
    if let Some(twice) = names.iter().find(|name| !seen.insert(name.as_str())) {
        return Err(TableError::Twice(twice.clone()).into());
    }
    Ok(())
}

/// Keeps the numbers of a column; `words`: its first cell that is no number, with its line.
fn put_column(
    sparse: &mut Sparse,
    source: &mut Source,
    mapping: &Mapping,
    name: &str,
    filled: (Vec<u32>, Vec<f64>),
    words: Option<(u64, String)>,
) -> Result<(), Problem> {
    match words {
        None => drop(sparse.columns.insert(name.to_owned(), filled)),
        // A needed column with numbers has a damaged cell. A column of words alone is left out, whatever its name.
        Some((line, cell)) if !filled.0.is_empty() && wanted(name, mapping) => {
            return Err(TableError::Number { line, column: name.to_owned(), cell }.into());
        }
        Some((line, cell)) => source.left_out.push(format!(
            "{}: `{}` in line {line} is not a number",
            shown(name),
            shown(&cell)
        )),
    }
    Ok(())
}

/// The line, from 1, of the record that begins at a byte of `text`. The reader's own count is one too low after the first
/// line that ends with carriage return and line feed: its records begin between the two.
fn line_at(text: &str, byte: u64) -> u64 {
    let start = usize::try_from(byte).unwrap_or(usize::MAX).min(text.len());
    let bytes = text.as_bytes();
    let ends = bytes[start..].iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
    1 + bytes[..start + ends].iter().filter(|byte| **byte == b'\n').count() as u64
}

/// The place of the time column among `names`; `None`: the mapping gives a rate instead.
pub(crate) fn time_column(names: &[String], mapping: &Mapping) -> Result<Option<usize>, Problem> {
    if let Some(wanted) = &mapping.time.column {
        let place = names.iter().position(|name| name == wanted);
        return place.map(Some).ok_or_else(|| TableError::NoTimeColumn(wanted.clone()).into());
    }
    let usual = names.iter().position(|name| canonical(name).is_none() && role(name) == Some(Role::Time));
    if usual.is_none() && mapping.rate_hz.or(mapping.usual_rate_hz).is_none() {
        return Err(TableError::NoTimes.into());
    }
    Ok(usual)
}
