//! Writes the report of an invented loop, to look at the page without running one:
//! `cargo run -p gaitfit-view --example loop_report -- report.html`

#[path = "../tests/common/go2.rs"]
#[allow(dead_code)] // Tests use the rest.
mod go2;
#[path = "../tests/common/invented_loop.rs"]
mod invented_loop;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "report.html".to_string());
    let page = gaitfit_view::loop_html(&invented_loop::two_rounds(5, 200, 500))?;
    println!("{path}: {} bytes", page.len());
    std::fs::write(path, page)?;
    Ok(())
}
