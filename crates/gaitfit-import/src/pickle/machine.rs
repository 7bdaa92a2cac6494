//! The stack machine of pickles, protocols 0 to 5 (Python's `pickletools` documents its instructions).

use super::PickleError;
use super::construct;
use crate::budget::Budget;
use crate::problem::Problem;
use std::collections::HashMap;
use std::rc::Rc;

/// Most objects of a pickle. Each takes some tens of bytes.
pub(super) const MAX_NODES: usize = 20_000_000;

/// Number of an object.
pub(crate) type Id = usize;

/// An object.
#[derive(Clone, Debug)]
pub(crate) enum Node {
    None,
    Number(f64),
    Text(Rc<str>),
    Bytes(Rc<[u8]>),
    /// Lists, tuples and sets.
    List(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    /// The name of a class or function, not the thing itself.
    Global(Rc<str>),
    /// A NumPy array; its content comes after it is made.
    Array(Rc<construct::RawArray>),
    /// A NumPy type of numbers.
    DType(crate::dtype::DType),
    /// Numbers in another file of the archive: key and type.
    Storage(Rc<str>, crate::dtype::DType),
    /// A PyTorch tensor.
    Tensor(Rc<construct::Tensor>),
}

/// A pickle as data.
#[derive(Debug)]
pub(crate) struct Pickle {
    /// All objects.
    pub nodes: Vec<Node>,
    /// The one that was saved.
    pub root: Id,
}

struct Machine<'a> {
    rest: &'a [u8],
    nodes: Vec<Node>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: HashMap<u64, Id>,
}

/// Reads a pickle. Bytes after its end are not looked at.
///
/// Errors: what is no pickle, is cut short, is too large, or calls what is not data.
pub(crate) fn read(bytes: &[u8], budget: &mut Budget) -> Result<Pickle, Problem> {
    let mut machine = Machine {
        rest: bytes,
        nodes: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
    };
    loop {
        if let Some(root) = machine.step(budget)? {
            return Ok(Pickle { nodes: machine.nodes, root });
        }
    }
}

impl<'a> Machine<'a> {
    /// One instruction; gives the object that was saved at the last.
    fn step(&mut self, budget: &mut Budget) -> Result<Option<Id>, Problem> {
        let op = self.byte()?;
        match op {
            // PROTO, FRAME: nothing to do.
            0x80 => drop(self.take(1)?),
            0x95 => drop(self.take(8)?),
            b'.' => return Ok(Some(self.pop()?)),
            b'(' => self.marks.push(self.stack.len()),
            b'0' => {
                // POP drops a mark if nothing lies on it.
                if self.marks.last() == Some(&self.stack.len()) {
                    self.marks.pop();
                } else {
                    self.pop()?;
                }
            }
            b'1' => drop(self.pop_mark()?),
            b'2' => {
                let top = self.top()?;
                self.stack.push(top);
            }
            b'N' => self.push(Node::None)?,
            0x88 => self.push(Node::Number(1.0))?,
            0x89 => self.push(Node::Number(0.0))?,
            b'I' => {
                let line = self.line()?;
                let number = match line {
                    "01" => 1.0,
                    "00" => 0.0,
                    _ => parse(line)?,
                };
                self.push(Node::Number(number))?;
            }
            b'J' => {
                let number = i32::from_le_bytes(self.array()?);
                self.push(Node::Number(f64::from(number)))?;
            }
            b'K' => {
                let number = self.byte()?;
                self.push(Node::Number(f64::from(number)))?;
            }
            b'M' => {
                let number = u16::from_le_bytes(self.array()?);
                self.push(Node::Number(f64::from(number)))?;
            }
            b'L' => {
                let number = parse(self.line()?.trim_end_matches('L'))?;
                self.push(Node::Number(number))?;
            }
            0x8a => {
                let size = usize::from(self.byte()?);
                let number = long(self.take(size)?)?;
                self.push(Node::Number(number))?;
            }
            0x8b => {
                let size = self.size4()?;
                let number = long(self.take(size)?)?;
                self.push(Node::Number(number))?;
            }
            b'F' => {
                let number = parse(self.line()?)?;
                self.push(Node::Number(number))?;
            }
            b'G' => {
                let number = f64::from_be_bytes(self.array()?);
                self.push(Node::Number(number))?;
            }
            b'S' => {
                let line = self.line()?;
                let text = line.trim_matches(['\'', '"']);
                self.text(text.as_bytes(), budget)?;
            }
            b'V' => {
                let text = self.line()?;
                self.text(text.as_bytes(), budget)?;
            }
            b'T' | b'X' => {
                let size = self.size4()?;
                let text = self.take(size)?;
                self.text(text, budget)?;
            }
            b'U' | 0x8c => {
                let size = usize::from(self.byte()?);
                let text = self.take(size)?;
                self.text(text, budget)?;
            }
            0x8d => {
                let size = self.size8()?;
                let text = self.take(size)?;
                self.text(text, budget)?;
            }
            b'B' => {
                let size = self.size4()?;
                self.bytes(size, budget)?;
            }
            b'C' => {
                let size = usize::from(self.byte()?);
                self.bytes(size, budget)?;
            }
            0x8e | 0x96 => {
                let size = self.size8()?;
                self.bytes(size, budget)?;
            }
            b')' | b']' | 0x8f => self.push(Node::List(Vec::new()))?,
            b'}' => self.push(Node::Dict(Vec::new()))?,
            b'l' | b't' | 0x91 => {
                let items = self.pop_mark()?;
                self.push(Node::List(items))?;
            }
            0x85..=0x87 => {
                let count = usize::from(op - 0x84);
                let items = self.pop_many(count)?;
                self.push(Node::List(items))?;
            }
            b'd' => {
                let items = self.pop_mark()?;
                self.push(Node::Dict(pairs(&items)?))?;
            }
            b'a' => {
                let items = self.pop_many(1)?;
                self.append(items)?;
            }
            b'e' | 0x90 => {
                let items = self.pop_mark()?;
                self.append(items)?;
            }
            b's' => {
                let items = self.pop_many(2)?;
                self.set_items(&items)?;
            }
            b'u' => {
                let items = self.pop_mark()?;
                self.set_items(&items)?;
            }
            b'p' => {
                let key = self.line()?.parse().map_err(|_| PickleError::MemoNumber)?;
                self.put(key)?;
            }
            b'q' => {
                let key = self.byte()?;
                self.put(u64::from(key))?;
            }
            b'r' => {
                let key = self.size4()?;
                self.put(key as u64)?;
            }
            0x94 => self.put(self.memo.len() as u64)?,
            b'g' => {
                let key = self.line()?.parse().map_err(|_| PickleError::MemoNumber)?;
                self.get(key)?;
            }
            b'h' => {
                let key = self.byte()?;
                self.get(u64::from(key))?;
            }
            b'j' => {
                let key = self.size4()?;
                self.get(key as u64)?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.global(module, name, budget)?;
            }
            0x93 => {
                let names = self.pop_many(2)?;
                let [Node::Text(module), Node::Text(name)] = [&self.nodes[names[0]], &self.nodes[names[1]]]
                else {
                    return Err(PickleError::ClassName.into());
                };
                let (module, name) = (module.clone(), name.clone());
                self.global(&module, &name, budget)?;
            }
            b'Q' => {
                let id = self.pop()?;
                let storage = construct::storage(&self.nodes, id)?;
                self.push(storage)?;
            }
            b'R' | 0x81 => {
                let parts = self.pop_many(2)?;
                let made = construct::call(&self.nodes, parts[0], parts[1], budget)?;
                self.push(made)?;
            }
            b'b' => {
                let state = self.pop()?;
                let object = self.top()?;
                if let Some(built) = construct::build(&self.nodes, object, state)? {
                    self.nodes[object] = built;
                }
            }
            // INST, OBJ, NEWOBJ_EX, EXT1-4, PERSID, buffers of other files.
            _ => {
                return Err(PickleError::Instruction(op).into());
            }
        }
        Ok(None)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], PickleError> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(PickleError::CutShort)?;
        self.rest = rest;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, PickleError> {
        Ok(self.take(1)?[0])
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], PickleError> {
        self.take(N)?.try_into().map_err(|_| PickleError::CutShort)
    }

    fn size4(&mut self) -> Result<usize, PickleError> {
        Ok(u32::from_le_bytes(self.array()?) as usize)
    }

    fn size8(&mut self) -> Result<usize, PickleError> {
        usize::try_from(u64::from_le_bytes(self.array()?)).map_err(|_| PickleError::CutShort)
    }

    fn line(&mut self) -> Result<&'a str, PickleError> {
        let end = self.rest.iter().position(|byte| *byte == b'\n').ok_or(PickleError::CutShort)?;
        let line = &self.rest[..end];
        self.rest = &self.rest[end + 1..];
        std::str::from_utf8(line).map_err(|_| PickleError::NotText)
    }

    fn push(&mut self, node: Node) -> Result<(), PickleError> {
        if self.nodes.len() >= MAX_NODES {
            return Err(PickleError::TooManyObjects);
        }
        self.nodes.push(node);
        self.stack.push(self.nodes.len() - 1);
        Ok(())
    }

    fn global(&mut self, module: &str, name: &str, budget: &mut Budget) -> Result<(), Problem> {
        // Texts that are in the pickle once may name many classes.
        budget.take_bytes(module.len() + name.len() + 1)?;
        Ok(self.push(Node::Global(format!("{module}.{name}").into()))?)
    }

    fn text(&mut self, bytes: &[u8], budget: &mut Budget) -> Result<(), Problem> {
        budget.take_bytes(bytes.len())?;
        Ok(self.push(Node::Text(String::from_utf8_lossy(bytes).into()))?)
    }

    fn bytes(&mut self, size: usize, budget: &mut Budget) -> Result<(), Problem> {
        let bytes = self.take(size)?;
        budget.take_bytes(bytes.len())?;
        Ok(self.push(Node::Bytes(bytes.into()))?)
    }

    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn pop(&mut self) -> Result<Id, PickleError> {
        if self.stack.len() <= self.floor() {
            return Err(PickleError::EmptyStack);
        }
        self.stack.pop().ok_or(PickleError::EmptyStack)
    }

    fn top(&self) -> Result<Id, PickleError> {
        self.stack.last().copied().ok_or(PickleError::EmptyStack)
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Id>, PickleError> {
        let at = self.stack.len().checked_sub(count).filter(|at| *at >= self.floor());
        Ok(self.stack.split_off(at.ok_or(PickleError::ShortStack)?))
    }

    fn pop_mark(&mut self) -> Result<Vec<Id>, PickleError> {
        let mark = self.marks.pop().ok_or(PickleError::NoMark)?;
        // A mark is never above the stack: nothing below it is popped.
        Ok(self.stack.split_off(mark.min(self.stack.len())))
    }

    fn append(&mut self, items: Vec<Id>) -> Result<(), PickleError> {
        let list = self.top()?;
        match &mut self.nodes[list] {
            Node::List(list) => list.extend(items),
            _ => return Err(PickleError::NotAList),
        }
        Ok(())
    }

    fn set_items(&mut self, items: &[Id]) -> Result<(), PickleError> {
        let dict = self.top()?;
        let new = pairs(items)?;
        match &mut self.nodes[dict] {
            Node::Dict(entries) => entries.extend(new),
            _ => return Err(PickleError::NotADictionary),
        }
        Ok(())
    }

    fn put(&mut self, key: u64) -> Result<(), PickleError> {
        let top = self.top()?;
        self.memo.insert(key, top);
        Ok(())
    }

    fn get(&mut self, key: u64) -> Result<(), PickleError> {
        let id = *self.memo.get(&key).ok_or(PickleError::NotRemembered)?;
        self.stack.push(id);
        // The stack alone could grow without new objects.
        if self.stack.len() > MAX_NODES {
            return Err(PickleError::TooManyObjects);
        }
        Ok(())
    }
}

fn pairs(items: &[Id]) -> Result<Vec<(Id, Id)>, PickleError> {
    if !items.len().is_multiple_of(2) {
        return Err(PickleError::KeyWithoutValue);
    }
    Ok(items.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect())
}

fn parse(text: &str) -> Result<f64, PickleError> {
    text.trim().parse().map_err(|_| PickleError::NotANumber(text.to_owned()))
}

/// An integer of any length, little-endian two's complement.
fn long(bytes: &[u8]) -> Result<f64, PickleError> {
    if bytes.len() > 1024 {
        return Err(PickleError::LongInteger);
    }
    let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
    let size = bytes.iter().rev().fold(0.0, |sum, byte| sum * 256.0 + f64::from(*byte));
    Ok(if negative { size - 256f64.powi(bytes.len() as i32) } else { size })
}
