//! What a schema's fields are, and which buffers each of them has.

use crate::columnar_error::{ColumnarError, damaged};
use crate::problem::Problem;
use polars_arrow_format::ipc::planus::Vector;
use polars_arrow_format::ipc::{FieldRef, Precision, TimeUnit, TypeRef};

/// Deepest fields inside each other.
const MAX_DEPTH: usize = 32;

/// How a field's numbers lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Physical {
    Bool,
    Int { bytes: usize, signed: bool },
    Real { bytes: usize },
}

/// The buffers of a field, after those of its validity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    /// Nothing at all, not even validity.
    None,
    /// Nothing but children.
    Children,
    /// Numbers.
    Numbers(Physical),
    /// So many buffers that are not read.
    Skipped(usize),
    /// Views with as many buffers as the batch says.
    Views,
    /// Where lists begin and end, of 4 or 8 bytes each.
    Lists(usize),
    /// Lists of so many values.
    FixedLists(usize),
}

/// A field of the schema.
#[derive(Debug)]
pub(super) struct Field {
    /// Its name after those of the groups that it is in, `/` between.
    pub name: String,
    pub layout: Layout,
    /// Why its numbers are not read, if they are not.
    pub refused: Option<&'static str>,
    /// It is what a list holds.
    pub in_list: bool,
    /// Of times: units a second.
    pub per_second: Option<f64>,
    pub children: Vec<Field>,
}

impl Field {
    /// The fields that hold something: without groups and lists themselves.
    pub fn leaves(&self) -> Vec<&Field> {
        match self.layout {
            Layout::Children | Layout::Lists(_) | Layout::FixedLists(_) => {
                self.children.iter().flat_map(Field::leaves).collect()
            }
            _ => vec![self],
        }
    }
}

/// Reads the schema's fields.
pub(super) fn fields<'a>(
    all: Option<Vector<'a, polars_arrow_format::ipc::planus::Result<FieldRef<'a>>>>,
) -> Result<Vec<Field>, Problem> {
    let mut left = crate::table::MAX_COLUMNS;
    let all = all.ok_or_else(|| damaged("a schema without fields"))?;
    all.iter().map(|field| read(field.map_err(damaged)?, "", Inside::default(), &mut left)).collect()
}

#[derive(Clone, Copy, Default)]
struct Inside {
    depth: usize,
    lists: usize,
    /// The field above is a list, whose inside has no name of its own.
    list: bool,
    refused: Option<&'static str>,
}

fn read(field: FieldRef<'_>, above: &str, inside: Inside, left: &mut usize) -> Result<Field, Problem> {
    // Fields may refer to one another, and a small file to many.
    *left = left
        .checked_sub(1)
        .ok_or(ColumnarError::NotRead("more than 4096 fields; save only the joints' columns"))?;
    if inside.depth > MAX_DEPTH {
        return Err(
            ColumnarError::NotRead("fields inside fields, more than 32 deep; save plain columns").into()
        );
    }
    let name = field.name().map_err(damaged)?.unwrap_or("");
    // The inside of a list has a name that says nothing, such as `item`.
    let name = match (above, inside.list) {
        (_, true) => above.to_owned(),
        ("", false) => name.to_owned(),
        (above, false) => format!("{above}/{name}"),
    };
    let kind = field.type_().map_err(damaged)?.ok_or_else(|| damaged("a field without a type"))?;
    let (mut layout, mut refused, per_second) = layout(&kind)?;
    // Such a column holds places in a dictionary, whose one buffer is passed over.
    if field.dictionary().map_err(damaged)?.is_some() {
        (layout, refused) = (Layout::Skipped(1), Some("words of a dictionary; save them as numbers"));
    }
    let is_list = matches!(layout, Layout::Lists(_) | Layout::FixedLists(_));
    let lists = inside.lists + usize::from(is_list);
    // The reason of the outermost field stands: it explains all below.
    let refused = inside.refused.or(refused).or((lists > 1).then_some("lists in lists"));
    let below = Inside { depth: inside.depth + 1, lists, list: is_list, refused };
    let mut children = Vec::new();
    // The children of a dictionary's column belong to the dictionary, whose messages are passed over.
    if layout != Layout::Skipped(1) || refused.is_none() {
        for child in field.children().map_err(damaged)?.iter().flat_map(|all| all.iter()) {
            children.push(read(child.map_err(damaged)?, &name, below, left)?);
        }
    }
    if is_list && children.len() != 1 {
        return Err(damaged("a list of not one kind").into());
    }
    Ok(Field { name, layout, refused, in_list: lists > 0, per_second, children })
}

/// The buffers of a type, why it is not read, and of times the units a second.
fn layout(kind: &TypeRef<'_>) -> Result<(Layout, Option<&'static str>, Option<f64>), Problem> {
    let per_second = |unit: TimeUnit| match unit {
        TimeUnit::Second => 1.0,
        TimeUnit::Millisecond => 1e3,
        TimeUnit::Microsecond => 1e6,
        TimeUnit::Nanosecond => 1e9,
    };
    let numbers = |physical| (Layout::Numbers(physical), None, None);
    let times =
        |bytes, unit| (Layout::Numbers(Physical::Int { bytes, signed: true }), None, Some(per_second(unit)));
    let skipped = |buffers, reason| (Layout::Skipped(buffers), Some(reason), None);
    let below = |layout| (layout, None, None);
    // Numbers and what holds them are read. Of all other types the buffers to pass over are counted.
    Ok(match kind {
        TypeRef::Null(_) => (Layout::None, Some("nothing in it"), None),
        TypeRef::Bool(_) => numbers(Physical::Bool),
        TypeRef::Int(int) => {
            let bytes = match int.bit_width().map_err(damaged)? {
                8 => 1,
                16 => 2,
                32 => 4,
                64 => 8,
                _ => return Err(damaged("integers of no known width").into()),
            };
            numbers(Physical::Int { bytes, signed: int.is_signed().map_err(damaged)? })
        }
        TypeRef::FloatingPoint(real) => numbers(Physical::Real {
            bytes: match real.precision().map_err(damaged)? {
                Precision::Half => 2,
                Precision::Single => 4,
                Precision::Double => 8,
            },
        }),
        TypeRef::Timestamp(time) => times(8, time.unit().map_err(damaged)?),
        TypeRef::Duration(time) => times(8, time.unit().map_err(damaged)?),
        TypeRef::Time(time) => {
            // Times of day in s and ms have 4 bytes, finer ones 8.
            let bytes = if time.bit_width().map_err(damaged)? == 32 { 4 } else { 8 };
            times(bytes, time.unit().map_err(damaged)?)
        }
        TypeRef::Date(_) | TypeRef::Interval(_) => skipped(1, "dates"),
        TypeRef::Decimal(_) => skipped(1, "decimal numbers; save them as float"),
        TypeRef::FixedSizeBinary(_) => skipped(1, "bytes"),
        TypeRef::Utf8(_) | TypeRef::LargeUtf8(_) => skipped(2, "text"),
        TypeRef::Binary(_) | TypeRef::LargeBinary(_) => skipped(2, "bytes"),
        TypeRef::Utf8View(_) | TypeRef::BinaryView(_) => (Layout::Views, Some("text"), None),
        TypeRef::Struct(_) => below(Layout::Children),
        TypeRef::List(_) => below(Layout::Lists(4)),
        TypeRef::LargeList(_) => below(Layout::Lists(8)),
        TypeRef::FixedSizeList(list) => {
            let size = usize::try_from(list.list_size().map_err(damaged)?).map_err(damaged)?;
            below(Layout::FixedLists(size))
        }
        TypeRef::Map(_)
        | TypeRef::Union(_)
        | TypeRef::RunEndEncoded(_)
        | TypeRef::ListView(_)
        | TypeRef::LargeListView(_) => {
            return Err(ColumnarError::NotRead(
                "columns of a kind that is not read (maps, unions, views of lists); save plain columns",
            )
            .into());
        }
    })
}
