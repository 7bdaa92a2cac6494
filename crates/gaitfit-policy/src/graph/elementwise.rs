//! Operators that take a number, or two numbers of the same place.

use crate::network::{Activation, activate_all, erfc};

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Function {
    /// One that networks know too.
    Activation(Activation),
    /// 1 / (1 + e⁻ˣ).
    Sigmoid,
    /// eˣ.
    Exp,
    /// Natural logarithm.
    Log,
    /// √x.
    Sqrt,
    /// 1 / x.
    Reciprocal,
    /// −x.
    Neg,
    /// |x|.
    Abs,
    /// The error function.
    Erf,
    /// ln(1 + eˣ).
    Softplus,
    /// x / (1 + |x|).
    Softsign,
    /// The sine of an angle x in rad.
    Sin,
    /// The cosine of an angle x in rad.
    Cos,
    /// −1, 0 or 1.
    Sign,
    /// The whole number below or at x.
    Floor,
    /// 1 where x is 0, else 0.
    Not,
    /// max(0, min(1, α x + β)).
    HardSigmoid([f32; 2]),
    /// x max(0, min(1, x / 6 + 1 / 2)).
    HardSwish,
    /// x tanh(ln(1 + eˣ)).
    Mish,
}

impl Function {
    /// Replaces every number by its value.
    pub fn apply(self, numbers: &mut [f32]) {
        let each = |numbers: &mut [f32], function: fn(f32) -> f32| {
            numbers.iter_mut().for_each(|x| *x = function(*x));
        };
        match self {
            Self::Activation(activation) => activate_all(numbers, activation),
            // For a large negative x the power is infinite and the quotient 0, which is right.
            Self::Sigmoid => each(numbers, |x| 1.0 / (1.0 + (-x).exp())),
            Self::Exp => each(numbers, f32::exp),
            Self::Log => each(numbers, f32::ln),
            Self::Sqrt => each(numbers, f32::sqrt),
            Self::Reciprocal => each(numbers, f32::recip),
            Self::Neg => each(numbers, |x| -x),
            Self::Abs => each(numbers, f32::abs),
            Self::Erf => each(numbers, erf),
            Self::Softplus => each(numbers, softplus),
            Self::Softsign => each(numbers, |x| x / (1.0 + x.abs())),
            Self::Sin => each(numbers, f32::sin),
            Self::Cos => each(numbers, f32::cos),
            // `signum` of 0 is 1 in Rust.
            Self::Sign => each(numbers, |x| if x == 0.0 { 0.0 } else { x.signum() }),
            Self::Floor => each(numbers, f32::floor),
            Self::Not => each(numbers, |x| f32::from(u8::from(x == 0.0))),
            Self::HardSigmoid([slope, offset]) => {
                numbers.iter_mut().for_each(|x| *x = (slope * *x + offset).clamp(0.0, 1.0));
            }
            // ONNX fixes slope and offset of this one.
            Self::HardSwish => each(numbers, |x| x * (x / 6.0 + 0.5).clamp(0.0, 1.0)),
            Self::Mish => each(numbers, |x| x * softplus(x).tanh()),
        }
    }
}

/// ln(1 + eˣ).
fn softplus(x: f32) -> f32 {
    // Written so that no large x overflows: for x > 0 it is x + ln(1 + e⁻ˣ).
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// 1 − erfc, in double precision.
fn erf(x: f32) -> f32 {
    let z = f64::from(x.abs());
    let t = 1.0 / (1.0 + erfc::P * z);
    let p = erfc::COEFFICIENTS.into_iter().fold(0.0, |p, coefficient| p * t + coefficient);
    // The formula is for z ≥ 0, and the error function is odd.
    (1.0 - p * t * (-z * z).exp()).copysign(f64::from(x)) as f32
}

/// A function of two numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Binary {
    /// a + b.
    Add,
    /// a − b.
    Sub,
    /// a b.
    Mul,
    /// a / b.
    Div,
    /// The larger; NaN if one is.
    Max,
    /// The smaller; NaN if one is.
    Min,
    /// aᵇ.
    Pow,
    /// a where a > 0, else a times b.
    PRelu,
    /// 1 where a = b, else 0.
    Equal,
    /// 1 where a < b, else 0.
    Less,
    /// 1 where a ≤ b, else 0.
    LessOrEqual,
    /// 1 where a > b, else 0.
    Greater,
    /// 1 where a ≥ b, else 0.
    GreaterOrEqual,
    /// 1 where neither is 0, else 0.
    And,
    /// 1 where not both are 0, else 0.
    Or,
}

/// Rule that gives the number of an operand for a place of the result.
#[derive(Clone, Debug, PartialEq)]
pub enum Reach {
    /// The same place.
    Same,
    /// The operand's only number, for all places.
    One,
    /// A place in the operand for each place of the result.
    Listed(Vec<u32>),
}

impl Reach {
    /// Place in the operand.
    #[inline(always)]
    pub fn at(&self, place: usize) -> usize {
        match self {
            Self::Same => place,
            Self::One => 0,
            Self::Listed(places) => places[place] as usize,
        }
    }
}

impl Binary {
    /// Writes its values for one robot.
    pub fn apply(self, out: &mut [f32], a: (&[f32], &Reach), b: (&[f32], &Reach)) {
        let truth = |truth: bool| f32::from(u8::from(truth));
        match self {
            Self::Add => each(out, a, b, |a, b| a + b),
            Self::Sub => each(out, a, b, |a, b| a - b),
            Self::Mul => each(out, a, b, |a, b| a * b),
            Self::Div => each(out, a, b, |a, b| a / b),
            // A NaN stays one, as in ONNX.
            Self::Max => each(out, a, b, |a, b| if a > b || a.is_nan() { a } else { b }),
            Self::Min => each(out, a, b, |a, b| if a < b || a.is_nan() { a } else { b }),
            // A product is exact where a power is not.
            Self::Pow => each(out, a, b, |a, b| if b == 2.0 { a * a } else { a.powf(b) }),
            Self::PRelu => each(out, a, b, |a, b| if a > 0.0 { a } else { a * b }),
            Self::Equal => each(out, a, b, |a, b| truth(a == b)),
            Self::Less => each(out, a, b, |a, b| truth(a < b)),
            Self::LessOrEqual => each(out, a, b, |a, b| truth(a <= b)),
            Self::Greater => each(out, a, b, |a, b| truth(a > b)),
            Self::GreaterOrEqual => each(out, a, b, |a, b| truth(a >= b)),
            Self::And => each(out, a, b, |a, b| truth(a != 0.0 && b != 0.0)),
            Self::Or => each(out, a, b, |a, b| truth(a != 0.0 || b != 0.0)),
        }
    }
}

#[inline(always)]
fn each(
    out: &mut [f32],
    (a, reach_a): (&[f32], &Reach),
    (b, reach_b): (&[f32], &Reach),
    function: impl Fn(f32, f32) -> f32,
) {
    // The usual cases need no look-up of places, so their loops become vectors.
    match (reach_a, reach_b) {
        (Reach::Same, Reach::Same) => {
            out.iter_mut().zip(a).zip(b).for_each(|((out, &a), &b)| *out = function(a, b));
        }
        (Reach::Same, Reach::One) => out.iter_mut().zip(a).for_each(|(out, &a)| *out = function(a, b[0])),
        (Reach::One, Reach::Same) => out.iter_mut().zip(b).for_each(|(out, &b)| *out = function(a[0], b)),
        _ => {
            for (place, out) in out.iter_mut().enumerate() {
                *out = function(a[reach_a.at(place)], b[reach_b.at(place)]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_their_definitions_where_these_are_known() {
        let value = |function: Function, x: f32| {
            let mut one = [x];
            function.apply(&mut one);
            one[0]
        };
        let known = [
            (Function::Erf, 0.5, 0.520_499_9),
            (Function::Erf, -2.0, -0.995_322_3),
            (Function::Softplus, 0.0, std::f32::consts::LN_2),
            (Function::Softplus, 90.0, 90.0),
            (Function::Softplus, -90.0, 0.0),
            (Function::Mish, 1.0, 0.865_098_4),
            (Function::HardSwish, 1.0, 2.0 / 3.0),
            (Function::HardSigmoid([0.2, 0.5]), 1.0, 0.7),
            (Function::Sigmoid, 0.0, 0.5),
            (Function::Sign, -3.0, -1.0),
            (Function::Sign, 0.0, 0.0),
            (Function::Activation(Activation::Relu), -1.0, 0.0),
        ];
        for (function, x, wanted) in known {
            assert!((value(function, x) - wanted).abs() < 1e-6, "{function:?}({x}) = {}", value(function, x));
        }
    }

    #[test]
    fn numbers_meet_by_their_reach() {
        let mut out = [0.0; 4];
        let listed = Reach::Listed(vec![0, 0, 1, 1]);
        Binary::Sub.apply(&mut out, (&[1.0, 2.0, 3.0, 4.0], &Reach::Same), (&[10.0, 20.0], &listed));
        assert_eq!(out, [-9.0, -8.0, -17.0, -16.0]);
        Binary::Div.apply(&mut out, (&[8.0], &Reach::One), (&[1.0, 2.0, 4.0, 8.0], &Reach::Same));
        assert_eq!(out, [8.0, 4.0, 2.0, 1.0]);
        Binary::Max.apply(&mut out, (&[f32::NAN, 2.0, -1.0, 0.0], &Reach::Same), (&[1.0], &Reach::One));
        assert!(out[0].is_nan() && out[1..] == [2.0, 1.0, 1.0]);
    }
}
