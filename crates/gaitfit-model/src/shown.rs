//! Text and numbers from files, made safe and short for messages.

use std::path::Path;

/// Max number of characters of a text in a message.
const MAX_CHARS: usize = 60;
/// Max number of characters of a path in a message.
const MAX_PATH_CHARS: usize = 1000;
/// Max number of characters of a sentence in a message.
const MAX_SENTENCE_CHARS: usize = 2000;

/// `text` for a message: at most 60 characters, the rest cut to `...`. Characters that control a terminal or turn the
/// direction of writing are escaped (`\u{1b}`), so that a file cannot write over what the program says.
pub fn shown(text: &str) -> String {
    escaped(text, MAX_CHARS)
}

/// `path` for a message, as [`shown`] but long enough for any path that one would type.
pub fn shown_path(path: &Path) -> String {
    escaped(&path.to_string_lossy(), MAX_PATH_CHARS)
}

/// `value` for a message: plain where that is short, else with an exponent (`1e300`, not three hundred digits).
pub fn shown_number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || !size.is_finite() || (1e-5..1e15).contains(&size) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// `value` for a message with `digits` significant digits, without trailing zeros: `0`, `5.66`, `0.00037`, `1e300`. Values below
/// 0.0001 and from 1,000,000 on have an exponent.
pub fn significant(value: f64, digits: usize) -> String {
    let rounded: f64 = format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value);
    // The rounded value decides, because rounding may carry it over a limit.
    let size = rounded.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if !size.is_finite() || (1e-4..1e6).contains(&size) {
        rounded.to_string()
    } else {
        format!("{rounded:e}")
    }
}

/// `value` with so many decimals, for a message; what rounds to zero has no sign, and what is huge has an exponent.
pub fn with_decimals(value: f64, decimals: usize) -> String {
    if value.abs() >= 1e9 {
        return significant(value, 3);
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| matches!(byte, b'0' | b'.')) => zero.to_owned(),
        _ => text,
    }
}

/// The first `max` items, and how many more there are: `a, b and 3 more`.
pub fn listed(items: impl IntoIterator<Item = impl AsRef<str>>, max: usize) -> String {
    let (mut text, mut more) = (String::new(), 0);
    for (place, item) in items.into_iter().enumerate() {
        if place >= max {
            more += 1;
            continue;
        }
        text.push_str(if place > 0 { ", " } else { "" });
        text.push_str(item.as_ref());
    }
    if more > 0 { format!("{text} and {more} more") } else { text }
}

/// A sentence for a message, as [`shown`] but long enough for any that makes sense.
pub fn shown_sentence(text: &str) -> String {
    escaped(text, MAX_SENTENCE_CHARS)
}

/// `count` and a noun in the number that it needs: `1 log`, `2 logs`. `noun`: its singular, whose plural has an `s` more.
pub fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}

/// A path as one argument of a command that a reader may copy: in quotes where a shell would take it apart. Control characters are
/// written as escapes of the shell's `$'…'`.
pub fn argument(path: &Path) -> String {
    let text = path.to_string_lossy();
    let plain = |c: char| c.is_alphanumeric() || "_-./+=:@%,".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        return text.into_owned();
    }
    if text.chars().any(commands) {
        // Whole, however long: a part of a path names another file.
        let mut inner = String::new();
        for c in text.chars() {
            match c {
                '\\' | '\'' | '\n' | '\r' | '\t' => inner.extend(c.escape_default()),
                // Byte by byte: shells do not know Rust's `\u{1b}`.
                c if commands(c) => {
                    let mut bytes = [0; 4];
                    for byte in c.encode_utf8(&mut bytes).bytes() {
                        inner.push_str(&format!("\\x{byte:02x}"));
                    }
                }
                c => inner.push(c),
            }
        }
        return format!("$'{inner}'");
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// Similarity from which on a known name is what was meant.
const ALIKE: f64 = 0.75;

/// A message of a reader such as "unknown field `a`, expected one of `b`, `c`" with the name that was meant instead of the list;
/// as it is if none is like it.
pub fn with_meant(message: &str) -> String {
    let message = message.trim_end();
    // Every second part stands in backquotes: the unknown name, then the known ones.
    let mut quoted = message.split('`').skip(1).step_by(2);
    let (Some(unknown), true) = (quoted.next(), message.starts_with("unknown ")) else {
        return message.to_owned();
    };
    let scored = quoted.map(|known| (strsim::jaro_winkler(unknown, known), known));
    match scored.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((score, known)) if score > ALIKE => {
            let what = message.split('`').next().unwrap_or_default().trim_end();
            format!("{what} `{}`. Did you mean `{known}`?", shown(unknown))
        }
        _ => message.to_owned(),
    }
}

/// As [`shown`], cut to `max` characters.
pub fn escaped(text: &str, max: usize) -> String {
    let mut out = String::new();
    let (mut count, mut cut) = (0, 0);
    for c in text.chars() {
        let before = out.len();
        if commands(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
        count += out[before..].chars().count();
        if count > max {
            out.truncate(cut);
            out.push_str("...");
            return out;
        }
        // The last place that leaves room for the dots.
        if count + 3 <= max {
            cut = out.len();
        }
    }
    out
}

/// Whether a character commands a terminal (control characters, among them the escape) or the order of writing.
pub(crate) fn commands(c: char) -> bool {
    // First the soft hyphen and marks of the order of writing, then characters without width, the mark of the byte
    // order, and tags.
    c.is_control()
        || matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}')
        || matches!(c, '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_to_sixty_characters() {
        assert_eq!(shown(&"é".repeat(60)), "é".repeat(60));
        assert_eq!(shown(&"é".repeat(61)), format!("{}...", "é".repeat(57)));
        assert_eq!(shown(&"a".repeat(15 << 20)).len(), 60);
        assert!(shown(&"\u{1b}".repeat(1000)).len() <= 60);
        assert_eq!(shown(""), "");
    }

    #[test]
    fn nothing_in_a_text_commands_the_terminal() {
        assert_eq!(shown("a\u{1b}[2Jb\nc\u{9b}d\u{7f}"), "a\\u{1b}[2Jb\\nc\\u{9b}d\\u{7f}");
        assert_eq!(shown("left\u{202e}right\u{feff}"), "left\\u{202e}right\\u{feff}");
        assert_eq!(shown("Gelenk-ß_関節"), "Gelenk-ß_関節");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(shown_number(-0.25), "-0.25");
        assert_eq!(shown_number(0.0), "0");
        assert_eq!(shown_number(1e300), "1e300");
        assert_eq!(shown_number(-1e-300), "-1e-300");
        assert_eq!(shown_number(f64::NAN), "NaN");
        assert!(shown_number(1.234_567_890_123_456e-300).len() < 30);
    }

    #[test]
    fn paths_are_one_argument_each() {
        for (path, text) in [
            ("logs/a_1.csv", "logs/a_1.csv"),
            ("my robot.toml", "'my robot.toml'"),
            ("it's.toml", r"'it'\''s.toml'"),
            ("m\n2.toml", r"$'m\n2.toml'"),
            ("a\u{1b}[2J'\\\u{200b}b", r"$'a\x1b[2J\'\\\xe2\x80\x8bb'"),
            ("", "''"),
        ] {
            assert_eq!(argument(Path::new(path)), text);
        }
        let long = "a".repeat(2000);
        assert_eq!(argument(Path::new(&format!("{long}\t"))), format!(r"$'{long}\t'"));
    }

    #[test]
    fn the_name_that_was_meant_is_said() {
        let found = with_meant("unknown field `refrence`, expected one of `file`, `reference`, `robot`");
        assert_eq!(found, "unknown field `refrence`. Did you mean `reference`?");
        let other = "unknown field `zzz`, expected one of `file`, `robot`";
        assert_eq!(with_meant(other), other);
        assert_eq!(with_meant("invalid type"), "invalid type");
    }

    #[test]
    fn numbers_have_no_needless_exponents_signs_and_zeros() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (5.66, "5.66"),
            (0.3721, "0.372"),
            (5.0, "5"),
            (99.96, "100"),
            (0.000_037_2, "3.72e-5"),
            (1e300, "1e300"),
            (1_234_567.0, "1.23e6"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(significant(value, 3), text);
        }
        for (value, text) in [(-0.0001, "0.000"), (-0.25, "-0.250"), (1e300, "1e300"), (0.0, "0.000")] {
            assert_eq!(with_decimals(value, 3), text);
        }
        assert_eq!([counted(1, "log"), counted(0, "log"), counted(2, "log")], ["1 log", "0 logs", "2 logs"]);
    }
}
