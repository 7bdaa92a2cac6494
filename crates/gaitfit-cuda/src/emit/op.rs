//! Operations of a program, before and after it is shared among threads.

use gaitfit_physics::trace;

/// The operation of a node on its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Op {
    /// A constant, as the bits of its `f64`.
    Constant(u64),
    /// A constant of each lane: row of [`Program::table`](super::Program::table).
    Table(u32),
    /// An input; after sharing, that of lane 0 and of its counterparts.
    Input(u32),
    /// In a loop (its region): what turns hand on (its place).
    Variable(u32, u32),
    /// After a loop: the same after the last turn.
    Result(u32, u32),
    /// a + b
    Add,
    /// a − b
    Sub,
    /// a · b
    Mul,
    /// −a
    Neg,
    /// a · b + c
    Fma,
    /// c − a · b
    Fnma,
    /// a · b − c
    Fms,
    /// a / b
    Div,
    /// √a
    Sqrt,
    /// 1 / a
    Recip,
    /// tanh a
    Tanh,
    /// Smaller of two.
    Min,
    /// Larger of two.
    Max,
    /// |a|
    Abs,
    /// Where a < b the third, else the fourth.
    Select,
    /// sin a
    Sin,
    /// cos a
    Cos,
    /// The whole number nearest to a.
    Round,
    /// The entry with the number a of a table (its place in [`Program::tables`](super::Program::tables)); 0 beyond its end.
    Gather(u32),
    /// An output of a function: the function's place in [`Program::functions`](super::Program::functions), then the output's
    /// number.
    Call(u32, u32),
    /// A guard: whether some lane does not satisfy a ≥ b.
    Unless,
    /// After a region with this guard (the first): the second, made in it, else the third.
    Merge,
    /// The operand's sum over the lanes of an environment.
    LaneSum,
    /// Its largest value over them.
    LaneMax,
    /// Its smallest value over them.
    LaneMin,
}

impl Op {
    /// Number of operands.
    pub fn arity(self) -> usize {
        match self {
            Op::Constant(_) | Op::Table(_) | Op::Input(_) | Op::Variable(..) | Op::Result(..) => 0,
            Op::Neg | Op::Sqrt | Op::Recip | Op::Tanh | Op::Abs | Op::Sin | Op::Cos => 1,
            Op::Round | Op::Gather(_) => 1,
            Op::LaneSum | Op::LaneMax | Op::LaneMin => 1,
            Op::Add | Op::Sub | Op::Mul | Op::Div | Op::Min | Op::Max | Op::Unless => 2,
            Op::Fma | Op::Fnma | Op::Fms | Op::Merge | Op::Call(..) => 3,
            Op::Select => 4,
        }
    }
}

/// An operation and its operands, by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Node {
    /// The operation.
    pub op: Op,
    /// Operands; those beyond its arity are zero.
    pub args: [u32; 4],
}

impl Node {
    /// A node.
    pub fn new(op: Op, operands: &[u32]) -> Self {
        let mut args = [0; 4];
        args[..operands.len()].copy_from_slice(operands);
        Self { op, args }
    }

    /// Its operands.
    pub fn operands(&self) -> &[u32] {
        &self.args[..self.op.arity()]
    }
}

impl From<trace::Node> for Node {
    fn from(node: trace::Node) -> Self {
        use trace::Node as From;
        let op = match node {
            From::Input(number) => Op::Input(number),
            From::Constant(bits) => Op::Constant(bits),
            From::Add(..) => Op::Add,
            From::Sub(..) => Op::Sub,
            From::Mul(..) => Op::Mul,
            From::Neg(..) => Op::Neg,
            From::Fma(..) => Op::Fma,
            From::Fnma(..) => Op::Fnma,
            From::Div(..) => Op::Div,
            From::Sqrt(..) => Op::Sqrt,
            From::Recip(..) => Op::Recip,
            From::Tanh(..) => Op::Tanh,
            From::Min(..) => Op::Min,
            From::Max(..) => Op::Max,
            From::Abs(..) => Op::Abs,
            From::Select(..) => Op::Select,
            From::Sin(..) => Op::Sin,
            From::Cos(..) => Op::Cos,
            From::Round(..) => Op::Round,
            From::Gather(table, _) => Op::Gather(table),
            From::Call(function, output, ..) => Op::Call(function, output),
            From::Unless(..) => Op::Unless,
            From::Merge(..) => Op::Merge,
            From::Variable(region, place) => Op::Variable(region, place),
            From::Result(region, place) => Op::Result(region, place),
        };
        let operands: Vec<u32> = node.operands().map(|id| id.0).collect();
        Self::new(op, &operands)
    }
}

/// A number in the text.
pub(super) fn literal(value: f64) -> String {
    // C has no literal for infinity: the largest finite number stands for it.
    let value = (value as f32).clamp(f32::MIN, f32::MAX);
    format!("{value:?}f")
}
