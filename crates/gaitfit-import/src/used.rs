//! Finds parts of a mapping that match nothing in the recording, and writes messages about them.

use crate::ImportError;
use crate::arrays::named;
use crate::mapping::{Mapping, Names};
use crate::table::Source;
use gaitfit_model::shown;

/// Max number of names of streams in a message.
pub(crate) const MAX_SHOWN: usize = 20;

/// Notes which names of `streams.take` the source has.
pub(crate) fn note_taken(source: &mut Source, mapping: &Mapping) {
    if source.chosen {
        return;
    }
    let mut names: Vec<&String> = source.tables.iter().map(|table| &table.name).collect();
    names.dedup();
    let columns = source.tables.iter().flat_map(|table| table.columns.keys());
    let all: Vec<&String> = names.iter().copied().chain(columns).collect();
    let begins = |wanted: &&String| all.iter().any(|name| name.starts_with(wanted.as_str()));
    let taken: Vec<String> = mapping.streams.take.iter().filter(begins).cloned().collect();
    // Topics are named before their columns; a table's columns are all that it can be asked for by.
    let shown: Vec<String> = all.iter().take(MAX_SHOWN).map(|name| (*name).clone()).collect();
    source.taken.extend(taken);
    source.takeable.extend(shown);
}

/// Refuses names of `streams.take` that no source has.
pub(crate) fn all_taken(sources: &[Source], mapping: &Mapping) -> Result<(), ImportError> {
    let missing = |wanted: &&String| !sources.iter().any(|source| source.taken.contains(wanted));
    let Some(wanted) = mapping.streams.take.iter().find(missing) else { return Ok(()) };
    let names = sources.iter().flat_map(|source| &source.takeable).take(MAX_SHOWN);
    let found = names.map(|name| shown(name)).collect::<Vec<_>>().join(", ");
    Err(ImportError::NoSuchStream { wanted: wanted.clone(), found })
}

/// Refuses names and templates of `[columns]` that no source has a column for, and says what else of the mapping none has.
pub(crate) fn all_used(sources: &[Source], mapping: &Mapping) -> Result<Vec<String>, ImportError> {
    for (_, names) in named(&mapping.columns) {
        let Some(Names::One(pattern)) = names else { continue };
        if !sources.iter().any(|source| source.fitted.contains(pattern)) {
            let columns: Vec<&String> = sources.iter().flat_map(|source| &source.columns).collect();
            return Err(no_column(pattern, &columns));
        }
    }
    let missing = |joint: &&String| !sources.iter().any(|source| source.renamed.contains(joint));
    let names = mapping.joint_names.keys().filter(missing);
    let mut unused: Vec<String> = names
        .map(|joint| format!("[joint_names] `{}`: the recording names no such joint", shown(joint)))
        .collect();
    if mapping.states_joints && !sources.iter().any(|source| source.numbered) {
        unused.push("`joints` of the mapping: the recording numbers no joints".to_owned());
    }
    Ok(unused)
}

/// The error of a name or template that is none of `columns`.
pub(crate) fn no_column(pattern: &str, columns: &[&String]) -> ImportError {
    let problem = format!("no column fits `{}`; the file has {}", shown(pattern), first_names(columns));
    ImportError::Mapping { problem }
}

fn first_names(names: &[&String]) -> String {
    names.iter().take(30).map(|name| shown(name)).collect::<Vec<_>>().join(", ")
}
