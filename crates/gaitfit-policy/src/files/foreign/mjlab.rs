//! The metadata that mjlab's exporter writes into an ONNX file: comma-separated lists, numbers with three decimals.
//!
//! `joint_names`, `joint_stiffness`, `joint_damping`, `default_joint_pos`, `action_scale` (one number or a list),
//! `observation_names`, `command_names`, `run_path`. Control period, scales and histories are not in it.

use super::{Known, names, numbers, terms};
use crate::error::invalid;
use crate::{PolicyError, Quantity};
use gaitfit_model::shown;

/// Control period of mjlab's tasks: four physics steps of 5 ms.
const CONTROL_DT: f64 = 0.02;
/// Most entries of a list.
const MAX_ENTRIES: usize = 1024;

/// What the entries say of a policy of `inputs` numbers and `outputs` actions; `None` where another program wrote them.
pub(in crate::files) fn read(
    entries: &[(String, String)],
    inputs: usize,
    outputs: usize,
) -> Result<Option<Known>, PolicyError> {
    let entry = |key: &str| entries.iter().find(|(own, _)| own == key).map(|(_, value)| value.as_str());
    let (Some(joints), Some(observed)) = (entry("joint_names"), entry("observation_names")) else {
        return Ok(None);
    };
    let joints = list(joints, "joint_names")?;
    if joints.len() != outputs {
        return Err(invalid(format!(
            "its metadata names {} joints, its network gives {outputs} actions: which joints it moves is not known. \
             Describe it in a TOML file with `joints` (docs/policies.md)",
            joints.len()
        )));
    }
    let per_joint = |key: &str| -> Result<Vec<f64>, PolicyError> {
        let text = entry(key).ok_or_else(|| {
            invalid(format!("its metadata has no `{key}`; describe it in a TOML file (docs/policies.md)"))
        })?;
        let values = list(text, key)?.iter().map(|word| number(word, key)).collect::<Result<Vec<_>, _>>()?;
        match values[..] {
            [one] => Ok(vec![one; outputs]),
            _ if values.len() == outputs => Ok(values),
            _ => Err(invalid(format!(
                "`{key}` of its metadata has {} numbers for {outputs} joints",
                values.len()
            ))),
        }
    };
    let mut width = 0;
    let mut quantities = Vec::new();
    for name in list(observed, "observation_names")? {
        let quantity = Quantity::from_foreign(&name).ok_or_else(|| invalid(terms::unknown(&name)))?;
        width += quantity.width(outputs);
        quantities.push(quantity);
    }
    if width == 0 || !inputs.is_multiple_of(width) {
        return Err(invalid(format!(
            "the terms of its metadata have {width} numbers, its network takes {inputs}: terms of other widths are not \
             known here. Describe it in a TOML file (docs/policies.md)"
        )));
    }
    let history = inputs / width;
    let term = |quantity: crate::Quantity| {
        let mut term = toml::Table::new();
        term.insert("quantity".into(), quantity.name().into());
        if history > 1 {
            term.insert("history".into(), (history as i64).into());
        }
        toml::Value::Table(term)
    };
    let mut table = toml::Table::new();
    table.insert("joints".into(), names(&joints));
    for (to, from) in [
        ("default_pose", "default_joint_pos"),
        ("action_scale", "action_scale"),
        ("kp", "joint_stiffness"),
        ("kd", "joint_damping"),
    ] {
        table.insert(to.into(), numbers(&per_joint(from)?));
    }
    table.insert("control_dt".into(), CONTROL_DT.into());
    table.insert("observation".into(), toml::Value::Array(quantities.into_iter().map(term).collect()));
    let mut notes = vec![format!(
        "read with mjlab's metadata, which has no control period and no scales: taken as {CONTROL_DT} s and 1. A TOML \
         file with `file` and what is otherwise changes it"
    )];
    if history > 1 {
        notes.push(format!(
            "its network takes {history} times the numbers of its terms: taken as a history of {history} frames, term \
             after term"
        ));
    }
    Ok(Some(Known { table, notes }))
}

fn list(text: &str, key: &str) -> Result<Vec<String>, PolicyError> {
    let words: Vec<String> =
        text.split(',').take(MAX_ENTRIES + 1).map(|word| word.trim().to_owned()).collect();
    if words.len() > MAX_ENTRIES {
        return Err(invalid(format!("`{key}` of its metadata has more than {MAX_ENTRIES} entries")));
    }
    Ok(words)
}

fn number(word: &str, key: &str) -> Result<f64, PolicyError> {
    word.parse().map_err(|_| invalid(format!("`{key}` of its metadata holds `{}`, no number", shown(word))))
}
