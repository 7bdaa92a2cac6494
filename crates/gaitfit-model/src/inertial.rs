//! Inertials as a file writes them, and whether they can be real.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::inertia::{Inertial, principal};
use crate::orientation::{AngleUnits, read_orientation};
use crate::rotation::IDENTITY;
use crate::shown::shown_number;
use crate::xml::{At, Element};

/// MJCF `<inertial>`: diagonal with an orientation, full, or a bare mass.
pub(crate) fn read_inertial(
    ctx: &mut Context,
    element: &Element,
    units: AngleUnits,
) -> Result<Inertial, ModelError> {
    let mut a = Attributes::new(element);
    let missing = |name: &str| (element.at, format!("<inertial> without `{name}`"), format!("add `{name}`"));
    let Some(pos) = a.array::<3>(ctx, "pos")? else {
        let (at, what, remedy) = missing("pos");
        return Err(ctx.invalid(at, what, remedy));
    };
    let Some(mass) = a.number(ctx, "mass")? else {
        let (at, what, remedy) = missing("mass");
        return Err(ctx.invalid(at, what, remedy));
    };
    if mass < 0.0 {
        return Err(ctx.invalid(
            a.at("mass"),
            format!("mass is {}", shown_number(mass)),
            "give zero or more",
        ));
    }
    let mut quat = IDENTITY;
    let oriented = read_orientation(&mut a, ctx, units, &mut quat)?;
    let diagonal = a.array::<3>(ctx, "diaginertia")?;
    let full = a.array::<6>(ctx, "fullinertia")?;
    a.finish(ctx)?;
    let inertia = match (diagonal, full) {
        // Checked before `boundinertia`, which would quietly lift it to zero.
        (Some(diagonal), None) if without_rounding(diagonal).iter().any(|i| *i < 0.0) => {
            return Err(ctx.invalid(
                element.at,
                "`diaginertia` has a negative principal moment",
                "give zero or more",
            ));
        }
        (Some(diagonal), None) => without_rounding(diagonal),
        (None, None) => [0.0; 3],
        (None, Some(full)) if !oriented => {
            let (values, axes) = principal(full);
            // MuJoCo's `mjEPS`.
            if values[2] < 1e-14 {
                return Err(ctx.invalid(
                    element.at,
                    format!("`fullinertia` has a principal moment of {}", shown_number(values[2])),
                    "give a positive definite tensor: xx yy zz xy xz yz",
                ));
            }
            quat = axes;
            values
        }
        (_, Some(_)) => {
            return Err(ctx.invalid(
                element.at,
                "`fullinertia` together with `diaginertia` or an orientation",
                "keep one form",
            ));
        }
    };
    Ok(Inertial { mass, pos, quat, inertia })
}

/// Size up to which a moment of inertia is rounding, kg·m²: programs that compute the principal moments of a link almost
/// without mass write −1e−22. A grain of sand has more.
pub(crate) const ROUNDING: f64 = 1e-15;
/// Size up to which a moment of inertia is rounding, as a share of the largest moment.
const ROUNDING_SHARE: f64 = 1e-12;

/// The moments without what is only rounding: a small negative moment is zero, and moments that violate A + B ≥ C by less
/// than that are on its border.
pub(crate) fn without_rounding(moments: [f64; 3]) -> [f64; 3] {
    let largest = moments.iter().fold(0.0_f64, |largest, moment| largest.max(moment.abs()));
    let small = ROUNDING.max(ROUNDING_SHARE * largest);
    let mut kept = moments.map(|moment| if moment < 0.0 && moment >= -small { 0.0 } else { moment });
    // A flat body lies on the border: its largest moment is the sum of the other two.
    for one in 0..3 {
        let others = kept[(one + 1) % 3] + kept[(one + 2) % 3];
        if kept[one] > others && kept[one] - others <= small {
            kept[one] = others;
        }
    }
    kept
}

/// Non-negative, and physical: no principal moment exceeds the sum of the other two.
pub(crate) fn check_inertia(
    ctx: &Context,
    at: At,
    label: &str,
    mut inertial: Inertial,
    balance: bool,
) -> Result<Inertial, ModelError> {
    inertial.inertia = without_rounding(inertial.inertia);
    let [a, b, c] = inertial.inertia;
    let moments = || format!("[{}]", [a, b, c].map(shown_number).join(", "));
    let finite = inertial.mass.is_finite() && (a + b + c).is_finite();
    if !finite || inertial.mass < 0.0 || a < 0.0 || b < 0.0 || c < 0.0 {
        return Err(ctx.invalid(
            at,
            format!(
                "{label}: mass {} or inertia {} is negative or not finite",
                shown_number(inertial.mass),
                moments()
            ),
            "give a mass and principal moments of zero or more",
        ));
    }
    // Every body has A + B − C = 2 ∫ z² dm, which is not negative.
    if a + b < c || a + c < b || b + c < a {
        if !balance {
            return Err(ctx.invalid(
                at,
                format!("{label}: principal moments {} violate A + B >= C", moments()),
                "correct the inertia, or set <compiler balanceinertia=\"true\"/>",
            ));
        }
        // As MuJoCo balances them: a ball has three equal moments.
        inertial.inertia = [(a + b + c) / 3.0; 3];
    }
    Ok(inertial)
}
