//! Costs by name.

use super::{Cost, CostError, MatchR, Reference, TimeAligned, Wass, Weights};
use crate::{Resets, Simulator};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;
use std::sync::Arc;

/// A cost by its name in configurations and results: `wass`, `matcho`, `matchs` (never reset), `matchs1`,
/// `matchs20` (reset every 20 samples), `matchr1` (restarted from the sensors' readings every sample).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum CostKind {
    /// [`Wass`].
    Wass,
    /// [`TimeAligned::match_o`].
    MatchO,
    /// [`TimeAligned::match_s`], with the samples between resets.
    MatchS(Option<NonZeroUsize>),
    /// [`MatchR`], with the samples between readings.
    MatchR(NonZeroUsize),
}

/// A name that no cost has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "there is no cost `{0}`; take wass, matcho, matchs (never reset), or matchr or matchs with the samples between \
     resets, for example matchr1 or matchs20"
)]
pub struct UnknownCost(pub String);

impl CostKind {
    /// The cost against `reference` with the paper's weights, as far as both sides have the signals.
    ///
    /// # Errors
    /// As the cost's own `new`.
    pub fn build(
        self,
        reference: &Arc<Reference>,
        simulator: &dyn Simulator,
    ) -> Result<Box<dyn Cost>, CostError> {
        // The action counts only where both sides have it.
        let (reference, shared) = (Arc::clone(reference), Weights::shared(reference, simulator));
        Ok(match self {
            Self::Wass => Box::new(Wass::new(reference, shared)?),
            Self::MatchO => Box::new(TimeAligned::match_o(reference, shared)?),
            Self::MatchS(horizon) => Box::new(TimeAligned::match_s(reference, Weights::PRIVILEGED, horizon)?),
            Self::MatchR(horizon) => Box::new(MatchR::new(reference, horizon)?),
        })
    }

    /// Whether it compares samples of whole simulated logs one by one, which needs the same clock on both sides.
    pub fn is_aligned(self) -> bool {
        matches!(self, Self::MatchO | Self::MatchS(_))
    }

    /// The parts of logs that a simulation gets to be compared with them. For costs that reset the whole state there
    /// are none, because a robot's logs do not contain it.
    pub fn given(self) -> Resets {
        match self {
            Self::MatchR(horizon) => Resets::Sensors(horizon.get()),
            _ => Resets::Never,
        }
    }

    /// Whether the simulated robot is given what the log's sensors read, its IMU's too.
    pub fn needs_imu(self) -> bool {
        matches!(self.given(), Resets::Sensors(_))
    }

    /// Whether it needs the base's state in the log.
    pub fn is_privileged(self) -> bool {
        matches!(self, Self::MatchS(_))
    }
}

impl fmt::Display for CostKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Wass => f.write_str("wass"),
            Self::MatchO => f.write_str("matcho"),
            Self::MatchS(None) => f.write_str("matchs"),
            Self::MatchS(Some(horizon)) => write!(f, "matchs{horizon}"),
            Self::MatchR(horizon) => write!(f, "matchr{horizon}"),
        }
    }
}

impl FromStr for CostKind {
    type Err = UnknownCost;

    fn from_str(name: &str) -> Result<Self, UnknownCost> {
        match name {
            "wass" => Ok(Self::Wass),
            "matcho" => Ok(Self::MatchO),
            "matchs" => Ok(Self::MatchS(None)),
            _ => {
                let unknown = || UnknownCost(name.to_owned());
                let horizon = |stem: &str| -> Option<NonZeroUsize> {
                    // `parse` takes a sign and leading zeros, but names must read as they print.
                    name.strip_prefix(stem).filter(|rest| !rest.starts_with(['+', '0']))?.parse().ok()
                };
                match (horizon("matchs"), horizon("matchr")) {
                    (Some(horizon), _) => Ok(Self::MatchS(Some(horizon))),
                    (_, Some(horizon)) => Ok(Self::MatchR(horizon)),
                    _ => Err(unknown()),
                }
            }
        }
    }
}

impl From<CostKind> for String {
    fn from(kind: CostKind) -> Self {
        kind.to_string()
    }
}

impl TryFrom<String> for CostKind {
    type Error = UnknownCost;

    fn try_from(name: String) -> Result<Self, UnknownCost> {
        name.parse()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn names_read_as_they_print() {
        for name in ["wass", "matcho", "matchs", "matchs1", "matchs20", "matchr1", "matchr10"] {
            let kind: CostKind = name.parse().unwrap();
            assert_eq!(kind.to_string(), name);
            let json = serde_json::to_string(&kind).unwrap();
            assert_eq!(serde_json::from_str::<CostKind>(&json).unwrap(), kind);
        }
        assert_eq!("matchs20".parse(), Ok(CostKind::MatchS(NonZeroUsize::new(20))));
        for name in [
            "",
            "Wass",
            "matchs0",
            "matchs+1",
            "matchs020",
            "matchs-1",
            "matchs1.5",
            "matcho1",
            "matchr",
            "matchr0",
        ] {
            assert_eq!(name.parse::<CostKind>(), Err(UnknownCost(name.to_owned())));
        }
    }
}
