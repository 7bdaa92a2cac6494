//! Drift trials: stand, a constant command for four seconds, stand (the paper's hardware trials).

use super::commands::{Commands, Order};
use crate::RobotError;
use crate::state::RobotState;

/// Time of standing before and after the command, s, as `gaitfit evaluate` simulates it.
const STAND: f64 = 1.0;
/// Time of the command, s, as `gaitfit evaluate` simulates it.
pub const COMMAND: f64 = 4.0;
/// The paper's speeds: ahead and to the side, m/s, and turning, rad/s.
pub const SPEEDS: [f32; 3] = [1.0, 1.0, 0.3925];
/// Names of a trial's directions: ahead, to the left, turning to the left, each and its opposite.
pub const DIRECTIONS: [[&str; 2]; 3] = [["+x", "-x"], ["+y", "-y"], ["+yaw", "-yaw"]];
/// Max number of repetitions.
const MAX_REPEATS: usize = 50;

/// A trial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// Where it goes, for example `+x`.
    pub direction: &'static str,
    /// Forward, left, m/s, and yaw rate, rad/s.
    pub command: [f32; 3],
}

/// All directions, `repeats` times over, as fast as `speeds` says; directions without speed are left out.
///
/// # Errors
/// Speeds that are negative or beyond 5, or all 0; no repetition, or more than 50.
pub fn trials(repeats: usize, speeds: [f32; 3]) -> Result<Vec<Trial>, RobotError> {
    let refuse = |problem: String| Err(RobotError::Script(problem));
    if let Some(wrong) = speeds.iter().find(|speed| !(0.0..=5.0).contains(*speed)) {
        return refuse(format!("a drift trial at {wrong}; give speeds from 0 to 5 (m/s, m/s, rad/s)"));
    }
    if speeds == [0.0; 3] {
        return refuse("drift trials without speed; give one above 0".to_owned());
    }
    if !(1..=MAX_REPEATS).contains(&repeats) {
        return refuse(format!("{repeats} drift trials of each direction; give 1 to {MAX_REPEATS}"));
    }
    // A direction without speed would be a trial of standing.
    let directions = (0..3).filter(|&part| speeds[part] > 0.0).flat_map(|part| {
        [1.0, -1.0].into_iter().zip(DIRECTIONS[part]).map(move |(sign, direction)| {
            let mut command = [0.0; 3];
            command[part] = sign * speeds[part];
            Trial { direction, command }
        })
    });
    let directions: Vec<Trial> = directions.collect();
    Ok(directions.iter().copied().cycle().take(repeats * directions.len()).collect())
}

/// Answer to the question whether the next trial begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It waits.
    Wait,
    /// The trial begins.
    Begin,
    /// No further trial.
    End,
}

/// Runs trials one after another, each a walk of its own in the logs. Between two it stands under the policy and asks.
pub struct Trials<'a> {
    trials: &'a [Trial],
    /// Asked while it waits: the trial's number, from 0, and for how long it has waited, s.
    next: Box<dyn FnMut(usize, f64) -> Next + 'a>,
    number: usize,
    /// Time at which the trial began, s; `None` while the robot waits.
    begun: Option<f64>,
    waiting: Option<f64>,
}

impl<'a> Trials<'a> {
    /// `next` is asked each control period while the robot waits.
    pub fn new(trials: &'a [Trial], next: impl FnMut(usize, f64) -> Next + 'a) -> Self {
        Self { trials, next: Box::new(next), number: 0, begun: None, waiting: None }
    }
}

impl Commands for Trials<'_> {
    fn at(&mut self, time: f64, _: &RobotState) -> Option<Order> {
        if self.begun.is_some_and(|begun| time - begun >= STAND + COMMAND + STAND) {
            // Each trial has a wait of its own.
            (self.begun, self.waiting) = (None, None);
            self.number += 1;
        }
        // After the last trial there is no order, so the robot lies down.
        let trial = self.trials.get(self.number)?;
        let begun = match self.begun {
            Some(begun) => begun,
            None => match (self.next)(self.number, time - *self.waiting.get_or_insert(time)) {
                // Without a walk nothing is recorded between two trials.
                Next::Wait => return Some(Order { command: [0.0; 3], walk: None }),
                Next::Begin => *self.begun.insert(time),
                Next::End => return None,
            },
        };
        let walks = (STAND..STAND + COMMAND).contains(&(time - begun));
        let command = if walks { trial.command } else { [0.0; 3] };
        // Standing before and after the command is part of a trial's log.
        Some(Order { command, walk: Some((self.number, begun)) })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::state::tests::standing;

    #[test]
    fn a_trial_stands_walks_and_stands_and_the_next_one_waits() {
        let list = trials(1, [0.5, 0.0, 0.3]).unwrap();
        let names: Vec<_> = list.iter().map(|trial| trial.direction).collect();
        assert_eq!(names, ["+x", "-x", "+yaw", "-yaw"]);
        let mut asked = Vec::new();
        let mut run = Trials::new(&list, |number, waited| {
            asked.push((number, waited));
            match (number, waited >= 2.0) {
                (2, _) => Next::End,
                (_, true) => Next::Begin,
                _ => Next::Wait,
            }
        });
        let state = standing();
        let mut orders = Vec::new();
        let mut time = 0.0;
        while let Some(order) = run.at(time, &state) {
            orders.push((time, order));
            time += 0.5;
        }
        drop(run);
        let at = |time: f64| orders.iter().find(|(at, _)| *at == time).unwrap().1;
        assert_eq!(at(1.5), Order { command: [0.0; 3], walk: None });
        assert_eq!(at(2.5), Order { command: [0.0; 3], walk: Some((0, 2.0)) });
        assert_eq!(at(3.0), Order { command: [0.5, 0.0, 0.0], walk: Some((0, 2.0)) });
        assert_eq!(at(6.5).command, [0.5, 0.0, 0.0]);
        assert_eq!(at(7.0), Order { command: [0.0; 3], walk: Some((0, 2.0)) });
        assert_eq!(at(8.0).walk, None);
        assert_eq!(at(11.0), Order { command: [-0.5, 0.0, 0.0], walk: Some((1, 10.0)) });
        assert_eq!(orders.len(), 32, "the third does not begin");
        assert_eq!(asked.first(), Some(&(0, 0.0)));
        assert_eq!(asked.iter().filter(|(_, waited)| *waited == 0.0).count(), 3, "each wait begins at 0");
    }

    #[test]
    fn speeds_and_counts_that_cannot_be_are_refused() {
        for (repeats, speeds) in
            [(0, SPEEDS), (51, SPEEDS), (1, [0.0; 3]), (1, [-1.0, 0.0, 0.0]), (1, [f32::NAN, 1.0, 1.0])]
        {
            assert!(trials(repeats, speeds).is_err(), "{repeats} {speeds:?}");
        }
        assert_eq!(trials(3, SPEEDS).unwrap().len(), 18);
    }
}
