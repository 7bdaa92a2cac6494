//! Whether a fit may be used: its doubts in one list, and how firmly it stands.

use super::audit::Audit;
use super::cost_result::CostFit;
use super::held_out::HeldOut;
use super::leftover::Leftover;
use super::parameter::{APART, Parameter};
use super::score::Score;
use gaitfit_adapt::RobotNumber;
use gaitfit_model::listed;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};

/// Firmness of a fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Nothing speaks against it.
    #[default]
    Sound,
    /// It has doubts: use it with another test.
    Doubtful,
    /// Walks that were not fitted contradict it: no policy is trained in it unless that is asked for by name.
    Contradicted,
}

/// The name with which settings let a contradicted fit pass.
pub const CONTRADICTED: &str = "contradicted";

/// Torque noise is large from this part of the weakest joint's max torque on. It stands for all torques that were not
/// commanded. Simulated robots without such effects are below 0.1. The walks of a real one are at 0.3 to 0.4.
const LOUD: f64 = 0.2;
/// The same limit if torque noise is a fitted parameter. Motors have less noise than this. If the model lacks an
/// effect, a search raises the noise instead. Simulated robots with noise of up to 0.04 were fitted with less than
/// 0.05; one with twisting joints was fitted with 0.12.
const LOUD_FITTED: f64 = 0.1;
/// From these values on the model lacks something: the share of the errors' variance that correlates with the robot's
/// motion, and the correlation between successive errors. Simulated robots that differ only in fitted parameters have
/// less than half of both.
const GOES_WITH: f64 = 0.1;
const REMEMBERS: f64 = 0.3;
/// A joint differs from the others if the share of its errors that correlates with motion is this many times the
/// average.
const ONE_JOINT: f64 = 3.0;
/// Widening of an interval, as a factor less 1, for each root of the part of the variance that goes with motion.
const WIDER: f64 = 10.0;
/// An interval below this part of the bounds says that 0 was wanted, and not only allowed.
const TIGHT: f64 = 0.05;
/// An upper bound of the impedance of contacts from which on they are rigid.
const RIGID: f64 = 0.99;
/// Parameters that a doubt names.
const NAMED: usize = 6;

/// Facts about a fit besides the result of its search.
pub(super) struct Evidence<'a> {
    /// The predictor that the fit is.
    pub fitted: &'a Score,
    /// The robot before the fit, then predictors that need no simulator.
    pub baselines: &'a [Score],
    /// Walks that were not fitted.
    pub held_out: Option<&'a HeldOut>,
    /// Torque that the weakest joint can give, N·m; absent where nothing limits it.
    pub effort: Option<f64>,
    /// Unit of the position errors over all joints.
    pub position_unit: &'a str,
}

/// Why a fit must not be used without checking, the worst reason first.
pub(super) fn doubts(fit: &CostFit, evidence: &Evidence<'_>) -> Vec<Doubt> {
    let mut doubts = fit.doubts.clone();
    doubts.extend(trivial(evidence));
    doubts.extend(evidence.held_out.and_then(HeldOut::doubt));
    doubts.extend(unexplained(fit, evidence.effort));
    doubts.extend(known_otherwise(&fit.parameters));
    doubts.extend(bounded(&fit.parameters, fit.leftover.as_ref().map(Leftover::remembers)));
    doubts.sort_by_key(|doubt| doubt.kind);
    doubts
}

/// Firmness of a fit with these doubts.
pub(super) fn standing(doubts: &[Doubt], held_out: Option<&HeldOut>) -> Standing {
    if held_out.is_some_and(HeldOut::contradicts) {
        Standing::Contradicted
    } else if doubts.is_empty() {
        Standing::Sound
    } else {
        Standing::Doubtful
    }
}

/// Why a result with these doubts must not be used, in words. One that is only doubtful may be: its intervals know it.
pub fn refusal(doubts: &[Doubt]) -> Option<String> {
    let refused = [DoubtKind::Trivial, DoubtKind::Falls, DoubtKind::WorseThanNominal, DoubtKind::Misfit];
    let mut kinds: Vec<DoubtKind> = doubts.iter().map(|doubt| doubt.kind).collect();
    kinds.retain(|kind| refused.contains(kind));
    // `doubts` are sorted by kind, so equal kinds are neighbours.
    kinds.dedup();
    let names: Vec<String> = kinds.iter().map(|kind| kind.headline().to_lowercase()).collect();
    (!names.is_empty()).then(|| format!("do not use this fit: {}", names.join(", ")))
}

/// The doubt that a predictor without a simulator is nearer to the logs: by errors of logs that were not fitted, or
/// else of those that were, or else by the cost.
fn trivial(evidence: &Evidence<'_>) -> Option<Doubt> {
    type Measure = fn(&Score) -> Option<f64>;
    let error = |logs: &str| format!("position error on {logs}, {}", evidence.position_unit);
    let measures: [(String, Measure); 3] = [
        (error("logs that were not fitted"), |score| score.rmse_validation_rad),
        (error("the fitted logs"), |score| score.rmse_fit_rad),
        ("cost on the fitted logs".to_owned(), |score| score.cost),
    ];
    // The first baseline is the robot before the fit, which needs a simulator.
    let guesses = evidence.baselines.iter().skip(1);
    let (what, fitted, guess, guessed) = guesses
        .filter_map(|guess| {
            let (what, fitted, guessed) = measures
                .iter()
                .find_map(|(what, measure)| Some((what, measure(evidence.fitted)?, measure(guess)?)))?;
            Some((what, fitted, &guess.name, guessed))
        })
        .min_by(|a, b| a.3.total_cmp(&b.3))?;
    (guessed < fitted).then(|| {
        let text = format!(
            "\"{guess}\" needs no simulator and predicts the logs better: {guessed:.5} against {fitted:.5} ({what}). Do \
             not use this fit: check targets, gains and joint order with `gaitfit inspect`, and fit further parameters."
        );
        Doubt::new(DoubtKind::Trivial, text)
    })
}

/// The doubt that the remaining errors are not only noise, or that they are too much noise.
fn unexplained(fit: &CostFit, effort: Option<f64>) -> Option<Doubt> {
    // Each reason is a sentence of one doubt, because all have the same remedy.
    let mut reasons: Vec<String> = Vec::new();
    // After a correction the noise is known by simulated logs; else it may be a fitted parameter, below.
    let noise = fit.correction.as_ref().map(|correction| correction.torque_noise);
    if let Some((noise, effort)) = noise.zip(effort).filter(|(noise, effort)| *noise > LOUD * effort) {
        reasons.push(format!(
            "The remaining errors are as large as torque noise of {noise:.1} N·m, {:.0} % of what the weakest joint \
             can give.",
            100.0 * noise / effort
        ));
    }
    let named = |one: &&Parameter| one.found.name == RobotNumber::TorqueNoise.name();
    let noise = fit.parameters.iter().find(named).map(|one| one.found.value);
    if let Some((noise, effort)) = noise.zip(effort).filter(|(noise, effort)| *noise > LOUD_FITTED * effort) {
        reasons.push(format!(
            "The fitted torque noise is {noise:.1} N·m, {:.0} % of what the weakest joint can give. Motors are not that \
             noisy: the noise stands for an effect that the model lacks. `gaitfit explain` looks for such effects.",
            100.0 * noise / effort
        ));
    }
    // Noise does not depend on the motion. Errors that do come from an effect that the model lacks.
    if let Some(audit) = fit.audit.as_ref().filter(|audit| audit.explained > GOES_WITH) {
        reasons.push(format!(
            "{:.0} % of the variance of its errors depend on the motion ({:.0} % at {}), most on {}.",
            100.0 * audit.explained,
            100.0 * audit.worst_joint.1,
            audit.worst_joint.0,
            audit.strongest.0
        ));
        if audit.worst_joint.1 > ONE_JOINT * audit.explained {
            reasons.push(format!(
                "{} is not like the other joints: `odd_joints = true` shows whether it has a spring.",
                audit.worst_joint.0
            ));
        }
    }
    // Noise of one sample does not depend on the noise of the sample before.
    if let Some(audit) = fit.audit.as_ref().filter(|audit| audit.memory.abs() > REMEMBERS) {
        reasons.push(format!(
            "Its errors have a correlation of {:.2} with those a sample before.",
            audit.memory
        ));
    }
    (!reasons.is_empty()).then(|| {
        reasons.push(missing(&fit.parameters).to_owned());
        Doubt::new(DoubtKind::Unexplained, reasons.join(" "))
    })
}

/// The remedy.
fn missing(parameters: &[Parameter]) -> &'static str {
    if parameters.iter().any(|one| one.found.name.starts_with("delay")) {
        "The intervals are widened for it. Fit further parameters, and check whole walks (cost \"wass\", logs in \
         `validate`)."
    } else {
        "No delay is fitted, and a missing delay appears as friction and armature: add a [[parameter]] of kind \
         \"delay\". The intervals are widened for it."
    }
}

/// By which factor both sides of the intervals grow if the errors of the fit correlate with the robot's motion.
pub(super) fn widening(audit: &Audit) -> f64 {
    let goes_with = if audit.explained > GOES_WITH { audit.explained } else { 0.0 };
    // The square of a correlation is a part of the variance, as `explained` is. So both can be compared.
    let remembers = if audit.memory.abs() > REMEMBERS { audit.memory * audit.memory } else { 0.0 };
    1.0 + WIDER * goes_with.max(remembers).sqrt()
}

/// Widens the intervals of the first fit to the values of another one that sees the same logs otherwise: whole walks
/// and short predictions. Says where the two disagree, if they do.
pub(super) fn reconcile(fits: &mut [CostFit]) {
    let Some((first, others)) = fits.split_first_mut() else { return };
    // Only the two kinds of costs see logs differently: by whole walks, and by predictions over some samples.
    let short = |fit: &CostFit| fit.cost_name.starts_with("matchr");
    let first_is_short = short(first);
    for other in others.iter().filter(|other| short(other) != first_is_short) {
        let mut apart = Vec::new();
        for one in other.comparison.iter().filter(|one| one.agrees == Some(false)) {
            let parameter = first.parameters.iter_mut().find(|parameter| parameter.found.name == one.name);
            // A parameter that the logs do not identify may have any value, so it does not disagree.
            if let Some(parameter) = parameter.filter(|parameter| parameter.identified == Some(true)) {
                parameter.reach(one.second);
                apart.push(format!("{} {:.4} and {:.4}", one.name, one.first, one.second));
            }
        }
        if !apart.is_empty() {
            let text = format!(
                "{} and {} give different values, by more than their errors: {}. The simulator lacks something; the intervals \
                 reach to both.",
                first.cost_name,
                other.cost_name,
                listed(&apart, NAMED)
            );
            first.doubts.push(Doubt::new(DoubtKind::Disagreement, text));
        }
    }
}

/// A sentence if values are far from their priors.
fn known_otherwise(parameters: &[Parameter]) -> Option<Doubt> {
    let far = |one: &Parameter| {
        let prior = one.prior?;
        let away = prior.away(one.found.value);
        (away.abs() > APART).then(|| {
            format!(
                "{} {:.4} for {:.4} ± {:.4}",
                one.found.name, one.found.value, prior.value, prior.deviation
            )
        })
    };
    let far: Vec<String> = parameters.iter().filter_map(far).collect();
    (!far.is_empty()).then(|| {
        let text = format!(
            "The walks contradict the known values: {}. The simulator lacks something, or the known values are of \
             another robot. The intervals reach to both.",
            listed(&far, NAMED)
        );
        Doubt::new(DoubtKind::Disagreement, text)
    })
}

/// The doubt that values rest on bounds of their search. 0 is an end of many quantities; a value rests there where
/// the logs exclude all others. `remembers`: whether successive errors of a clamped robot's fit are
/// correlated. If they are only noise, a simulated robot without friction or delay may have made the log.
fn bounded(parameters: &[Parameter], remembers: Option<bool>) -> Option<Doubt> {
    let named = |is_so: &dyn Fn(&Parameter) -> bool| -> Vec<String> {
        parameters.iter().filter(|one| is_so(one)).map(|one| one.found.name.clone()).collect()
    };
    let measured = remembers == Some(true);
    let (stopped, empty) = (named(&stopped_by_bound), named(&|one| wants_nothing(one, measured)));
    let mut reasons = Vec::new();
    if !stopped.is_empty() {
        let rest = if stopped.len() == 1 { "rests on a bound" } else { "rest on bounds" };
        reasons.push(format!(
            "{} {rest} of the search: widen it, or fit further parameters.",
            listed(&stopped, NAMED)
        ));
    }
    if !empty.is_empty() {
        let (rest, exclude) = if empty.len() == 1 {
            ("rests", "its interval excludes")
        } else {
            ("rest", "the intervals exclude")
        };
        reasons.push(format!(
            "{} {rest} at 0 and {exclude} all else, which no real joint does: they stand for something that the \
             simulator lacks.",
            listed(&empty, NAMED)
        ));
    }
    // If the errors are noise, an empty parameter alone does not condemn the fit.
    let kind = if stopped.is_empty() && remembers == Some(false) {
        DoubtKind::Unexplained
    } else {
        DoubtKind::Misfit
    };
    (!reasons.is_empty()).then(|| Doubt::new(kind, reasons.join(" ")))
}

/// Whether only a bound of the search stopped the value. 0 is an end of many quantities and no such bound; see
/// [`wants_nothing`].
pub(super) fn stopped_by_bound(parameter: &Parameter) -> bool {
    let estimate = &parameter.found;
    // `at_bound` does not say which bound it is: it is the nearer one.
    let upper = estimate.value - estimate.lower >= estimate.upper - estimate.value;
    // Contacts with the largest impedance are rigid, which is an end of that quantity as 0 is one of others.
    let rigid = estimate.name == RobotNumber::GroundImpedance.name() && estimate.upper >= RIGID;
    estimate.at_bound && if upper { !rigid } else { estimate.lower != 0.0 }
}

/// Whether friction or delay, of which every real robot has some, rests at 0 and the logs exclude more. Where it is
/// known to be 0, nothing is wrong. `measured`: by the interval as it was measured, before it was widened for what the
/// simulator lacks.
pub(super) fn wants_nothing(parameter: &Parameter, measured: bool) -> bool {
    let estimate = &parameter.found;
    let real = ["frictionloss", "delay"].iter().any(|kind| estimate.name.starts_with(kind));
    let narrow = |[_, upper]: [f64; 2]| upper - estimate.lower < TIGHT * (estimate.upper - estimate.lower);
    real && estimate.at_bound
        && estimate.lower == 0.0
        // At the lower bound, not at the upper one.
        && estimate.value < 0.5 * estimate.upper
        && parameter.truth != Some(0.0)
        && estimate
            .identification
            .as_ref()
            .filter(|_| measured)
            .map(|one| [one.lower, one.upper])
            .or(parameter.interval)
            .is_some_and(narrow)
}

#[cfg(test)]
mod tests;
