//! What expressions do with numbers.

/// Of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    ];

    /// Its value.
    pub(super) fn value(self, x: f32) -> f32 {
        match self {
            Self::Negate => -x,
            Self::Not => flag(x == 0.0),
            Self::Abs => x.abs(),
            Self::Sqrt => x.sqrt(),
            Self::Square => x * x,
            Self::Exp => x.exp(),
            Self::Ln => x.ln(),
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tanh => x.tanh(),
        }
    }
}

/// Of two numbers. Comparisons and `and`, `or` give 1 or 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

    /// Its value.
    pub(super) fn value(self, a: f32, b: f32) -> f32 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => a.powf(b),
            Self::Min => smaller(a, b),
            Self::Max => largest(a, b),
            Self::Less => flag(a < b),
            Self::LessOrEqual => flag(a <= b),
            Self::Greater => flag(a > b),
            Self::GreaterOrEqual => flag(a >= b),
            Self::Equal => flag(a == b),
            Self::Unequal => flag(a != b),
            Self::And => flag(a != 0.0 && b != 0.0),
            Self::Or => flag(a != 0.0 || b != 0.0),
        }
    }
}

/// How a row becomes one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

    /// Of `count` values, one after the other.
    pub(super) fn value(self, values: impl Iterator<Item = f32>, count: usize) -> f32 {
        match self {
            Self::Sum => values.sum(),
            Self::Mean => values.sum::<f32>() / count as f32,
            Self::Norm => values.map(|x| x * x).sum::<f32>().sqrt(),
            Self::Min => values.reduce(smaller).unwrap_or(f32::NAN),
            Self::Max => values.reduce(largest).unwrap_or(f32::NAN),
        }
    }
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
}

impl Function {
    /// All, by name.
    pub(super) fn all() -> impl Iterator<Item = (&'static str, Self)> {
        let ones = One::FUNCTIONS.iter().map(|(name, one)| (*name, Self::One(*one)));
        let folds = FoldKind::ALL.iter().map(|(name, kind)| (*name, Self::Fold(*kind)));
        ones.chain(folds).chain([("clamp", Self::Clamp), ("select", Self::Select)])
    }

    /// What it takes, in words.
    pub(super) fn takes(self) -> &'static str {
        match self {
            Self::One(_) => "one value",
            Self::Fold(FoldKind::Min | FoldKind::Max) => "a row, or two values",
            Self::Fold(_) => "a row",
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
fn largest(a: f32, b: f32) -> f32 {
    if a > b || a.is_nan() { a } else { b }
}
