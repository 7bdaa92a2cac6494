//! The feet of a robot: which geoms each of them is.

use gaitfit_model::rotation::sub;
use gaitfit_model::{Model, shown};
use gaitfit_sim::Batch;

use super::WalkerError;

/// Names that a message suggests.
const NEAREST: usize = 3;

/// A foot: one geom, or all geoms of one body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FootGeoms {
    /// Place in [`gaitfit_sim::Motion::normal_force`] of the geom whose centre is the foot's place.
    pub main: usize,
    /// Places of all its geoms: it touches the ground where one of them does.
    pub geoms: Vec<usize>,
}

/// A foot by the model's geoms.
pub(super) struct NamedFoot {
    /// The one whose centre is the foot's place.
    pub main: usize,
    pub geoms: Vec<usize>,
}

impl NamedFoot {
    /// In the order of a batch's contacts.
    pub fn places(&self, batch: &Batch) -> FootGeoms {
        // A geom has a place for each plane or obstacle that it may touch.
        let places = |wanted: usize| {
            let all = batch.contact_geoms().iter().enumerate();
            all.filter(move |(_, geom)| **geom == wanted).map(|(place, _)| place)
        };
        FootGeoms {
            // `named` takes geoms that may touch the ground, so there is a place.
            main: places(self.main).next().unwrap_or_default(),
            geoms: self.geoms.iter().flat_map(|&geom| places(geom)).collect(),
        }
    }
}

/// The feet that `names` name: a geom that may touch the ground, or a body, which stands for all such geoms of it.
pub(super) fn named(model: &Model, names: &[String]) -> Result<Vec<NamedFoot>, WalkerError> {
    let mut feet: Vec<NamedFoot> = Vec::with_capacity(names.len());
    for name in names {
        let foot = find(model, name)?;
        if let Some(other) =
            feet.iter().position(|other| other.geoms.iter().any(|geom| foot.geoms.contains(geom)))
        {
            let what = format!("has `{}` and `{}`, which share a geom", shown(&names[other]), shown(name));
            return Err(WalkerError::Option { option: "feet", what });
        }
        feet.push(foot);
    }
    Ok(feet)
}

fn find(model: &Model, name: &str) -> Result<NamedFoot, WalkerError> {
    let contacts = contacts(model);
    // A geom goes before a body of the same name.
    let geoms: Vec<usize> = match contacts.iter().find(|&&geom| model.geoms[geom].name == name) {
        Some(&geom) => vec![geom],
        None => {
            let body = model.body(name);
            contacts.iter().copied().filter(|&geom| Some(model.geoms[geom].body) == body).collect()
        }
    };
    let mean: [f64; 3] = std::array::from_fn(|k| {
        geoms.iter().map(|&geom| model.geoms[geom].pos[k]).sum::<f64>() / geoms.len().max(1) as f64
    });
    let off = |geom: usize| sub(model.geoms[geom].pos, mean).iter().map(|x| x * x).sum::<f64>();
    // The geom nearest to the middle of all stands for the foot's place.
    match geoms.iter().copied().min_by(|&a, &b| off(a).total_cmp(&off(b))) {
        Some(main) => Ok(NamedFoot { main, geoms }),
        None => Err(unknown(model, name, &contacts)),
    }
}

/// Geoms that may touch the ground, each once.
fn contacts(model: &Model) -> Vec<usize> {
    let mut geoms: Vec<usize> = model.pairs.iter().map(|pair| pair.geom).collect();
    geoms.sort_unstable();
    geoms.dedup();
    geoms
}

fn unknown(model: &Model, name: &str, contacts: &[usize]) -> WalkerError {
    let there = model.geoms.iter().any(|geom| geom.name == name) || model.body(name).is_some();
    let why = if there { "never touches the ground" } else { "is no geom or body" };
    let bodies = contacts.iter().map(|&geom| model.bodies[model.geoms[geom].body].name.as_str());
    let names = contacts.iter().map(|&geom| model.geoms[geom].name.as_str()).chain(bodies);
    let what =
        format!("has `{}`, which {why} of {}; {}", shown(name), shown(&model.name), nearest(name, names));
    WalkerError::Option { option: "feet", what }
}

/// Sentence part: the names that are most like `wanted`.
pub(super) fn nearest<'a>(wanted: &str, names: impl Iterator<Item = &'a str>) -> String {
    let lower = wanted.to_lowercase();
    let mut scored: Vec<(f64, &str)> =
        names.map(|name| (strsim::jaro_winkler(&lower, &name.to_lowercase()), name)).collect();
    // By name where scores are equal, so that equal names lie side by side for `dedup_by`.
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    scored.dedup_by(|a, b| a.1 == b.1);
    let names: Vec<String> = scored.into_iter().take(NEAREST).map(|(_, name)| shown(name)).collect();
    match names.len() {
        0 => "nothing of it touches the ground".to_owned(),
        1 => format!("the nearest name is {}", names[0]),
        _ => format!("the nearest names are {}", names.join(", ")),
    }
}
