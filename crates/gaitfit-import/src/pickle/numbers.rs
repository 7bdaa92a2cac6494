//! Makes named arrays of a pickle's objects.

use super::PickleError;
use super::node::{Id, Node, Pickle, RawArray, Tensor};
use crate::arrays::{Array, Arrays, count};
use crate::budget::Budget;
use crate::npz::numbers;
use crate::problem::Problem;
use indexmap::IndexMap;
use std::rc::Rc;

/// Deepest dictionary in dictionaries.
const DEEPEST: usize = 8;
/// Max number of named arrays.
const MAX_ARRAYS: usize = 10_000;
/// Max number of objects looked at: objects that hold each other are seen more than once.
const MAX_VISITS: usize = 1_000_000;

/// Gives the bytes of a PyTorch storage.
pub(crate) type Storages<'a> = dyn FnMut(&str, &mut Budget) -> Result<Rc<[u8]>, Problem> + 'a;

/// Makes arrays of what a pickle holds.
pub(crate) struct Numbers<'a, 'b> {
    nodes: &'a [Node],
    storages: &'a mut Storages<'b>,
    budget: &'a mut Budget,
    visits: usize,
}

/// The named arrays of `pickle`: dictionaries of arrays, tensors or lists of numbers, and lists of such dictionaries, one
/// a sample. Names in dictionaries of dictionaries are joined by `/`.
pub(crate) fn arrays(
    pickle: &Pickle,
    storages: &mut Storages<'_>,
    budget: &mut Budget,
) -> Result<Arrays, Problem> {
    let mut out = Arrays::default();
    let mut numbers = Numbers { nodes: &pickle.nodes, storages, budget, visits: 0 };
    numbers.gather("", pickle.root, 0, &mut out)?;
    if out.numbers.is_empty() {
        return Err(PickleError::NoArrays.into());
    }
    Ok(out)
}

impl Numbers<'_, '_> {
    /// Adds what `id` holds under `name`.
    fn gather(&mut self, name: &str, id: Id, depth: usize, out: &mut Arrays) -> Result<(), Problem> {
        // Objects may contain one another many times over, so visits are counted and not objects.
        self.visits += 1;
        let full = out.numbers.len() + out.words.len() >= MAX_ARRAYS;
        // What is too deep or too much is left out: the rest may still be a log.
        if depth > DEEPEST || full || self.visits > MAX_VISITS {
            return Ok(());
        }
        let nodes = self.nodes;
        match &nodes[id] {
            Node::Dict(entries) => {
                for (key, value) in entries {
                    let key = match &nodes[*key] {
                        Node::Text(text) => text.clone(),
                        Node::Number(number) => number.to_string().into(),
                        _ => continue,
                    };
                    // One long key may be that of many entries.
                    self.budget.take_bytes(name.len() + key.len())?;
                    let name = if name.is_empty() { key.to_string() } else { format!("{name}/{key}") };
                    self.gather(&name, *value, depth + 1, out)?;
                }
            }
            Node::List(items) => {
                self.budget.take_values(items.len())?;
                if let Some(words) = self.words(items)? {
                    out.words.insert(name.to_owned(), words);
                } else if !items.is_empty() && items.iter().all(|item| matches!(nodes[*item], Node::Dict(_)))
                {
                    self.rows(name, items, out)?;
                } else if let Some(array) = self.array(id)? {
                    out.numbers.insert(name.to_owned(), array);
                } else {
                    // Such as [configuration, rows].
                    for (i, item) in items.iter().enumerate().take(16) {
                        if matches!(nodes[*item], Node::Dict(_) | Node::List(_)) {
                            self.gather(&format!("{name}/{i}"), *item, depth + 1, out)?;
                        }
                    }
                }
            }
            Node::Array(raw) if raw.dtype.is_text() => {
                self.take_words(
                    raw.bytes.len().checked_div(raw.dtype.bytes()).unwrap_or(0),
                    raw.bytes.len(),
                )?;
                let words: Option<Vec<String>> = match raw.dtype.bytes() {
                    0 => None,
                    size => raw.bytes.chunks_exact(size).map(|word| raw.dtype.text(word)).collect(),
                };
                if let Some(words) = words {
                    out.words.insert(name.to_owned(), words);
                }
            }
            Node::Array(_) | Node::Tensor(_) | Node::Number(_) => {
                if let Some(array) = self.array(id)? {
                    out.numbers.insert(name.to_owned(), array);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The words in a list that holds nothing else.
    fn words(&mut self, items: &[Id]) -> Result<Option<Vec<String>>, Problem> {
        let word = |id: &Id| match &self.nodes[*id] {
            Node::Text(text) => Some(text),
            _ => None,
        };
        let Some(words) = items.iter().map(word).collect::<Option<Vec<_>>>() else { return Ok(None) };
        if words.is_empty() {
            return Ok(None);
        }
        // One long text may be in the list many times.
        self.take_words(words.len(), words.iter().map(|word| word.len()).sum())?;
        Ok(Some(words.into_iter().map(|word| word.to_string()).collect()))
    }

    /// Takes the memory of `count` words of `bytes` together.
    fn take_words(&mut self, count: usize, bytes: usize) -> Result<(), Problem> {
        Ok(self.budget.take_bytes(bytes.saturating_add(count.saturating_mul(size_of::<String>())))?)
    }

    /// Stacks dictionaries, one a sample. What is not numbers of one shape in all rows is left out.
    fn rows(&mut self, name: &str, items: &[Id], out: &mut Arrays) -> Result<(), Problem> {
        let nodes = self.nodes;
        let mut columns: IndexMap<Rc<str>, (Vec<usize>, Vec<f64>, usize)> = IndexMap::new();
        for (row, item) in items.iter().enumerate() {
            let Node::Dict(entries) = &nodes[*item] else { return Ok(()) };
            self.budget.take_values(entries.len())?;
            for (key, value) in entries {
                let Node::Text(key) = &nodes[*key] else { continue };
                // A column that the first row lacks cannot be whole.
                if row > 0 && !columns.contains_key(key) {
                    continue;
                }
                let Some(array) = self.array(*value)? else { continue };
                let (shape, data, rows) =
                    columns.entry(key.clone()).or_insert_with(|| (array.shape.clone(), Vec::new(), 0));
                // A row without this column, or with another shape, ends it: its rows no longer keep up.
                if *shape == array.shape && *rows == row {
                    data.extend_from_slice(&array.data);
                    *rows += 1;
                }
            }
        }
        // Only what every row has in one shape is an array.
        for (key, (shape, data, rows)) in columns {
            if rows == items.len() {
                let name = if name.is_empty() { key.to_string() } else { format!("{name}/{key}") };
                let shape = [&[rows], shape.as_slice()].concat();
                out.numbers.insert(name, Array { shape, data });
            }
        }
        Ok(())
    }

    /// The array that an object is, if it is one: numbers, lists of numbers or of arrays, arrays, tensors.
    fn array(&mut self, id: Id) -> Result<Option<Array>, Problem> {
        let nodes = self.nodes;
        Ok(match &nodes[id] {
            Node::Number(number) => {
                self.budget.take_values(1)?;
                Some(Array { shape: Vec::new(), data: vec![*number] })
            }
            Node::Array(raw) => self.raw(raw)?,
            Node::Tensor(tensor) => Some(self.tensor(tensor)?),
            Node::List(items) => {
                self.budget.take_values(items.len())?;
                let mut shape: Option<Vec<usize>> = None;
                let mut data = Vec::new();
                for item in items {
                    let inner = match &nodes[*item] {
                        Node::Number(number) => {
                            self.budget.take_values(1)?;
                            Array { shape: Vec::new(), data: vec![*number] }
                        }
                        Node::Array(raw) => match self.raw(raw)? {
                            Some(array) => array,
                            None => return Ok(None),
                        },
                        Node::Tensor(tensor) => self.tensor(tensor)?,
                        // Lists go two deep here.
                        Node::List(numbers) => {
                            self.budget.take_values(numbers.len())?;
                            let number = |id: &Id| match &nodes[*id] {
                                Node::Number(number) => Some(*number),
                                _ => None,
                            };
                            match numbers.iter().map(number).collect::<Option<Vec<f64>>>() {
                                Some(data) => Array { shape: vec![data.len()], data },
                                None => return Ok(None),
                            }
                        }
                        _ => return Ok(None),
                    };
                    // Lists of unequal parts are no array.
                    if shape.get_or_insert_with(|| inner.shape.clone()) != &inner.shape {
                        return Ok(None);
                    }
                    data.extend(inner.data);
                }
                let Some(inner) = shape else { return Ok(None) };
                Some(Array { shape: [&[items.len()], inner.as_slice()].concat(), data })
            }
            _ => None,
        })
    }

    fn raw(&mut self, raw: &RawArray) -> Result<Option<Array>, Problem> {
        let Some(elements) = count(&raw.shape).filter(|_| !raw.dtype.is_text()) else { return Ok(None) };
        self.budget.take_values(elements)?;
        let data = numbers(&raw.bytes, raw.dtype, &raw.shape, elements, raw.fortran);
        Ok(data.map(|data| Array { shape: raw.shape.clone(), data }))
    }

    fn tensor(&mut self, tensor: &Tensor) -> Result<Array, Problem> {
        let outside = || PickleError::BeyondStorage;
        let elements = count(&tensor.shape).ok_or_else(outside)?;
        self.budget.take_values(elements)?;
        let bytes = (self.storages)(&tensor.key, self.budget)?;
        let size = tensor.dtype.bytes();
        let mut data = Vec::with_capacity(elements);
        let mut place = vec![0usize; tensor.shape.len()];
        // Strides may be 0 or overlap, so each number is looked up by its own place.
        for _ in 0..elements {
            let at = place
                .iter()
                .zip(&tensor.stride)
                .try_fold(tensor.offset, |at, (i, stride)| at.checked_add(i.checked_mul(*stride)?));
            let start = at.and_then(|at| at.checked_mul(size)).ok_or_else(outside)?;
            let number = bytes.get(start..).and_then(|bytes| tensor.dtype.number(bytes.get(..size)?));
            data.push(number.ok_or_else(outside)?);
            for axis in (0..tensor.shape.len()).rev() {
                place[axis] += 1;
                if place[axis] < tensor.shape[axis] {
                    break;
                }
                place[axis] = 0;
            }
        }
        Ok(Array { shape: tensor.shape.clone(), data })
    }
}
