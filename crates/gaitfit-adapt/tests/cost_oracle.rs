//! Costs against SciPy and NumPy (tools/make_cost_fixtures.py), and their behaviour on bad input.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::Signals;
use gaitfit_adapt::cost::{
    Breakdown, Cost, CostError, Recorded, Reference, Signal, TimeAligned, Wass, Weights, position_rmse,
    sort_f32, wasserstein1,
};
use serde::Deserialize;
use std::sync::Arc;

#[derive(Deserialize)]
struct Fixtures {
    pairs: Vec<Pair>,
    costs: Costs,
}

#[derive(Deserialize)]
struct Pair {
    name: String,
    simulated: Vec<f32>,
    robot: Vec<f64>,
    distance: f64,
}

#[derive(Deserialize)]
struct Run {
    position: Vec<f64>,
    velocity: Vec<f64>,
    action: Vec<f64>,
}

#[derive(Deserialize)]
struct Costs {
    joints: usize,
    skip: usize,
    robot: Vec<Run>,
    aligned: Vec<Run>,
    free: Vec<Run>,
    wass_aligned: [Vec<f64>; 3],
    wass_free: [Vec<f64>; 3],
    match_o: [f64; 3],
    position_rmse_first: f64,
    position_rmse_first_per_joint: Vec<f64>,
}

/// One simulated run in the simulator's precision.
#[derive(Clone)]
struct Single {
    position: Vec<f32>,
    velocity: Vec<f32>,
    action: Vec<f32>,
}

impl Single {
    fn of(run: &Run) -> Self {
        let narrow = |values: &[f64]| values.iter().map(|value| *value as f32).collect();
        Self { position: narrow(&run.position), velocity: narrow(&run.velocity), action: narrow(&run.action) }
    }

    fn view(&self) -> Signals<'_> {
        Signals { action: Some(&self.action), ..Signals::of_joints(&self.position, &self.velocity) }
    }
}

fn fixtures() -> Fixtures {
    serde_json::from_str(include_str!("fixtures/costs.json")).unwrap()
}

fn target(costs: &Costs) -> Arc<Reference> {
    let recordings: Vec<Recorded> = costs
        .robot
        .iter()
        .map(|run| Recorded {
            position: run.position.clone(),
            velocity: run.velocity.clone(),
            action: Some(run.action.clone()),
            ..Recorded::default()
        })
        .collect();
    let joints = (0..costs.joints).map(|joint| format!("joint_{joint}")).collect();
    Arc::new(Reference::new(joints, &recordings, costs.skip).unwrap())
}

fn singles(runs: &[Run]) -> Vec<Single> {
    runs.iter().map(Single::of).collect()
}

fn evaluate(cost: &dyn Cost, runs: &[Single]) -> Result<Breakdown, CostError> {
    let mut accumulator = cost.begin();
    for (recording, run) in runs.iter().enumerate() {
        accumulator.add(recording, run.view())?;
    }
    accumulator.finish()
}

fn close(ours: f64, theirs: f64, what: &str) {
    assert!((ours - theirs).abs() <= 1e-12 * theirs.abs().max(1.0), "{what}: {ours} against {theirs}");
}

#[test]
fn wasserstein1_agrees_with_scipy() {
    for mut pair in fixtures().pairs {
        sort_f32(&mut pair.simulated);
        pair.robot.sort_by(f64::total_cmp);
        close(wasserstein1(&pair.simulated, &pair.robot), pair.distance, &pair.name);
    }
}

#[test]
fn wass_agrees_with_its_definition() {
    let costs = fixtures().costs;
    let target = target(&costs);
    let wass = Wass::new(Arc::clone(&target), Weights::from_reference(&target)).unwrap();
    for (runs, expected) in [(&costs.aligned, &costs.wass_aligned), (&costs.free, &costs.wass_free)] {
        let breakdown = evaluate(&wass, &singles(runs)).unwrap();
        let mut total = 0.0;
        for (group, joints) in breakdown.groups.iter().zip(expected) {
            for (ours, theirs) in group.per_joint.iter().zip(joints) {
                close(ours.unwrap(), *theirs, &group.signal.to_string());
            }
            total += joints.iter().sum::<f64>() / joints.len() as f64;
        }
        assert_eq!(breakdown.groups.len(), 3);
        close(breakdown.total, total, "total");
    }
}

#[test]
fn match_o_and_rmse_agree_with_their_definition() {
    let costs = fixtures().costs;
    let target = target(&costs);
    let aligned = singles(&costs.aligned);
    let weights = Weights { position: 1.0, velocity: 0.5, action: 2.0, ..Weights::default() };
    let breakdown = evaluate(&TimeAligned::match_o(Arc::clone(&target), weights).unwrap(), &aligned).unwrap();
    for (group, expected) in breakdown.groups.iter().zip(costs.match_o) {
        close(group.value, expected, &group.signal.to_string());
    }
    let [position, velocity, action] = costs.match_o;
    close(breakdown.total, position + 0.5 * velocity + 2.0 * action, "total");

    let rmse = position_rmse(&target, 0, &aligned[0].position).unwrap();
    close(rmse.total, costs.position_rmse_first, "rmse");
    for (ours, theirs) in rmse.per_joint.iter().zip(&costs.position_rmse_first_per_joint) {
        close(*ours, *theirs, "rmse of a joint");
    }
}

/// The robot against itself costs nothing but the rounding of its samples to f32.
#[test]
fn the_robot_itself_costs_nothing() {
    let costs = fixtures().costs;
    let target = target(&costs);
    let runs = singles(&costs.robot);
    for cost in both(&target, Weights::from_reference(&target)) {
        let total = evaluate(cost.as_ref(), &runs).unwrap().total;
        assert!(total < 1e-6, "{}: {total}", cost.name());
    }
}

fn both(target: &Arc<Reference>, weights: Weights) -> [Box<dyn Cost>; 2] {
    [
        Box::new(Wass::new(Arc::clone(target), weights).unwrap()),
        Box::new(TimeAligned::match_o(Arc::clone(target), weights).unwrap()),
    ]
}

/// Worker threads may finish recordings in any order, and accumulators are reused.
#[test]
fn order_and_reuse_change_no_bit() {
    let costs = fixtures().costs;
    let target = target(&costs);
    let runs = singles(&costs.aligned);
    for cost in both(&target, Weights::from_reference(&target)) {
        let forward = evaluate(cost.as_ref(), &runs).unwrap();
        let mut accumulator = cost.begin();
        for _ in 0..2 {
            accumulator.add(1, runs[1].view()).unwrap();
            accumulator.add(0, runs[0].view()).unwrap();
            assert_eq!(accumulator.finish().unwrap(), forward, "{}", cost.name());
        }
        std::thread::scope(|scope| {
            let (cost, runs) = (cost.as_ref(), &runs);
            let other = scope.spawn(move || evaluate(cost, runs)).join().unwrap().unwrap();
            assert_eq!(other, forward);
        });
    }
}

/// A diverged candidate is named and leaves the accumulator fit for the next one.
#[test]
fn diverged_candidates_are_refused() {
    let costs = fixtures().costs;
    let target = target(&costs);
    let runs = singles(&costs.aligned);
    for (bad_value, cost) in
        [f32::NAN, f32::INFINITY].into_iter().zip(both(&target, Weights::from_reference(&target)))
    {
        let good = evaluate(cost.as_ref(), &runs).unwrap();
        let mut bad = runs[1].clone();
        bad.velocity[7 * costs.joints + 2] = bad_value;
        let mut accumulator = cost.begin();
        accumulator.add(0, runs[0].view()).unwrap();
        let error = accumulator.add(1, bad.view()).unwrap_err();
        assert!(error.is_candidate_failure());
        assert_eq!(
            error.to_string(),
            "simulated velocity of joint joint_2 is not finite at sample 7 of recording 1"
        );
        for (recording, run) in runs.iter().enumerate() {
            accumulator.add(recording, run.view()).unwrap();
        }
        assert_eq!(accumulator.finish().unwrap(), good);
        // The same value in the pre-roll does not count.
        let mut early = runs[1].clone();
        early.velocity[2] = bad_value;
        assert_eq!(evaluate(cost.as_ref(), &[runs[0].clone(), early]).unwrap(), good);
    }
}

#[test]
fn wrong_setups_are_refused() {
    let costs = fixtures().costs;
    let target = target(&costs);
    let runs = singles(&costs.aligned);
    let weights = Weights::from_reference(&target);
    for cost in both(&target, weights) {
        let mut accumulator = cost.begin();
        assert!(matches!(accumulator.finish(), Err(CostError::Missing(0))));
        let without = Signals { action: None, ..runs[0].view() };
        assert!(matches!(accumulator.add(0, without), Err(CostError::MissingSignal { .. })));
        let ragged = Signals { position: &runs[0].position[1..], ..runs[0].view() };
        assert!(matches!(accumulator.add(0, ragged), Err(CostError::Shape { .. })));
    }
    let match_o = TimeAligned::match_o(Arc::clone(&target), weights).unwrap();
    let mut accumulator = match_o.begin();
    accumulator.add(0, runs[0].view()).unwrap();
    assert_eq!(accumulator.add(0, runs[0].view()).unwrap_err(), CostError::Repeated(0));
    assert!(matches!(accumulator.add(2, runs[0].view()), Err(CostError::UnknownRecording { .. })));
    assert!(matches!(accumulator.add(1, runs[0].view()), Err(CostError::Shape { .. })));

    for bad in [[0.0, 0.0, 0.0], [1.0, -1.0, 0.0], [f64::NAN, 1.0, 0.0]] {
        let weights = Weights { position: bad[0], velocity: bad[1], action: bad[2], ..Weights::default() };
        assert!(matches!(Wass::new(Arc::clone(&target), weights), Err(CostError::Weights(_))));
    }
}

/// A joint that is constant on the robot is left out of the mean; a signal of constants is refused.
#[test]
fn constant_dimensions_are_left_out() {
    let joints = vec!["moving".to_owned(), "held".to_owned()];
    let recorded = Recorded {
        position: vec![0.0, 0.5, 1.0, 0.5, 2.0, 0.5],
        velocity: vec![0.0; 6],
        ..Recorded::default()
    };
    let target = Arc::new(Reference::new(joints, &[recorded], 0).unwrap());
    assert_eq!(
        target.constant(),
        [(Signal::Position, "held"), (Signal::Velocity, "moving"), (Signal::Velocity, "held")]
    );
    assert_eq!(
        Wass::new(Arc::clone(&target), Weights::from_reference(&target)).unwrap_err(),
        CostError::AllConstant(Signal::Velocity)
    );
    let run =
        Single { position: vec![0.25, 9.0, 1.25, 9.0, 2.25, 9.0], velocity: vec![0.0; 6], action: vec![] };
    for cost in both(&target, Weights::POSITION) {
        // Range 2, so the scale is 1 and the shift of 0.25 is the cost.
        let breakdown = evaluate(cost.as_ref(), std::slice::from_ref(&run)).unwrap();
        assert_eq!(breakdown.total, 0.25);
        assert_eq!(breakdown.groups[0].per_joint, [Some(0.25), None]);
    }
}

/// Six recordings of 4,700 samples and 24 dimensions: time per sample of Wass and MatchO.
/// `cargo test --release -p gaitfit-adapt --test tests cost_oracle -- --ignored --nocapture`
#[test]
#[ignore = "a timing; run it alone, in release"]
fn timing_costs_are_fast() {
    use gaitfit_random::{Purpose, Stream};
    let (joints, samples, recordings) = (12, 4_700, 6);
    let run = |seed: u64, spread: f64| -> Vec<f64> {
        let mut values = vec![0.0; samples * joints];
        Stream::new(seed, Purpose(99)).fill_normals(0, &mut values);
        values.iter().map(|value| spread * value).collect()
    };
    let recorded: Vec<Recorded> = (0..recordings)
        .map(|r| Recorded { position: run(r, 0.3), velocity: run(r + 100, 2.0), ..Recorded::default() })
        .collect();
    let names = (0..joints).map(|joint| joint.to_string()).collect();
    let target = Arc::new(Reference::new(names, &recorded, 0).unwrap());
    for extra in [0, 10] {
        let simulated: Vec<Single> = (0..recordings)
            .map(|r| {
                Single::of(&Run { position: run(r + 200, 0.3), velocity: run(r + 300, 2.1), action: vec![] })
            })
            .map(|mut single| {
                // Unequal counts take the general merge.
                single.position.truncate((samples - extra) * joints);
                single.velocity.truncate((samples - extra) * joints);
                single
            })
            .collect();
        for cost in both(&target, Weights::from_reference(&target)) {
            if extra > 0 && cost.name() == "matcho" {
                continue;
            }
            let mut accumulator = cost.begin();
            let mut best = f64::INFINITY;
            for _ in 0..10 {
                let start = std::time::Instant::now();
                for (recording, single) in simulated.iter().enumerate() {
                    accumulator.add(recording, Signals { action: None, ..single.view() }).unwrap();
                }
                accumulator.finish().unwrap();
                best = best.min(start.elapsed().as_secs_f64());
            }
            let count = (recordings as usize * (samples - extra) * joints * 2) as f64;
            let ns = 1e9 * best / count;
            println!(
                "{} ({extra} samples fewer): {ns:.2} ns a sample, {:.1} ms for 20 candidates on 2 threads",
                cost.name(),
                10.0 * best * 1e3
            );
            assert!(ns < 30.0);
        }
    }
}
