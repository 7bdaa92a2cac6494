//! `deploy.yaml`, which unitree_rl_lab writes beside a policy's ONNX file.
//!
//! Joints have no names in it: `joint_ids_map` gives each of the policy's joints its place in Unitree's SDK, whose lists
//! are known here for each robot by their length. Gains are in the SDK's order, everything else in the policy's.

use super::{FAR, Known, Note, names, numbers, sdk, terms};
use gaitfit_policy::invalid;
use gaitfit_policy::{PolicyError, Quantity};
use indexmap::IndexMap;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Max numbers of joints and of terms.
const MAX_ENTRIES: usize = 256;
/// Max frames of a history.
const MAX_FRAMES: usize = 1 << 20;

#[derive(Deserialize)]
struct Deploy {
    joint_ids_map: Vec<usize>,
    step_dt: f64,
    stiffness: Vec<f64>,
    damping: Vec<f64>,
    default_joint_pos: Vec<f64>,
    actions: IndexMap<String, Action>,
    observations: IndexMap<String, Entry>,
}

#[derive(Deserialize)]
struct Action {
    clip: Option<Vec<Vec<f64>>>,
    scale: Option<Numbers>,
    offset: Option<Numbers>,
    joint_ids: Option<JointIds>,
}

/// Numbers of joints, or the start, stop and step of a Python slice of them.
#[derive(Deserialize)]
struct JointIds(Vec<Option<usize>>);

impl JointIds {
    /// Whether these are all of `count` joints, in their order.
    fn are_all(ids: Option<&Self>, count: usize) -> bool {
        let slice = |ids: &[Option<usize>]| match ids {
            [start, stop, step] => {
                start.is_none_or(|start| start == 0)
                    && stop.is_none_or(|stop| stop == count)
                    && step.is_none_or(|step| step == 1)
            }
            _ => false,
        };
        ids.is_none_or(|Self(ids)| ids.iter().copied().eq((0..count).map(Some)) || slice(ids))
    }
}

/// An entry of `observations`.
#[derive(Deserialize)]
#[serde(untagged)]
enum Entry {
    /// A setting of all terms, such as `use_gym_history`.
    Switch(bool),
    Term(Term),
    Group(IndexMap<String, GroupEntry>),
}

#[derive(Deserialize)]
#[serde(untagged)]
enum GroupEntry {
    Switch(bool),
    Term(Term),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Term {
    params: Option<Params>,
    scale: Option<Numbers>,
    clip: Option<Vec<f64>>,
    history_length: Option<usize>,
}

#[derive(Deserialize)]
struct Params {
    asset_cfg: Option<Asset>,
}

#[derive(Deserialize)]
struct Asset {
    joint_ids: Option<JointIds>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Numbers {
    One(f64),
    Many(Vec<f64>),
}

impl Numbers {
    fn spread(&self, count: usize) -> Vec<f64> {
        match self {
            Self::One(one) => vec![*one; count],
            Self::Many(many) => many.clone(),
        }
    }
}

/// The file that belongs to a policy: beside it, in `params` beside it, or in `params` beside its folder.
pub(crate) fn beside(policy: &Path) -> Option<PathBuf> {
    let folder = policy.parent()?;
    // A bare file name has an empty folder, which is the working directory: the folder above it is `..`.
    let outer = if folder.as_os_str().is_empty() { Path::new("..").to_owned() } else { folder.join("..") };
    [folder.join("deploy.yaml"), folder.join("params/deploy.yaml"), outer.join("params/deploy.yaml")]
        .into_iter()
        .find(|path| path.is_file())
}

/// Reads the file's text.
pub(crate) fn read(text: &str) -> Result<Known, PolicyError> {
    let deploy: Deploy = serde_saphyr::from_str(text).map_err(|error| unreadable(&error.to_string()))?;
    let count = deploy.joint_ids_map.len();
    // Gains are listed for every place of the SDK, so their number tells which robot it is.
    let slots = deploy.stiffness.len();
    if count == 0 {
        return Err(invalid("joint_ids_map is empty"));
    }
    if count > MAX_ENTRIES || deploy.observations.len() > MAX_ENTRIES {
        return Err(invalid(format!(
            "{count} joints and {} terms; at most {MAX_ENTRIES}",
            deploy.observations.len()
        )));
    }
    if let Some(slot) = (1..count)
        .find_map(|k| Some(deploy.joint_ids_map[k]).filter(|slot| deploy.joint_ids_map[..k].contains(slot)))
    {
        return Err(invalid(format!("joint_ids_map has place {slot} twice")));
    }
    if deploy.default_joint_pos.len() != count {
        let numbers = deploy.default_joint_pos.len();
        return Err(invalid(format!("default_joint_pos has {numbers} numbers for {count} joints")));
    }
    let Some((robot, sdk)) = sdk::with_places(slots) else {
        return Err(invalid(format!(
            "it has gains of {slots} joints, and no robot of unitree_rl_lab is known with as many: describe the policy in \
             a TOML file with `joints` (docs/policies.md)"
        )));
    };
    // A place without a motor has an empty name: a policy that moves it is of another robot.
    let joints: Option<Vec<String>> = deploy
        .joint_ids_map
        .iter()
        .map(|&slot| sdk.get(slot).filter(|name| !name.is_empty()).map(|name| (*name).to_owned()))
        .collect();
    let (Some(joints), true) = (joints, deploy.damping.len() == slots) else {
        return Err(invalid(format!(
            "joint_ids_map, stiffness and damping do not belong together ({robot} has {slots} places)"
        )));
    };
    let of_policy = |values: &[f64]| -> Vec<f64> {
        deploy.joint_ids_map.iter().filter_map(|&slot| values.get(slot).copied()).collect()
    };
    let (name, action) = match deploy.actions.iter().next() {
        Some((name, action)) if deploy.actions.len() == 1 => (name, action),
        _ => return Err(invalid(format!("it has {} actions; one is read", deploy.actions.len()))),
    };
    if name != "JointPositionAction" {
        return Err(invalid(format!("its action is `{name}`; only JointPositionAction is read")));
    }
    if action.clip.is_some() {
        return Err(invalid(
            "its action clips targets; describe the policy in a TOML file (docs/policies.md)",
        ));
    }
    if !JointIds::are_all(action.joint_ids.as_ref(), count) {
        return Err(invalid(
            "its action moves some of the joints, or in another order; describe the policy in a TOML file (docs/policies.md)",
        ));
    }
    let pose = &deploy.default_joint_pos;
    // The program adds nothing where it is null.
    let offset = action.offset.as_ref().unwrap_or(&Numbers::One(0.0)).spread(count);
    // Both are written from the same numbers; YAML may round them.
    let apart = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-6;
    if offset.len() != pose.len() || offset.iter().zip(pose).any(apart) {
        return Err(invalid(
            "the action's offset is not default_joint_pos: gaitfit's policies have one pose for both",
        ));
    }
    let (observation, order) = observed(&deploy.observations, count)?;
    let mut table = toml::Table::new();
    table.insert("joints".into(), names(&joints));
    table.insert("default_pose".into(), numbers(pose));
    table.insert(
        "action_scale".into(),
        numbers(&action.scale.as_ref().unwrap_or(&Numbers::One(1.0)).spread(count)),
    );
    table.insert("kp".into(), numbers(&of_policy(&deploy.stiffness)));
    table.insert("kd".into(), numbers(&of_policy(&deploy.damping)));
    table.insert("control_dt".into(), deploy.step_dt.into());
    table.insert("observation".into(), toml::Value::Array(observation));
    if let Some(order) = order {
        let mut history = toml::Table::new();
        history.insert("order".into(), order.into());
        table.insert("history".into(), toml::Value::Table(history));
    }
    let text = format!(
        "read with unitree_rl_lab's deploy.yaml, whose {slots} gains are taken as those of the {robot} in the order of \
         Unitree's SDK"
    );
    let notes = vec![Note { entries: &["joints", "kp", "kd"], text }];
    Ok(Known { table, notes })
}

/// Why the text is no such file, in the file's words.
fn unreadable(error: &str) -> PolicyError {
    // The reader's own words for an entry of no known kind name a type of this program.
    let reason = match error.contains("did not match any variant") {
        true => {
            "an entry of `observations` is neither a term (with `params`, `scale`, `clip` and `history_length`), nor a switch, nor \
             a group of these"
        }
        false => error,
    };
    invalid(format!("it cannot be read as unitree_rl_lab's deploy.yaml: {reason}"))
}

/// The observation of a description, and the order of its history's frames if it is not Isaac Lab's.
fn observed(
    entries: &IndexMap<String, Entry>,
    joints: usize,
) -> Result<(Vec<toml::Value>, Option<&'static str>), PolicyError> {
    let (mut observation, mut frames) = (Vec::new(), false);
    let mut take_switch = |name: &str, on: bool| match name {
        "use_gym_history" => {
            frames = on;
            Ok(())
        }
        // Whether it clips before or behind the scale: clips that matter are refused.
        "scale_first" => Ok(()),
        _ => Err(invalid(format!("`{name}: {on}` under observations is not known here"))),
    };
    for (name, entry) in entries {
        match entry {
            Entry::Switch(on) => take_switch(name, *on)?,
            Entry::Term(settings) => observation.push(term(name, settings, joints)?),
            Entry::Group(group) if entries.len() == 1 && group.len() <= MAX_ENTRIES => {
                for (name, entry) in group {
                    match entry {
                        GroupEntry::Switch(on) => take_switch(name, *on)?,
                        GroupEntry::Term(settings) => observation.push(term(name, settings, joints)?),
                    }
                }
            }
            Entry::Group(_) => {
                return Err(invalid(format!(
                    "`{name}` is a group of observations beside others; only one group is read"
                )));
            }
        }
    }
    Ok((observation, frames.then_some("frames")))
}

/// A term of a description.
fn term(name: &str, settings: &Term, joints: usize) -> Result<toml::Value, PolicyError> {
    let quantity = Quantity::from_foreign(name).ok_or_else(|| invalid(terms::unknown(name)))?;
    let asset = settings.params.as_ref().and_then(|params| params.asset_cfg.as_ref());
    if !JointIds::are_all(asset.and_then(|asset| asset.joint_ids.as_ref()), joints) {
        return Err(invalid(format!(
            "`{name}` has some of the joints, or in another order; describe the policy in a TOML file (docs/policies.md)"
        )));
    }
    let is_far = |clip: &[f64]| matches!(clip, [low, high] if *low <= -FAR && *high >= FAR);
    if let Some(clip) = settings.clip.as_ref().filter(|clip| !is_far(clip)) {
        return Err(invalid(format!("`{name}` is clipped to {clip:?}, which is not known here")));
    }
    // A length of 0 is a term without a history: the present frame alone.
    let history = settings.history_length.unwrap_or(1).max(1);
    if history > MAX_FRAMES {
        return Err(invalid(format!("`{name}` has a history of {history} frames; at most {MAX_FRAMES}")));
    }
    let mut term = toml::Table::new();
    term.insert("quantity".into(), quantity.name().into());
    if let Some(scale) = &settings.scale {
        term.insert("scale".into(), numbers(&scale.spread(quantity.width(joints))));
    }
    if history > 1 {
        term.insert("history".into(), (history as i64).into());
    }
    Ok(toml::Value::Table(term))
}
