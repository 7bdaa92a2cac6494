//! From an expression's pieces to its tree.
//!
//! From loose to tight: `or`; `and`; `not`; comparisons; `+ -`; `* /`; a sign before; `^`.

use super::error::{ExpressionError, Problem, elements_like, nearest};
use super::operator::{FoldKind, Function, One, Side, Two};
use super::quantity::{Elements, Names, Quantity, covered};
use super::token::{Token, tokens, wrong};
use super::{Fold, MAX_FOLDS, Node};

/// Max brackets and signs inside each other: the parser calls itself for each, and its stack is limited.
const MAX_DEPTH: usize = 32;
/// Max number of operators, functions, numbers and quantities.
const MAX_NODES: usize = 256;
/// Max number of elements of a row whose pairs are taken: 496 pairs.
const MAX_PAIRED: usize = 32;

/// A part, and how many numbers it has.
struct Part {
    node: Node,
    width: usize,
}

type Read<T> = Result<T, ExpressionError>;

/// The folds of an expression and what is made of them.
pub(super) fn parse(text: &str, names: &Names<'_>) -> Read<(Vec<Fold>, Node)> {
    let tokens = tokens(text)?;
    let mut parser = Parser { text, tokens, next: 0, depth: 0, nodes: 0, names, folds: Vec::new() };
    let whole = parser.either()?;
    if *parser.token() != Token::End {
        return parser.expected("an operator or the end");
    }
    // A reward is one number. A row is left over where a sum or mean was forgotten.
    if whole.width != 1 {
        return wrong(text, 0, Problem::Row(whole.width));
    }
    Ok((parser.folds, whole.node))
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<(usize, Token)>,
    /// Number of the token that is read next; the last one is the end and is never passed.
    next: usize,
    depth: usize,
    nodes: usize,
    names: &'a Names<'a>,
    folds: Vec<Fold>,
}

impl Parser<'_> {
    fn token(&self) -> &Token {
        self.tokens.get(self.next).map_or(&Token::End, |(_, token)| token)
    }

    /// Byte at which the next token begins.
    fn at(&self) -> usize {
        self.tokens.get(self.next).map_or(self.text.len(), |(at, _)| *at)
    }

    fn wrong<T>(&self, at: usize, problem: Problem) -> Read<T> {
        wrong(self.text, at, problem)
    }

    fn expected<T>(&self, wanted: &str) -> Read<T> {
        let (found, wanted) = (self.token().shown(), wanted.to_owned());
        self.wrong(self.at(), Problem::Expected { found, wanted })
    }

    /// Takes a sign, if it is next.
    fn take(&mut self, sign: &str) -> bool {
        let matches = matches!(self.token(), Token::Sign(next) if *next == sign);
        self.next += usize::from(matches);
        matches
    }

    /// Takes a word, if it is next.
    fn take_word(&mut self, word: &str) -> bool {
        let matches = matches!(self.token(), Token::Word(next) if next == word);
        self.next += usize::from(matches);
        matches
    }

    fn expect(&mut self, sign: &str) -> Read<()> {
        if self.take(sign) { Ok(()) } else { self.expected(&format!("`{sign}`")) }
    }

    fn deeper<T>(&mut self, inner: impl FnOnce(&mut Self) -> Read<T>) -> Read<T> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            let what = format!("more than {MAX_DEPTH} brackets and signs inside each other");
            return self.wrong(self.at(), Problem::Size { what });
        }
        // An error ends the reading, so the depth need not be taken back then.
        let read = inner(self)?;
        self.depth -= 1;
        Ok(read)
    }

    /// Counts a node that begins or is joined at `at`.
    fn part(&mut self, at: usize, node: Node, width: usize) -> Read<Part> {
        self.nodes += 1;
        if self.nodes > MAX_NODES {
            let what = format!("more than {MAX_NODES} operators, numbers and quantities");
            return self.wrong(at, Problem::Size { what });
        }
        Ok(Part { node, width })
    }

    /// The length of rows that are taken together.
    fn common(&self, at: usize, widths: &[usize]) -> Read<usize> {
        let width = widths.iter().copied().max().unwrap_or(1);
        // One foot has no pairs.
        if widths.contains(&0) && width <= 1 {
            return Ok(0);
        }
        match widths.iter().find(|&&other| other != 1 && other != width) {
            Some(&other) => self.wrong(at, Problem::Lengths(other, width)),
            None => Ok(width),
        }
    }

    fn two(&mut self, at: usize, operator: Two, a: Part, b: Part) -> Read<Part> {
        let width = self.common(at, &[a.width, b.width])?;
        self.part(at, Node::Two(operator, Box::new([a.node, b.node])), width)
    }

    fn one(&mut self, at: usize, operator: One, of: Part) -> Read<Part> {
        self.part(at, Node::One(operator, Box::new(of.node)), of.width)
    }

    fn fold(&mut self, at: usize, kind: FoldKind, row: Part) -> Read<Part> {
        if self.folds.len() == MAX_FOLDS {
            let what = format!("more than {MAX_FOLDS} sums, means, norms and extremes");
            return self.wrong(at, Problem::Size { what });
        }
        // The row was read before, so the folds in it have smaller numbers.
        self.folds.push(Fold { kind, width: row.width, row: row.node });
        self.part(at, Node::Fold(self.folds.len() - 1), 1)
    }

    /// One element of each pair of a row.
    fn paired(&mut self, at: usize, side: Side, row: Part) -> Read<Part> {
        if row.width > MAX_PAIRED {
            let what = format!("pairs of a row of {} numbers, more than {MAX_PAIRED}", row.width);
            return self.wrong(at, Problem::Size { what });
        }
        let pairs = side.places(row.width);
        let width = pairs.len();
        self.part(at, row.node.picked(&pairs), width)
    }

    fn either(&mut self) -> Read<Part> {
        let mut left = self.both()?;
        loop {
            let at = self.at();
            if !self.take_word("or") {
                return Ok(left);
            }
            let right = self.both()?;
            left = self.two(at, Two::Or, left, right)?;
        }
    }

    fn both(&mut self) -> Read<Part> {
        let mut left = self.negated()?;
        loop {
            let at = self.at();
            if !self.take_word("and") {
                return Ok(left);
            }
            let right = self.negated()?;
            left = self.two(at, Two::And, left, right)?;
        }
    }

    fn negated(&mut self) -> Read<Part> {
        let at = self.at();
        if !self.take_word("not") {
            return self.compared();
        }
        let operand = self.deeper(Self::negated)?;
        self.one(at, One::Not, operand)
    }

    fn comparison(&mut self) -> Option<Two> {
        let comparison = Two::COMPARISONS.iter().find(|(sign, _)| *self.token() == Token::Sign(sign));
        comparison.map(|(_, operator)| *operator)
    }

    fn compared(&mut self) -> Read<Part> {
        let left = self.sum()?;
        let at = self.at();
        let Some(operator) = self.comparison() else { return Ok(left) };
        self.next += 1;
        let right = self.sum()?;
        // `a < b < c` would compare c with 0 or 1, which nobody means.
        if self.comparison().is_some() {
            return self.wrong(self.at(), Problem::Chained);
        }
        self.two(at, operator, left, right)
    }

    fn sum(&mut self) -> Read<Part> {
        let mut left = self.product()?;
        loop {
            let at = self.at();
            let operator = match self.token() {
                Token::Sign("+") => Two::Add,
                Token::Sign("-") => Two::Subtract,
                _ => return Ok(left),
            };
            self.next += 1;
            let right = self.product()?;
            left = self.two(at, operator, left, right)?;
        }
    }

    fn product(&mut self) -> Read<Part> {
        let mut left = self.signed()?;
        loop {
            let at = self.at();
            let operator = match self.token() {
                Token::Sign("*") => Two::Multiply,
                Token::Sign("/") => Two::Divide,
                _ => return Ok(left),
            };
            self.next += 1;
            let right = self.signed()?;
            left = self.two(at, operator, left, right)?;
        }
    }

    fn signed(&mut self) -> Read<Part> {
        let at = self.at();
        if self.take("-") {
            // A sign is looser than `^`: −x^2 is −(x^2), as in mathematics.
            let operand = self.deeper(Self::signed)?;
            return self.one(at, One::Negate, operand);
        }
        let base = self.atom()?;
        let at = self.at();
        if !self.take("^") {
            return Ok(base);
        }
        // Right-associative: x^y^z is x^(y^z), and an exponent may have a sign.
        let exponent = self.deeper(Self::signed)?;
        if exponent.node == Node::Number(2.0) {
            // A product is exact where a power is not.
            return self.one(at, One::Square, base);
        }
        self.two(at, Two::Power, base, exponent)
    }

    fn atom(&mut self) -> Read<Part> {
        let at = self.at();
        if self.take("(") {
            let inner = self.deeper(Self::either)?;
            self.expect(")")?;
            return Ok(inner);
        }
        match self.token().clone() {
            Token::Number(number) => {
                self.next += 1;
                self.part(at, Node::Number(number), 1)
            }
            Token::Word(word) if !matches!(word.as_str(), "and" | "or" | "not") => {
                self.next += 1;
                // A name that is both would be the quantity.
                match Quantity::ALL.iter().find(|quantity| quantity.name() == word) {
                    Some(quantity) => self.quantity(at, *quantity),
                    None => self.function(at, &word),
                }
            }
            _ => self.expected("a number, a quantity, a function or a bracket"),
        }
    }

    /// A quantity, after its name: all of it, or the elements that patterns in brackets pick.
    fn quantity(&mut self, at: usize, quantity: Quantity) -> Read<Part> {
        let names = quantity.elements().names(self.names);
        let mut places = quantity.places(self.names);
        let bracket = self.at();
        if self.take("[") {
            if quantity.elements() == Elements::None {
                return self.wrong(bracket, Problem::NoRow(quantity.name()));
            }
            let mut picked = vec![false; names.len()];
            // Patterns only mark elements, so the order of patterns does not matter and no element counts
            // twice.
            loop {
                let at = self.at();
                let Token::Text(pattern) = self.token().clone() else {
                    return self.expected("a name or pattern in quotes");
                };
                self.next += 1;
                match covered(&pattern, &names) {
                    Ok(places) if places.is_empty() => {
                        let (quantity, names) = (quantity.name(), elements_like(&pattern, &names));
                        return self.wrong(at, Problem::NoElement { pattern, quantity, names });
                    }
                    Ok(places) => places.into_iter().for_each(|place| picked[place] = true),
                    Err(error) => return self.wrong(at, Problem::Pattern(error.to_string())),
                }
                if !self.take(",") {
                    break;
                }
            }
            self.expect("]")?;
            places = (0..names.len()).filter(|&place| picked[place]).collect();
        } else if places.is_empty() {
            // A robot may have no such elements at all, for example no angles but those of wheels.
            let problem = Problem::NoElement {
                pattern: "*".to_owned(),
                quantity: quantity.name(),
                names: vec!["none".to_owned()],
            };
            return self.wrong(at, problem);
        }
        let width = places.len();
        self.part(at, Node::Quantity(quantity, places), width)
    }

    /// A function, after its name.
    fn function(&mut self, at: usize, word: &str) -> Read<Part> {
        let Some((_, function)) = Function::all().find(|(name, _)| *name == word) else {
            let (name, nearest) = (word.to_owned(), nearest(word));
            return self.wrong(at, Problem::Unknown { name, nearest });
        };
        self.expect("(")?;
        let mut arguments = vec![self.deeper(Self::either)?];
        while self.take(",") {
            let argument = self.deeper(Self::either)?;
            arguments.push(argument);
        }
        self.expect(")")?;
        // `min` and `max` fold a row if they have one argument, and compare two; the count decides.
        let found = arguments.len();
        let mut rest = arguments.into_iter();
        // The fourth argument is asked for only to refuse it.
        match (function, rest.next(), rest.next(), rest.next(), rest.next()) {
            (Function::One(one), Some(of), None, ..) => self.one(at, one, of),
            (Function::Fold(kind), Some(row), None, ..) => self.fold(at, kind, row),
            (Function::Fold(FoldKind::Min), Some(a), Some(b), None, _) => self.two(at, Two::Min, a, b),
            (Function::Fold(FoldKind::Max), Some(a), Some(b), None, _) => self.two(at, Two::Max, a, b),
            (Function::Clamp, Some(x), Some(low), Some(high), None) => {
                // Bounds the wrong way round would give a constant without a word.
                if let (Some(min), Some(max)) = (low.node.constant(), high.node.constant())
                    && min > max
                {
                    return self.wrong(at, Problem::Clamp(min.to_string(), max.to_string()));
                }
                let above = self.two(at, Two::Max, x, low)?;
                self.two(at, Two::Min, above, high)
            }
            (Function::Select, Some(condition), Some(yes), Some(no), None) => {
                let width = self.common(at, &[condition.width, yes.width, no.width])?;
                self.part(at, Node::Select(Box::new([condition.node, yes.node, no.node])), width)
            }
            (Function::Pairs(side), Some(row), None, ..) => self.paired(at, side, row),
            _ => {
                let (function, wanted) = (word.to_owned(), function.takes());
                self.wrong(at, Problem::Arguments { function, wanted, found })
            }
        }
    }
}
