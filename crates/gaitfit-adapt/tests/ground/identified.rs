//! What the logs identify, and networks.

use super::*;

#[test]
fn what_the_data_cannot_tell_is_not_identified() {
    let simulator = Pendulum::new(8, 0.5);
    let theta = theta(&["a", "b", "idle"], 1.0);
    let costs = [simulator.cost("wass")];
    let mut fit = Fit::new(&simulator, &theta, &costs, options(60)).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let mut outcomes = fit.outcomes();
    let outcome = &mut outcomes[0];
    assert!(outcome.identify(&simulator, &theta, costs[0].as_ref(), &[], 5, &never).unwrap());
    let identifications: Vec<_> =
        outcome.parameters.iter().map(|parameter| parameter.identification.clone().unwrap()).collect();
    assert!(identifications.iter().all(|one| one.noise == NoiseSource::Recordings));
    // The damping shows in the joint; the base and the idle number do not.
    let [damping, base, idle] = &identifications[..] else { unreachable!() };
    assert!(damping.identified && damping.lower < damping.upper, "{damping:?}");
    assert!(damping.lower - 0.3 < TRUTH[0] && TRUTH[0] < damping.upper + 0.3, "{damping:?}");
    for flat in [base, idle] {
        assert_eq!((flat.lower, flat.upper, flat.identified), (0.0, 2.0, false));
    }
    let text = serde_json::to_string(&outcomes).unwrap();
    let back: Vec<gaitfit_adapt::fit::CostOutcome> = serde_json::from_str(&text).unwrap();
    assert_eq!(back, outcomes);
}

/// Without noise the interval closes in on the truth; a point that is not the minimum says where to look.
#[test]
fn identification_without_noise_and_away_from_the_minimum() {
    let simulator = Pendulum::new(2, 0.0);
    let theta = theta(&["a", "b"], 1.0);
    let cost = simulator.cost("matchs");
    let identifications = identify(&simulator, &theta, cost.as_ref(), &TRUTH, &[], 0, &never).unwrap();
    assert!(
        identifications.iter().all(|one| one.identified && one.upper - one.lower < 1e-3),
        "{identifications:?}"
    );
    assert!(identifications.iter().all(|one| one.better.is_none()), "{identifications:?}");
    let away = identify(&simulator, &theta, cost.as_ref(), &[0.7, TRUTH[1]], &[], 0, &never).unwrap();
    assert!(away[0].better.is_some_and(|better| (better - TRUTH[0]).abs() < 0.1), "{away:?}");
    let one = Pendulum::new(1, 0.0);
    let cost = one.cost("matcho");
    let assumed = identify(&one, &theta, cost.as_ref(), &[0.55, TRUTH[1]], &[], 0, &never).unwrap();
    assert_eq!(assumed[0].noise, NoiseSource::Assumed);
    let noisy = Pendulum::new(1, 0.3);
    let cost = noisy.cost("matcho");
    let drawn = identify(&noisy, &theta, cost.as_ref(), &TRUTH, &[], 0, &never).unwrap();
    assert_eq!(drawn[0].noise, NoiseSource::Draws);
}

/// A robot that happens to fall in the draw asked for says little of how flat the cost is: the next without a fall counts.
#[test]
fn identification_takes_a_draw_in_which_the_robot_stays_up() {
    let mut simulator = Pendulum::new(4, 0.5);
    let highest = |draw: u64| {
        let states = (0..4).flat_map(|recording| simulator.run(recording, &TRUTH, Resets::Never, draw));
        states.map(|state| state[0].abs()).fold(0.0, f64::max)
    };
    let heights: Vec<f64> = (0..8).map(highest).collect();
    let worst = (0..7).max_by(|&a, &b| heights[a].total_cmp(&heights[b])).unwrap();
    simulator.reach = 0.5 * (heights[worst] + heights[worst + 1]);
    let theta = theta(&["a", "b"], 1.0);
    let cost = simulator.cost("wass");
    let identifications =
        identify(&simulator, &theta, cost.as_ref(), &TRUTH, &[], worst as u64, &never).unwrap();
    assert_eq!(simulator.draws.lock().unwrap().last(), Some(&(worst as u64 + 1)));
    assert!(identifications[0].identified, "{identifications:?}");
}

/// The pendulum with other parameters: its damping is the sum of the first two values times `parts` and of `more`, the third
/// one is b.
struct Mean {
    pendulum: Pendulum,
    parts: [f64; 2],
    more: f64,
}

impl Simulator for Mean {
    fn identity(&self) -> &Identity {
        self.pendulum.identity()
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        let [one, other] = self.parts;
        let mean = |values: &[f64]| vec![one * values[0] + other * values[1] + self.more, values[2]];
        let of = |rollout: &Rollout| Rollout { values: mean(&rollout.values), ..rollout.clone() };
        let candidates: Vec<Rollout> = candidates.iter().map(of).collect();
        self.pendulum.simulate(theta, &candidates, consume, cancel)
    }
}

/// Two parameters that make up for each other look well known one at a time.
#[test]
fn parameters_that_make_up_for_each_other_have_wide_intervals() {
    let simulator = Mean { pendulum: Pendulum::new(8, 0.5), parts: [0.5; 2], more: 0.0 };
    let cost = simulator.pendulum.cost("matchs");
    let values = [TRUTH[0], TRUTH[0], TRUTH[1]];
    let both = theta(&["one", "other", "b"], 1.0);
    let identifications = identify(&simulator, &both, cost.as_ref(), &values, &[], 0, &never).unwrap();
    let one = theta(&["a", "b"], 1.0);
    let alone = identify(&simulator.pendulum, &one, cost.as_ref(), &TRUTH, &[], 0, &never).unwrap();
    let width = |one: &gaitfit_adapt::fit::Identification| one.upper - one.lower;
    // Alone each would seem twice as uncertain as their mean.
    for half in &identifications[..2] {
        assert!(width(half) > 4.0 * width(&alone[0]), "{half:?} {:?}", alone[0]);
        // Each may be anything from 0 to the whole sum, because the other compensates it.
        assert!(half.lower < 0.05 && half.upper > 2.0 * TRUTH[0] - 0.05, "{half:?}");
    }
    assert!(width(&identifications[2]) < 1.5 * width(&alone[1]), "{identifications:?} {alone:?}");
}

/// A simulator with more damping would find less: the interval reaches there.
#[test]
fn intervals_hold_what_other_simulators_would_find() {
    // The second value does nothing.
    let mean = |more| Mean { pendulum: Pendulum::new(8, 0.05), parts: [1.0, 0.0], more };
    let (simulator, damped) = (mean(0.0), mean(0.1));
    let cost = simulator.pendulum.cost("matchs");
    let theta = theta(&["one", "other", "b"], 1.0);
    let values = [TRUTH[0], TRUTH[0], TRUTH[1]];
    let identified = |others: &[Alternative<'_>]| {
        identify(&simulator, &theta, cost.as_ref(), &values, others, 0, &never).unwrap()
    };
    let other = Alternative { what: "more damping".to_owned(), simulator: &damped };
    let (plain, held) = (identified(&[]), identified(&[other]));
    let less = TRUTH[0] - 0.1;
    assert!(plain[0].lower > less && held[0].lower < less, "{plain:?} {held:?}");
    assert!(held[2].lower > TRUTH[1] - 0.1, "{held:?}");
}

/// One network with the last three angles and velocities: evaluated as documented, it learns tanh of the velocity.
struct OneNetwork(Identity);

fn network_output(weights: &[f64], inputs: &[f64]) -> f64 {
    let mut x = inputs.to_vec();
    let mut at = 0;
    for (inputs, outputs) in [(6, 8), (8, 4), (4, 1)] {
        let unit = |o: usize| {
            let sum: f64 = (0..inputs).map(|i| x[i] * weights[at + i * outputs + o]).sum();
            sum + weights[at + inputs * outputs + o]
        };
        let y: Vec<f64> = (0..outputs).map(unit).collect();
        at += (inputs + 1) * outputs;
        x = if outputs > 1 { y.iter().map(|y| y.tanh()).collect() } else { y };
    }
    x[0]
}

impl OneNetwork {
    fn signals(output: impl Fn(&[f64]) -> f64) -> (Vec<f32>, Vec<f32>) {
        let state = |sample: usize| {
            let t = 0.1 * sample as f64;
            (t.sin(), 2.0 * (0.7 * t).cos())
        };
        let row = |sample: usize| {
            let past = [sample, sample.saturating_sub(1), sample.saturating_sub(2)].map(state);
            let inputs: Vec<f64> = past.iter().flat_map(|(q, v)| [*q, *v]).collect();
            let (q, v) = state(sample);
            ((q + output(&inputs)) as f32, v as f32)
        };
        (0..100).map(row).unzip()
    }
}

impl Simulator for OneNetwork {
    fn identity(&self) -> &Identity {
        &self.0
    }

    fn simulate(
        &self,
        _theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        _cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        for (candidate, rollout) in candidates.iter().enumerate() {
            let (position, velocity) = Self::signals(|inputs| network_output(&rollout.values, inputs));
            consume(candidate, 0, Signals::of_joints(&position, &velocity));
        }
        Ok(())
    }
}

#[test]
fn networks_are_fitted_from_either_start_by_the_separable_form() {
    let simulator = OneNetwork(Identity::new(vec!["hip".into()], 1));
    let (position, velocity) = OneNetwork::signals(|inputs| 0.8 * (0.9 * inputs[1]).tanh());
    let wide = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect();
    let recorded = Recorded { position: wide(&position), velocity: wide(&velocity), ..Recorded::default() };
    let target = Arc::new(Reference::new(simulator.0.joints.clone(), &[recorded], 0).unwrap());
    let costs = [CostKind::MatchO.build(&target, &simulator).unwrap()];
    for start in [NetworkStart::Zero, NetworkStart::Random] {
        let rule = NetworkRule { start, regularisation: 1e-4, ..NetworkRule::new(NetworkName::ResidAct) };
        let theta = Theta::new(vec![rule.modification(&[], simulator.joints(), &[0.0]).unwrap()]).unwrap();
        let options = FitOptions { covariance: CovarianceKind::Separable, ..options(300) };
        let before = simulate_one(&simulator, &theta, &theta.start(1), Resets::Never).unwrap();
        assert_eq!(before[0].position, OneNetwork::signals(|_| 0.0).0, "starts at no correction");
        let mut fit = Fit::new(&simulator, &theta, &costs, options).unwrap();
        let first = fit.step(&never).unwrap().unwrap().runs[0].best;
        while fit.step(&never).unwrap().is_some() {}
        let best = fit.outcomes()[0].best_cost;
        assert!(best < 0.15 * first, "{start:?}: {first} {best}");
        assert!(
            !fit.outcomes()
                .remove(0)
                .identify(&simulator, &theta, costs[0].as_ref(), &[], 0, &never)
                .unwrap()
        );
    }
}
