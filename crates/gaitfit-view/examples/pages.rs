//! Writes the pages of an invented training run and its evaluation, to look at them without training:
//! `cargo run -p gaitfit-view --example pages -- folder`

#[path = "../tests/common/invented.rs"]
mod invented;

use gaitfit_view::{evaluation_html, gait_picture_svg, training_report};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".to_string()));
    for (name, text) in [
        ("training.html", training_report(&invented::training(5, 600))?),
        ("evaluation.html", evaluation_html(&invented::evaluation(10_000))?),
        ("gait.svg", gait_picture_svg(&invented::go2::gait(200))),
    ] {
        println!("{name}: {} bytes", text.len());
        std::fs::write(folder.join(name), text)?;
    }
    Ok(())
}
