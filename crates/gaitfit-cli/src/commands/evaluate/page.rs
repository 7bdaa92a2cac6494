//! The result as a page.

use super::text::{MOTION, rows};
use crate::cli;
use crate::exit::Failure;
use gaitfit::evaluate::{Measured, Verdict};
use gaitfit::gait;
use gaitfit::world::World;
use gaitfit::{machine, policy_file};
use gaitfit_learn::evaluate::Trial;
use gaitfit_view::Estimate;
use gaitfit_view::evaluation::{Ground, Histogram, Measure};
use gaitfit_view::{Doubt, DoubtKind, EvaluationReport, Replay, Setting};

/// Bars of a histogram.
const BINS: usize = 40;

/// The numbers in large print.
const HEADLINE: [&str; 4] = ["linear-velocity error", "angular-velocity error", MOTION, "falls"];

/// The number of a trajectory whose mean is this row; `None` for rates.
fn of_trial(name: &str) -> Option<fn(&Trial) -> f64> {
    match name {
        "summed reward" => Some(|trial| trial.reward),
        "linear-velocity error" => Some(|trial| trial.linear_velocity_error),
        "angular-velocity error" => Some(|trial| trial.angular_velocity_error),
        MOTION => Some(|trial| trial.motion_error.unwrap_or(f64::NAN)),
        "action rate" => Some(|trial| trial.action_rate),
        _ => None,
    }
}

/// `report.html`.
pub fn page(
    args: &cli::Evaluate,
    world: &World,
    measured: &Measured,
    verdict: Option<&Verdict>,
    replay: Option<Replay>,
    wall_seconds: f64,
) -> Result<String, Failure> {
    let document = &measured.evaluation;
    // Row by row as on the terminal.
    let measure = |(name, estimate, digits, unit): (&str, Estimate, usize, &str)| Measure {
        name: name.to_owned(),
        unit: unit.to_owned(),
        mean: estimate.mean,
        ci95: estimate.ci95,
        decimals: Some(digits),
        headline: HEADLINE.contains(&name),
        limit: None,
        histogram: of_trial(name).map(|value| {
            let values: Vec<f64> = measured.trials.iter().map(value).collect();
            Histogram::from_samples(&values, BINS)
        }),
    };
    let setting = |name: &str, value: String| Setting { name: name.to_owned(), value };
    let diverged = document.divergence().map(|text| Doubt::new(DoubtKind::Diverged, text));
    // A verdict against the policy is shown as a doubt, one for it as a sentence.
    let stands = verdict.filter(|one| !one.walks);
    let stands = stands.map(|one| Doubt::new(DoubtKind::NoWalk, one.text.clone()));
    let report = EvaluationReport {
        title: policy_file::title(&args.world.policy),
        robot: document.simulator.clone(),
        created: machine::now(),
        wall_seconds,
        doubts: diverged.into_iter().chain(stands).collect(),
        verdict: verdict.filter(|one| one.walks).map(|one| one.text.clone()).unwrap_or_default(),
        trajectories: document.trajectories as u64,
        seconds: document.seconds,
        measures: rows(document).into_iter().map(measure).collect(),
        // The number of robots of a trial is not in its result.
        drift: document.drift.iter().map(|trial| trial.drawn(args.drift.unwrap_or(cli::DRIFT))).collect(),
        ground: document
            .ground
            .iter()
            .map(|row| Ground {
                name: row.ground.clone(),
                level: row.level as u32,
                difficulty: row.difficulty_text(),
                robots: row.robots as u32,
                crossed: row.crossed.mean,
                falls: row.fall_rate.mean,
                speed: row.speed.mean,
            })
            .collect(),
        replay,
        gait: measured.gait.as_ref().map(gait::picture),
        gait_caption: "standing, then ahead at half the largest command".to_owned(),
        settings: vec![
            setting("seed", document.seed.to_string()),
            setting("physics steps per action", world.scene.settings.substeps.to_string()),
            setting("control period, s", world.scene.walker.interface.control_dt.to_string()),
        ],
        versions: vec![setting("gaitfit", env!("CARGO_PKG_VERSION").to_owned())],
        ..EvaluationReport::default()
    };
    gaitfit_view::evaluation_html(&report).map_err(Failure::failed)
}
