//! Commands and states of a motion on one clock, and as logs.

use std::fmt::Write as _;
use std::time::Duration;

use gaitfit_log::column_names::{BASE_QUATERNION, BASE_RATES};

use super::Heard;
use super::flight::Flown;
use super::plan::Stage;
use crate::command::Command;
use crate::robot::Robot;
use crate::state::RobotState;

/// Time between rows, s: that between two commands.
pub(super) const DT: f64 = 0.002;
/// Rows are interpolated between two states that are at most this far apart, s.
const GAP: f64 = 0.05;

/// A row: what was sent at its time, and the state then.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Since the motion began, s.
    pub time: f64,
    /// The stage.
    pub stage: Stage,
    /// The command that was sent then; it holds until the next row.
    pub command: Command,
    /// The state, interpolated between the messages around it.
    pub state: RobotState,
}

/// Rows at equal distances.
#[derive(Clone, Debug, Default)]
pub struct SampledStates {
    /// There are no rows where no state came for 50 ms.
    pub rows: Vec<Row>,
    /// Mean time between two messages, s; gaps do not count.
    pub message: f64,
}

/// Rows of a motion, every 2 ms, without damping.
pub fn sampled(flown: &Flown) -> SampledStates {
    let mut rows = Vec::new();
    let moving: Vec<_> = flown.sent.iter().filter(|sent| sent.stage != Stage::Damping).collect();
    let (Some(first), Some(last)) = (moving.first(), moving.last()) else { return SampledStates::default() };
    let finite: Vec<&Heard> = flown.heard.iter().filter(|one| is_finite(&one.state)).collect();
    let (mut sent, mut heard) = (0, 0);
    let count = ((last.at - first.at).as_secs_f64() / DT) as u64;
    // Both lists rise in time, so one pass over each finds the neighbours of every row.
    for number in 0..=count {
        let at = first.at + Duration::from_secs_f64(DT * number as f64);
        // A command that is sent a little late counts at its due time.
        while moving.get(sent + 1).is_some_and(|next| next.at <= at + Duration::from_secs_f64(0.5 * DT)) {
            sent += 1;
        }
        while finite.get(heard + 1).is_some_and(|next| next.came <= at) {
            heard += 1;
        }
        let (Some(before), Some(after)) = (finite.get(heard), finite.get(heard + 1)) else { continue };
        let apart = after.came.saturating_sub(before.came).as_secs_f64();
        // No state is made up across a gap, before the first message or between two of the same time.
        if before.came > at || apart > GAP || apart <= 0.0 {
            continue;
        }
        let part = (at.saturating_sub(before.came).as_secs_f64() / apart) as f32;
        rows.push(Row {
            time: DT * number as f64,
            stage: moving[sent].stage,
            command: moving[sent].command,
            state: between(&before.state, &after.state, part),
        });
    }
    // The mean, not the median, as messages may arrive in bursts.
    let apart: Vec<f64> = finite
        .windows(2)
        .map(|pair| pair[1].came.saturating_sub(pair[0].came).as_secs_f64())
        .filter(|apart| *apart <= GAP)
        .collect();
    SampledStates { rows, message: apart.iter().sum::<f64>() / apart.len().max(1) as f64 }
}

fn is_finite(state: &RobotState) -> bool {
    // These are the numbers that are interpolated: one NaN would spoil all rows beside it.
    let parts: [&[f32]; 3] = [&state.q, &state.dq, &state.torque];
    parts.iter().all(|part| part.iter().all(|x| x.is_finite()))
}

/// Joints between two states; the rest is that of the nearer one.
fn between(before: &RobotState, after: &RobotState, part: f32) -> RobotState {
    let mut state = if part < 0.5 { *before } else { *after };
    for motor in 0..state.q.len() {
        let mix = |a: f32, b: f32| a + part * (b - a);
        state.q[motor] = mix(before.q[motor], after.q[motor]);
        state.dq[motor] = mix(before.dq[motor], after.dq[motor]);
        state.torque[motor] = mix(before.torque[motor], after.torque[motor]);
    }
    state
}

/// The first lines of a log.
fn head(robot: &Robot, columns: &[&str]) -> String {
    let joints = robot.joints();
    let named = columns.iter().flat_map(|prefix| joints.iter().map(move |joint| format!(",{prefix}{joint}")));
    let body = [&BASE_QUATERNION[..], &BASE_RATES].concat().join(",");
    format!("time{},{body},acc_x,acc_y,acc_z\n", named.collect::<String>())
}

fn numbers<'n>(text: &mut String, numbers: impl IntoIterator<Item = &'n f32>) {
    for number in numbers {
        // As f64, so that a reader of f64 gets the robot's f32 without rounding.
        let _ = write!(text, ",{:?}", f64::from(*number));
    }
}

fn unit(text: &mut String, state: &RobotState) {
    numbers(text, state.quaternion.iter().chain(&state.gyroscope).chain(&state.accelerometer));
    text.push('\n');
}

/// The log of a motion from the hanging pose on, as fits of legs in the air read it; `None` without it.
pub fn motion_csv(flown: &Flown, sampled: &SampledStates, robot: &Robot) -> Option<String> {
    let plan = flown.plan.as_ref()?;
    // The ways to and from the hanging pose start from anywhere and are no part of the log.
    let kept = |row: &&Row| matches!(row.stage, Stage::Hold | Stage::Joint(_) | Stage::Excite);
    let rows: Vec<&Row> = sampled.rows.iter().filter(kept).collect();
    // The log's time begins at 0.
    let begin = rows.first()?.time;
    let gains =
        |values: &[f32]| values.iter().map(|x| format!("{:?}", f64::from(*x))).collect::<Vec<_>>().join(", ");
    let mut text = format!(
        "# robot = {:?}\n# rate_hz = {:?}\n# kp = [{}]\n# kd = [{}]\n",
        robot.name,
        1.0 / DT,
        gains(plan.kp()),
        gains(plan.kd())
    );
    text.push_str(&head(robot, &["q_", "dq_", "qdes_", "tau_"]));
    for row in rows {
        let _ = write!(text, "{:.4}", row.time - begin);
        numbers(&mut text, &row.state.q);
        numbers(&mut text, &row.state.dq);
        row.command.iter().for_each(|slot| numbers(&mut text, [&slot.q]));
        numbers(&mut text, &row.state.torque);
        unit(&mut text, &row.state);
    }
    Some(text)
}

/// All messages of a recording, with the times at which they came.
pub fn listening_csv(heard: &[Heard], robot: &Robot) -> String {
    let mut text = format!("# robot = {:?}\n{}", robot.name, head(robot, &["q_", "dq_", "tau_"]));
    for one in heard {
        let _ = write!(text, "{:.6}", one.came.as_secs_f64());
        numbers(&mut text, one.state.q.iter().chain(&one.state.dq).chain(&one.state.torque));
        unit(&mut text, &one.state);
    }
    text
}
