//! Errors in the text of an expression.

use gaitfit_model::shown;

use super::operator::Function;
use super::quantity::Quantity;

/// What is wrong in the text of an expression, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{}` is wrong at character {column}: {problem}", shown(text))]
pub struct ExpressionError {
    /// Where, from 1.
    pub column: usize,
    /// The expression.
    pub text: String,
    /// The fault, and what could stand there instead.
    pub problem: Problem,
}

/// Faults of an expression.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// Too long, too deep, or too much of something.
    #[error("it has {what}; put parts into terms of their own")]
    Size {
        /// Part that there is too much of, with its limit.
        what: String,
    },
    /// A character that means nothing.
    #[error("`{0}` means nothing here")]
    Character(String),
    /// A number that cannot be read or is not finite.
    #[error("`{}` is no number", shown(.0))]
    Number(String),
    /// Something else must be here.
    #[error("`{}` stands where {wanted} must be", shown(found))]
    Expected {
        /// Text that was found.
        found: String,
        /// Text that was expected.
        wanted: String,
    },
    /// A name that means nothing.
    #[error("there is no `{}`{}. {}", shown(name), did_you_mean(.nearest.as_deref()), all_names())]
    Unknown {
        /// The name.
        name: String,
        /// The one that is most like it.
        nearest: Option<String>,
    },
    /// A pattern that covers no element.
    #[error("`{}` matches no element of `{quantity}`; they are {}", shown(pattern), list(names))]
    NoElement {
        /// The pattern.
        pattern: String,
        /// Quantity whose element is unknown.
        quantity: &'static str,
        /// Its elements, or those that are most like it.
        names: Vec<String>,
    },
    /// A pattern that cannot be read.
    #[error("{0}")]
    Pattern(String),
    /// A single number has no elements.
    #[error("`{0}` is a single number and has no elements to pick")]
    NoRow(&'static str),
    /// Rows of different lengths.
    #[error(
        "a row of {0} numbers and one of {1} do not go together; pick elements, or make each a number first"
    )]
    Lengths(usize, usize),
    /// The whole must be a number.
    #[error("it is a row of {0} numbers; make it one with sum, mean, norm, min or max")]
    Row(usize),
    /// A comparison of comparisons.
    #[error("compare two at a time, and join comparisons with `and`")]
    Chained,
    /// A clamp whose least is above its largest.
    #[error("`clamp` goes from {0} to {1}, and its least must not be above its largest; exchange them")]
    Clamp(String, String),
    /// A function with another number of arguments.
    #[error("`{function}` takes {wanted}, not {found}")]
    Arguments {
        /// Which.
        function: String,
        /// Number of arguments that it takes.
        wanted: &'static str,
        /// Number of arguments that were given.
        found: usize,
    },
}

fn did_you_mean(name: Option<&str>) -> String {
    name.map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

fn list(names: &[String]) -> String {
    let names: Vec<String> = names.iter().map(|name| shown(name)).collect();
    names.join(", ")
}

/// All names of quantities and functions.
fn all_names() -> String {
    let quantities: Vec<&str> = Quantity::ALL.iter().map(|quantity| quantity.name()).collect();
    format!("Quantities: {}. Functions: {}", quantities.join(", "), functions().join(", "))
}

fn functions() -> Vec<&'static str> {
    Function::all().map(|(name, _)| name).collect()
}

/// The name of a quantity or function that is most like `name`, if one is like it.
pub(super) fn nearest(name: &str) -> Option<String> {
    let known = Quantity::ALL.iter().map(|quantity| quantity.name()).chain(functions());
    let scored = known.map(|known| (strsim::jaro_winkler(name, known), known));
    let (score, known) = scored.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (score > 0.7).then(|| known.to_owned())
}

/// Max number of element names in a message.
const MAX_NAMES: usize = 8;

/// Names of elements for a message: all if they are few, else those that are most like `pattern`.
pub(super) fn elements_like(pattern: &str, names: &[&str]) -> Vec<String> {
    let mut names: Vec<&str> = names.to_vec();
    if names.len() > MAX_NAMES {
        let score = |name: &str| strsim::sorensen_dice(pattern, name);
        names.sort_by(|a, b| score(b).total_cmp(&score(a)));
        names.truncate(MAX_NAMES - 1);
        names.push("...");
    }
    names.into_iter().map(str::to_owned).collect()
}
