//! Messages of bounded length: what they quote may be as long as a file.

use std::borrow::Cow;

/// Max characters of a message.
const MAX: usize = 4000;
/// Characters of its end that are kept: the remedy is there.
const END: usize = 800;
/// Digits of a number that is cut.
const SHOWN_DIGITS: usize = 12;
/// Digits from which on a number is cut.
const MAX_DIGITS: usize = 40;
/// Digits up to which a number is shown as it is: no whole number of 64 bits has more.
const PLAIN_DIGITS: usize = 20;

/// The message with its middle left out where it is long, and without numbers of hundreds of digits.
pub fn brief(message: &str) -> Cow<'_, str> {
    let message = short_numbers(message);
    let count = message.chars().count();
    if count <= MAX {
        return message;
    }
    let place = |number: usize| message.char_indices().nth(number).map_or(message.len(), |(place, _)| place);
    // Cut between characters: a byte in the middle of one is no place to cut.
    let (head, tail) = (place(MAX - END), place(count - END));
    let left_out = count - MAX;
    Cow::Owned(format!("{} [… {left_out} characters left out …] {}", &message[..head], &message[tail..]))
}

/// The text without numbers of hundreds of digits: as `1e300` where a few digits and zeros make it up, else cut.
pub fn short_numbers(text: &str) -> Cow<'_, str> {
    let mut out = String::new();
    let mut rest = text;
    while let Some(start) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let (before, digits) = rest.split_at(start);
        let length = digits.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(digits.len());
        let (number, after) = digits.split_at(length);
        out.push_str(before);
        // Numbers of usual length are read easily as they are.
        if length <= PLAIN_DIGITS {
            out.push_str(number);
        // A fraction's digits were found behind `0.`, which is already written and is taken back.
        } else if let Some((small, short)) = below_one(&out).zip(fraction(number)) {
            out.truncate(small);
            out.push_str(&short);
        // Behind another point an exponent would count the digits from the wrong place.
        } else if out.strip_suffix('.').is_some_and(ends_in_digit) {
            out.push_str(&cut(number));
        } else {
            out.push_str(&whole(number));
        }
        rest = after;
    }
    // Most texts have no digits, and are not copied.
    if out.is_empty() {
        return Cow::Borrowed(text);
    }
    out.push_str(rest);
    Cow::Owned(out)
}

/// The length of the text without the `0.` at its end; `None` if it ends otherwise, also in `10.`.
fn below_one(text: &str) -> Option<usize> {
    text.strip_suffix("0.").filter(|before| !ends_in_digit(before)).map(str::len)
}

fn ends_in_digit(text: &str) -> bool {
    text.ends_with(|letter: char| letter.is_ascii_digit())
}

/// A whole number of many digits.
fn whole(digits: &str) -> String {
    scientific(digits.trim_end_matches('0'), digits.len() as i64 - 1).unwrap_or_else(|| cut(digits))
}

/// The digits, of which only the first are shown if there are too many.
fn cut(digits: &str) -> String {
    match digits.len() {
        count if count <= MAX_DIGITS => digits.to_owned(),
        count => format!("{}... ({count} digits)", &digits[..SHOWN_DIGITS]),
    }
}

/// A number below 1 by its digits after the point; `None` if more than a few of them count.
fn fraction(digits: &str) -> Option<String> {
    let significant = digits.trim_start_matches('0');
    let zeros = (digits.len() - significant.len()) as i64;
    scientific(significant.trim_end_matches('0'), -zeros - 1)
}

/// `123` and 300 as `1.23e300`; `None` if there are more digits than a double has.
fn scientific(significant: &str, exponent: i64) -> Option<String> {
    // A double is determined by 17 significant digits.
    const DOUBLE: usize = 17;
    // No digits at all: the number was a row of zeros, which has no exponent.
    let first = significant.get(..1).filter(|_| significant.len() <= DOUBLE)?;
    let others = &significant[1..];
    let point = if others.is_empty() { "" } else { "." };
    Some(format!("{first}{point}{others}e{exponent}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_message_keeps_its_beginning_and_its_remedy() {
        let long = format!("x.toml: `{}` is unknown; correct it", "ä".repeat(90_000));
        let brief = brief(&long);
        assert!(brief.chars().count() < MAX + 60, "{}", brief.len());
        assert!(brief.starts_with("x.toml: `ää") && brief.ends_with("ä` is unknown; correct it"));
        assert!(brief.contains("[… 86"), "{}", &brief[..200]);
        assert_eq!(super::brief("at most 1,000 of 64 digits"), "at most 1,000 of 64 digits");
        assert!(matches!(super::brief("short"), Cow::Borrowed("short")));
    }

    #[test]
    fn numbers_of_hundreds_of_digits_have_an_exponent_or_are_cut() {
        let text = format!("`upper` is {}; give less", 1e300);
        assert_eq!(brief(&text), "`upper` is 1e300; give less");
        assert_eq!(brief(&format!("{} and {}", 1e30, u64::MAX)), "1e30 and 18446744073709551615");
        assert_eq!(brief(&format!("from {} to {}", -1.25e-200, 3.5e120)), "from -1.25e-200 to 3.5e120");
        assert_eq!(
            brief(&format!("{} of {}", "12".repeat(30), f64::MIN_POSITIVE)),
            "121212121212... (60 digits) of 2.2250738585072014e-308"
        );
        for number in ["10.00000000000000000000001", "1.50000000000000000000000"] {
            assert_eq!(brief(number), number, "an exponent would make it another number");
        }
        let hash = "sha256 0123456789012345678901234567890123456789";
        assert_eq!(brief(hash), hash);
    }
}
