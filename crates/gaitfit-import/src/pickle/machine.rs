//! The stack machine of pickles, protocols 0 to 5 (Python's `pickletools` documents its instructions).

use super::PickleError;
use super::construct;
use super::node::{Id, MAX_NODES, Node, Pickle};
use crate::budget::Budget;
use crate::problem::Problem;
use std::collections::HashMap;

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
        // Each group takes the instructions that it knows; the last one refuses what is left.
        if let Some(number) = self.number(op)? {
            self.push(Node::Number(number))?;
        } else if let Some(text) = self.text_operand(op)? {
            self.text(text, budget)?;
        } else if let Some(size) = self.size_of_bytes(op)? {
            self.bytes(size, budget)?;
        } else if let Some(made) = self.collection(op)? {
            self.push(made)?;
        } else if let Some(key) = self.stored_key(op)? {
            self.put(key)?;
        } else if let Some(key) = self.remembered_key(op)? {
            self.get(key)?;
        } else if op == b'.' {
            return Ok(Some(self.pop()?));
        } else if !self.arrange(op)? {
            self.object(op, budget)?;
        }
        Ok(None)
    }

    /// The number that an instruction pushes.
    fn number(&mut self, op: u8) -> Result<Option<f64>, PickleError> {
        Ok(Some(match op {
            // NEWTRUE, NEWFALSE.
            0x88 => 1.0,
            0x89 => 0.0,
            // INT; protocol 0 writes true and false as 01 and 00.
            b'I' => match self.line()? {
                "01" => 1.0,
                "00" => 0.0,
                line => parse(line)?,
            },
            // BININT, BININT1, BININT2.
            b'J' => f64::from(i32::from_le_bytes(self.array()?)),
            b'K' => f64::from(self.byte()?),
            b'M' => f64::from(u16::from_le_bytes(self.array()?)),
            // LONG, LONG1, LONG4.
            b'L' => parse(self.line()?.trim_end_matches('L'))?,
            0x8a => {
                let size = usize::from(self.byte()?);
                long(self.take(size)?)?
            }
            0x8b => {
                let size = self.size4()?;
                long(self.take(size)?)?
            }
            // FLOAT, BINFLOAT.
            b'F' => parse(self.line()?)?,
            b'G' => f64::from_be_bytes(self.array()?),
            _ => return Ok(None),
        }))
    }

    /// The text that an instruction pushes.
    fn text_operand(&mut self, op: u8) -> Result<Option<&'a [u8]>, PickleError> {
        let size = match op {
            // STRING, UNICODE.
            b'S' => return Ok(Some(self.line()?.trim_matches(['\'', '"']).as_bytes())),
            b'V' => return Ok(Some(self.line()?.as_bytes())),
            // BINSTRING, BINUNICODE; SHORT_BINSTRING, SHORT_BINUNICODE; BINUNICODE8.
            b'T' | b'X' => self.size4()?,
            b'U' | 0x8c => usize::from(self.byte()?),
            0x8d => self.size8()?,
            _ => return Ok(None),
        };
        self.take(size).map(Some)
    }

    /// The number of bytes that an instruction pushes.
    fn size_of_bytes(&mut self, op: u8) -> Result<Option<usize>, PickleError> {
        Ok(Some(match op {
            // BINBYTES, SHORT_BINBYTES; BINBYTES8, BYTEARRAY8.
            b'B' => self.size4()?,
            b'C' => usize::from(self.byte()?),
            0x8e | 0x96 => self.size8()?,
            _ => return Ok(None),
        }))
    }

    /// The list or dictionary that an instruction makes of what lies on the stack.
    fn collection(&mut self, op: u8) -> Result<Option<Node>, PickleError> {
        Ok(Some(match op {
            // EMPTY_TUPLE, EMPTY_LIST, EMPTY_SET; EMPTY_DICT.
            b')' | b']' | 0x8f => Node::List(Vec::new()),
            b'}' => Node::Dict(Vec::new()),
            // LIST, TUPLE, FROZENSET; TUPLE1 to TUPLE3; DICT.
            b'l' | b't' | 0x91 => Node::List(self.pop_mark()?),
            0x85..=0x87 => Node::List(self.pop_many(usize::from(op - 0x84))?),
            b'd' => Node::Dict(pairs(&self.pop_mark()?)?),
            _ => return Ok(None),
        }))
    }

    /// Returns the key under which an instruction keeps the top of the stack.
    fn stored_key(&mut self, op: u8) -> Result<Option<u64>, PickleError> {
        Ok(Some(match op {
            // PUT, BINPUT, LONG_BINPUT, MEMOIZE.
            b'p' => self.line()?.parse().map_err(|_| PickleError::MemoNumber)?,
            b'q' => u64::from(self.byte()?),
            b'r' => self.size4()? as u64,
            // MEMOIZE has no key: the number of objects that are kept so far is its key.
            0x94 => self.memo.len() as u64,
            _ => return Ok(None),
        }))
    }

    /// Returns the key under which an instruction finds what was kept.
    fn remembered_key(&mut self, op: u8) -> Result<Option<u64>, PickleError> {
        Ok(Some(match op {
            // GET, BINGET, LONG_BINGET.
            b'g' => self.line()?.parse().map_err(|_| PickleError::MemoNumber)?,
            b'h' => u64::from(self.byte()?),
            b'j' => self.size4()? as u64,
            _ => return Ok(None),
        }))
    }

    /// Instructions that order the stack and put items into what lies on it; `false` for others.
    fn arrange(&mut self, op: u8) -> Result<bool, PickleError> {
        match op {
            // PROTO, FRAME: nothing to do.
            0x80 => drop(self.take(1)?),
            0x95 => drop(self.take(8)?),
            // MARK.
            b'(' => {
                self.marks.push(self.stack.len());
                bounded(self.marks.len())?;
            }
            // POP drops a mark if nothing lies on it.
            b'0' if self.marks.last() == Some(&self.stack.len()) => drop(self.marks.pop()),
            b'0' => drop(self.pop()?),
            // POP_MARK, DUP.
            b'1' => drop(self.pop_mark()?),
            b'2' => {
                let top = self.top()?;
                self.push_again(top)?;
            }
            // APPEND; APPENDS, ADDITEMS; SETITEM; SETITEMS.
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
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Instructions that name classes and functions, or make objects of them.
    fn object(&mut self, op: u8, budget: &mut Budget) -> Result<(), Problem> {
        match op {
            // NONE, GLOBAL, STACK_GLOBAL, BINPERSID.
            b'N' => self.push(Node::None)?,
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
            // REDUCE, NEWOBJ, BUILD.
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
            _ => return Err(PickleError::Instruction(op).into()),
        }
        Ok(())
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
        // Objects below the last mark are out of reach until the mark is taken away.
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
        bounded(self.memo.len())
    }

    fn get(&mut self, key: u64) -> Result<(), PickleError> {
        let id = *self.memo.get(&key).ok_or(PickleError::NotRemembered)?;
        self.push_again(id)
    }

    /// Puts an object onto the stack that there is already.
    fn push_again(&mut self, id: Id) -> Result<(), PickleError> {
        self.stack.push(id);
        bounded(self.stack.len())
    }
}

/// Refuses more entries of stack, marks or memo than there may be objects: an instruction of one byte adds one without
/// a new object.
fn bounded(entries: usize) -> Result<(), PickleError> {
    if entries > MAX_NODES { Err(PickleError::TooManyObjects) } else { Ok(()) }
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
    // Far beyond the largest double; a power of 256 of more bytes is infinite anyway.
    if bytes.len() > 1024 {
        return Err(PickleError::LongInteger);
    }
    let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
    let size = bytes.iter().rev().fold(0.0, |sum, byte| sum * 256.0 + f64::from(*byte));
    Ok(if negative { size - 256f64.powi(bytes.len() as i32) } else { size })
}
