//! What expressions do with numbers: of `N` robots at once, one after the other in an array, which the compiler turns
//! into vector instructions.

/// Of one number.
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
    /// Those that are written as functions, by name.
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

    /// Its values.
    #[inline]
    pub(super) fn value<const N: usize>(self, x: [f32; N]) -> [f32; N] {
        match self {
            Self::Negate => x.map(|x| -x),
            Self::Not => x.map(|x| flag(x == 0.0)),
            Self::Abs => x.map(f32::abs),
            Self::Sqrt => x.map(f32::sqrt),
            Self::Square => x.map(|x| x * x),
            Self::Exp => x.map(f32::exp),
            Self::Ln => x.map(f32::ln),
            Self::Sin => x.map(f32::sin),
            Self::Cos => x.map(f32::cos),
            Self::Tanh => x.map(f32::tanh),
            Self::Floor => x.map(f32::floor),
        }
    }
}

/// Of two numbers. Comparisons and `and`, `or` give 1 or 0.
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
    /// The smaller; not a number if one of them is none.
    Min,
    /// The larger; not a number if one of them is none.
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
    /// Not both are 0.
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

    /// Its values.
    #[inline]
    pub(super) fn value<const N: usize>(self, a: [f32; N], b: [f32; N]) -> [f32; N] {
        match self {
            Self::Add => both(a, b, |a, b| a + b),
            Self::Subtract => both(a, b, |a, b| a - b),
            Self::Multiply => both(a, b, |a, b| a * b),
            Self::Divide => both(a, b, |a, b| a / b),
            Self::Power => both(a, b, f32::powf),
            Self::Min => both(a, b, smaller),
            Self::Max => both(a, b, larger),
            Self::Less => both(a, b, |a, b| flag(a < b)),
            Self::LessOrEqual => both(a, b, |a, b| flag(a <= b)),
            Self::Greater => both(a, b, |a, b| flag(a > b)),
            Self::GreaterOrEqual => both(a, b, |a, b| flag(a >= b)),
            Self::Equal => both(a, b, |a, b| flag(a == b)),
            Self::Unequal => both(a, b, |a, b| flag(a != b)),
            Self::And => both(a, b, |a, b| flag(a != 0.0 && b != 0.0)),
            Self::Or => both(a, b, |a, b| flag(a != 0.0 || b != 0.0)),
        }
    }
}

#[inline]
fn both<const N: usize>(a: [f32; N], b: [f32; N], value: impl Fn(f32, f32) -> f32) -> [f32; N] {
    std::array::from_fn(|k| value(a[k], b[k]))
}

/// The second where the first is not 0, else the third.
#[inline]
pub(super) fn select<const N: usize>(condition: [f32; N], yes: [f32; N], no: [f32; N]) -> [f32; N] {
    std::array::from_fn(|k| if condition[k] != 0.0 { yes[k] } else { no[k] })
}

/// How a row becomes one number.
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

    /// Of the numbers of a row, one after the other.
    pub(super) fn value<const N: usize>(self, row: &[[f32; N]]) -> [f32; N] {
        let count = row.len() as f32;
        let squared = |x: &[f32; N]| One::Square.value(*x);
        match self {
            Self::Sum => sum(row.iter().copied()),
            Self::Mean => sum(row.iter().copied()).map(|sum| sum / count),
            Self::Norm => sum(row.iter().map(squared)).map(f32::sqrt),
            Self::Min => row.iter().copied().reduce(|a, b| both(a, b, smaller)).unwrap_or([f32::NAN; N]),
            Self::Max => row.iter().copied().reduce(|a, b| both(a, b, larger)).unwrap_or([f32::NAN; N]),
        }
    }
}

/// From the first to the last; 0 of an empty row.
fn sum<const N: usize>(row: impl Iterator<Item = [f32; N]>) -> [f32; N] {
    row.reduce(|a, b| both(a, b, |a, b| a + b)).unwrap_or([0.0; N])
}

/// What a name before brackets calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    /// Of one value.
    One(One),
    /// Of a row; `min` and `max` also of two values.
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

    /// What it takes, in words.
    pub(super) fn takes(self) -> &'static str {
        match self {
            Self::One(_) => "one value",
            Self::Fold(FoldKind::Min | FoldKind::Max) => "a row, or two values",
            Self::Fold(_) | Self::Pairs(_) => "a row",
            Self::Clamp => "a value, its least and its largest",
            Self::Select => "a condition and two values",
        }
    }
}

/// 1 or 0.
pub(super) fn flag(on: bool) -> f32 {
    if on { 1.0 } else { 0.0 }
}

/// Unlike `f32::min`, not a number if one of them is none.
fn smaller(a: f32, b: f32) -> f32 {
    if a < b || a.is_nan() { a } else { b }
}

/// Unlike `f32::max`, not a number if one of them is none.
fn larger(a: f32, b: f32) -> f32 {
    if a > b || a.is_nan() { a } else { b }
}
