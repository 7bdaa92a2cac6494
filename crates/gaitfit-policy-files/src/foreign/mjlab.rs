//! The metadata that mjlab's exporter writes into an ONNX file: comma-separated lists, numbers with three decimals.
//!
//! `joint_names`, `joint_stiffness`, `joint_damping`, `default_joint_pos`, `action_scale` (one number or a list),
//! `observation_names`, `command_names`, `run_path`. Since mjlab 1.6 also one entry a term, parts of which stand between
//! semicolons: `observation_terms_scale`, `observation_terms_history_length` (0 without one),
//! `observation_terms_flatten_history_dim`, `observation_terms_clip`. The control period is not in it. Policies
//! of motion tracking also have `anchor_body_name`.

use super::{FAR, Known, Note, names, numbers, terms};
use gaitfit_model::{shown, shown_number};
use gaitfit_policy::invalid;
use gaitfit_policy::{PolicyError, Quantity};

/// Control period of mjlab's tasks: four physics steps of 5 ms.
const CONTROL_DT: f64 = 0.02;
/// Control periods by which it reads the motion ahead: it counts the motion on before it observes, also after a reset.
const AHEAD: i64 = 1;
/// Max frames of a history.
const MAX_HISTORY: f64 = 256.0;
/// Max number of entries of a list.
const MAX_ENTRIES: usize = 1024;

/// Reads the entries of a policy of `inputs` numbers and `outputs` actions; `None` if another program wrote
/// them.
pub(crate) fn read(
    entries: &[(String, String)],
    inputs: usize,
    outputs: usize,
) -> Result<Option<Known>, PolicyError> {
    let entries = Entries { entries, outputs };
    let (Some(joints), Some(observed)) = (entries.get("joint_names"), entries.get("observation_names"))
    else {
        return Ok(None);
    };
    let joints = list(joints, "joint_names")?;
    // Without this the gains and scales could go to the wrong joints.
    if joints.len() != outputs {
        return Err(invalid(format!(
            "its metadata names {} joints, its network gives {outputs} actions: which joints it moves is not known. \
             Describe it in a TOML file with `joints` (docs/policies.md)",
            joints.len()
        )));
    }
    let tracks = entries.get("anchor_body_name");
    let terms = Terms::new(&list(observed, "observation_names")?, tracks.is_some())?;
    let (histories, is_guessed) = terms.histories(&entries, inputs)?;
    terms.check(&entries, inputs, &histories)?;
    let scales = terms.lists(&entries, "observation_terms_scale")?;
    let mut table = toml::Table::new();
    table.insert("joints".into(), names(&joints));
    for (to, from) in [
        ("default_pose", "default_joint_pos"),
        ("action_scale", "action_scale"),
        ("kp", "joint_stiffness"),
        ("kd", "joint_damping"),
    ] {
        table.insert(to.into(), numbers(&entries.per_joint(from)?));
    }
    table.insert("control_dt".into(), CONTROL_DT.into());
    table.insert("observation".into(), terms.described(&histories, scales.as_deref()));
    let lacks = if scales.is_some() { "" } else { " and no scales" };
    let taken = if scales.is_some() { "" } else { " and 1" };
    let text = format!(
        "read with mjlab's metadata, which has no control period{lacks}: taken as {CONTROL_DT} s{taken}. A TOML file with \
         `file` and what is otherwise changes it"
    );
    let mut notes = vec![Note { entries: &["control_dt", "observation"], text }];
    if is_guessed {
        let history = histories.first().copied().unwrap_or(1);
        let text = format!(
            "its network takes {history} times the numbers of its terms: taken as a history of {history} frames, term \
             after term"
        );
        notes.push(Note { entries: &["observation"], text });
    }
    if let Some(body) = tracks {
        // Where it is shows on a robot.
        table.insert("anchor_body".into(), body.into());
    }
    Ok(Some(Known { table, notes }))
}

/// The metadata of a policy of `outputs` actions.
struct Entries<'a> {
    entries: &'a [(String, String)],
    outputs: usize,
}

impl Entries<'_> {
    fn get(&self, key: &str) -> Option<&str> {
        self.entries.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// A number a joint; the metadata has as many, or one for all.
    fn per_joint(&self, key: &str) -> Result<Vec<f64>, PolicyError> {
        let text = self.get(key).ok_or_else(|| {
            invalid(format!("its metadata has no `{key}`; describe it in a TOML file (docs/policies.md)"))
        })?;
        let values = list(text, key)?.iter().map(|word| number(word, key)).collect::<Result<Vec<_>, _>>()?;
        let outputs = self.outputs;
        match values[..] {
            [one] => Ok(vec![one; outputs]),
            _ if values.len() == outputs => Ok(values),
            _ => Err(invalid(format!(
                "`{key}` of its metadata has {} numbers for {outputs} joints",
                values.len()
            ))),
        }
    }
}

/// The terms of the observation.
struct Terms {
    /// Number of terms that the metadata names.
    count: usize,
    /// Their quantities, and the number of the term that each is of: a motion's command is two.
    quantities: Vec<(usize, Quantity)>,
}

impl Terms {
    fn new(named: &[String], tracks: bool) -> Result<Self, PolicyError> {
        let mut quantities = Vec::new();
        for (number, name) in named.iter().enumerate() {
            if !tracks && terms::is_of_tracking(name) {
                return Err(invalid(format!(
                    "it observes `{name}`, and its metadata has no `anchor_body_name`, the body that it is of; export it \
                     again with mjlab, or describe it in a TOML file (docs/policies-motion.md)"
                )));
            }
            // One term of a motion may be several quantities.
            let of_term = match if tracks { terms::of_motion(name) } else { None } {
                Some(several) => several.to_vec(),
                None => vec![Quantity::from_foreign(name).ok_or_else(|| invalid(terms::unknown(name)))?],
            };
            quantities.extend(of_term.into_iter().map(|quantity| (number, quantity)));
        }
        Ok(Self { count: named.len(), quantities })
    }

    /// A list of numbers for each quantity; `None` where the metadata has no such entry.
    fn lists(&self, entries: &Entries, key: &str) -> Result<Option<Vec<Vec<f64>>>, PolicyError> {
        let Some(text) = entries.get(key) else { return Ok(None) };
        let words = list(text, key)?;
        if words.len() != self.count {
            let (count, terms) = (words.len(), self.count);
            return Err(invalid(format!("`{key}` of its metadata has {count} entries for {terms} terms")));
        }
        let numbers = |word: &String| {
            word.split(';')
                .take(MAX_ENTRIES)
                .map(|part| number(part.trim(), key))
                .collect::<Result<Vec<_>, _>>()
        };
        let all: Vec<Vec<f64>> = words.iter().map(numbers).collect::<Result<_, _>>()?;
        // A list of a motion's command is cut into those of its two quantities.
        let of_quantity = |(number, quantity): &(usize, Quantity)| {
            let (values, width) = (&all[*number], quantity.width(entries.outputs));
            match quantity {
                Quantity::ReferenceJointPosition if values.len() == 2 * width => values[..width].to_vec(),
                Quantity::ReferenceJointVelocity if values.len() == 2 * width => values[width..].to_vec(),
                _ => values.clone(),
            }
        };
        Ok(Some(self.quantities.iter().map(of_quantity).collect()))
    }

    /// Frames of each quantity, and whether they follow from the network's width alone.
    fn histories(&self, entries: &Entries, inputs: usize) -> Result<(Vec<usize>, bool), PolicyError> {
        if let Some(lengths) = self.lists(entries, "observation_terms_history_length")? {
            let length = |numbers: &Vec<f64>| match numbers.first().copied().unwrap_or(0.0) {
                length if (0.0..=MAX_HISTORY).contains(&length) && length.fract() == 0.0 => {
                    // 0 stands for a term without a history: the present frame alone.
                    Ok((length as usize).max(1))
                }
                length => Err(invalid(format!(
                    "`observation_terms_history_length` of its metadata has {}; a history has 0 to {MAX_HISTORY} frames",
                    shown_number(length)
                ))),
            };
            return Ok((lengths.iter().map(length).collect::<Result<Vec<usize>, _>>()?, false));
        }
        let per_frame: usize =
            self.quantities.iter().map(|(_, quantity)| quantity.width(entries.outputs)).sum();
        // Before mjlab 1.6 nothing states the history: the network's width does.
        let length = inputs.checked_div(per_frame).unwrap_or(0);
        Ok((vec![length; self.quantities.len()], length > 1))
    }

    /// Refuses terms that are not the network's, and histories and clips that are not read.
    fn check(&self, entries: &Entries, inputs: usize, histories: &[usize]) -> Result<(), PolicyError> {
        let quantities = || self.quantities.iter().map(|(_, quantity)| *quantity);
        // The lengths come from a file, so the sum may overflow.
        let width = quantities().zip(histories).try_fold(0_usize, |sum, (quantity, &length)| {
            sum.checked_add(quantity.width(entries.outputs).checked_mul(length)?)
        });
        if width != Some(inputs) || inputs == 0 {
            return Err(invalid(format!(
                "the terms of its metadata have {} numbers, its network takes {inputs}: terms of other widths are not known \
                 here. Describe it in a TOML file (docs/policies.md)",
                width.unwrap_or(usize::MAX)
            )));
        }
        let is_motion = |quantity: Quantity| {
            matches!(quantity, Quantity::ReferenceJointPosition | Quantity::ReferenceJointVelocity)
        };
        // gaitfit stores each quantity's frames together, so frames that alternate have no place in a description.
        if quantities().zip(histories).any(|(quantity, &length)| is_motion(quantity) && length > 1) {
            return Err(invalid(
                "its metadata has a history of the motion's command, whose frames hold angles and velocities in turn: this is \
                 not read",
            ));
        }
        let flat = self.lists(entries, "observation_terms_flatten_history_dim")?.unwrap_or_default();
        if flat.iter().zip(histories).any(|(flat, &length)| length > 1 && flat.first() == Some(&0.0)) {
            return Err(invalid(
                "its metadata has a history that is not flat; describe it in a TOML file (docs/policies.md)",
            ));
        }
        let clips = self.lists(entries, "observation_terms_clip")?.unwrap_or_default();
        if let Some((quantity, clip)) =
            quantities().zip(&clips).find(|(_, clip)| clip.iter().any(|limit| limit.abs() < FAR))
        {
            let name = quantity.name();
            return Err(invalid(format!(
                "its metadata clips {name} to {clip:?}, which is not known here: describe it in a TOML file without the clip, \
                 if the robot stays within it (docs/policies.md)"
            )));
        }
        Ok(())
    }

    /// The observation of a description.
    fn described(&self, histories: &[usize], scales: Option<&[Vec<f64>]>) -> toml::Value {
        let term = |(place, (_, quantity)): (usize, &(usize, Quantity))| {
            let mut term = toml::Table::new();
            term.insert("quantity".into(), quantity.name().into());
            if histories[place] > 1 {
                term.insert("history".into(), (histories[place] as i64).into());
            }
            if quantity.is_of_reference() {
                term.insert("ahead".into(), AHEAD.into());
            }
            match scales.map(|scales| &scales[place][..]) {
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
        toml::Value::Array(self.quantities.iter().enumerate().map(term).collect())
    }
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
