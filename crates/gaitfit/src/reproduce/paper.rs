//! The paper's tables: which cells they have, and the numbers printed there.

use crate::Error;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// Every table, as `paper.toml` has them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Paper {
    /// `--set` that bring every cell to the paper's scale.
    full: Vec<String>,
    /// Those that cells with networks need besides.
    full_networks: Vec<String>,
    /// Further settings of cells with ResidAct.
    full_resid_act: Vec<String>,
    /// Those that cells with networks on every joint need besides.
    full_every_joint: Vec<String>,
    /// True parameters of the model shift, N·m and kg·m².
    pub truth: IndexMap<String, f64>,
    /// The tables.
    #[serde(rename = "table")]
    pub tables: Vec<Table>,
}

/// A table or figure.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Its name on the command line.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// What its cells go through.
    pub kind: Kind,
    /// How long it takes, in words.
    pub time: String,
    /// Its cells.
    #[serde(rename = "cell")]
    pub cells: Vec<PaperCell>,
}

/// Stages that cells go through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Collect and adapt: which parameters are found.
    Identification,
    /// Then fine-tune and evaluate: how well the policy walks.
    Finetuning,
}

/// A cell and what the paper has there.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PaperCell {
    /// Stem of its file: scenario, modification, cost.
    pub name: String,
    /// Parameters found, N·m and kg·m².
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    values: IndexMap<String, f64>,
    /// Errors of the parameters found, percent.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    errors_percent: IndexMap<String, f64>,
    /// Their mean as printed, percent.
    #[serde(skip_serializing_if = "Option::is_none")]
    mean_error_percent: Option<f64>,
    /// What the text says of a bar without a printed value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub says: Option<String>,
}

impl Paper {
    /// Reads the data file, which is part of the program.
    ///
    /// # Errors
    /// A data file that is wrong.
    pub fn read() -> Result<Self, Error> {
        toml::from_str(include_str!("paper.toml"))
            .map_err(|error| Error::failed(format!("the program's own paper.toml: {error}")))
    }

    /// The table of that name.
    ///
    /// # Errors
    /// No such table; the message lists them.
    pub fn table(&self, name: &str) -> Result<&Table, Error> {
        self.tables.iter().find(|table| table.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.tables.iter().map(|table| table.name.as_str()).collect();
            let scored = names.iter().map(|known| (strsim::jaro_winkler(name, known), known));
            // Jaro–Winkler similarity is 1 for equal names. Below 0.7 a suggestion would be a guess.
            let near = scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(score, _)| *score > 0.7);
            let near = near.map_or_else(String::new, |(_, known)| format!(" Did you mean `{known}`?"));
            Error::settings(format!("there is no table `{name}`; there are {}.{near}", names.join(", ")))
        })
    }

    /// `--set` that bring a cell to the paper's scale.
    pub fn full(&self, cell: &PaperCell) -> Vec<String> {
        let parts = cell.parts();
        let networks = parts.is_some_and(|[_, modification, _]| modification != "fricarm");
        let resid_act = parts.is_some_and(|[_, modification, _]| modification == "residact");
        // The spring is on one joint, and its cells have the networks of this joint only.
        let everywhere = networks && parts.is_some_and(|[scenario, ..]| scenario != "spring");
        let chosen = |wanted: bool, list: &'_ [String]| if wanted { list.to_vec() } else { Vec::new() };
        let more = chosen(networks, &self.full_networks)
            .into_iter()
            .chain(chosen(resid_act, &self.full_resid_act))
            .chain(chosen(everywhere, &self.full_every_joint));
        self.full.iter().cloned().chain(more).collect()
    }

    /// The paper's error of each parameter, percent; empty where it printed none.
    pub fn errors(&self, cell: &PaperCell) -> IndexMap<String, f64> {
        let of_value = |(name, value): (&String, &f64)| {
            let truth = self.truth.get(name)?;
            Some((name.clone(), 100.0 * (value / truth - 1.0).abs()))
        };
        let mut errors = cell.errors_percent.clone();
        // An error that follows from a printed value replaces a printed error.
        errors.extend(cell.values.iter().filter_map(of_value));
        errors
    }

    /// Mean of [`Self::errors`], as printed or computed.
    pub fn mean_error(&self, cell: &PaperCell) -> Option<f64> {
        let errors = self.errors(cell);
        let mean = (!errors.is_empty()).then(|| errors.values().sum::<f64>() / errors.len() as f64);
        cell.mean_error_percent.or(mean)
    }
}

impl PaperCell {
    /// Scenario, modification and cost.
    pub fn parts(&self) -> Option<[&str; 3]> {
        // From the end: names of scenarios have hyphens too.
        let mut parts = self.name.rsplitn(3, '-');
        let (cost, modification, scenario) = (parts.next()?, parts.next()?, parts.next()?);
        Some([scenario, modification, cost])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn the_papers_means_follow_from_its_errors() {
        let paper = Paper::read().unwrap();
        let wass = &paper.table("parameters").unwrap().cells[0];
        // (5 + 2 + 16 + 0.1 + 0.8 + 1.2) / 6
        assert!((paper.mean_error(wass).unwrap() - 4.183).abs() < 1e-3);
        for cell in &paper.table("noise").unwrap().cells {
            let errors = paper.errors(cell);
            let mean = errors.values().sum::<f64>() / 6.0;
            assert_eq!(errors.len(), 6);
            assert!((mean - paper.mean_error(cell).unwrap()).abs() < 2e-3, "{}: {mean}", cell.name);
        }
    }

    #[test]
    fn a_wrong_table_is_told_the_right_ones() {
        let error = Paper::read().unwrap().table("nois").unwrap_err();
        assert!(error.to_string().contains("Did you mean `noise`?"), "{error}");
    }

    #[test]
    fn names_split_from_the_end() {
        let cell = PaperCell { name: "noise-2.5-fricarm-wass".to_owned(), ..PaperCell::default() };
        assert_eq!(cell.parts(), Some(["noise-2.5", "fricarm", "wass"]));
    }
}
