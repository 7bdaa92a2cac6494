//! Which numbers of the observation the inputs of a graph take.

use crate::error::invalid;
use crate::observation::Layout;
use crate::{Interface, PolicyError, Quantity};
use gaitfit_model::shown;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// What each input of a graph takes, by its name.
pub type Inputs = IndexMap<String, Taken>;

/// What an input takes of the observation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "give \"all\", \"present\", \"past\", or a list of quantities")]
pub enum Taken {
    /// Frames with all their terms.
    Frames(Frames),
    /// The present frames of these terms, in this order.
    Terms(Vec<Quantity>),
}

/// Frames of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frames {
    /// The whole row.
    All,
    /// The present frame of each term.
    Present,
    /// All but the present frames.
    Past,
}

impl Taken {
    /// Its places in the row of an observation.
    ///
    /// # Errors
    /// A quantity that is not observed.
    pub(super) fn places(&self, interface: &Interface) -> Result<Vec<usize>, PolicyError> {
        let layout = Layout::new(interface, &interface.observation);
        let present = || layout.slots().iter().flat_map(|slot| slot.present.clone());
        Ok(match self {
            Self::Frames(Frames::All) => (0..layout.width()).collect(),
            Self::Frames(Frames::Present) => present().collect(),
            Self::Frames(Frames::Past) => {
                let mut is_past = vec![true; layout.width()];
                present().for_each(|place| is_past[place] = false);
                (0..layout.width()).filter(|&place| is_past[place]).collect()
            }
            Self::Terms(terms) => {
                let mut places = Vec::new();
                for quantity in terms {
                    let slot = layout.slots().iter().find(|slot| slot.quantity == *quantity);
                    let slot = slot.ok_or_else(|| {
                        let name = quantity.name();
                        invalid(format!("`inputs` names {name}, which is not in `observation`: add it there"))
                    })?;
                    places.extend(slot.present.clone());
                }
                places
            }
        })
    }
}

/// What the inputs take that a description does not name, by their widths: `None` for a width that the file leaves open.
///
/// # Errors
/// Widths that are neither that of the row nor of the present frame.
pub(super) fn guessed(
    interface: &Interface,
    open: &[(String, Option<usize>)],
) -> Result<Inputs, PolicyError> {
    let width = |frames: Frames| Ok::<_, PolicyError>(Taken::Frames(frames).places(interface)?.len());
    let widths = [Frames::All, Frames::Present, Frames::Past]
        .map(|frames| width(frames).map(|width| (frames, width)))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let mut inputs = Inputs::new();
    for (name, wanted) in open {
        let fits = widths.iter().find(|(_, width)| Some(*width) == *wanted);
        // One input of any width takes everything.
        let frames = match (fits, open) {
            (Some((frames, _)), _) => *frames,
            (None, [_]) if wanted.is_none() => Frames::All,
            _ => {
                let name = shown(name);
                let takes = wanted.map_or("any number of".to_owned(), |width| width.to_string());
                let described = interface.describe(&interface.observation);
                let present = widths[1].1;
                return Err(invalid(format!(
                    "its input {name} takes {takes} numbers; the observation is {described}, {present} in its present frame. \
                     Say what it takes in a TOML file, for example inputs = {{ {name} = \"present\" }} (or \"all\", \"past\", \
                     or a list of quantities; docs/policies-foreign.md)"
                )));
            }
        };
        inputs.insert(name.clone(), Taken::Frames(frames));
    }
    Ok(inputs)
}
