//! Functions in expressions. They work on many numbers at once, in loops that the compiler turns into vector
//! instructions.

/// Functions of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum One {
    /// −x.
    Negate,
    /// 1 if x is 0, else 0.
    Not,
    /// |x|.
    Abs,
    /// √x.
    Sqrt,
    /// x².
    Square,
    /// eˣ.
    Exp,
    /// ln x.
    Ln,
    /// sin x.
    Sin,
    /// cos x.
    Cos,
    /// tanh x.
    Tanh,
    /// The largest whole number that is not above x.
    Floor,
}

impl One {
    /// Operations that are written as functions, by name.
    pub const FUNCTIONS: &'static [(&'static str, Self)] = &[
        ("abs", Self::Abs),
        ("sqrt", Self::Sqrt),
        ("square", Self::Square),
        ("exp", Self::Exp),
        ("ln", Self::Ln),
        ("sin", Self::Sin),
        ("cos", Self::Cos),
        ("tanh", Self::Tanh),
        ("floor", Self::Floor),
    ];

    /// Writes its value of each number of `x`.
    pub(super) fn apply(self, x: &[f32], to: &mut [f32]) {
        match self {
            Self::Negate => each(x, to, |x| -x),
            Self::Not => each(x, to, |x| flag(x == 0.0)),
            Self::Abs => each(x, to, f32::abs),
            Self::Sqrt => each(x, to, f32::sqrt),
            Self::Square => each(x, to, |x| x * x),
            Self::Exp => each(x, to, f32::exp),
            Self::Ln => each(x, to, f32::ln),
            Self::Sin => each(x, to, f32::sin),
            Self::Cos => each(x, to, f32::cos),
            Self::Tanh => each(x, to, f32::tanh),
            Self::Floor => each(x, to, f32::floor),
        }
    }

    /// Its value of one number.
    pub(super) fn value(self, x: f32) -> f32 {
        // Through the loop of rows, so that a folded constant has the same bits as the same number in a row.
        let mut value = [0.0];
        self.apply(&[x], &mut value);
        value[0]
    }
}

/// Functions of two numbers. Comparisons and `and`, `or` give 1 or 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Two {
    /// a + b.
    Add,
    /// a − b.
    Subtract,
    /// a · b.
    Multiply,
    /// a / b.
    Divide,
    /// aᵇ.
    Power,
    /// The smaller of two; NaN if one of them is NaN.
    Min,
    /// The larger of two; NaN if one of them is NaN.
    Max,
    /// a < b.
    Less,
    /// a ≤ b.
    LessOrEqual,
    /// a > b.
    Greater,
    /// a ≥ b.
    GreaterOrEqual,
    /// a = b.
    Equal,
    /// a ≠ b.
    Unequal,
    /// Neither is 0.
    And,
    /// At least one is not 0.
    Or,
}

impl Two {
    /// Comparisons by their sign; longer signs before those that they begin with.
    pub const COMPARISONS: &'static [(&'static str, Self)] = &[
        ("<=", Self::LessOrEqual),
        (">=", Self::GreaterOrEqual),
        ("==", Self::Equal),
        ("!=", Self::Unequal),
        ("<", Self::Less),
        (">", Self::Greater),
    ];

    /// Writes its value of each number of `a` and the one of `b` at its place.
    pub(super) fn apply(self, a: &[f32], b: &[f32], to: &mut [f32]) {
        match self {
            Self::Add => both(a, b, to, |a, b| a + b),
            Self::Subtract => both(a, b, to, |a, b| a - b),
            Self::Multiply => both(a, b, to, |a, b| a * b),
            Self::Divide => both(a, b, to, |a, b| a / b),
            Self::Power => both(a, b, to, f32::powf),
            Self::Min => both(a, b, to, smaller),
            Self::Max => both(a, b, to, larger),
            Self::Less => both(a, b, to, |a, b| flag(a < b)),
            Self::LessOrEqual => both(a, b, to, |a, b| flag(a <= b)),
            Self::Greater => both(a, b, to, |a, b| flag(a > b)),
            Self::GreaterOrEqual => both(a, b, to, |a, b| flag(a >= b)),
            Self::Equal => both(a, b, to, |a, b| flag(a == b)),
            Self::Unequal => both(a, b, to, |a, b| flag(a != b)),
            // Without a branch, which `&&` would be, the loop becomes vector instructions.
            Self::And => both(a, b, to, |a, b| flag((a != 0.0) & (b != 0.0))),
            Self::Or => both(a, b, to, |a, b| flag((a != 0.0) | (b != 0.0))),
        }
    }

    /// Its value of two numbers.
    pub(super) fn value(self, a: f32, b: f32) -> f32 {
        let mut value = [0.0];
        self.apply(&[a], &[b], &mut value);
        value[0]
    }
}

#[inline(always)]
fn each(x: &[f32], to: &mut [f32], value: impl Fn(f32) -> f32) {
    to.iter_mut().zip(x).for_each(|(to, &x)| *to = value(x));
}

#[inline(always)]
fn both(a: &[f32], b: &[f32], to: &mut [f32], value: impl Fn(f32, f32) -> f32) {
    to.iter_mut().zip(a).zip(b).for_each(|((to, &a), &b)| *to = value(a, b));
}

/// Writes the second where the first is not 0, else the third.
pub(super) fn select(condition: &[f32], yes: &[f32], no: &[f32], to: &mut [f32]) {
    let choices = condition.iter().zip(yes).zip(no);
    to.iter_mut().zip(choices).for_each(|(to, ((&on, &yes), &no))| *to = if on != 0.0 { yes } else { no });
}

/// Functions that make one number of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FoldKind {
    /// Σ x.
    Sum,
    /// Σ x / n.
    Mean,
    /// √Σ x².
    Norm,
    /// The smallest.
    Min,
    /// The largest.
    Max,
}

impl FoldKind {
    /// All, by name.
    pub const ALL: &'static [(&'static str, Self)] = &[
        ("sum", Self::Sum),
        ("mean", Self::Mean),
        ("norm", Self::Norm),
        ("min", Self::Min),
        ("max", Self::Max),
    ];

    /// Writes its value of the rows that begin at each place of `to`: their elements are `to.len()` apart in `row`.
    pub(super) fn apply(self, row: &[f32], to: &mut [f32]) {
        let lanes = to.len();
        let count = (row.len() / lanes) as f32;
        // `row` has the first element of all robots, then the second, and so on.
        let (first, rest) = row.split_at(lanes.min(row.len()));
        let rest = rest.chunks_exact(lanes);
        // The result starts as the first element and takes in one further element a pass: each pass runs over
        // all robots at once.
        match self {
            // An empty row has no smallest number, and a sum of 0.
            Self::Min | Self::Max if first.is_empty() => to.fill(f32::NAN),
            Self::Min | Self::Max | Self::Sum | Self::Mean if !first.is_empty() => to.copy_from_slice(first),
            Self::Norm if !first.is_empty() => One::Square.apply(first, to),
            _ => to.fill(0.0),
        }
        match self {
            Self::Sum | Self::Mean => rest.for_each(|x| onto(to, x, |sum, x| sum + x)),
            Self::Norm => rest.for_each(|x| onto(to, x, |sum, x| sum + x * x)),
            Self::Min => rest.for_each(|x| onto(to, x, smaller)),
            Self::Max => rest.for_each(|x| onto(to, x, larger)),
        }
        match self {
            // An empty row has no mean: 0 / 0.
            Self::Mean => to.iter_mut().for_each(|x| *x /= count),
            Self::Norm => to.iter_mut().for_each(|x| *x = x.sqrt()),
            _ => {}
        }
    }
}

#[inline(always)]
fn onto(to: &mut [f32], x: &[f32], value: impl Fn(f32, f32) -> f32) {
    to.iter_mut().zip(x).for_each(|(to, &x)| *to = value(*to, x));
}

/// Functions that a name before brackets calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    /// A function of one value.
    One(One),
    /// A function of a row; `min` and `max` also of two values.
    Fold(FoldKind),
    /// `clamp(x, low, high)`.
    Clamp,
    /// `select(condition, yes, no)`.
    Select,
    /// `first(row)` and `second(row)`: that element of each pair.
    Pairs(Side),
}

/// An element of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    First,
    Second,
}

impl Side {
    /// This element of each pair of a row of `width`: element i with each j < i, as (1, 0), (2, 0), (2, 1), (3, 0), ….
    pub(super) fn places(self, width: usize) -> Vec<usize> {
        let pairs = (0..width).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs.map(|(i, j)| if self == Self::First { i } else { j }).collect()
    }
}

impl Function {
    /// All, by name.
    pub(super) fn all() -> impl Iterator<Item = (&'static str, Self)> {
        let ones = One::FUNCTIONS.iter().map(|(name, one)| (*name, Self::One(*one)));
        let folds = FoldKind::ALL.iter().map(|(name, kind)| (*name, Self::Fold(*kind)));
        let pairs = [("first", Self::Pairs(Side::First)), ("second", Self::Pairs(Side::Second))];
        ones.chain(folds).chain([("clamp", Self::Clamp), ("select", Self::Select)]).chain(pairs)
    }

    /// Describes its arguments, in words.
    pub(super) fn takes(self) -> &'static str {
        match self {
            Self::One(_) => "one value",
            Self::Fold(FoldKind::Min | FoldKind::Max) => "a row, or two values",
            Self::Fold(_) | Self::Pairs(_) => "a row",
            Self::Clamp => "a value, its minimum and its maximum",
            Self::Select => "a condition and two values",
        }
    }
}

/// 1 or 0.
pub(in crate::task) fn flag(on: bool) -> f32 {
    if on { 1.0 } else { 0.0 }
}

/// Unlike `f32::min`, this gives NaN if `a` or `b` is NaN.
fn smaller(a: f32, b: f32) -> f32 {
    // A NaN in `b` fails the comparison, so `b` is what is returned.
    if a < b || a.is_nan() { a } else { b }
}

/// Unlike `f32::max`, this gives NaN if `a` or `b` is NaN.
fn larger(a: f32, b: f32) -> f32 {
    if a > b || a.is_nan() { a } else { b }
}
