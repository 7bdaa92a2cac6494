//! The fit of one cost, from the outcome of its search.

use super::audit::Audit;
use super::cost_result::CostFit;
use super::doubts;
use super::leftover::Leftover;
use super::parameter::Parameter;
use super::score::{Robot, mean, validation};
use super::setup::Setup;
use super::standing::widening;
use crate::Error;
use gaitfit_adapt::fit::{
    Agreement, CostOutcome, Evaluation, FallPenalty, FitError, Job, RunGeneration, compare, evaluate,
};
use gaitfit_adapt::never;
use gaitfit_adapt::{Prior, RobotNumber, Theta};
use gaitfit_view::DoubtKind;

/// One evaluation of a robot by cost number `cost`, without a charge for falls.
fn evaluated(
    setup: &Setup,
    cost: usize,
    theta: &Theta,
    values: Vec<f64>,
) -> Result<Option<Evaluation>, Error> {
    let jobs = [Job { cost, values, draw: 0 }];
    let simulator = setup.searched().simulator.as_ref();
    let evaluations =
        evaluate(simulator, theta, &setup.costs, &FallPenalty::NONE, &jobs, &never).map_err(Error::failed)?;
    Ok(evaluations.into_iter().next())
}

/// The fit of cost number `cost`. `course`: the generations of its runs. `left`: what remains unexplained in its
/// errors.
///
/// # Errors
/// A simulation that fails.
pub(super) fn fit(
    setup: &Setup,
    cost: usize,
    outcome: &CostOutcome,
    course: &[RunGeneration],
    left: Option<Leftover>,
) -> Result<CostFit, Error> {
    let config = &setup.config;
    let values = outcome.values();
    // The robot before the fit is the same simulator with an empty θ.
    let fitted = evaluated(setup, cost, &setup.theta, values.clone())?;
    let nominal = evaluated(setup, cost, &Theta::default(), Vec::new())?;
    let (nominal_cost, nominal_falls) = nominal.map_or((None, 0), |nominal| (nominal.cost, nominal.falls));
    // Doubts about the search come first, then those about the errors that remain.
    let mut doubts = doubts::doubts(outcome, nominal_cost, nominal_falls, course);
    let audit = audited(setup, cost, &values)?;
    doubts.extend(left.as_ref().and_then(Leftover::doubt));
    let has = |kind| doubts.iter().any(|doubt| doubt.kind == kind);
    let wider = audit.as_ref().map_or(1.0, widening);
    // Widening comes before priors are combined in: a prior must not be weighed against an interval that is too
    // narrow.
    let parameter = |at: usize, prior: Option<Prior>| {
        let estimate = &outcome.parameters[at];
        let mut parameter = Parameter {
            truth: config.truth.get(&estimate.name).copied(),
            published: config.published.get(&estimate.name).copied(),
            prior,
            interval: estimate.identification.as_ref().map(|one| [one.lower, one.upper]),
            identified: estimate.identification.as_ref().map(|one| one.identified),
            found: estimate.clone(),
        };
        parameter.widen(wider);
        if let Some(left) = &left {
            left.widen(at, &mut parameter);
        }
        // The intervals of simulated robots have the priors in them.
        if outcome.regression.is_none() {
            let alone = parameter.interval;
            parameter.combine();
            // No simulated robot is like the real one, so estimates from walks and from legs in the air may both be
            // wrong.
            if outcome.unlike.is_some() {
                alone.into_iter().flatten().for_each(|end| parameter.reach(end));
            }
        }
        parameter
    };
    // The prior of an entry, moved to the fitted strength and friction under load.
    let prior = |at: usize| {
        let mut prior = *setup.theta.prior(at)?;
        let fitted = |place: Option<usize>| {
            let place = place.filter(|place| *place < outcome.parameters.len())?;
            Some(parameter(place, setup.theta.prior(place).copied()))
        };
        // Estimates from legs in the air depend on the motors' strength and on friction under load. So their errors
        // contain the errors of these two.
        if let Some(strength) = fitted(setup.theta.strength(at)).filter(|_| prior.by_strength != 0.0) {
            prior = prior.with_strength(strength.found.value, strength.error());
        }
        if let Some(load) = fitted(setup.theta.load(at)).filter(|_| prior.by_load != 0.0) {
            prior = prior.with_load(load.found.value, load.error());
        }
        Some(prior)
    };
    let mut parameters: Vec<Parameter> =
        (0..outcome.parameters.len()).map(|at| parameter(at, prior(at))).collect();
    // What concerns several parameters, or all seeds, comes after the single intervals.
    widen_load_mass(&mut parameters);
    if outcome.uncertainty.is_some() && has(DoubtKind::NotConverged) {
        widen_to_seeds(&mut parameters);
    }
    let theta = Theta::default();
    let (robot, before) =
        (Robot { theta: &setup.theta, values: &values }, Robot { theta: &theta, values: &[] });
    Ok(CostFit {
        cost_name: outcome.cost.clone(),
        cost: outcome.best_cost,
        nominal_cost,
        converged: !has(DoubtKind::NotConverged),
        better_than_nominal: !has(DoubtKind::WorseThanNominal),
        doubts,
        falls: fitted.map_or(0, |fitted| fitted.falls),
        nominal_falls,
        mean_error_percent: mean_error_percent(&parameters),
        validation: validation(
            config.costs[cost],
            &setup.validate,
            setup.aligned(),
            |set| robot.simulate(set.simulator.as_ref(), config.costs[cost].given()),
            |set| before.simulate(set.simulator.as_ref(), config.costs[cost].given()),
        )?,
        parameters,
        runs: outcome.runs.clone(),
        uncertainty: outcome.uncertainty.clone(),
        correction: outcome.correction.clone(),
        regression: outcome.regression.clone(),
        redrawn: outcome.redrawn,
        audit,
        leftover: left,
        comparison: Vec::new(),
    })
}

/// Mean error of the parameters whose truth is known and not zero, %.
fn mean_error_percent(parameters: &[Parameter]) -> Option<f64> {
    let error = |parameter: &Parameter| {
        let truth = parameter.truth.filter(|truth| *truth != 0.0)?;
        Some(100.0 * (parameter.found.value / truth - 1.0).abs())
    };
    mean(parameters.iter().filter_map(error).map(Some))
}

/// Widens the interval of a load's mass by the interval of its distance. Walks show the load's moment, mass × distance,
/// better than either factor. But the interval of the mass is measured at one distance.
fn widen_load_mass(parameters: &mut [Parameter]) {
    let place = |kind: RobotNumber, parameters: &[Parameter]| {
        parameters.iter().position(|one| one.found.name == kind.name())
    };
    let places = [RobotNumber::PayloadMass, RobotNumber::PayloadX].map(|kind| place(kind, parameters));
    let [Some(mass), Some(distance)] = places else { return };
    let x = parameters[distance].found.value;
    let moment = parameters[mass].found.value * x;
    // Either all parameters have intervals or none has. So if the distance has none, neither has the mass.
    for end in parameters[distance].interval.into_iter().flatten() {
        // On the other side of the base's middle no mass has this moment, so the mass may be anything above.
        let other = if end * x > 0.0 { moment / end } else { parameters[mass].found.upper };
        parameters[mass].reach(other);
    }
}

/// Widens intervals to the values of all seeds. An interval of least squares comes from the slopes at one seed's
/// values. If seeds end at different values, the logs allow more than this interval contains.
fn widen_to_seeds(parameters: &mut [Parameter]) {
    for parameter in parameters {
        // Only the best seed is corrected. The same correction is assumed for the values of the others.
        let moved = parameter.found.value - parameter.found.uncorrected.unwrap_or(parameter.found.value);
        for value in parameter.found.per_run.clone() {
            parameter.reach(value + moved);
        }
    }
}

/// The quantities on which errors of short predictions of the fitted logs depend; absent for other costs.
fn audited(setup: &Setup, cost: usize, values: &[f64]) -> Result<Option<Audit>, Error> {
    let kind = setup.config.costs[cost];
    if !kind.needs_imu() {
        return Ok(None);
    }
    let robot = Robot { theta: &setup.theta, values };
    let predicted = robot.simulate(setup.fit.simulator.as_ref(), kind.given())?;
    let skip = setup.method.samples(setup.config.skip_seconds(), &setup.fit.logs);
    Ok(Audit::new(&setup.fit, &predicted, skip))
}

/// Random draws over which costs are averaged where two fits are compared. One draw may favour a value by chance.
const COMPARED_DRAWS: u8 = 8;

/// The parameters of `other` beside those of `first`. Their costs are distances from the logs alone, as reported:
/// without the charge for falls, the price of priors and that of large networks.
pub(super) fn beside(
    setup: &Setup,
    first: &CostOutcome,
    other: &CostOutcome,
) -> Result<Vec<Agreement>, Error> {
    // Where a simulation has no random draws, all draws give the same.
    let draws = if setup.options.falls.random { COMPARED_DRAWS } else { 1 };
    let cost_of = |name: &str| {
        // Both outcomes are of costs of this setup, so the name is always there.
        let cost = setup.costs.iter().position(|cost| cost.name() == name).unwrap_or_default();
        move |candidates: &[Vec<f64>]| -> Result<Vec<Option<f64>>, FitError> {
            let drawn = |values: &Vec<f64>| {
                let values = values.clone();
                (0..draws).map(move |draw| Job { cost, values: values.clone(), draw: draw.into() })
            };
            let jobs: Vec<Job> = candidates.iter().flat_map(drawn).collect();
            let (simulator, theta) = (setup.searched().simulator.as_ref(), &setup.theta);
            let evaluations = evaluate(simulator, theta, &setup.costs, &FallPenalty::NONE, &jobs, &never)?;
            let distance = |(values, drawn): (&Vec<f64>, &[Evaluation])| {
                Some(
                    mean(drawn.iter().map(|one| one.cost))?
                        - theta.prior_cost(values)
                        - theta.regularisation(values),
                )
            };
            Ok(candidates.iter().zip(evaluations.chunks(draws.into())).map(distance).collect())
        }
    };
    compare(first, other, cost_of(&first.cost), cost_of(&other.cost)).map_err(Error::failed)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::adapt::parameter::example;

    #[test]
    fn a_load_is_as_unsure_as_its_place() {
        let load = |place: [f64; 2]| {
            let mut parameters = [
                example("payload_mass", 3.0, [0.0, 20.0], [2.8, 3.2]),
                example("payload_x", -0.4, [-0.5, 0.5], place),
            ];
            widen_load_mass(&mut parameters);
            (parameters[0].interval.unwrap(), parameters[0].identified)
        };
        let (near, identified) = load([-0.5, -0.2]);
        assert!((near[0] - 2.4).abs() < 1e-12 && (near[1] - 6.0).abs() < 1e-12, "{near:?}");
        assert_eq!(identified, Some(true));
        let (unknown, identified) = load([-0.45, 0.3]);
        assert!((unknown[0] - 2.4 / 0.9).abs() < 1e-12 && unknown[1] == 20.0, "{unknown:?}");
        assert_eq!(identified, Some(false));
    }

    #[test]
    fn intervals_reach_to_the_seeds() {
        let mut one = [example("armature", 0.008, [0.0, 0.1], [0.0079, 0.0081])];
        one[0].found.per_run = vec![0.009, 0.006];
        one[0].found.uncorrected = Some(0.009);
        widen_to_seeds(&mut one);
        let [lower, upper] = one[0].interval.unwrap();
        assert!(
            (lower - 0.005).abs() < 1e-12 && (upper - 0.0081).abs() < 1e-12,
            "all seeds get the correction of the best one"
        );
    }
}
