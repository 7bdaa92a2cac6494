//! Choice of the numbers of the observation that each input of a graph takes.

use crate::error::invalid;
use crate::observation::Layout;
use crate::{Interface, PolicyError, Quantity};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// Numbers that each input of a graph takes, by the input's name.
pub type Inputs = IndexMap<String, Taken>;

/// Numbers of the observation that an input takes.
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
    pub fn places(&self, interface: &Interface) -> Result<Vec<usize>, PolicyError> {
        let layout = Layout::new(interface, &interface.observation);
        let present = || layout.slots().iter().flat_map(|slot| slot.present.clone());
        Ok(match self {
            Self::Frames(Frames::All) => (0..layout.width()).collect(),
            Self::Frames(Frames::Present) => present().collect(),
            Self::Frames(Frames::Past) => {
                // All other places of the row, so that the past frames keep the row's order.
                let mut is_past = vec![true; layout.width()];
                present().for_each(|place| is_past[place] = false);
                (0..layout.width()).filter(|&place| is_past[place]).collect()
            }
            Self::Terms(terms) => {
                let mut places = Vec::new();
                for quantity in terms {
                    // If a quantity is observed twice, its first term counts.
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
