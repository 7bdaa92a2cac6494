//! Axes and signs of orientation and gyro, from a person's tilts.

use gaitfit_model::rotation::{Vec3, dot};
use serde::Serialize;

use super::turned::{
    advanced, angle, axis_name, mean_attitude, mounting, nearest_quarter_turns, turn_between,
};
use super::{Check, Finding, Heard};

/// How far the axis of a turn may be from the one asked for, degrees: nobody turns a robot about one axis alone.
const OFF_AXIS: f64 = 35.0;
/// How far the turn by the gyro may be from that by the orientation: in parts of the turn, and degrees.
const GYRO: (f64, f64) = (0.15, 3.0);
/// Messages at the beginning whose mean orientation is the one before the turn.
const BEFORE: usize = 10;

/// A turn by hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// The right side down: about +x.
    RollRight,
    /// The nose down: about +y.
    NoseDown,
    /// The nose to the left: about +z.
    TurnLeft,
}

impl Motion {
    /// All, in the order in which they are asked for.
    pub const ALL: [Self; 3] = [Self::NoseDown, Self::RollRight, Self::TurnLeft];

    /// The request to the person.
    pub fn words(self) -> &'static str {
        match self {
            Self::RollRight => "roll the robot to the right: its right side down",
            Self::NoseDown => "tilt its nose down",
            Self::TurnLeft => "turn it to the left, seen from above",
        }
    }

    /// The base's axis about which it turns.
    pub fn axis(self) -> Vec3 {
        match self {
            Self::RollRight => [1.0, 0.0, 0.0],
            Self::NoseDown => [0.0, 1.0, 0.0],
            Self::TurnLeft => [0.0, 0.0, 1.0],
        }
    }
}

/// A turn that a person made, with the states from just before it to its end.
#[derive(Clone, Debug)]
pub struct Tilted {
    /// The turn that was asked for.
    pub motion: Motion,
    /// States from just before it to its end.
    pub heard: Vec<Heard>,
}

/// A turn as the unit saw it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TiltReport {
    /// The turn that was asked for.
    pub motion: Motion,
    /// The turn by the orientation, degrees about x, y, z.
    pub turn: [f64; 3],
    /// The turn by the gyro, degrees about x, y, z.
    pub gyro_turn: [f64; 3],
}

/// What turns show, how the unit is mounted (roll, pitch, yaw, degrees) if not as the base's axes are, and what is wrong.
/// `gyro_bias`: the gyro's reading at rest, rad/s; zeros if it is unknown.
pub fn tilted(turns: &[Tilted], gyro_bias: Vec3) -> (Vec<TiltReport>, Option<[f64; 3]>, Vec<Finding>) {
    let mut findings = Vec::new();
    let reports: Vec<TiltReport> = turns.iter().filter_map(|turn| report(turn, gyro_bias)).collect();
    for one in &reports {
        judge_gyro(one, &mut findings);
    }
    // All turns about other axes than asked for: together they tell how the unit is mounted.
    let off = |one: &&TiltReport| angle(one.turn, one.motion.axis()).to_degrees() > OFF_AXIS;
    let wrong: Vec<&TiltReport> = reports.iter().filter(off).collect();
    let read = |motion: Motion| reports.iter().find(|one| one.motion == motion).map(|one| one.turn);
    let mut mounted = None;
    if !wrong.is_empty() {
        // Three turns about the base's axes, as the unit read them, give the rotation between unit and base.
        let [x, y, z] = [Motion::RollRight, Motion::NoseDown, Motion::TurnLeft].map(read);
        let whole = match (x, y, z) {
            (Some(x), Some(y), Some(z)) => mounting([x, y, z]).map(nearest_quarter_turns),
            _ => None,
        };
        let words: Vec<String> = wrong
            .iter()
            .map(|one| format!("{} reads as a turn about {}", name(one.motion), axis_name(one.turn)))
            .collect();
        let remedy = match whole {
            // A unit that is not turned does not explain wrong axes.
            Some((angles, away)) if away < OFF_AXIS && angles != [0.0; 3] => {
                mounted = Some(angles);
                format!("The unit is mounted turned: state imu.mounting = {angles:?} (roll, pitch, yaw) in logs")
            }
            _ => "One axis or sign of the orientation is wrong, or the order of its components, or the robot was turned \
                  otherwise: repeat, and compare with the vendor's documentation"
                .to_owned(),
        };
        findings.push(Finding::fault(Check::Mounting, words.join("; "), remedy));
    }
    (reports, mounted, findings)
}

fn name(motion: Motion) -> &'static str {
    match motion {
        Motion::RollRight => "rolling right (+x)",
        Motion::NoseDown => "nose down (+y)",
        Motion::TurnLeft => "turning left (+z)",
    }
}

fn report(tilted: &Tilted, gyro_bias: Vec3) -> Option<TiltReport> {
    let heard = &tilted.heard;
    // Means over still moments before and after, so that noise does not matter.
    let from = mean_attitude(&heard[..heard.len().min(BEFORE)])?;
    let to = mean_attitude(&heard[heard.len().saturating_sub(BEFORE)..])?;
    // The gyro alone, integrated from the first orientation, must lead to the second.
    let mut q = from;
    for pair in heard.windows(2) {
        let seconds = pair[1].came.saturating_sub(pair[0].came).as_secs_f64();
        // The mean of both ends (trapezoidal rule). A person may take half a minute, in which a small bias adds up.
        let mean = |k: usize| 0.5 * f64::from(pair[0].state.gyroscope[k] + pair[1].state.gyroscope[k]);
        let rate: Vec3 = std::array::from_fn(|k| mean(k) - gyro_bias[k]);
        q = advanced(q, rate, seconds);
    }
    let degrees = |turn: Vec3| turn.map(f64::to_degrees);
    Some(TiltReport {
        motion: tilted.motion,
        turn: degrees(turn_between(from, to)),
        gyro_turn: degrees(turn_between(from, q)),
    })
}

fn judge_gyro(one: &TiltReport, findings: &mut Vec<Finding>) {
    let size = dot(one.turn, one.turn).sqrt();
    let difference: Vec3 = std::array::from_fn(|k| one.gyro_turn[k] - one.turn[k]);
    if dot(difference, difference).sqrt() < GYRO.0 * size + GYRO.1 {
        return;
    }
    let of_gyro = dot(one.gyro_turn, one.gyro_turn).sqrt();
    let ratio = of_gyro / size.max(1e-9);
    let opposite = angle(one.gyro_turn, one.turn).to_degrees() > 180.0 - OFF_AXIS;
    let along = angle(one.gyro_turn, one.turn).to_degrees() < OFF_AXIS;
    let (problem, remedy) = if opposite {
        (
            "the gyro reads the opposite sign of the orientation's turn".to_owned(),
            "In logs state imu.negated = true",
        )
    // 180/π = 57 if the unit is a degree; half of it leaves room for a turn that was not pure.
    } else if along && ratio > 30.0 {
        ("the gyro's unit is °/s".to_owned(), "In logs state imu.unit = \"deg\"")
    } else {
        (
            format!(
                "the gyro's rates add up to a turn about {} of {of_gyro:.0}°, the orientation's to {} of {size:.0}°",
                axis_name(one.gyro_turn),
                axis_name(one.turn)
            ),
            "Bring gyro and orientation into one frame; if only their size differs, check the gyro's unit and range",
        )
    };
    findings.push(Finding::fault(Check::GyroAttitude, format!("{}: {problem}", name(one.motion)), remedy));
}
