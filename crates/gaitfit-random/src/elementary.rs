//! Logarithm, sine and cosine from IEEE basic operations alone, so that every machine and backend returns the
//! same bits. System libraries differ in the last place, and so would a resumed or ported run.

use std::f64::consts::{LN_2, SQRT_2, TAU};

/// 1, 1/3, 1/5, …: the series of artanh. Constants, because a division takes longer than the rest of a term.
const ARTANH: [f64; 12] = {
    let mut coefficients = [0.0; 12];
    let mut k = 0;
    while k < 12 {
        coefficients[k] = 1.0 / (2 * k + 1) as f64;
        k += 1;
    }
    coefficients
};

/// Ratios of successive terms of the cosine and sine series without x²: 1/(2k(2k − 1)) and 1/(2k(2k + 1)), from
/// k = 1.
const COSINE_SINE: [(f64, f64); 8] = {
    let mut ratios = [(0.0, 0.0); 8];
    let mut k = 0;
    while k < 8 {
        let even = (2 * k + 2) as f64;
        ratios[k] = (1.0 / (even * (even - 1.0)), 1.0 / (even * (even + 1.0)));
        k += 1;
    }
    ratios
};

/// Natural logarithm of a positive, normal `x`; relative error below 1e-15.
///
/// With x = m·2^e, m in [√½, √2) and s = (m − 1)/(m + 1): ln m = 2·(s + s³/3 + s⁵/5 + …). |s| ≤ 0.172, so
/// twelve terms are below the rounding error.
#[inline(always)]
pub(crate) fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    // The lower 52 bits are the fraction. An exponent of 1023 stands for 2⁰, so this lies in [1, 2).
    let mantissa = f64::from_bits((bits & ((1 << 52) - 1)) | (1023 << 52));
    // Arithmetic instead of a branch that half of all draws would mispredict: one less in the exponent halves.
    let upper = u64::from(mantissa >= SQRT_2);
    let mantissa = f64::from_bits(mantissa.to_bits() - (upper << 52));
    let exponent = ((bits >> 52) + upper) as i64 - 1023;
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let mut series = 0.0;
    // Horner's scheme in s², from the highest power down.
    for coefficient in ARTANH.iter().rev() {
        series = series * s2 + coefficient;
    }
    exponent as f64 * LN_2 + 2.0 * s * series
}

/// (cos 2πt, sin 2πt) for t in [0, 1); absolute error below 1e-15.
///
/// t is reduced exactly to the nearest quarter turn; the Taylor series on [−π/4, π/4] end below the rounding
/// error (x^18/18! ≈ 2e-18).
#[inline(always)]
pub(crate) fn cos_sin_turns(t: f64) -> (f64, f64) {
    // Adding a half and cutting off rounds to the nearest quarter.
    // From t = 7/8 on it is 4, a whole turn, which acts below as 0 does.
    let quarter = (4.0 * t + 0.5) as u32;
    let angle = TAU * (t - 0.25 * f64::from(quarter));
    let square = angle * angle;
    let (mut cosine, mut sine) = (1.0, 1.0);
    // From the last term inwards: each step is 1 less a ratio times all that follows it.
    for (even, odd) in COSINE_SINE.iter().rev() {
        cosine = 1.0 - cosine * (square * even);
        sine = 1.0 - sine * (square * odd);
    }
    sine *= angle;
    // Quarter turns swap the two and change signs, without a branch: (c, s), (−s, c), (−c, −s), (s, −c).
    let swap = quarter % 2 == 1;
    let (x, y) = (if swap { sine } else { cosine }, if swap { cosine } else { sine });
    // Bit 1 of the number, moved to bit 63, is the sign.
    let flip = |value: f64, flip: u32| f64::from_bits(value.to_bits() ^ (u64::from(flip & 2) << 62));
    (flip(x, quarter + 1), flip(y, quarter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ln_agrees_with_the_system_library() {
        for i in 1..20_000_u32 {
            let x = f64::from(i) / 20_000.0;
            assert!((ln(x) - x.ln()).abs() <= 1e-15 * x.ln().abs().max(0.1), "ln {x}");
        }
        for exponent in 0..54 {
            let x = 0.5_f64.powi(exponent);
            assert!((ln(x) - x.ln()).abs() <= 1e-15 * x.ln().abs(), "ln 2^-{exponent}");
        }
        assert_eq!(ln(1.0), 0.0);
    }

    #[test]
    fn cos_sin_agree_with_the_system_library() {
        for i in 0..40_000_u32 {
            let t = f64::from(i) / 40_000.0;
            let (cosine, sine) = cos_sin_turns(t);
            // The system's argument TAU·t carries its own rounding error of up to 4e-16.
            assert!((cosine - (TAU * t).cos()).abs() < 1e-15, "cos {t}");
            assert!((sine - (TAU * t).sin()).abs() < 1e-15, "sin {t}");
            assert!((cosine * cosine + sine * sine - 1.0).abs() < 1e-15);
        }
        let (cosine, sine) = cos_sin_turns(0.25);
        assert_eq!((cosine.abs(), sine), (0.0, 1.0));
    }
}
