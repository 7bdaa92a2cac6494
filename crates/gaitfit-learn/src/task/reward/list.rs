//! The reward terms of a task: built in, written as expressions, or a library user's functions.

use gaitfit_model::shown;
use gaitfit_policy::walker::Walker;

use super::TERMS;
use crate::task::error::refuse;
use crate::task::expression::{Expression, Names};
use crate::task::{Moment, TaskError, TaskSettings};

/// Max number of terms that the settings define.
const MAX_EXPRESSIONS: usize = 64;
/// Longest name of a term, bytes.
const MAX_NAME: usize = 64;

/// Source of a reward term's value.
pub enum Value {
    /// An expression: of [`TERMS`], or of the settings.
    Expression(Expression),
    /// A function of a library's user.
    Own(Box<dyn Fn(&Moment<'_>) -> f32 + Send + Sync>),
}

/// A reward term of a task.
pub(in crate::task) struct WeightedTerm {
    pub(in crate::task) name: String,
    /// Weight times the control step.
    pub(in crate::task) weight: f32,
    pub(in crate::task) value: Value,
}

/// The settings' reward terms of non-zero weight. Expressions of weight zero are read as well.
pub(in crate::task) fn listed(
    settings: &TaskSettings,
    walker: &Walker,
) -> Result<Vec<WeightedTerm>, TaskError> {
    let names = Names::new(settings, walker);
    let mut expressions = expressions(settings, &names)?;
    let mut terms = Vec::new();
    for (name, &weight) in &settings.rewards {
        let built_in = TERMS.iter().find(|term| term.name == name);
        let built_in = built_in.map(|term| read(name, term.text, &names)).transpose()?;
        // Taken out of the list: what is left at the end has no weight.
        let written = expressions.iter().position(|(other, _)| *other == name);
        // The order of what is left does not matter: one of them is named in the error.
        let written = written.map(|place| expressions.swap_remove(place).1);
        let Some(expression) = built_in.or(written) else {
            let known = TERMS.iter().map(|term| term.name).chain(settings.terms.keys().map(String::as_str));
            let known: Vec<_> = known.collect();
            let what = format!(
                "has `{}`; known terms: {}. A term of your own is an expression in task.terms",
                shown(name),
                known.join(", ")
            );
            return refuse("rewards", what);
        };
        if !weight.is_finite() {
            return refuse("rewards", format!("gives `{name}` the weight {weight}"));
        }
        if weight != 0.0 {
            // Weights are per second, as in legged_gym, so another control period keeps their meaning.
            let weight = (weight * walker.interface.control_dt) as f32;
            terms.push(WeightedTerm { name: name.clone(), weight, value: Value::Expression(expression) });
        }
    }
    match expressions.first() {
        Some((name, _)) => refuse(
            "terms",
            format!("has `{name}`, which task.rewards gives no weight; give it one there (0 turns it off)"),
        ),
        None => Ok(terms),
    }
}

/// The settings' own terms.
fn expressions<'a>(
    settings: &'a TaskSettings,
    names: &Names<'_>,
) -> Result<Vec<(&'a str, Expression)>, TaskError> {
    if settings.terms.len() > MAX_EXPRESSIONS {
        return refuse("terms", format!("has {} terms; at most {MAX_EXPRESSIONS}", settings.terms.len()));
    }
    let mut expressions = Vec::new();
    for (name, text) in &settings.terms {
        let letters = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
        if !letters || !begins || name.len() > MAX_NAME {
            let what = format!(
                "has a term `{}`; a name begins with a letter and has letters, digits and _, at most {MAX_NAME}",
                shown(name)
            );
            return refuse("terms", what);
        }
        if TERMS.iter().any(|term| term.name == name) {
            return refuse("terms", format!("has `{name}`, which is built in; give it another name"));
        }
        expressions.push((name.as_str(), read(name, text, names)?));
    }
    Ok(expressions)
}

fn read(name: &str, text: &str, names: &Names<'_>) -> Result<Expression, TaskError> {
    let refused = |error| TaskError::Expression { term: name.to_owned(), error: Box::new(error) };
    Expression::new(text, names).map_err(refused)
}
