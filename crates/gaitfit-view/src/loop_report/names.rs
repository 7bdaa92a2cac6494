//! Names of policies for readers: files and results say π₀, π₁, …; a page says before and after.

const DIGITS: std::ops::RangeInclusive<char> = '₀'..='₉';

/// A text for readers with plain names: π₀ is `before`, `after` (as results name it, such as π₂) is `after`, and others are
/// `after round 1` and so on.
pub fn plain(page: &str, after: &str) -> String {
    // A policy of another name, such as `fine-tuned`, has no number; then no π is the last one.
    let last = number(after.strip_prefix('π').unwrap_or_default()).map(|(number, _)| number);
    let mut parts = page.split('π');
    let mut text = String::with_capacity(page.len());
    // What stands before the first π has no number.
    text.push_str(parts.next().unwrap_or_default());
    for part in parts {
        match number(part) {
            Some((0, rest)) => text.extend(["before", rest]),
            Some((number, rest)) if Some(number) == last => text.extend(["after", rest]),
            Some((number, rest)) => text.extend([&format!("after round {number}"), rest]),
            None => text.extend(["π", part]),
        }
    }
    text
}

/// The number that a text begins with in subscript digits, and what follows it.
fn number(text: &str) -> Option<(u32, &str)> {
    // The digits are three bytes each in UTF-8, so the cut is made by letters.
    let rest = text.trim_start_matches(|letter| DIGITS.contains(&letter));
    let digits = &text[..text.len() - rest.len()];
    let value =
        |number: Option<u32>, digit: char| number?.checked_mul(10)?.checked_add(digit as u32 - '₀' as u32);
    let number = digits.chars().fold(Some(0), value)?;
    (!digits.is_empty()).then_some((number, rest))
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn policies_get_plain_names() {
        assert_eq!(plain("π₀ → π₁ → π₂, 2π", "π₂"), "before → after round 1 → after, 2π");
        assert_eq!(plain("π₁₂ minus π₀", "π₁₂"), "after minus before");
        assert_eq!(plain("no policy", "fine-tuned"), "no policy");
        assert_eq!(plain("π₉₉₉₉₉₉₉₉₉₉₉", "π₁"), "π₉₉₉₉₉₉₉₉₉₉₉");
    }
}
