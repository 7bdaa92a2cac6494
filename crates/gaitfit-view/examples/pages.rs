//! Writes invented pages and pictures of all kinds but fits and loops, to look at them without training:
//! `cargo run -p gaitfit-view --example pages -- folder`

#[path = "../tests/common/go2.rs"]
#[allow(dead_code)] // Tests use the rest.
mod go2;
#[path = "../tests/common/invented.rs"]
mod invented;

use gaitfit_view::chart::{Bar, BarGroup, Look, bar_figure};
use gaitfit_view::log_picture::{LogJoint, LogMark, LogPicture};
use gaitfit_view::{Doubt, DoubtKind, EvaluationReport, evaluation_html, log_picture_svg, training_report};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".to_string()));
    for (name, text) in [
        ("training.html", training_report(&invented::training(5, 600))?),
        ("evaluation.html", evaluation_html(&invented::evaluation(10_000))?),
        ("doubted.html", evaluation_html(&doubted())?),
        ("log.svg", log_picture_svg(&log())),
        ("bars.svg", bar_figure("Errors", &bars()).standalone()),
    ] {
        println!("{name}: {} bytes", text.len());
        std::fs::write(folder.join(name), text)?;
    }
    Ok(())
}

fn doubted() -> EvaluationReport {
    let doubts = vec![
        Doubt::new(DoubtKind::OwnSimulatorOnly, ""),
        Doubt::new(DoubtKind::Diverged, "12 of 100 robots diverged. They are counted as falls."),
    ];
    EvaluationReport { doubts, ..invented::evaluation(100) }
}

fn log() -> LogPicture {
    let time_s: Vec<f64> = (0..4000).map(|i| f64::from(i) * 0.005).collect();
    let joint = |number: usize| {
        let leg = ["FL", "FR", "RL", "RR"][number / 3];
        let wave = |lag: f64| -> Vec<f64> {
            time_s
                .iter()
                .map(|t| 0.4 * (1.3 * (t - lag) + number as f64).sin() - (number % 3) as f64)
                .collect()
        };
        LogJoint {
            name: format!("{leg}_{}", ["hip", "thigh", "calf"][number % 3]),
            slides: false,
            position: wave(0.06),
            target: wave(0.0),
        }
    };
    let mark = |joint: &str, span_s, error| LogMark { joints: vec![joint.into()], span_s, error };
    LogPicture {
        title: "trajectory_00.csv (go2)".into(),
        facts: "4000 samples at 200 Hz, 20.00 s".into(),
        joints: (0..12).map(joint).collect(),
        marks: vec![mark("FR_calf", (4.0, 9.0), true), mark("RL_hip", (12.0, 12.4), false)],
        time_s,
    }
}

fn bars() -> Vec<BarGroup> {
    let bar = |name: &str, value: f64, half_width: f64, look| Bar {
        name: name.into(),
        value,
        half_width,
        text: if half_width.is_finite() {
            format!("{value:.2} ± {half_width:.2}")
        } else {
            format!("{value:.2}")
        },
        look,
    };
    let pair = |name: &str, ours: f64, theirs: f64| {
        [bar(name, ours, 0.3 * ours, Look::color(0)), bar("paper", theirs, f64::NAN, Look::AREA)]
    };
    let cells = [("friction and armature, Wass", 0.4, 2.1), ("friction and armature, MatchS(20)", 1.9, 3.4)];
    let errors = cells.into_iter().flat_map(|(name, ours, theirs)| pair(name, ours, theirs)).collect();
    let rewards = vec![bar("fitted", -1.2, 0.2, Look::color(0)), bar("truth", 3.0, 0.1, Look::color(1))];
    vec![
        BarGroup { title: "Mean parameter error, %".into(), bars: errors },
        BarGroup { title: "Summed reward (higher is better)".into(), bars: rewards },
    ]
}
