//! The columns that a Parquet file has: leaves of its schema's tree.

use super::encodings::Physical;
use crate::columnar_error::{ColumnarError, damaged};
use crate::problem::Problem;
use polars_parquet_format::{ConvertedType, FieldRepetitionType, LogicalType, SchemaElement, TimeUnit, Type};

/// Deepest groups inside each other.
const MAX_DEPTH: usize = 32;

/// A column.
#[derive(Debug)]
pub(super) struct Leaf {
    /// Names of its groups and itself, `/` between; without the names that lists give to their inside.
    pub name: String,
    /// Type of its numbers.
    pub physical: Physical,
    /// The reason for not reading it.
    pub refused: Option<&'static str>,
    /// Largest definition level: that of a value.
    pub defined: u32,
    /// Largest repetition level: 1 of lists.
    pub repeated: u32,
    /// Definition level of a place in a list.
    pub in_list: u32,
    /// For times: the number of units in a second.
    pub per_second: Option<f64>,
}

/// Place of the walk in the schema.
#[derive(Clone, Default)]
struct Above {
    names: Vec<String>,
    defined: u32,
    repeated: u32,
    in_list: u32,
    /// The group above is a list.
    list: bool,
    /// The group above is what a list repeats.
    inside: bool,
    depth: usize,
}

/// The leaves of a schema, in the order of a row group's columns.
pub(super) fn leaves(schema: &[SchemaElement]) -> Result<Vec<Leaf>, Problem> {
    let root = schema.first().ok_or_else(|| damaged("no schema"))?;
    let mut out = Vec::new();
    let mut next = 1;
    let children = root.num_children.unwrap_or(0);
    for _ in 0..children {
        walk(schema, &mut next, &Above::default(), &mut out)?;
    }
    Ok(out)
}

fn walk(
    schema: &[SchemaElement],
    next: &mut usize,
    above: &Above,
    out: &mut Vec<Leaf>,
) -> Result<(), Problem> {
    let wrong = || damaged("a schema that does not fit together");
    let element = schema.get(*next).ok_or_else(wrong)?;
    *next += 1;
    if above.depth > MAX_DEPTH {
        return Err(
            ColumnarError::NotRead("columns inside columns, more than 32 deep; save plain columns").into()
        );
    }
    let mut here = above.clone();
    here.depth += 1;
    // Levels as Dremel counts them (Melnik et al. 2010): one for each repeated or optional field on the way.
    let repeats = element.repetition_type == Some(FieldRepetitionType::REPEATED);
    if repeats {
        here.repeated += 1;
    }
    if repeats || element.repetition_type == Some(FieldRepetitionType::OPTIONAL) {
        here.defined += 1;
    }
    if repeats {
        here.in_list = here.defined;
    }
    let children = element.num_children.unwrap_or(0);
    // `joint_pos/list/element` is called `joint_pos`.
    let silent = (repeats && above.list) || (above.inside && children == 0);
    if !silent {
        here.names.push(element.name.clone());
    }
    here.list = is_list(element);
    here.inside = repeats && above.list;
    // An empty group has no type either.
    if children > 0 || element.type_.is_none() {
        for _ in 0..children {
            walk(schema, next, &here, out)?;
        }
        return Ok(());
    }
    let (physical, refused) = physical(element);
    let refused = refused.or((here.repeated > 1).then_some("lists in lists"));
    out.push(Leaf {
        name: here.names.join("/"),
        physical,
        refused,
        defined: here.defined,
        repeated: here.repeated,
        in_list: here.in_list,
        per_second: per_second(element),
    });
    Ok(())
}

fn is_list(element: &SchemaElement) -> bool {
    element.converted_type == Some(ConvertedType::LIST)
        || matches!(element.logical_type, Some(LogicalType::LIST(_)))
}

/// Returns the type of the numbers, or why they are not read.
fn physical(element: &SchemaElement) -> (Physical, Option<&'static str>) {
    let unsigned =
        [ConvertedType::UINT_8, ConvertedType::UINT_16, ConvertedType::UINT_32, ConvertedType::UINT_64];
    let mut signed = element.converted_type.is_none_or(|kind| !unsigned.contains(&kind));
    // The logical type is the newer one and overrules the converted type.
    if let Some(LogicalType::INTEGER(kind)) = &element.logical_type {
        signed = kind.is_signed;
    }
    let decimal = element.converted_type == Some(ConvertedType::DECIMAL)
        || matches!(element.logical_type, Some(LogicalType::DECIMAL(_)));
    let int =
        |bytes| (Physical::Int { bytes, signed }, decimal.then_some("decimal numbers; save them as float"));
    match element.type_ {
        Some(Type::BOOLEAN) => (Physical::Bool, None),
        Some(Type::INT32) => int(4),
        Some(Type::INT64) => int(8),
        Some(Type::FLOAT) => (Physical::Float, None),
        Some(Type::DOUBLE) => (Physical::Double, None),
        // Refused columns have a type that nobody looks at.
        Some(Type::INT96) => (Physical::Bool, Some("times of 96 bits; save them as timestamps")),
        _ => (Physical::Bool, Some("text")),
    }
}

/// Units a second of a column of times.
fn per_second(element: &SchemaElement) -> Option<f64> {
    let per_second = |unit: &TimeUnit| match unit {
        TimeUnit::MILLIS(_) => 1e3,
        TimeUnit::MICROS(_) => 1e6,
        TimeUnit::NANOS(_) => 1e9,
    };
    match (&element.logical_type, element.converted_type) {
        (Some(LogicalType::TIMESTAMP(time)), _) => Some(per_second(&time.unit)),
        (Some(LogicalType::TIME(time)), _) => Some(per_second(&time.unit)),
        (_, Some(ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS)) => Some(1e3),
        (_, Some(ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS)) => Some(1e6),
        _ => None,
    }
}
