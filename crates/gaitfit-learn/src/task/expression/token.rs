//! From an expression's text to its words, numbers and signs.

use super::error::{ExpressionError, Problem};

/// Longest expression, bytes.
pub(super) const MAX_BYTES: usize = 1000;

/// Signs; longer ones before those that they begin with.
const SIGNS: &[&str] = &["<=", ">=", "==", "!=", "<", ">", "+", "-", "*", "/", "^", "(", ")", "[", "]", ","];

/// A piece of an expression.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    /// A number.
    Number(f32),
    /// A name.
    Word(String),
    /// A text in quotes.
    Text(String),
    /// A sign.
    Sign(&'static str),
    /// The end of the text.
    End,
}

impl Token {
    /// As it was written, nearly.
    pub(super) fn shown(&self) -> String {
        match self {
            Self::Number(number) => number.to_string(),
            Self::Word(word) => word.clone(),
            Self::Text(text) => format!("\"{text}\""),
            Self::Sign(sign) => (*sign).to_owned(),
            Self::End => "the end".to_owned(),
        }
    }
}

/// An error at byte `at` of `text`.
pub(super) fn wrong<T>(text: &str, at: usize, problem: Problem) -> Result<T, ExpressionError> {
    // A column counts characters, while `at` counts bytes.
    let column = text.get(..at).unwrap_or(text).chars().count() + 1;
    Err(ExpressionError { column, text: text.to_owned(), problem })
}

/// The tokens of a text with the byte at which each begins; the last is its end.
pub(super) fn tokens(text: &str) -> Result<Vec<(usize, Token)>, ExpressionError> {
    // The message shows only the beginning of a text that is too long.
    if text.len() > MAX_BYTES {
        let what = format!("{} bytes, more than {MAX_BYTES}", text.len());
        let short: String = text.chars().take(60).collect();
        return wrong(&short, 0, Problem::Size { what });
    }
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (length, token) = if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        } else if first.is_ascii_digit() || first == '.' {
            number(text, at)?
        } else if first.is_ascii_alphabetic() || first == '_' {
            let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let length = rest.find(|c| !word(c)).unwrap_or(rest.len());
            (length, Token::Word(rest[..length].to_owned()))
        } else if first == '"' || first == '\'' {
            let Some(length) = rest[1..].find(first) else {
                let (found, wanted) = ("the end".to_owned(), format!("the closing {first}"));
                return wrong(text, text.len(), Problem::Expected { found, wanted });
            };
            (length + 2, Token::Text(rest[1..=length].to_owned()))
        // Longer signs stand before their beginnings in the list, as `<=` before `<`.
        } else if let Some(sign) = SIGNS.iter().find(|sign| rest.starts_with(**sign)) {
            (sign.len(), Token::Sign(sign))
        } else {
            return wrong(text, at, Problem::Character(first.escape_debug().to_string()));
        };
        tokens.push((at, token));
        at += length;
    }
    tokens.push((text.len(), Token::End));
    Ok(tokens)
}

/// The number that begins at byte `at`.
fn number(text: &str, at: usize) -> Result<(usize, Token), ExpressionError> {
    let rest = &text[at..];
    // A second point is left to the standard parser, which refuses it below.
    let mut length = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
    // An `e` without digits is taken too, and the standard parser refuses it below.
    if let Some(exponent) = rest[length..].strip_prefix(['e', 'E']) {
        let sign = usize::from(exponent.starts_with(['+', '-']));
        let digits = &exponent[sign..];
        let count = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        length += 1 + sign + count;
    }
    // `2x` is no product.
    let stuck = rest[length..].find(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let whole = length + stuck.unwrap_or(rest.len() - length);
    match rest[..whole].parse::<f32>() {
        Ok(number) if number.is_finite() => Ok((whole, Token::Number(number))),
        _ => wrong(text, at, Problem::Number(rest[..whole].to_owned())),
    }
}
