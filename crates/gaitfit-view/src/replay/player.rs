//! The page that plays a replay, and the player within a report.

use super::check::check;
use super::pack::pack;
use super::{Frame, Replay, ReplayError, ReplayRobot};
use crate::format::{clean, clean_prose};
use crate::page;
use serde::Serialize;

/// The heading of a robot's pane.
#[derive(Serialize)]
struct Pane {
    name: String,
    /// Whether it has a velocity that can be compared with a command: a clamped robot has none.
    moves: bool,
}

/// The player as `player.html` sees it, on a page of its own or within a report.
#[derive(Serialize)]
pub(crate) struct Player {
    robots: Vec<Pane>,
    data: String,
    style: &'static str,
    script: String,
    /// Within a report it listens to keys and wheel only once it was clicked.
    embedded: bool,
}

impl Player {
    /// The player of a replay that can be drawn.
    pub fn new(replay: &Replay, embedded: bool) -> Result<Player, ReplayError> {
        // Before packing, which relies on indices and lengths that fit together.
        check(replay)?;
        let json = serde_json::to_string(&pack(replay))?;
        Ok(Player {
            robots: replay.robots.iter().map(pane).collect(),
            // A name could contain `</script>`, which would end the element.
            data: within_script(&json),
            style: include_str!("replay.css"),
            // In this order: later files use names of earlier ones.
            script: [
                include_str!("maths.js"),
                include_str!("motion.js"),
                include_str!("ground.js"),
                include_str!("mesh.js"),
                include_str!("webgl.js"),
                include_str!("flat.js"),
                include_str!("player.js"),
            ]
            .concat(),
            embedded,
        })
    }
}

fn pane(robot: &ReplayRobot) -> Pane {
    let moves = |frame: &Frame| frame.velocity.iter().any(|x| x.is_finite());
    Pane { name: clean(&robot.name), moves: robot.frames.iter().any(moves) }
}

/// Max number of robots of a replay within a report.
const MAX_ROBOTS: usize = 4;
/// Max number of frames of a replay within a report: two minutes at 50 Hz.
const MAX_FRAMES: usize = 6000;

/// A replay within a report, as the template sees it.
#[derive(Serialize)]
pub(crate) struct Motion {
    pub player: Option<Player>,
    note: String,
}

impl Motion {
    /// The replay cut to what a report holds, and why it has none though it was to have one.
    pub fn new(replay: Option<&Replay>) -> (Motion, Option<String>) {
        let (player, problem) = match replay.map(embedded) {
            None => (None, None),
            Some(Ok(player)) => (Some(player), None),
            Some(Err(why)) => {
                (None, Some(format!("The page has no replay: {}.", clean_prose(&why.to_string()))))
            }
        };
        (Motion { player, note: replay.map_or(String::new(), |r| clean_prose(&r.note)) }, problem)
    }
}

fn embedded(replay: &Replay) -> Result<Player, ReplayError> {
    // A report shows numbers first. It holds the beginning of a long replay, so that its file stays small.
    let robots = replay.robots.iter().take(MAX_ROBOTS).map(|robot| {
        // Not a clone of the whole robot, which would copy the frames that are cut off.
        let frames = robot.frames.iter().take(MAX_FRAMES).cloned().collect();
        ReplayRobot {
            name: robot.name.clone(),
            bodies: robot.bodies.clone(),
            geoms: robot.geoms.clone(),
            meshes: robot.meshes.clone(),
            feet: robot.feet.clone(),
            ground: robot.ground.clone(),
            frames,
        }
    });
    Player::new(&Replay { dt: replay.dt, robots: robots.collect(), ..Replay::default() }, true)
}

#[derive(Serialize)]
struct Page {
    title: String,
    note: String,
    player: Player,
}

/// Renders a self-contained HTML page that plays the motion in 3-D (WebGL 2, or a flat drawing without it).
///
/// `#t=1.5` behind the page's address opens it halted at 1.5 s.
///
/// # Errors
/// [`ReplayError`] names the robot and what does not fit together; see [`Replay`] for what is asked.
pub fn replay_html(replay: &Replay) -> Result<String, ReplayError> {
    let page = Page {
        title: clean(&replay.title),
        note: clean_prose(&replay.note),
        player: Player::new(replay, false)?,
    };
    Ok(page::render(include_str!("replay.html"), page)?)
}

/// JSON that neither ends a script element nor upsets an XML parser: `<`, `>` and `&` occur in strings only, where
/// they can be written by their numbers.
fn within_script(json: &str) -> String {
    json.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}
