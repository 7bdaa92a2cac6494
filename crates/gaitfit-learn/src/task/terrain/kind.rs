//! Kinds of ground, and how many columns each gets.

use std::fmt;
use std::str::FromStr;

use gaitfit_model::shown;
use indexmap::IndexMap;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// A kind of ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TerrainKind {
    /// Level ground.
    Flat,
    /// A pyramid with level top, or the pit of its shape.
    Slopes,
    /// A pyramid of steps, or the pit of its shape.
    Stairs,
    /// Noise.
    Rough,
}

impl TerrainKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Flat, Self::Slopes, Self::Stairs, Self::Rough];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Slopes => "slopes",
            Self::Stairs => "stairs",
            Self::Rough => "rough",
        }
    }
}

impl FromStr for TerrainKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        let kind = Self::ALL.into_iter().find(|kind| kind.name() == text);
        kind.ok_or_else(|| format!("`{}` is no kind of terrain; the kinds are {}", shown(text), known()))
    }
}

/// One kind, or several with their shares of the columns.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Kinds {
    /// All columns.
    One(TerrainKind),
    /// By share; shares need not sum to one.
    Shares(IndexMap<TerrainKind, f64>),
}

impl Kinds {
    /// Kinds with their shares.
    pub fn shares(&self) -> Vec<(TerrainKind, f64)> {
        match self {
            Self::One(kind) => vec![(*kind, 1.0)],
            Self::Shares(shares) => shares.iter().map(|(&kind, &share)| (kind, share)).collect(),
        }
    }

    /// Kind of each of `count` columns, and its number among those of its kind.
    pub(super) fn columns(&self, count: usize) -> Vec<(TerrainKind, usize)> {
        let shares = self.shares();
        let sum: f64 = shares.iter().map(|(_, share)| share).sum();
        let mut columns: Vec<(TerrainKind, usize)> = Vec::with_capacity(count);
        for column in 0..count {
            // The middle of the column decides, so rounding does not favour the first kind.
            let place = (column as f64 + 0.5) / count as f64 * sum;
            let mut so_far = 0.0;
            let chosen = shares.iter().find(|(_, share)| {
                so_far += share;
                place < so_far
            });
            // Rounding of the sum may leave the last column without a kind.
            let kind = chosen.or(shares.last()).map_or(TerrainKind::Flat, |(kind, _)| *kind);
            // Numbers count only the columns of the same kind: even ones are pits, odd ones pyramids.
            columns.push((kind, columns.iter().filter(|(other, _)| *other == kind).count()));
        }
        columns
    }
}

impl<'de> Deserialize<'de> for Kinds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Read)
    }
}

struct Read;

impl<'de> Visitor<'de> for Read {
    type Value = Kinds;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "a kind of terrain, or a table of kinds and their shares such as { stairs = 2, rough = 1 }",
        )
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Kinds, E> {
        text.parse().map(Kinds::One).map_err(E::custom)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Kinds, A::Error> {
        let mut shares = IndexMap::new();
        while let Some((name, share)) = map.next_entry::<String, f64>()? {
            shares.insert(name.parse().map_err(A::Error::custom)?, share);
        }
        Ok(Kinds::Shares(shares))
    }
}
