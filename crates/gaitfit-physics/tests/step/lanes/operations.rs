//! Every operation of a dual against differences of the same function of plain numbers.

use gaitfit_physics::{Dual, Real};

type D = Dual<f64>;

/// Derivative of `of` at `x` against central differences of the same function of plain numbers, and its value.
fn agrees(name: &str, x: f64, of: fn(D) -> D, plain: fn(f64) -> f64) {
    let found = of(Dual::new(x, 3.0));
    assert_eq!(found.value.to_bits(), plain(x).to_bits(), "{name} at {x}");
    let h = 1e-6 * x.abs().max(1.0);
    let wanted = 3.0 * (plain(x + h) - plain(x - h)) / (2.0 * h);
    let error = (found.tangent - wanted).abs() / wanted.abs().max(1.0);
    assert!(error < 1e-8, "{name} at {x}: {} and not {wanted}", found.tangent);
}

/// Functions of any scalar, for numbers and for duals.
macro_rules! functions {
    ($($name:literal: $x:ident => $value:expr;)*) => {
        [$({
            fn of<T: Real>($x: T) -> T {
                $value
            }
            ($name, of::<D> as fn(D) -> D, of::<f64> as fn(f64) -> f64)
        }),*]
    };
}

/// A literal.
fn c<T: Real>(x: f64) -> T {
    T::lit(x)
}

#[test]
fn every_operation_has_its_derivative() {
    let smooth = functions! {
        "add": x => x + x;
        "sub": x => x * x - x * c(3.0);
        "mul": x => x * (x + c(1.0));
        "neg": x => -x;
        "fma": x => T::fma(x, x + c(0.5), x * x);
        "fnma": x => T::fnma(x, x + c(0.5), x * x);
        "div": x => T::div(x * x + c(0.3), x + c(5.0));
        "sqrt": x => T::sqrt(x * x + c(0.2));
        "min": x => T::min(x, x * x);
        "max": x => T::max(x, x * x);
        "abs": x => T::abs(x);
        "clamp": x => T::clamp(x * x, c(0.5), c(2.0));
        "select": x => T::select_lt(x, c(0.4), x * x, x * c(3.0));
        "sine": x => T::sin_cos(x * x).0;
        "cosine": x => T::sin_cos(x * x).1;
        "recip": x => T::recip(x + c(5.0));
        "tanh": x => T::tanh(x);
        "round": x => T::round(x);
        "gather": x => T::gather(&[1.0, 4.0, 2.0].map(T::constant), x.abs().round());
        "constant": x => T::fma(x, c(0.0), c(1.5));
    };
    for (name, dual, plain) in smooth {
        for x in [-2.2, -0.7, 0.3, 0.8, 1.7] {
            agrees(name, x, dual, plain);
        }
    }
}

#[test]
fn kinks_take_the_side_of_the_value() {
    let (x, up) = (Dual::new(0.0, 1.0), Dual::new(0.0, 2.0));
    assert_eq!(x.min(up).tangent, 2.0, "a tie is the second's, as of the value");
    assert_eq!(x.max(up).tangent, 2.0);
    assert_eq!(D::select_lt(x, up, x, up).tangent, 2.0);
    assert_eq!(x.sqrt(), Dual::new(0.0, 0.0));
    assert_eq!(x.abs().tangent, 1.0);
}

#[test]
fn guards_look_at_values() {
    assert!(D::enter(Dual::new(-1.0, 5.0).unless_ge(D::zero())));
    assert!(!D::enter(Dual::new(0.0, -5.0).unless_ge(D::zero())));
    assert!(!D::enter(D::never()));
}
