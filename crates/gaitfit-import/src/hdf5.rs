//! HDF5 files, such as recordings of robomimic and Isaac Lab: datasets of numbers as arrays, named by their paths.
//!
//! The library that reads them is given the sizes that it may make: a dataset that states more is refused before it is read.

use crate::arrays::{Array, Arrays, count};
use crate::budget::Budget;
use crate::columnar_error::{ColumnarError, damaged};
use crate::problem::Problem;
use hdf5_pure::{DType, Dataset, File, Group, VlenStringReadOptions};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Deepest groups inside each other: links may lead in a ring.
const MAX_DEPTH: usize = 8;
/// Max number of groups and datasets.
const MAX_OBJECTS: usize = 10_000;
/// Longest words of a dataset together, bytes.
const MAX_WORDS: usize = 1 << 20;

/// The arrays of the file.
pub(crate) fn read(file: &[u8], budget: &mut Budget) -> Result<Arrays, Problem> {
    // The library refuses what it does not understand. Should it panic over a damaged file instead, that is an error too.
    catch_unwind(AssertUnwindSafe(|| whole(file, budget)))
        .unwrap_or_else(|_| Err(damaged("its reader gave up").into()))
}

fn whole(file: &[u8], budget: &mut Budget) -> Result<Arrays, Problem> {
    budget.take_bytes(file.len())?;
    let file = File::from_bytes(file.to_vec()).map_err(library)?;
    let mut reader = Reader { arrays: Arrays::default(), objects: 0, budget };
    reader.group(&file.root(), "", 0)?;
    Ok(reader.arrays)
}

struct Reader<'a> {
    arrays: Arrays,
    objects: usize,
    budget: &'a mut Budget,
}

impl Reader<'_> {
    fn count(&mut self) -> Result<(), Problem> {
        self.objects += 1;
        if self.objects > MAX_OBJECTS {
            return Err(ColumnarError::Library(format!(
                "more than {MAX_OBJECTS} groups and datasets; save one recording a file"
            ))
            .into());
        }
        Ok(())
    }

    fn group(&mut self, group: &Group, above: &str, depth: usize) -> Result<(), Problem> {
        let unlisted = |error: hdf5_pure::Error| ColumnarError::Group {
            path: above.to_owned(),
            problem: error.to_string(),
        };
        let wrong = |path: &str, problem: Problem| ColumnarError::Object {
            path: path.to_owned(),
            problem: problem.into(),
        };
        let path = |name: &str| if above.is_empty() { name.to_owned() } else { format!("{above}/{name}") };
        for name in group.datasets().map_err(unlisted)? {
            // Counted before it is opened: a small file may have very many objects.
            self.count()?;
            let path = path(&name);
            let dataset = group.dataset(&name).map_err(|error| wrong(&path, library(error).into()))?;
            self.dataset(&dataset, &path).map_err(|problem| wrong(&path, problem))?;
        }
        // Groups may contain one another.
        if depth == MAX_DEPTH {
            return Ok(());
        }
        for name in group.groups().map_err(unlisted)? {
            self.count()?;
            let path = path(&name);
            let inner = group.group(&name).map_err(|error| wrong(&path, library(error).into()))?;
            self.group(&inner, &path, depth + 1)?;
        }
        Ok(())
    }

    fn dataset(&mut self, dataset: &Dataset, path: &str) -> Result<(), Problem> {
        let too_large = || ColumnarError::NotRead("its shape is too large");
        let shape: Option<Vec<usize>> =
            dataset.shape().map_err(library)?.into_iter().map(|size| usize::try_from(size).ok()).collect();
        let shape = shape.filter(|shape| shape.len() <= 8).ok_or_else(too_large)?;
        let elements = count(&shape).ok_or_else(too_large)?;
        let kind = dataset.dtype().map_err(library)?;
        let bytes = usize::try_from(dataset.element_size().map_err(library)?).map_err(|_| too_large())?;
        // The raw bytes, and the parts of the file that they are unpacked from.
        let raw = elements.checked_mul(bytes).and_then(|raw| raw.checked_mul(2)).ok_or_else(too_large)?;
        let chunk = match dataset.chunk_shape().map_err(library)? {
            None => 0,
            Some(chunk) => {
                let sizes: Option<Vec<usize>> =
                    chunk.into_iter().map(|size| usize::try_from(size).ok()).collect();
                let all = sizes.and_then(|sizes| count(&sizes)).and_then(|all| all.checked_mul(bytes));
                all.ok_or_else(too_large)?
            }
        };
        match kind {
            DType::F32 | DType::F64 => {}
            DType::I8 | DType::I16 | DType::I32 | DType::I64 => {}
            DType::U8 | DType::U16 | DType::U32 | DType::U64 => {}
            // Words name joints or columns, so more of them than columns are not read.
            DType::String | DType::VariableLengthString if elements <= crate::table::MAX_COLUMNS => {
                // The words may be longer than their references; the library may make `MAX_WORDS` bytes of
                // them.
                self.budget.take_bytes(raw.max(MAX_WORDS))?;
                let words = match kind {
                    DType::String => dataset.read_string().map_err(library)?,
                    _ => {
                        let options = VlenStringReadOptions::new()
                            .with_max_elements(elements)
                            .with_max_payload_bytes(MAX_WORDS);
                        dataset.read_vlen_strings(options).map_err(library)?
                    }
                };
                self.arrays.words.insert(path.to_owned(), words);
                return Ok(());
            }
            // Pictures, structures, references.
            _ => return Ok(()),
        }
        // Before anything is unpacked.
        self.budget.take_values(elements)?;
        self.budget.take_bytes(raw)?;
        self.budget.take_bytes(chunk)?;
        let data = dataset.read_f64().map_err(library)?;
        if data.len() != elements {
            return Err(damaged(format!("{} numbers where its shape says {elements}", data.len())).into());
        }
        self.arrays.numbers.insert(path.to_owned(), Array { shape, data });
        Ok(())
    }
}

fn library(error: hdf5_pure::Error) -> ColumnarError {
    ColumnarError::Library(error.to_string())
}
