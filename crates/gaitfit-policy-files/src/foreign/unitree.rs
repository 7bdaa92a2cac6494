//! `deploy.yaml`, which unitree_rl_lab writes beside a policy's ONNX file.
//!
//! Joints have no names in it: `joint_ids_map` gives each of the policy's joints its place in Unitree's SDK, whose lists
//! are known here for each robot by their length. Gains are in the SDK's order, everything else in the policy's.

use super::{Known, names, numbers, sdk, terms};
use gaitfit_policy::invalid;
use gaitfit_policy::{PolicyError, Quantity};
use indexmap::IndexMap;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Bounds beyond which a clipped observation counts as not clipped.
const FAR: f64 = 50.0;
/// Most joints and terms.
const MAX_ENTRIES: usize = 256;

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
    joint_ids: Option<Ids>,
}

/// Numbers of joints; nulls where Isaac Lab has a slice of all.
#[derive(Deserialize)]
struct Ids(Vec<Option<usize>>);

impl Ids {
    /// Whether these are all of `count` joints, in their order.
    fn are_all(ids: Option<&Self>, count: usize) -> bool {
        ids.is_none_or(|Self(ids)| {
            ids.iter().all(Option::is_none) || ids.iter().copied().eq((0..count).map(Some))
        })
    }
}

/// What stands under `observations`: a term, a switch of all terms, or a group of both.
#[derive(Deserialize)]
#[serde(untagged)]
enum Entry {
    One(Part),
    Group(IndexMap<String, Part>),
    /// A term that lacks `params`.
    Bare(Settings),
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Part {
    Switch(bool),
    Term(Term),
}

#[derive(Deserialize)]
struct Term {
    params: Params,
    #[serde(flatten)]
    settings: Settings,
}

#[derive(Deserialize)]
struct Params {
    asset_cfg: Option<Asset>,
}

#[derive(Deserialize)]
struct Asset {
    joint_ids: Option<Ids>,
}

#[derive(Deserialize)]
struct Settings {
    scale: Option<Numbers>,
    clip: Option<Vec<f64>>,
    history_length: Option<usize>,
    use_gym_history: Option<bool>,
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
    let outer = if folder.as_os_str().is_empty() { Path::new("..").to_owned() } else { folder.join("..") };
    [folder.join("deploy.yaml"), folder.join("params/deploy.yaml"), outer.join("params/deploy.yaml")]
        .into_iter()
        .find(|path| path.is_file())
}

/// What the file's text says.
pub(crate) fn read(text: &str) -> Result<Known, PolicyError> {
    let deploy: Deploy =
        serde_saphyr::from_str(text).map_err(|error| invalid(format!("no deploy.yaml: {error}")))?;
    let count = deploy.joint_ids_map.len();
    let slots = deploy.stiffness.len();
    if count == 0 || count > MAX_ENTRIES || deploy.observations.len() > MAX_ENTRIES {
        return Err(invalid(format!(
            "{count} joints and {} terms; at most {MAX_ENTRIES}",
            deploy.observations.len()
        )));
    }
    let Some((robot, sdk)) = sdk::with_places(slots) else {
        return Err(invalid(format!(
            "it has gains of {slots} joints, and no robot of unitree_rl_lab is known with as many: describe the policy in \
             a TOML file with `joints` (docs/policies.md)"
        )));
    };
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
    if action.clip.is_some() || !Ids::are_all(action.joint_ids.as_ref(), count) {
        return Err(invalid(
            "its action clips targets, or moves some of the joints or in another order; describe the policy in a TOML file \
             (docs/policies.md)",
        ));
    }
    let pose = &deploy.default_joint_pos;
    // The program adds nothing where it is null.
    let offset = action.offset.as_ref().unwrap_or(&Numbers::One(0.0)).spread(count);
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
    let notes = vec![format!(
        "read with unitree_rl_lab's deploy.yaml, whose {slots} gains are taken as those of the {robot} in the order of \
         Unitree's SDK"
    )];
    Ok(Known { table, notes })
}

/// The observation of a description, and the order of its history's frames if it is not Isaac Lab's.
fn observed(
    entries: &IndexMap<String, Entry>,
    joints: usize,
) -> Result<(Vec<toml::Value>, Option<&'static str>), PolicyError> {
    let one_group =
        |name: &str| invalid(format!("`{name}` is a group of observations; only one group is read"));
    let mut parts: Vec<(&str, Option<&Part>, Option<&Settings>)> = Vec::new();
    for (name, entry) in entries {
        match entry {
            Entry::One(part) => parts.push((name, Some(part), None)),
            Entry::Group(group) if entries.len() == 1 && group.len() <= MAX_ENTRIES => {
                parts.extend(group.iter().map(|(name, part)| (&name[..], Some(part), None)));
            }
            Entry::Bare(settings) if settings.use_gym_history.is_none() => {
                parts.push((name, None, Some(settings)));
            }
            Entry::Group(_) | Entry::Bare(_) => return Err(one_group(name)),
        }
    }
    let (mut observation, mut order) = (Vec::new(), None);
    for (name, part, bare) in parts {
        let settings = match (part, bare) {
            (Some(Part::Switch(frames)), _) if name == "use_gym_history" => {
                order = frames.then_some("frames");
                continue;
            }
            // Whether it clips before or behind the scale: clips that matter are refused.
            (Some(Part::Switch(_)), _) if name == "scale_first" => continue,
            (Some(Part::Term(Term { params, settings })), _) if settings.use_gym_history.is_none() => {
                let ids = params.asset_cfg.as_ref().and_then(|asset| asset.joint_ids.as_ref());
                if !Ids::are_all(ids, joints) {
                    return Err(invalid(format!(
                        "`{name}` has some of the joints, or in another order; describe the policy in a TOML file \
                         (docs/policies.md)"
                    )));
                }
                settings
            }
            (None, Some(settings)) => settings,
            _ => return Err(one_group(name)),
        };
        observation.push(term(name, settings, joints)?);
    }
    Ok((observation, order))
}

/// A term of a description.
fn term(name: &str, settings: &Settings, joints: usize) -> Result<toml::Value, PolicyError> {
    let quantity = Quantity::from_foreign(name).ok_or_else(|| invalid(terms::unknown(name)))?;
    if let Some(clip) = settings.clip.as_ref().filter(|clip| clip.iter().any(|x| x.abs() < FAR)) {
        return Err(invalid(format!("`{name}` is clipped to {clip:?}, which is not known here")));
    }
    let mut term = toml::Table::new();
    term.insert("quantity".into(), quantity.name().into());
    if let Some(scale) = &settings.scale {
        term.insert("scale".into(), numbers(&scale.spread(quantity.width(joints))));
    }
    let history = settings.history_length.unwrap_or(1).clamp(1, 1 << 20);
    if history > 1 {
        term.insert("history".into(), (history as i64).into());
    }
    Ok(toml::Value::Table(term))
}
