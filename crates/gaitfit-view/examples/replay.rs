//! Writes a replay of two invented trots, to look at the page without training:
//! `cargo run -p gaitfit-view --example replay -- replay.html`

#[path = "../tests/common/go2.rs"]
#[allow(dead_code)] // Other examples use the rest.
mod go2;

use gaitfit_view::{Replay, replay_html};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "replay.html".to_string());
    let replay = Replay {
        title: "Go2: before and after the fit".into(),
        note: "Two invented trots under the same commands".into(),
        dt: go2::DT,
        robots: vec![go2::trot("before", 500, 0.7), go2::trot("after", 500, 0.98)],
    };
    let page = replay_html(&replay)?;
    println!("{path}: {} bytes", page.len());
    std::fs::write(&path, page)?;
    let one = Replay { robots: replay.robots[1..].to_vec(), title: "Go2, one policy".into(), ..replay };
    std::fs::write(path.replace(".html", "_one.html"), replay_html(&one)?)?;
    Ok(())
}
