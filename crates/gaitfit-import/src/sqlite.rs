//! The tables of an SQLite file, read only ("Database File Format", sqlite.org/fileformat2.html). ROS 2's bags of the kind
//! db3 are such files. This reads whole tables row by row, which is all that bags need; there is no SQL.

use crate::problem::Problem;
use crate::sqlite_error::SqliteError;

/// The first bytes of a file.
pub(crate) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Deepest tree. SQLite's own cursors go 20 deep.
const DEEPEST: usize = 24;
/// Largest row, bytes.
const MAX_ROW: usize = 256 << 20;

/// A cell.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cell<'a> {
    Null,
    Integer(i64),
    Real(f64),
    Text(&'a str),
    Blob(&'a [u8]),
}

impl<'a> Cell<'a> {
    /// A whole number.
    pub fn integer(&self) -> Option<i64> {
        match self {
            Cell::Integer(number) => Some(*number),
            _ => None,
        }
    }

    /// Words.
    pub fn text(&self) -> Option<&'a str> {
        match self {
            Cell::Text(text) => Some(text),
            _ => None,
        }
    }
}

/// An open file.
pub(crate) struct Database<'a> {
    bytes: &'a [u8],
    page_size: usize,
    /// Bytes of a page that hold rows.
    usable: usize,
}

/// A table: where it begins and its columns' names.
pub(crate) struct TableInfo {
    root: u32,
    columns: Vec<String>,
}

impl TableInfo {
    /// Number of the column called `name`.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column.eq_ignore_ascii_case(name))
    }
}

/// Pages and bytes that a table may still have. One that is reached twice is in a circle.
struct Left {
    pages: usize,
    bytes: usize,
}

fn damaged() -> SqliteError {
    SqliteError::Damaged
}

impl<'a> Database<'a> {
    /// Looks at the file's header.
    pub fn open(bytes: &'a [u8]) -> Result<Self, SqliteError> {
        let header = bytes.get(..100).filter(|header| header.starts_with(MAGIC)).ok_or_else(damaged)?;
        let page_size = match u16::from_be_bytes([header[16], header[17]]) {
            // Two bytes cannot hold 65,536.
            1 => 65_536,
            size => usize::from(size),
        };
        // Byte 20: bytes at the end of each page that are reserved for extensions.
        let usable = page_size.checked_sub(usize::from(header[20])).ok_or_else(damaged)?;
        // Bounds of the format. `usable − 35` below relies on the last one.
        if !page_size.is_power_of_two() || page_size < 512 || usable < 480 {
            return Err(damaged());
        }
        // Byte 56: 1 is UTF-8, 2 and 3 are UTF-16; 0 in a file without a table.
        if u32::from_be_bytes([header[56], header[57], header[58], header[59]]) > 1 {
            return Err(SqliteError::Utf16);
        }
        Ok(Database { bytes, page_size, usable })
    }

    /// The table called `name`, if there is one.
    pub fn table(&self, name: &str) -> Result<Option<TableInfo>, Problem> {
        let mut table = None;
        self.rows(1, &mut |cells| {
            if let [kind, own, _, root, sql, ..] = cells
                && kind.text() == Some("table")
                && own.text() == Some(name)
            {
                let root = root.integer().and_then(|root| u32::try_from(root).ok());
                table = root.zip(sql.text()).map(|(root, sql)| TableInfo { root, columns: columns(sql) });
            }
            Ok(())
        })?;
        Ok(table)
    }

    /// Calls `row` with the cells of every row of a table, in the order of their numbers. An integer primary key is NULL
    /// among the cells: SQLite keeps it as the row's number, which is put there.
    pub fn each(&self, table: &TableInfo, row: &mut RowVisitor<'_>) -> Result<(), Problem> {
        self.rows(table.root, row)
    }

    fn rows(&self, root: u32, row: &mut RowVisitor<'_>) -> Result<(), Problem> {
        let mut left = Left { pages: self.bytes.len() / self.page_size + 1, bytes: self.bytes.len() };
        self.page(root, 0, &mut left, row)
    }

    fn page(
        &self,
        number: u32,
        depth: usize,
        left: &mut Left,
        row: &mut RowVisitor<'_>,
    ) -> Result<(), Problem> {
        // Pages may refer to one another; each counts when it is visited.
        left.pages = left.pages.checked_sub(1).ok_or_else(damaged)?;
        if depth > DEEPEST {
            return Err(damaged().into());
        }
        let page = self.page_bytes(number)?;
        // The first page begins with the file's header.
        let start = if number == 1 { 100 } else { 0 };
        let kind = *page.get(start).ok_or_else(damaged)?;
        let cells = usize::from(be16(page, start + 3)?);
        // Kinds of pages: 5 is an inner page of a table, 13 a leaf. Indexes (2 and 10) are not visited.
        let head = match kind {
            5 => 12,
            13 => 8,
            _ => return Err(damaged().into()),
        };
        // Keys rise from cell to cell, and the pages beyond the last key hang on the header.
        for cell in 0..cells {
            let at = usize::from(be16(page, start + head + 2 * cell)?);
            if kind == 5 {
                self.page(be32(page, at)?, depth + 1, left, row)?;
            } else {
                self.cell(page, at, left, row)?;
            }
        }
        if kind == 5 {
            self.page(be32(page, start + 8)?, depth + 1, left, row)?;
        }
        Ok(())
    }

    /// A page without the bytes that are reserved at its end.
    fn page_bytes(&self, number: u32) -> Result<&'a [u8], SqliteError> {
        let start = (number as usize).checked_sub(1).and_then(|page| page.checked_mul(self.page_size));
        let start = start.ok_or_else(damaged)?;
        let end = start.checked_add(self.usable).ok_or_else(damaged)?;
        self.bytes.get(start..end).ok_or_else(damaged)
    }

    /// A row in a leaf: its size, its number, its content, of which the end may lie in other pages.
    fn cell(
        &self,
        page: &'a [u8],
        mut at: usize,
        left: &mut Left,
        row: &mut RowVisitor<'_>,
    ) -> Result<(), Problem> {
        let size = usize::try_from(varint(page, &mut at)?).map_err(|_| damaged())?;
        let id = varint(page, &mut at)?;
        if size > MAX_ROW {
            return Err(damaged().into());
        }
        // All rows together fit into the file, unless several places name one.
        left.bytes = left.bytes.checked_sub(size + 2).ok_or_else(damaged)?;
        // How much of a row lies in its leaf before the rest goes to overflow pages (the format's section 1.6).
        let (max, min) = (self.usable - 35, (self.usable - 12) * 32 / 255 - 23);
        if size <= max {
            let content = at.checked_add(size).and_then(|end| page.get(at..end)).ok_or_else(damaged)?;
            return visit(content, id, row);
        }
        let here = min + (size - min) % (self.usable - 4);
        let here = if here <= max { here } else { min };
        let mut content = Vec::with_capacity(size);
        content.extend_from_slice(page.get(at..at + here).ok_or_else(damaged)?);
        let mut next = be32(page, at + here)?;
        // The rest of the row lies in a list of overflow pages, each beginning with the number of the next.
        while content.len() < size {
            left.pages = left.pages.checked_sub(1).ok_or_else(damaged)?;
            let overflow = self.page_bytes(next)?;
            next = be32(overflow, 0)?;
            let part = overflow.get(4..).ok_or_else(damaged)?;
            content.extend_from_slice(&part[..part.len().min(size - content.len())]);
        }
        visit(&content, id, row)
    }
}

/// Takes the cells of a row.
pub(crate) type RowVisitor<'a> = dyn FnMut(&[Cell<'_>]) -> Result<(), Problem> + 'a;

/// Splits a row into cells.
fn visit(content: &[u8], id: i64, row: &mut RowVisitor<'_>) -> Result<(), Problem> {
    let mut at = 0;
    let head = usize::try_from(varint(content, &mut at)?).ok().filter(|head| *head <= content.len());
    let head = head.ok_or_else(damaged)?;
    let mut body = head;
    let mut cells = Vec::new();
    while at < head {
        let kind = varint(content, &mut at)?;
        let mut take = |size: usize| {
            let end = body.checked_add(size).filter(|end| *end <= content.len()).ok_or_else(damaged)?;
            let taken = &content[body..end];
            body = end;
            Ok::<&[u8], SqliteError>(taken)
        };
        // Two's complement, the highest byte first.
        let integer = |bytes: &[u8]| {
            let first = if bytes[0] & 0x80 == 0 { 0i64 } else { -1 };
            bytes.iter().fold(first, |sum, byte| (sum << 8) | i64::from(*byte))
        };
        // Serial types (section 2.1): NULL, integers of 1, 2, 3, 4, 6 and 8 bytes, a double, the constants 0 and 1,
        // then blobs and texts whose size is in the number.
        cells.push(match kind {
            // The key: SQLite writes NULL for it.
            0 if cells.is_empty() => Cell::Integer(id),
            0 => Cell::Null,
            1..=4 => Cell::Integer(integer(take(kind as usize)?)),
            5 => Cell::Integer(integer(take(6)?)),
            6 => Cell::Integer(integer(take(8)?)),
            7 => Cell::Real(f64::from_bits(integer(take(8)?) as u64)),
            8 | 9 => Cell::Integer(kind - 8),
            12.. => {
                let bytes = take(usize::try_from((kind - 12) / 2).map_err(|_| damaged())?)?;
                match kind % 2 {
                    0 => Cell::Blob(bytes),
                    _ => Cell::Text(std::str::from_utf8(bytes).map_err(|_| damaged())?),
                }
            }
            _ => return Err(damaged().into()),
        });
    }
    row(&cells)
}

/// Columns of `CREATE TABLE name(a TYPE, b TYPE, ...)`: the first word of each part.
fn columns(sql: &str) -> Vec<String> {
    let Some(inside) = sql.split_once('(').and_then(|(_, rest)| rest.rsplit_once(')')) else {
        return Vec::new();
    };
    // Commas in brackets, as of types or checks, separate nothing.
    let mut depth = 0;
    let parts = inside.0.split(|c| {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        c == ',' && depth == 0
    });
    let name = |part: &str| {
        let word = part.split_whitespace().next().unwrap_or("");
        word.trim_matches(['"', '`', '[', ']', '\'']).to_owned()
    };
    parts.take(100).map(name).collect()
}

fn be16(bytes: &[u8], at: usize) -> Result<u16, SqliteError> {
    let end = at.checked_add(2).ok_or_else(damaged)?;
    bytes.get(at..end).map(|two| u16::from_be_bytes([two[0], two[1]])).ok_or_else(damaged)
}

fn be32(bytes: &[u8], at: usize) -> Result<u32, SqliteError> {
    let end = at.checked_add(4).ok_or_else(damaged)?;
    bytes.get(at..end).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]])).ok_or_else(damaged)
}

/// A number of one to nine bytes, seven bits in each but the ninth.
fn varint(bytes: &[u8], at: &mut usize) -> Result<i64, SqliteError> {
    let mut value = 0u64;
    for place in 0..9 {
        let byte = *bytes.get(*at).ok_or_else(damaged)?;
        *at += 1;
        if place == 8 {
            return Ok(((value << 8) | u64::from(byte)) as i64);
        }
        value = (value << 7) | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            break;
        }
    }
    Ok(value as i64)
}

/// A table that a bag must have.
pub(crate) fn needed(database: &Database<'_>, name: &str) -> Result<TableInfo, Problem> {
    database.table(name)?.ok_or_else(|| SqliteError::NoTable(name.to_owned()).into())
}
