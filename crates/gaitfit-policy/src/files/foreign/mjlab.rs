//! The metadata that mjlab's exporter writes into an ONNX file: comma-separated lists, numbers with three decimals.
//!
//! `joint_names`, `joint_stiffness`, `joint_damping`, `default_joint_pos`, `action_scale` (one number or a list),
//! `observation_names`, `command_names`, `run_path`. Since mjlab 1.6 also one entry a term, parts of which stand between
//! semicolons: `observation_terms_scale`, `observation_terms_history_length` (0 without one),
//! `observation_terms_flatten_history_dim`, `observation_terms_clip`. The control period is not in it. Policies
//! of motion tracking also have `anchor_body_name`.

use super::{Known, names, numbers, terms};
use crate::error::invalid;
use crate::{PolicyError, Quantity};
use gaitfit_model::{shown, shown_number};

/// Control period of mjlab's tasks: four physics steps of 5 ms.
const CONTROL_DT: f64 = 0.02;
/// Bounds beyond which a clipped term counts as not clipped.
const FAR: f64 = 50.0;
/// Max frames of a history.
const MAX_HISTORY: f64 = 256.0;
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
    let tracks = entry("anchor_body_name");
    // The quantities of the policy, and the number of the term that each is of: a motion's command is two.
    let (mut quantities, mut of) = (Vec::new(), Vec::new());
    let named = list(observed, "observation_names")?;
    for (number, name) in named.iter().enumerate() {
        if tracks.is_none() && terms::is_of_tracking(name) {
            return Err(invalid(format!(
                "it observes `{name}`, and its metadata has no `anchor_body_name`, the body that it is of; export it again with \
                 mjlab, or describe it in a TOML file (docs/policies-motion.md)"
            )));
        }
        let found = match tracks {
            Some(_) => terms::of_motion(name),
            None => None,
        };
        let found = match found {
            Some(found) => found.to_vec(),
            None => vec![Quantity::from_foreign(name).ok_or_else(|| invalid(terms::unknown(name)))?],
        };
        of.extend(found.iter().map(|_| number));
        quantities.extend(found);
    }
    let of_terms = |key: &str| -> Result<Option<Vec<Vec<f64>>>, PolicyError> {
        let Some(text) = entry(key) else { return Ok(None) };
        let words = list(text, key)?;
        if words.len() != named.len() {
            let (found, terms) = (words.len(), named.len());
            return Err(invalid(format!("`{key}` of its metadata has {found} entries for {terms} terms")));
        }
        let numbers = |word: &String| {
            word.split(';')
                .take(MAX_ENTRIES)
                .map(|part| number(part.trim(), key))
                .collect::<Result<Vec<_>, _>>()
        };
        let all: Vec<Vec<f64>> = words.iter().map(numbers).collect::<Result<_, _>>()?;
        // A list of a motion's command is cut into those of its two quantities.
        let of_quantity = |(&number, quantity): (&usize, &Quantity)| {
            let (values, width) = (&all[number], quantity.width(outputs));
            match quantity {
                Quantity::ReferenceJointPosition if values.len() == 2 * width => values[..width].to_vec(),
                Quantity::ReferenceJointVelocity if values.len() == 2 * width => values[width..].to_vec(),
                _ => values.clone(),
            }
        };
        Ok(Some(of.iter().zip(&quantities).map(of_quantity).collect()))
    };
    let stated = of_terms("observation_terms_history_length")?;
    let per_frame: usize = quantities.iter().map(|quantity| quantity.width(outputs)).sum();
    let (histories, is_guessed) = match &stated {
        Some(lengths) => {
            let length = |numbers: &Vec<f64>| match numbers.first().copied().unwrap_or(0.0) {
                length if (0.0..=MAX_HISTORY).contains(&length) && length.fract() == 0.0 => {
                    Ok((length as usize).max(1))
                }
                length => Err(invalid(format!(
                    "`observation_terms_history_length` of its metadata has {}; a history has 0 to {MAX_HISTORY} frames",
                    shown_number(length)
                ))),
            };
            (lengths.iter().map(length).collect::<Result<Vec<usize>, _>>()?, false)
        }
        None => {
            let length = inputs.checked_div(per_frame).unwrap_or(0);
            (vec![length; quantities.len()], length > 1)
        }
    };
    let width = quantities.iter().zip(&histories).try_fold(0_usize, |sum, (quantity, &length)| {
        sum.checked_add(quantity.width(outputs).checked_mul(length)?)
    });
    if width != Some(inputs) || inputs == 0 {
        return Err(invalid(format!(
            "the terms of its metadata have {} numbers, its network takes {inputs}: terms of other widths are not known \
             here. Describe it in a TOML file (docs/policies.md)",
            width.unwrap_or(usize::MAX)
        )));
    }
    let is_motion = |quantity: &Quantity| {
        matches!(quantity, Quantity::ReferenceJointPosition | Quantity::ReferenceJointVelocity)
    };
    if quantities.iter().zip(&histories).any(|(quantity, &length)| is_motion(quantity) && length > 1) {
        return Err(invalid(
            "its metadata has a history of the motion's command, whose frames hold angles and velocities in turn: this is not \
             read",
        ));
    }
    let flat = of_terms("observation_terms_flatten_history_dim")?.unwrap_or_default();
    if flat.iter().zip(&histories).any(|(flat, &length)| length > 1 && flat.first() == Some(&0.0)) {
        return Err(invalid(
            "its metadata has a history that is not flat; describe it in a TOML file (docs/policies.md)",
        ));
    }
    let clips = of_terms("observation_terms_clip")?.unwrap_or_default();
    if let Some((quantity, clip)) =
        quantities.iter().zip(&clips).find(|(_, clip)| clip.iter().any(|limit| limit.abs() < FAR))
    {
        let name = quantity.name();
        return Err(invalid(format!(
            "its metadata clips {name} to {clip:?}, which is not known here: describe it in a TOML file without the clip, if \
             the robot stays within it (docs/policies.md)"
        )));
    }
    let scales = of_terms("observation_terms_scale")?;
    let term = |(place, quantity): (usize, &Quantity)| {
        let mut term = toml::Table::new();
        term.insert("quantity".into(), quantity.name().into());
        if histories[place] > 1 {
            term.insert("history".into(), (histories[place] as i64).into());
        }
        match scales.as_ref().map(|scales| &scales[place][..]) {
            None | Some([1.0]) => {}
            Some([one]) => {
                term.insert("scale".into(), (*one).into());
            }
            Some(many) => {
                term.insert("scale".into(), numbers(many));
            }
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
    table.insert("observation".into(), toml::Value::Array(quantities.iter().enumerate().map(term).collect()));
    let lacks = if scales.is_some() { "" } else { " and no scales" };
    let taken = if scales.is_some() { "" } else { " and 1" };
    let mut notes = vec![format!(
        "read with mjlab's metadata, which has no control period{lacks}: taken as {CONTROL_DT} s{taken}. A TOML file with \
         `file` and what is otherwise changes it"
    )];
    if is_guessed {
        let history = histories.first().copied().unwrap_or(1);
        notes.push(format!(
            "its network takes {history} times the numbers of its terms: taken as a history of {history} frames, term \
             after term"
        ));
    }
    if let Some(body) = tracks {
        // Where it is shows on a robot.
        table.insert("anchor_body".into(), body.into());
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
