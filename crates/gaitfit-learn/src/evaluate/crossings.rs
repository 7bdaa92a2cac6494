//! Whether robots get off their cell of generated ground: level by level, kind by kind.

use gaitfit_sim::stats::Estimate;
use serde::Serialize;

use super::Subject;
use crate::player::Player;
use crate::task::{Cell, Course, Ended, Environment, Task, TaskError, TerrainKind};
use crate::tiles::in_tiles;

/// Environments that one thread advances together.
const TILE: usize = 64;

/// Result of one robot on its cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Crossing {
    /// Its cell.
    pub cell: Cell,
    /// Whether it left the cell without a fall.
    pub crossed: bool,
    /// Whether it fell, or its state stopped being a number, before it left the cell.
    pub fell: bool,
    /// Distance from where it started, in a straight line, m.
    pub distance: f64,
    /// Time until it left, fell, or time was up, s.
    pub seconds: f64,
}

/// Robots on one kind and level of ground.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CrossingSummary {
    /// Kind of ground.
    pub kind: TerrainKind,
    /// `up` for slopes and stairs that lead up from the start, `down` for those that lead down, else empty.
    pub direction: &'static str,
    /// Level, from 0.
    pub level: usize,
    /// Height of a step (m), slope, or roughness (m).
    pub difficulty: f64,
    /// Robots.
    pub robots: usize,
    /// Share that left their cell without a fall.
    pub crossed: Option<Estimate>,
    /// Share that fell.
    pub fell: Option<Estimate>,
    /// Mean distance from the start over the time it took, m/s.
    pub speed: Option<Estimate>,
}

/// Starts `robots` on every cell of the task's ground and tells each to walk straight ahead at `speed` (m/s), whichever
/// way it faces, for three times as long as the way off the cell takes at that speed, and a second more. Results do not
/// depend on the number of threads. Nothing on flat ground.
///
/// # Errors
/// A robot that cannot be, or the subject's `cancel`.
pub fn crossings(
    subject: &Subject<'_>,
    robots: usize,
    speed: f64,
    threads: usize,
) -> Result<Vec<Crossing>, TaskError> {
    let (count, steps) = crossing_size(subject.task, robots, speed);
    in_tiles(count, TILE, threads, |first, count| tile(subject, first, count, speed, steps))
}

/// Robots on all cells, and control periods of each: nothing on flat ground. `robots`, `speed`: as for [`crossings`].
pub fn crossing_size(task: &Task, robots: usize, speed: f64) -> (usize, u32) {
    let Some(course) = &task.course else { return (0, 0) };
    let settings = course.settings();
    // From the middle of the cell to its edge is half of its size.
    let seconds = 3.0 * 0.5 * course.size() / speed + 1.0;
    let steps = (seconds / task.walker.interface.control_dt).ceil() as u32;
    (settings.levels * settings.columns * robots, steps)
}

fn tile(
    subject: &Subject<'_>,
    first: u32,
    count: usize,
    speed: f64,
    steps: u32,
) -> Result<Vec<Crossing>, TaskError> {
    let environment = crossing_environment(subject, first, count, speed)?;
    let Some(mut recorder) = CrossingRecorder::new(&environment) else { return Ok(Vec::new()) };
    let mut player = Player::new(subject, environment);
    for step in 1..=steps {
        player.step(step)?;
        let places = &player.environment.motion().base_position;
        if recorder.take(step, |index| (player.ended[index], ground_place(&places[3 * index..]))) {
            // Progress is counted against all periods, so those that are not simulated count as done.
            player.skip(steps - step);
            break;
        }
    }
    Ok(recorder.finish())
}

/// Where a base at `position` is over the ground, m.
pub fn ground_place(position: &[f32]) -> [f64; 2] {
    [f64::from(position[0]), f64::from(position[1])]
}

/// Makes `count` environments, numbered from `first`, spread over the cells of the task's ground. Their command is to
/// walk ahead at `speed`, m/s.
///
/// # Errors
/// A robot that cannot be simulated.
pub fn crossing_environment<'a>(
    subject: &Subject<'a>,
    first: u32,
    count: usize,
    speed: f64,
) -> Result<Environment<'a>, TaskError> {
    let Subject { task, candidate, seed, .. } = *subject;
    let mut environment = Environment::new(task, candidate, seed, first, count)?;
    if let Some(course) = &task.course {
        let settings = course.settings();
        for index in 0..count {
            // Robots of neighbouring numbers are on neighbouring columns.
            let level = (first as usize + index) / settings.columns % settings.levels;
            environment.hold_command(index, [speed as f32, 0.0, 0.0]);
            environment.put_on_level(index, level);
        }
        environment.refresh();
    }
    Ok(environment)
}

/// Crossings of robots side by side, step by step, from whatever simulates them.
pub struct CrossingRecorder<'a> {
    course: &'a Course,
    crossings: Vec<Crossing>,
    starts: Vec<[f64; 2]>,
    /// The control period, s.
    dt: f64,
}

impl<'a> CrossingRecorder<'a> {
    /// A recorder for the robots of `environment`, which have not moved yet; `None` on flat ground.
    pub fn new(environment: &Environment<'a>) -> Option<Self> {
        let task = environment.task();
        // On flat ground there is no recorder, so the default is never used.
        let cell = |index: usize| environment.cell(index).unwrap_or_default();
        let crossing = |index: usize| Crossing { cell: cell(index), ..Crossing::default() };
        let places = environment.motion().base_position.chunks_exact(3);
        Some(Self {
            course: task.course.as_ref()?,
            crossings: (0..environment.count()).map(crossing).collect(),
            starts: places.map(ground_place).collect(),
            dt: task.walker.interface.control_dt,
        })
    }

    /// Adds step number `step`, from 1: how each robot's episode stands, and where it is over the ground, m. Returns
    /// whether all robots have left their cells or fallen. What a robot does afterwards does not count.
    pub fn take(&mut self, step: u32, state: impl Fn(usize) -> (Ended, [f64; 2])) -> bool {
        let half = 0.5 * self.course.size();
        for (index, crossing) in
            self.crossings.iter_mut().enumerate().filter(|(_, one)| !one.crossed && !one.fell)
        {
            let (ended, [x, y]) = state(index);
            crossing.fell = matches!(ended, Ended::Fall | Ended::Diverged);
            // The time stays that of the last step that counts, because the filter then skips the robot.
            crossing.seconds = f64::from(step) * self.dt;
            if ended == Ended::Diverged {
                continue;
            }
            // The place of a robot that diverged is not finite, so it is skipped above.
            let middle = self.course.middle(crossing.cell);
            crossing.distance = (x - self.starts[index][0]).hypot(y - self.starts[index][1]);
            // Cells are squares along the axes, so the larger of the two coordinates decides.
            crossing.crossed = !crossing.fell && (x - middle[0]).abs().max((y - middle[1]).abs()) > half;
        }
        self.crossings.iter().all(|one| one.crossed || one.fell)
    }

    /// The crossings.
    pub fn finish(self) -> Vec<Crossing> {
        self.crossings
    }
}

/// Means by kind, direction and level, in the columns' order, easy ground first.
pub fn summarise_crossings(course: &Course, crossings: &[Crossing]) -> Vec<CrossingSummary> {
    let settings = course.settings();
    let mut kinds: Vec<(TerrainKind, &'static str)> = Vec::new();
    let place = |cell: Cell| {
        let kind = course.kind(cell);
        let direction = match kind {
            TerrainKind::Flat | TerrainKind::Rough => "",
            // Robots start in the middle of a cell, which is the lowest place of a pit.
            _ if course.is_pit(cell) => "up",
            _ => "down",
        };
        (kind, direction)
    };
    for column in 0..settings.columns {
        // The kind belongs to the column and is the same on all levels.
        let kind = place(Cell { level: 0, column });
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let mut summaries = Vec::new();
    for (kind, direction) in kinds {
        for level in 0..settings.levels {
            // Robots of all columns of this kind and direction, on this level.
            let here = || {
                crossings
                    .iter()
                    .filter(move |one| one.cell.level == level && place(one.cell) == (kind, direction))
            };
            let robots = here().count();
            let share =
                |wanted: fn(&&Crossing) -> bool| Estimate::share(here().filter(wanted).count(), robots);
            let column =
                (0..settings.columns).find(|&column| place(Cell { level, column }) == (kind, direction));
            // The kinds are those of the columns, so one of them is found.
            let cell = Cell { level, column: column.unwrap_or_default() };
            // A robot that took no step has gone 0 m in 0 s: its speed is 0.
            let speeds: Vec<f64> = here().map(|one| one.distance / one.seconds.max(1e-9)).collect();
            summaries.push(CrossingSummary {
                kind,
                direction,
                level,
                difficulty: course.difficulty(cell),
                robots,
                crossed: share(|one| one.crossed),
                fell: share(|one| one.fell),
                speed: Estimate::from_values(&speeds),
            });
        }
    }
    summaries
}
