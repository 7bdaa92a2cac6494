//! The inputs of a fit at its beginning: a checkpoint is resumed only by a fit of the same logs, parameters and settings.

use super::FitOptions;
use crate::cost::{Cost, Weights};
use crate::{Entry, Prior, Simulator, Theta};
use gaitfit_model::{shown, shown_number, significant};
use serde::{Deserialize, Serialize};

/// The inputs on which the numbers of a checkpoint depend. The simulator's own computation is not known here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Joint names, in the order of the signals' columns.
    pub joints: Vec<String>,
    /// Recordings that the simulator simulates.
    pub recordings: usize,
    /// The entries of θ.
    pub parameters: Vec<Searched>,
    /// Estimates from before the fit: places of their entries, and what they add to the cost.
    pub priors: Vec<(usize, Prior)>,
    /// Cost of one standard error from a prior.
    pub prior_weight: f64,
    /// The costs.
    pub costs: Vec<Against>,
    /// Options of the search.
    pub options: FitOptions,
}

/// An entry of θ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Searched {
    /// Name.
    pub name: String,
    /// Unit of the numbers.
    pub unit: String,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// First mean.
    pub start: f64,
    /// First standard deviation.
    pub deviation: f64,
}

/// The recordings and weights of a cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Against {
    /// The cost's name.
    pub cost: String,
    /// SHA-256 of the recordings; `None` of a cost without [`Cost::compared`].
    pub recordings: Option<String>,
    /// Part of the recordings in which the robot fell, 0 to 1; `None` in checkpoints of earlier builds.
    #[serde(default)]
    pub fall_rate: Option<f64>,
    /// Samples at the start of each recording that do not count.
    pub skip: usize,
    /// Weights of the signals.
    pub weights: Weights,
}

impl Origin {
    /// The inputs of a fit.
    pub(super) fn new(
        simulator: &dyn Simulator,
        theta: &Theta,
        costs: &[Box<dyn Cost>],
        options: &FitOptions,
    ) -> Self {
        let against = |cost: &dyn Cost| {
            let compared = cost.compared();
            Against {
                cost: cost.name().to_owned(),
                // Fingerprints instead of the signals keep a checkpoint small.
                recordings: compared.map(|one| one.reference.fingerprint()),
                fall_rate: compared.map(|one| one.reference.fall_rate()),
                skip: compared.map_or(0, |one| one.reference.skip()),
                weights: compared.map_or_else(Weights::default, |one| one.weights),
            }
        };
        Self {
            joints: simulator.joints().to_vec(),
            recordings: simulator.recordings(),
            parameters: theta.entries().iter().map(Searched::new).collect(),
            priors: theta.priors().enumerate().filter_map(|(at, prior)| Some((at, *prior?))).collect(),
            prior_weight: theta.prior_weight(),
            costs: costs.iter().map(|cost| against(cost.as_ref())).collect(),
            options: options.clone(),
        }
    }

    /// The first difference between this fit and `saved`, in words; `None` when a checkpoint of `saved` may be resumed. More generations
    /// may be asked for.
    pub(super) fn difference(&self, saved: &Self) -> Option<String> {
        let list = |names: Vec<&str>| shown(&names.join(", "));
        // Only the first difference is named. Joints come first: the order of all signals depends on them.
        let texts = |names: &[String]| list(names.iter().map(String::as_str).collect());
        if saved.joints != self.joints {
            let (before, now) = (texts(&saved.joints), texts(&self.joints));
            return Some(format!("its joints are {before}, and this fit's are {now}"));
        }
        if saved.recordings != self.recordings {
            let (before, now) = (saved.recordings, self.recordings);
            return Some(format!("it was begun with {before} logs, and there are {now} now"));
        }
        let names = |one: &Self| list(one.parameters.iter().map(|one| one.name.as_str()).collect());
        // The order counts too: a checkpoint has its values by place.
        if !saved.parameters.iter().map(|one| &one.name).eq(self.parameters.iter().map(|one| &one.name)) {
            return Some(format!("it searches {}, and this fit searches {}", names(saved), names(self)));
        }
        let entries = saved.parameters.iter().zip(&self.parameters);
        entries
            .filter_map(|(before, now)| now.difference(before))
            .next()
            .or_else(|| {
                let same = saved.priors == self.priors && saved.prior_weight == self.prior_weight;
                (!same).then(|| "its priors, or their weight, were others".to_owned())
            })
            .or_else(|| self.other_costs(saved))
            .or_else(|| self.other_options(saved))
    }

    fn other_costs(&self, saved: &Self) -> Option<String> {
        let names =
            |one: &Self| shown(&one.costs.iter().map(|one| one.cost.as_str()).collect::<Vec<_>>().join(", "));
        if names(saved) != names(self) {
            return Some(format!("it minimises {}, and this fit minimises {}", names(saved), names(self)));
        }
        saved.costs.iter().zip(&self.costs).find_map(|(before, now)| {
            if before.skip != now.skip {
                let (before, now) = (before.skip, now.skip);
                return Some(format!(
                    "the first {before} samples of its logs did not count, and now the first {now}"
                ));
            }
            // The rate alone may differ because an earlier build counted falls otherwise, so it is named apart.
            if before.recordings != now.recordings && before.fall_rate != now.fall_rate {
                let rate = |rate: Option<f64>| {
                    rate.map_or_else(|| "unknown".to_owned(), |rate| format!("{} %", significant(100.0 * rate, 3)))
                };
                return Some(format!(
                    "the part of its logs in which the robot fell was {}, and it is {} now: other logs, another `allow`, or an \
                     earlier build, which counted falls otherwise",
                    rate(before.fall_rate),
                    rate(now.fall_rate)
                ));
            }
            if before.recordings != now.recordings {
                return Some(
                    "its logs are others: positions, velocities or actions in them differ".to_owned(),
                );
            }
            (before.weights != now.weights)
                .then(|| format!("the weights of `{}` were others", shown(&now.cost)))
        })
    }

    fn other_options(&self, saved: &Self) -> Option<String> {
        // No `..`: a new option must be thought about here. Limits may change between start and resumption.
        let FitOptions {
            method,
            population,
            generations: _,
            restarts,
            seeds,
            covariance,
            bounds,
            patience: _,
            tolerance,
            falls,
            random_numbers,
        } = &self.options;
        let before = &saved.options;
        // Compared as the text that the message shows.
        let all = [
            ("seeds", format!("{:?}", before.seeds), format!("{seeds:?}")),
            ("population", before.population.to_string(), population.to_string()),
            ("restarts", before.restarts.to_string(), restarts.to_string()),
            ("method", format!("{:?}", before.method), format!("{method:?}")),
            ("covariance", format!("{:?}", before.covariance), format!("{covariance:?}")),
            ("bounds", format!("{:?}", before.bounds), format!("{bounds:?}")),
            ("tolerance", shown_number(before.tolerance), shown_number(*tolerance)),
            ("falls", in_words(&before.falls), in_words(falls)),
            ("random_numbers", format!("{:?}", before.random_numbers), format!("{random_numbers:?}")),
        ];
        let (name, before, now) = all.into_iter().find(|(_, before, now)| before != now)?;
        Some(format!("`{name}` was {}, and it is {} now", shown(&before), shown(&now)))
    }
}

/// The values of settings by name, for a message.
fn in_words(settings: &impl Serialize) -> String {
    match serde_json::to_value(settings) {
        Ok(serde_json::Value::Object(values)) if !values.is_empty() => {
            let one = |(name, value): (&String, &serde_json::Value)| format!("{name} = {value}");
            values.iter().map(one).collect::<Vec<_>>().join(", ")
        }
        _ => "as by default".to_owned(),
    }
}

impl Searched {
    fn new(entry: &Entry) -> Self {
        let Entry { name, unit, lower, upper, start, deviation, .. } = entry;
        let [lower, upper, start, deviation] = [*lower, *upper, *start, *deviation];
        Self { name: name.clone(), unit: unit.clone(), lower, upper, start, deviation }
    }

    fn difference(&self, saved: &Self) -> Option<String> {
        let name = shown(&self.name);
        if saved.unit != self.unit {
            return Some(format!(
                "the unit of `{name}` was {}, and it is {} now",
                shown(&saved.unit),
                shown(&self.unit)
            ));
        }
        let numbers = [
            ("lower bound", saved.lower, self.lower),
            ("upper bound", saved.upper, self.upper),
            ("start", saved.start, self.start),
            ("deviation", saved.deviation, self.deviation),
        ];
        // Compared exactly: another last digit means other candidates.
        let (what, before, now) = numbers.into_iter().find(|(_, before, now)| before != now)?;
        let [before, now] = [before, now].map(shown_number);
        Some(format!("the {what} of `{name}` was {before}, and it is {now} now"))
    }
}
