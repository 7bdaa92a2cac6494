//! A program as text.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::ops::Range;

use super::PeriodProgram;
use super::crossing::Crossing;
use super::function::{self, function_name};
use super::layout::{Class, Layout, Place};
use super::op::{Node, Op, literal};
use super::program::{Kind, Program};

/// Name of the kernel.
pub const KERNEL: &str = "control_period";

/// The words that a program's text is written in, as CUDA.
pub const WORDS: &str = include_str!("words.cuh");

/// Name of the array in the text that holds a table of the program; whoever loads the program fills it.
pub(super) fn table_name(number: usize) -> String {
    format!("table_{number}")
}

/// Text of a kernel of blocks of `block` threads; to compile it, put its [`head`] and [`WORDS`] before it.
pub fn body(program: &PeriodProgram, layout: &Layout) -> String {
    let mut writer = Writer::new(program, layout);
    writer.kernel(program);
    writer.text
}

/// The numbers that [`WORDS`] need.
pub fn head(layout: &Layout, block: usize) -> String {
    format!("#define LANES {}\n#define BLOCK {block}\n", layout.lanes)
}

/// Everything that the device's compiler needs.
pub fn cuda(program: &PeriodProgram, layout: &Layout, block: usize) -> String {
    head(layout, block) + WORDS + &body(program, layout)
}

/// What an operation computes, for operations that are one expression of their operands. `table`: the name of a table.
pub(super) fn computed(op: Op, a: &[String], table: impl Fn(usize) -> String) -> Option<String> {
    Some(match op {
        Op::Add => format!("{} + {}", a[0], a[1]),
        Op::Sub => format!("{} - {}", a[0], a[1]),
        Op::Mul => format!("{} * {}", a[0], a[1]),
        Op::Fma => format!("FMA({}, {}, {})", a[0], a[1], a[2]),
        Op::Fnma => format!("FMA(-{}, {}, {})", a[0], a[1], a[2]),
        Op::Fms => format!("FMA({}, {}, -{})", a[0], a[1], a[2]),
        Op::Div => format!("DIV({}, {})", a[0], a[1]),
        Op::Sqrt => format!("SQRT({})", a[0]),
        Op::Recip => format!("RECIP({})", a[0]),
        Op::Tanh => format!("TANH({})", a[0]),
        Op::Round => format!("ROUND({})", a[0]),
        Op::Gather(number) => format!("GATHER({}, {})", table(number as usize), a[0]),
        Op::Min => format!("MIN({}, {})", a[0], a[1]),
        Op::Max => format!("MAX({}, {})", a[0], a[1]),
        Op::Abs => format!("ABS({})", a[0]),
        Op::Select => format!("SELECT({}, {}, {}, {})", a[0], a[1], a[2], a[3]),
        Op::Unless => format!("UNLESS({}, {})", a[0], a[1]),
        Op::Merge => format!("({} ? {} : {})", a[0], a[1], a[2]),
        Op::LaneSum => format!("LANE_SUM({})", a[0]),
        Op::LaneMax => format!("LANE_MAX({})", a[0]),
        Op::LaneMin => format!("LANE_MIN({})", a[0]),
        _ => return None,
    })
}

pub(super) struct Writer<'a> {
    pub(super) program: &'a Program,
    /// Place of each input of the recording.
    pub(super) places: &'a [Place],
    pub(super) layout: &'a Layout,
    text: String,
    pub(super) depth: usize,
    pub(super) crossing: Crossing,
    /// Numbers that each open block has read, and whether the block begins afresh.
    pub(super) read: Vec<(bool, BTreeSet<u32>)>,
    /// Open regions.
    open: Vec<u32>,
    /// Nodes declared already, before the region they are made in.
    pub(super) declared: BTreeSet<u32>,
    /// In one of a loop's two texts: whether it is the one without guarded regions.
    pub(super) lean: Option<bool>,
}

impl<'a> Writer<'a> {
    pub(super) fn new(period: &'a PeriodProgram, layout: &'a Layout) -> Self {
        Self {
            program: &period.program,
            places: &layout.inputs,
            layout,
            text: String::new(),
            depth: 0,
            crossing: Crossing::new(&period.program),
            read: vec![(true, BTreeSet::new())],
            open: Vec::new(),
            declared: BTreeSet::new(),
            lean: None,
        }
    }

    pub(super) fn bare(&self, node: u32) -> (u32, bool) {
        self.program.bare(node)
    }

    /// Whether it is read from memory where it is used, not where it stands.
    pub(super) fn read_late(&self, node: u32) -> bool {
        match self.program.nodes[node as usize].op {
            Op::Input(number) => !self.written(self.places[number as usize].class),
            op => matches!(op, Op::Table(_)),
        }
    }

    fn has_statement(&self, node: u32) -> bool {
        let op = self.program.nodes[node as usize].op;
        !matches!(op, Op::Constant(_) | Op::Variable(..) | Op::Result(..) | Op::Neg) && !self.read_late(node)
    }

    pub(super) fn line(&mut self, text: &str) {
        let indent = 2 * self.depth;
        let _ = writeln!(self.text, "{:indent$}{text}", "");
    }

    /// Text of a node in an expression. Writes the reading of a number that is read late, unless it has been read.
    pub(super) fn operand(&mut self, node: u32) -> String {
        let (node, minus) = self.bare(node);
        if self.read_late(node) || self.room(node).is_some() {
            self.read(node);
        }
        let name = match self.program.nodes[node as usize].op {
            Op::Constant(bits) => format!("K({})", literal(f64::from_bits(bits))),
            Op::Variable(region, place) | Op::Result(region, place)
                if !self.crossing.held.contains_key(&(region, place)) =>
            {
                format!("v{region}_{place}")
            }
            _ => format!("t{node}"),
        };
        if minus { format!("(-{name})") } else { name }
    }

    /// Its place in scratch memory, if it must be read from there.
    fn room(&self, node: u32) -> Option<usize> {
        match self.program.nodes[node as usize].op {
            Op::Variable(region, place) | Op::Result(region, place) => {
                self.crossing.held.get(&(region, place)).copied()
            }
            _ => {
                let here = self.program.home[node as usize].is_some_and(|home| self.open.contains(&home));
                self.crossing.scratch.get(&node).copied().filter(|_| !here && self.has_statement(node))
            }
        }
    }

    pub(super) fn read(&mut self, node: u32) {
        // An outer block's reading is visible inside, except in a block that begins afresh.
        for (fresh, known) in self.read.iter().rev() {
            if known.contains(&node) {
                return;
            }
            if *fresh {
                break;
            }
        }
        if let Some((_, known)) = self.read.last_mut() {
            known.insert(node);
        }
        let from = match self.program.nodes[node as usize].op {
            Op::Input(number) => self.source(self.places[number as usize]),
            Op::Table(row) => format!("ROW({row})"),
            _ => match self.room(node) {
                Some(room) => format!("GET({room})"),
                None => return,
            },
        };
        self.line(&format!("const R t{node} = {from};"));
    }

    /// Whether the program writes numbers of a class.
    fn written(&self, class: Class) -> bool {
        self.layout.outputs.iter().any(|place| place.class == class)
    }

    fn source(&self, place: Place) -> String {
        let who = if place.lane.is_some() { "OWN" } else { "ALL" };
        let (class, slot) = (place.class.letter(), place.slot);
        match place.class {
            Class::Weights => format!("WEIGHT_{who}({slot})"),
            written if self.written(written) => format!("HELD_{who}({class}, {slot})"),
            _ => format!("GIVEN_{who}({class}, {slot})"),
        }
    }

    fn kernel(&mut self, period: &PeriodProgram) {
        let rows = self.program.table.len();
        if rows > 0 {
            let lanes = self.layout.lanes;
            let values: Vec<String> = self
                .program
                .table
                .iter()
                .flat_map(|row| row.iter().take(lanes))
                .map(|&x| literal(x))
                .collect();
            let _ = writeln!(self.text, "__device__ const float table_values[] = {{{}}};", values.join(", "));
        }
        for (number, table) in self.program.tables.iter().enumerate() {
            let _ = writeln!(self.text, "__device__ float {}[{}];", table_name(number), table.len().max(1));
        }
        for (number, function) in self.program.functions.iter().enumerate() {
            self.text.push_str(&function::text(number, function));
        }
        let _ = writeln!(self.text, "KERNEL({KERNEL}) {{");
        self.depth = 1;
        self.line("BEGIN");
        // Classes that the robot has no numbers of get no pointer.
        for (class, base) in [
            (Class::State, "state"),
            (Class::Params, "params"),
            (Class::Targets, "targets"),
            (Class::Memory, "memory"),
            (Class::Report, "report"),
            (Class::Disturbance, "disturbance"),
        ] {
            let kind = if self.written(class) { "float" } else { "const float" };
            let (slots, size) = (self.layout.slots(class).own, self.layout.size(class));
            if size > 0 {
                self.line(&format!("PLACE({kind}, {}, {base}, {slots}, {size})", class.letter()));
            }
        }
        let size = self.layout.size(Class::Weights);
        if size > 0 {
            self.line(&format!("PLACE_WEIGHTS({}, {size})", self.layout.slots(Class::Weights).own));
        }
        if rows > 0 {
            self.line(&format!("PLACE_TABLE({rows})"));
        }
        if self.crossing.rooms() > 0 {
            self.line(&format!("SCRATCH({})", self.crossing.rooms()));
        }
        self.block(None, 0..self.program.nodes.len() as u32);
        let mut kept = BTreeSet::new();
        for (&place, &(_, output)) in self.layout.outputs.iter().zip(&period.outputs) {
            // Outputs of all lanes share a slot: one statement writes it in every thread.
            if kept.insert((place.class, place.lane.is_some(), place.slot)) {
                let value = self.operand(self.program.outputs[output as usize]);
                let who = if place.lane.is_some() { "OWN" } else { "ALL" };
                self.line(&format!("KEEP_{who}({}, {}, {value})", place.class.letter(), place.slot));
            }
        }
        self.text.push_str("}\n");
    }

    /// Nodes of a region, or of all.
    pub(super) fn block(&mut self, parent: Option<u32>, nodes: Range<u32>) {
        let mut at = nodes.start;
        let program = self.program;
        for (index, region) in program.regions.iter().enumerate() {
            if region.parent != parent {
                continue;
            }
            self.statements(at..region.nodes.start);
            at = region.nodes.end;
            match &region.kind {
                Kind::Guarded(guard) => self.guarded(index as u32, *guard, region.nodes.clone()),
                Kind::Loop { count, carried } => {
                    self.turns(index as u32, *count, carried, parent, region.nodes.clone());
                }
            }
        }
        self.statements(at..nodes.end);
    }

    fn guarded(&mut self, index: u32, guard: u32, nodes: Range<u32>) {
        if self.lean == Some(true) {
            return self.left_out(index);
        }
        // What is read behind the region is declared before it, so that it lives on.
        let early = self.crossing.early.range(nodes.clone()).copied();
        let early: Vec<u32> =
            early.filter(|&node| self.has_statement(node) && !self.declared.contains(&node)).collect();
        for &node in &early {
            let kind = if self.program.nodes[node as usize].op == Op::Unless { "bool" } else { "R" };
            self.line(&format!("{kind} t{node};"));
        }
        self.declared.extend(early);
        // Merges begin with the number before the region and are overwritten inside it: threads that skip it
        // keep the first.
        let merges = self.crossing.set_inside.get(&index).cloned().unwrap_or_default();
        for &merge in &merges {
            let before = self.operand(self.program.nodes[merge as usize].args[2]);
            let kind = if self.crossing.early.contains(&merge) { "" } else { "R " };
            self.line(&format!("{kind}t{merge} = {before};"));
        }
        // After the declarations: the operand may write lines of its own.
        let guard = self.operand(guard);
        self.line(&format!("if ({guard}) {{"));
        self.enter(index, false);
        self.block(Some(index), nodes);
        self.hold(index);
        for &merge in &merges {
            let inside = self.operand(self.program.nodes[merge as usize].args[1]);
            self.line(&format!("t{merge} = {inside};"));
        }
        self.close();
    }

    /// Numbers of this region that a loop hands on to guarded regions.
    fn hold(&mut self, index: u32) {
        let held: Vec<((u32, u32), usize)> =
            self.crossing.held.iter().map(|(&place, &room)| (place, room)).collect();
        for ((region, place), room) in held {
            let Kind::Loop { carried, .. } = &self.program.regions[region as usize].kind else { continue };
            let (first, next) = carried[place as usize];
            for node in [first, next] {
                if self.program.home[self.bare(node).0 as usize] == Some(index) {
                    let value = self.operand(node);
                    self.line(&format!("PUT({room}, {value})"));
                }
            }
        }
    }

    pub(super) fn enter(&mut self, region: u32, fresh: bool) {
        self.depth += 1;
        self.open.push(region);
        self.read.push((fresh, BTreeSet::new()));
    }

    pub(super) fn close(&mut self) {
        self.read.pop();
        self.open.pop();
        self.depth -= 1;
        self.line("}");
    }

    fn statements(&mut self, nodes: Range<u32>) {
        for index in nodes {
            self.statement(index);
            if let (Some(room), true) =
                (self.crossing.scratch.get(&index).copied(), self.has_statement(index))
            {
                self.line(&format!("PUT({room}, t{index})"));
            }
        }
    }

    fn statement(&mut self, index: u32) {
        let node = self.program.nodes[index as usize];
        if !self.has_statement(index) || self.crossing.merged.contains(&index) {
            return;
        }
        if node.op == Op::Merge && self.lean == Some(true) {
            let before = self.operand(node.args[2]);
            return self.line(&format!("const R t{index} = {before};"));
        }
        let a: Vec<String> = node.operands().iter().map(|&operand| self.operand(operand)).collect();
        // One call computes both, for the price of little more than one.
        if matches!(node.op, Op::Sin | Op::Cos) {
            return self.turn(index, node, &a[0]);
        }
        let value = match node.op {
            Op::Input(number) => self.source(self.places[number as usize]),
            Op::Call(function, output) => {
                format!("{}.n{output}", self.call(index, node, function, &a))
            }
            op => match computed(op, &a, table_name) {
                Some(value) => value,
                None => return,
            },
        };
        let kind = if node.op == Op::Unless { "const bool " } else { "const R " };
        let kind = if self.crossing.early.contains(&index) { "" } else { kind };
        self.line(&format!("{kind}t{index} = {value};"));
    }

    /// The result of a function: one call for outputs that stand in a row.
    fn call(&mut self, index: u32, node: Node, function: u32, arguments: &[String]) -> String {
        let is_output = |at: u32, number: u32| {
            self.program.nodes.get(at as usize) == Some(&Node { op: Op::Call(function, number), ..node })
                && self.program.home[at as usize] == self.program.home[index as usize]
        };
        let Op::Call(_, output) = node.op else { return String::new() };
        let first = index.checked_sub(output).filter(|first| (0..output).all(|k| is_output(first + k, k)));
        let call = format!("{}({})", function_name(function as usize), arguments.join(", "));
        let Some(first) = first else { return call };
        if output == 0 {
            self.line(&format!("const Four c{first} = {call};"));
        }
        format!("c{first}")
    }

    /// Sine and cosine of one angle at once.
    fn turn(&mut self, index: u32, node: Node, angle: &str) {
        let other = if node.op == Op::Sin { Op::Cos } else { Op::Sin };
        let next = index + 1;
        let pair = |at: u32| {
            self.program.nodes.get(at as usize) == Some(&Node { op: other, ..node })
                && self.program.home[at as usize] == self.program.home[index as usize]
        };
        if index > 0 && pair(index - 1) {
            // Written with the one before it.
            return;
        }
        let paired = pair(next);
        let unused = format!("u{index}");
        let partner = if paired { format!("t{next}") } else { unused };
        let first = format!("t{index}");
        for (name, node) in [(&first, index), (&partner, next)] {
            if !(self.crossing.early.contains(&node) && name.starts_with('t')) {
                self.line(&format!("R {name};"));
            }
        }
        let (sine, cosine) = if node.op == Op::Sin { (first, partner) } else { (partner, first) };
        self.line(&format!("SINCOS({angle}, {sine}, {cosine});"));
    }
}
