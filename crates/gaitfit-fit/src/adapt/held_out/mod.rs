//! Walking logs that were not fitted: how far the simulated robot's walks under their commands are from them, beside
//! how far the robot is from itself.
//!
//! The measure is [`Wass`](gaitfit_adapt::cost::Wass) on whole walks, whatever cost was fitted. It needs no clocks, so a
//! robot can be compared with itself: the logs are cut into blocks of half a second, about a stride, and one half of
//! each log's blocks is compared with the other half. Commands are the same on both sides. No simulator need be closer to the
//! robot than that. Where logs that were fitted have the same commands, whole walks are compared with them too: a robot
//! differs from one trial to the next by more than within one. (Logs of other commands would not do: commands make more
//! of a difference than most simulators' errors.)

mod compare;
mod trials;

pub(super) use compare::{held_out, simulations};
pub use trials::Trials;

use gaitfit_adapt::cost::Signal;
use gaitfit_adapt::fit::max_falls_by_chance;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};

/// A cost of this many times the floor's upper end is a misfit. Fits of a real Go2's walks that lack its load and floor are at
/// 1.7 times, fits with all that differs at 1.0 times; the robot before the fit is at 5 times.
const FAR: f64 = 1.5;
/// A fit is a misfit too if it leaves more than this part of the distance that the robot before the fit had beyond the floor.
const LEFT: f64 = 0.5;
/// Largest share of simulated walks in which a fitted robot may fall by chance.
const CHANCE: f64 = 0.02;

/// The number of simulations in results of earlier builds.
fn once() -> usize {
    1
}

/// Distances of simulated walks from held-out logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Logs, or stretches of logs, that were compared.
    pub logs: usize,
    /// Total time of them that counts, s.
    pub seconds: f64,
    /// Number of times that the walks were simulated, each with other random draws. A robot whose simulations are all alike is
    /// simulated once, and its falls count as often.
    #[serde(default = "once")]
    pub simulations: usize,
    /// `wass` of the fitted robot, all simulations of the walks pooled; absent if it diverged. The robot's range is 2 in each of
    /// the three signals.
    pub cost: Option<f64>,
    /// `wass` of each simulation alone. They scatter, and are higher: a single walk's chance counts as a difference.
    #[serde(default)]
    pub single_costs: Vec<f64>,
    /// `wass` of the robot before the fit, all simulations pooled.
    pub nominal_cost: Option<f64>,
    /// Distance of the robot from itself; absent if the logs are too short.
    pub floor: Option<Floor>,
    /// Distance of the robot from itself in other trials of the same commands; absent without such logs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials: Option<Trials>,
    /// Number of falls of the fitted robot in all simulations of the walks, `simulations` × `logs`.
    pub falls: usize,
    /// The same before the fit.
    pub nominal_falls: usize,
    /// Part of the logs in which the robot itself would fall if it walked them again, 0 to 1 (see
    /// [`Falling`](crate::walk::falling::Falling)).
    #[serde(default)]
    pub robot_fall_rate: f64,
    /// Number of the robot's falls from which this part is estimated.
    #[serde(default)]
    pub robot_falls: usize,
    /// Joint by joint, signal by signal.
    pub distances: Vec<Distance>,
}

/// One half of the logs' blocks against the other half, mean over the draws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Floor {
    /// `wass` of the robot.
    pub mean: f64,
    /// Half the width of the range in which 95 % of the draws lie.
    pub range95: f64,
    /// `wass` of the fitted robot: its blocks of the one half against the robot's of the other. It is a little above that
    /// of all blocks, as halves have fewer samples.
    pub cost: Option<f64>,
}

/// Wasserstein-1 distance of a joint's signal to the held-out logs, in the signal's unit; absent if it diverged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// Joint.
    pub joint: String,
    /// Signal.
    pub signal: Signal,
    /// Distance of the fitted robot.
    pub fitted: Option<f64>,
    /// Distance of the robot before the fit.
    pub nominal: Option<f64>,
    /// Distance of one half of the blocks to the other half, mean over the draws.
    pub floor: Option<f64>,
}

/// Whether the fit explains the logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// No worse than the robot explains itself.
    Explained,
    /// Worse than that.
    Worse,
    /// Far worse than that.
    Misfit,
    /// Worse than the robot before the fit.
    WorseThanNominal,
    /// It falls where the robot walks.
    Falls,
    /// There is no floor to judge by.
    Unknown,
}

impl HeldOut {
    /// Whether the fit explains the logs.
    pub fn verdict(&self) -> Verdict {
        // First what rules a fit out, then trials of the same commands, then the floor.
        // A robot whose simulation diverges is no better than the one before the fit.
        let Some(cost) = self.cost else { return Verdict::WorseThanNominal };
        if self.nominal_cost.is_some_and(|nominal| cost > nominal) {
            return Verdict::WorseThanNominal;
        }
        if self.falls > self.nominal_falls && self.falls > self.max_falls() {
            return Verdict::Falls;
        }
        if self.trials.as_ref().is_some_and(Trials::explained) {
            return Verdict::Explained;
        }
        // From here on the fit is judged by halves of blocks. `self.cost` has twice as many samples and
        // cannot be set beside them.
        let Some(floor) = &self.floor else { return Verdict::Unknown };
        let upper = floor.mean + floor.range95;
        // The part of the nominal robot's excess that the fit leaves.
        let left = |cost: f64| {
            self.nominal_cost
                .is_some_and(|nominal| cost - floor.mean > LEFT * (nominal - floor.mean).max(0.0))
        };
        match floor.cost {
            Some(cost) if cost <= upper => Verdict::Explained,
            Some(cost) if cost <= FAR * upper && !left(cost) => Verdict::Worse,
            _ => Verdict::Misfit,
        }
    }

    /// Falls in words: of how many simulated walks, or of how many logs if each was simulated once.
    fn falls_words(&self, falls: usize, logs: &str) -> String {
        match self.simulations {
            0 | 1 => format!("{falls} of {logs}"),
            times => format!("{falls} of {} simulated walks of {logs}", times * self.logs),
        }
    }

    /// Max number of falls without a doubt, in all simulations: 2 % of the walks, or the number that chance explains if the fitted
    /// robot falls as often as the real one.
    fn max_falls(&self) -> usize {
        let walks = (self.simulations.max(1) * self.logs) as f64;
        let by_chance = max_falls_by_chance(self.robot_fall_rate * walks, self.robot_falls);
        by_chance.max((CHANCE * walks).round() as usize)
    }

    /// Whether whole walks contradict the fit: no policy is to be trained in it.
    pub fn contradicts(&self) -> bool {
        matches!(self.verdict(), Verdict::WorseThanNominal | Verdict::Falls)
    }

    /// Why the fit must not be used as it is; `None` if it explains the logs nearly as well as the robot does.
    pub fn doubt(&self) -> Option<Doubt> {
        let kind = match self.verdict() {
            Verdict::Misfit => DoubtKind::Misfit,
            Verdict::WorseThanNominal => DoubtKind::WorseThanNominal,
            Verdict::Falls => DoubtKind::Falls,
            Verdict::Explained | Verdict::Worse | Verdict::Unknown => return None,
        };
        Some(Doubt::new(kind, format!("On whole walks {}.", self.sentence())))
    }

    /// The result in a sentence.
    pub fn sentence(&self) -> String {
        let number =
            |value: Option<f64>| value.map_or_else(|| "diverged".to_owned(), |value| format!("{value:.4}"));
        let nominal = format!("the robot before the fit {}", number(self.nominal_cost));
        let logs = format!("{} held-out log{}", self.logs, if self.logs == 1 { "" } else { "s" });
        let verdict = self.verdict();
        // Worst first, in the order of `verdict`.
        if self.cost.is_none() {
            return match self.nominal_cost {
                Some(_) => format!("the simulation of the fit diverges on {logs}; {nominal} (wass)"),
                None => {
                    format!(
                        "the simulation of the fit diverges on {logs}, also that of the robot before the fit"
                    )
                }
            };
        }
        if verdict == Verdict::WorseThanNominal {
            return format!(
                "the fit explains {logs} worse than the robot before the fit does: {} against {} (wass)",
                number(self.cost),
                number(self.nominal_cost)
            );
        }
        if verdict == Verdict::Falls {
            return format!(
                "the fitted robot falls in {}, {}{}",
                self.falls_words(self.falls, &logs),
                match self.robot_fall_rate {
                    rate if rate > 0.0 => format!("the robot in {:.0} %", 100.0 * rate),
                    _ => "in which the robot walks".to_owned(),
                },
                match self.nominal_falls {
                    0 => " and the robot before the fit does not fall".to_owned(),
                    falls => format!("; the robot before the fit falls in {falls}"),
                }
            );
        }
        let falls = match self.falls {
            0 => String::new(),
            falls => format!("; the fitted robot falls in {}", self.falls_words(falls, "these logs")),
        };
        if let Some(trials) = self.trials.as_ref().filter(|trials| trials.explained()) {
            return format!("the fit explains {logs} {} (wass; {nominal}){falls}", trials.words());
        }
        let Some(floor) = &self.floor else {
            return format!(
                "the fit is {} from {logs} (wass; {nominal}), which are too short to compare the robot with itself{falls}",
                number(self.cost)
            );
        };
        // A floor of 0 has no multiples, so the factor is left out there.
        let how = match (verdict, floor.cost) {
            (Verdict::Explained, _) => "as well as other seconds of the same walks do".to_owned(),
            (_, Some(cost)) if floor.mean > 0.0 => {
                format!(
                    "worse than other seconds of the same walks do, {:.1} times as far off",
                    cost / floor.mean
                )
            }
            _ => "worse than other seconds of the same walks do".to_owned(),
        };
        format!(
            "the fit explains {logs} {how}: {} against {:.4} ± {:.4} (wass of half of the seconds; of all of them {}, before the \
             fit {}){falls}",
            number(floor.cost),
            floor.mean,
            floor.range95,
            number(self.cost),
            number(self.nominal_cost)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example(cost: f64, nominal: f64, floor: Option<(f64, f64)>) -> HeldOut {
        HeldOut {
            logs: 16,
            seconds: 48.0,
            simulations: 1,
            cost: Some(cost),
            single_costs: vec![cost],
            nominal_cost: Some(nominal),
            floor: floor.map(|(mean, range95)| Floor { mean, range95, cost: Some(cost) }),
            trials: None,
            falls: 0,
            nominal_falls: 0,
            robot_fall_rate: 0.0,
            robot_falls: 0,
            distances: Vec::new(),
        }
    }

    #[test]
    fn the_sentence_says_worse_where_it_is_worse() {
        let floor = Some((0.0118, 0.0009));
        let said = |one: HeldOut| (one.verdict(), one.sentence(), one.doubt().map(|doubt| doubt.kind));
        let (verdict, text, doubt) = said(example(0.0121, 0.2, floor));
        assert!(verdict == Verdict::Explained && doubt.is_none());
        assert!(text.contains("as well as") && text.contains("0.0121 against 0.0118 ± 0.0009"), "{text}");
        let (verdict, text, doubt) = said(example(0.0177, 0.2, floor));
        assert!(
            verdict == Verdict::Worse && doubt.is_none() && text.contains("1.5 times as far off"),
            "{text}"
        );
        let (verdict, _, doubt) = said(example(0.0236, 0.2, floor));
        assert!(verdict == Verdict::Misfit && doubt == Some(DoubtKind::Misfit), "twice as far as the robot");
        let (verdict, ..) = said(example(0.0177, 0.022, floor));
        assert_eq!(
            verdict,
            Verdict::Misfit,
            "more than half of what the robot before the fit was off by is left"
        );
        let (verdict, _, doubt) = said(example(0.1, 0.2, floor));
        assert!(verdict == Verdict::Misfit && doubt == Some(DoubtKind::Misfit));
        let (verdict, text, doubt) = said(example(0.3, 0.2, floor));
        assert!(verdict == Verdict::WorseThanNominal && doubt == Some(DoubtKind::WorseThanNominal));
        assert!(text.contains("worse than the robot before the fit does: 0.3000 against 0.2000"), "{text}");
        let (verdict, text, _) = said(example(0.1, 0.2, None));
        assert!(verdict == Verdict::Unknown && text.contains("too short"), "{text}");
        let falls = |falls, nominal_falls| HeldOut { falls, nominal_falls, ..example(0.0121, 0.2, floor) };
        let (verdict, text, doubt) = said(falls(1, 0));
        assert!(verdict == Verdict::Falls && doubt == Some(DoubtKind::Falls) && falls(1, 0).contradicts());
        assert!(text.contains("falls in 1 of 16 held-out logs"), "{text}");
        assert_eq!(falls(1, 3).verdict(), Verdict::Explained, "the robot before the fit falls more often");
        // A robot that falls in a quarter of its logs falls in 4 of 16. It was seen to fall four times: by chance in up to
        // 4 + 2 √(4 + 4) = 9.7.
        let falling =
            |falls| HeldOut { falls, robot_fall_rate: 0.25, robot_falls: 4, ..example(0.0121, 0.2, floor) };
        assert_eq!((falling(10).verdict(), falling(11).verdict()), (Verdict::Explained, Verdict::Falls));
        // Two of a hundred walks are no doubt, whether 16 logs are simulated once or eight times.
        let of_eight = |falls| HeldOut { simulations: 8, falls, ..example(0.0121, 0.2, floor) };
        let (verdict, text, _) = said(of_eight(3));
        assert!(
            verdict == Verdict::Explained
                && text.ends_with("falls in 3 of 128 simulated walks of these logs"),
            "{text}"
        );
        let (verdict, text, _) = said(of_eight(4));
        assert!(
            verdict == Verdict::Falls
                && text.contains("falls in 4 of 128 simulated walks of 16 held-out logs"),
            "{text}"
        );
        let one_log = |falls| HeldOut { logs: 1, simulations: 8, falls, ..example(0.0121, 0.2, floor) };
        assert_eq!([0, 1].map(|falls| one_log(falls).verdict()), [Verdict::Explained, Verdict::Falls]);
        let trials = Trials { pairs: 12, itself: [0.04, 0.29], fitted: [0.035, 0.2] };
        let (verdict, text, _) = said(HeldOut { trials: Some(trials), ..example(0.1, 0.2, floor) });
        assert!(
            verdict == Verdict::Explained && text.contains("another trial of the same commands"),
            "{text}"
        );
        let diverged = HeldOut { cost: None, ..example(0.1, 0.2, floor) };
        assert_eq!(diverged.verdict(), Verdict::WorseThanNominal);
        assert!(
            diverged.sentence().contains("diverges on 16 held-out logs; the robot before the fit 0.2000"),
            "{}",
            diverged.sentence()
        );
        let both = HeldOut { nominal_cost: None, ..diverged };
        assert!(both.sentence().ends_with("also that of the robot before the fit"), "{}", both.sentence());
    }
}
