//! The result as a page.

use crate::cli;
use crate::exit::Failure;
use gaitfit::evaluate::Measured;
use gaitfit::gait;
use gaitfit::machine;
use gaitfit::world::World;
use gaitfit_learn::evaluate::Trial;
use gaitfit_view::evaluation::{Ground, Histogram, Measure};
use gaitfit_view::loop_report::Estimate;
use gaitfit_view::{Doubt, DoubtKind, EvaluationReport, Setting};

/// Bars of a histogram.
const BINS: usize = 40;

/// `report.html`.
pub fn page(
    args: &cli::Evaluate,
    world: &World,
    measured: &Measured,
    wall_seconds: f64,
) -> Result<String, Failure> {
    let document = &measured.evaluation;
    let summary = document;
    let measure = |name: &str, unit: &str, estimate: Estimate, value: Option<fn(&Trial) -> f64>| Measure {
        name: name.to_owned(),
        unit: unit.to_owned(),
        mean: estimate.mean,
        ci95: estimate.ci95,
        limit: None,
        histogram: value.map(|value| {
            let values: Vec<f64> = measured.trials.iter().map(value).collect();
            Histogram::from_samples(&values, BINS)
        }),
    };
    let setting = |name: &str, value: String| Setting { name: name.to_owned(), value };
    let report = EvaluationReport {
        title: document.policy.clone(),
        robot: document.simulator.clone(),
        created: machine::now(),
        wall_seconds,
        doubts: document.divergence().map(|text| Doubt::new(DoubtKind::Diverged, text)).into_iter().collect(),
        trajectories: summary.trajectories as u64,
        seconds: document.seconds,
        measures: vec![
            measure("summed reward", "", summary.reward, Some(|t| t.reward)),
            measure(
                "linear-velocity error",
                "m/s",
                summary.linear_velocity_error,
                Some(|t| t.linear_velocity_error),
            ),
            measure(
                "angular-velocity error",
                "rad/s",
                summary.angular_velocity_error,
                Some(|t| t.angular_velocity_error),
            ),
            measure("falls", "share", summary.fall_rate, None),
            measure("action rate", "a step", summary.action_rate, Some(|t| t.action_rate)),
        ],
        drift: document.drift.iter().map(|trial| trial.drawn(args.drift)).collect(),
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
        gait: measured.gait.as_ref().map(gait::picture),
        gait_caption: "standing, then ahead at half the greatest command".to_owned(),
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
