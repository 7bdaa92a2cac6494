//! Numbers and untrusted names as text for people.

/// Text for a number that is not known.
pub(crate) const UNKNOWN: &str = "–";

/// Longest name printed in full, characters; the rest becomes "…".
const LONGEST_NAME: usize = 200;
/// Longest sentence or setting printed in full, characters.
const LONGEST_PROSE: usize = 4000;

/// `x` with `digits` significant digits; powers of ten outside 10⁻⁴ … 10⁶.
pub(crate) fn significant(x: f64, digits: usize) -> String {
    if !x.is_finite() {
        return UNKNOWN.to_string();
    }
    if x == 0.0 {
        return "0".to_string();
    }
    let (mantissa, exponent) = scientific_parts(x, digits);
    // Beyond this, zeros would have to be counted by eye.
    if (-4..6).contains(&exponent) {
        // Never below 0 decimals: 12345 with 3 digits stays 12345.
        fixed(x, (digits as i32 - 1 - exponent).max(0) as usize)
    } else {
        format!("{}\u{a0}×\u{a0}10{}", minus(&mantissa), superscript(exponent))
    }
}

/// As [`significant`], without trailing zeros: for bounds and settings, which are round by nature.
pub(crate) fn round_number(x: f64) -> String {
    let text = significant(x, 4);
    if text.contains('×') {
        let (mantissa, power) = text.split_once('\u{a0}').unwrap_or((&text, ""));
        return format!("{}\u{a0}{power}", trim_zeros(mantissa));
    }
    trim_zeros(&text).to_string()
}

/// Value and spread, the spread with two significant digits and the value to the same decimal.
pub(crate) fn with_spread(value: f64, spread: f64) -> (String, String) {
    if !value.is_finite() || !spread.is_finite() || spread == 0.0 {
        return (significant(value, 4), significant(spread, 2));
    }
    let spread_exponent = scientific_parts(spread, 2).1;
    // Zero has no power of ten of its own.
    let value_exponent = if value == 0.0 { spread_exponent } else { scientific_parts(value, 4).1 };
    // A spread below 1e-6 would give its value more than seven decimals.
    let plain = -6..6;
    if !plain.contains(&spread_exponent) || !(-4..6).contains(&value_exponent.max(spread_exponent)) {
        return (significant(value, 4), significant(spread, 2));
    }
    // Two digits of the spread.
    let decimals = (1 - spread_exponent).max(0) as usize;
    (fixed(value, decimals), fixed(spread, decimals))
}

/// `x` with a fixed number of decimals and a true minus sign.
pub(crate) fn fixed(x: f64, decimals: usize) -> String {
    if !x.is_finite() {
        return UNKNOWN.to_string();
    }
    let text = format!("{x:.decimals$}");
    let is_zero = text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.'));
    // A number that is rounded to zero has no sign.
    minus(if is_zero { text.trim_start_matches('-') } else { &text })
}

/// How long something took, unknown unless positive: seconds below two minutes, minutes and hours above.
pub(crate) fn duration(seconds: f64) -> String {
    if !seconds.is_finite() || seconds <= 0.0 {
        UNKNOWN.to_string()
    } else if seconds < 120.0 {
        format!("{}\u{a0}s", significant(seconds, 3))
    } else if seconds < 7200.0 {
        format!("{}\u{a0}min", significant(seconds / 60.0, 3))
    } else {
        format!("{}\u{a0}h", significant(seconds / 3600.0, 3))
    }
}

/// Thousands apart: 10 000.
pub(crate) fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        // Counted from the end.
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{a0}');
        }
        out.push(digit);
    }
    out
}

/// A name fit to print: no control or direction-changing characters, at most [`LONGEST_NAME`] characters.
pub(crate) fn clean(name: &str) -> String {
    printable(name, LONGEST_NAME)
}

/// As [`clean`], for sentences and settings.
pub(crate) fn clean_prose(text: &str) -> String {
    printable(text, LONGEST_PROSE)
}

fn printable(text: &str, longest: usize) -> String {
    // Characters of zero width, direction marks, and numbers that are no characters: names that differ must look
    // different.
    let hidden = |c: &char| {
        c.is_control()
            || matches!(*c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
                | '\u{feff}' | '\u{fffe}' | '\u{ffff}')
    };
    // A line break is a control character, but it separates words.
    let mut shown = text.chars().map(|c| if c == '\n' { ' ' } else { c }).filter(|c| !hidden(c));
    let mut printed: String = shown.by_ref().take(longest).collect();
    if shown.next().is_some() {
        printed.push('…');
    }
    printed
}

/// `text` for element content and double-quoted attributes.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    // XML forbids most control characters even if they are escaped.
    for c in clean(text).chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

fn trim_zeros(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

fn minus(text: &str) -> String {
    // The true minus is as wide as a digit, so that columns of numbers align.
    text.replace('-', "\u{2212}")
}

/// Mantissa text and power of ten after rounding to `digits`.
fn scientific_parts(x: f64, digits: usize) -> (String, i32) {
    // Rust rounds first, so 9.996 with three digits has the exponent 1.
    let text = format!("{x:.*e}", digits.saturating_sub(1));
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    (mantissa.to_string(), exponent.parse().unwrap_or(0))
}

fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            '0' => '⁰',
            // The superscripts four to nine are consecutive from U+2074.
            d => char::from_u32(0x2070 + d.to_digit(10).unwrap_or(0)).unwrap_or(d),
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // A test that panics has failed.
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_in_print() {
        assert_eq!(significant(0.004_812_3, 3), "0.00481");
        assert_eq!(significant(-12.345, 3), "−12.3");
        assert_eq!(significant(9.996, 3), "10.0");
        assert_eq!(significant(1.5e-9, 3), "1.50\u{a0}×\u{a0}10⁻⁹");
        assert_eq!(significant(4.27e9, 2), "4.3\u{a0}×\u{a0}10⁹");
        assert_eq!(significant(f64::NAN, 3), "–");
        assert_eq!(significant(f64::NEG_INFINITY, 3), "–");
        assert_eq!(round_number(0.5), "0.5");
        assert_eq!(round_number(100.0), "100");
        assert_eq!(round_number(2e-9), "2\u{a0}×\u{a0}10⁻⁹");
        assert_eq!(fixed(-0.000_01, 3), "0.000");
    }

    #[test]
    fn the_spread_decides_the_decimals() {
        assert_eq!(with_spread(0.183_42, 0.001_23), ("0.1834".into(), "0.0012".into()));
        assert_eq!(with_spread(123.456, 12.3), ("123".into(), "12".into()));
        assert_eq!(with_spread(0.2, f64::NAN), ("0.2000".into(), "–".into()));
        assert_eq!(with_spread(0.0, 0.01), ("0.000".into(), "0.010".into()));
        assert_eq!(with_spread(1e9, 1e-9).0, "1.000\u{a0}×\u{a0}10⁹");
    }

    #[test]
    fn counts_are_grouped_by_thousands() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1\u{a0}000", "1\u{a0}234\u{a0}567"]);
    }

    #[test]
    fn names_lose_what_hides() {
        assert_eq!(clean("a\u{0}b\u{202e}c\nd"), "abc d");
        assert_eq!(clean(&"x".repeat(10_000)).chars().count(), LONGEST_NAME + 1);
        assert_eq!(escape("<b a='1'>&\""), "&lt;b a=&#39;1&#39;&gt;&amp;&quot;");
    }
}
