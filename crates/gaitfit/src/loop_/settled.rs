//! What a training need not draw at random any more: the numbers of the robot that a fit found, if it stands firmly.

use super::results::RoundResult;
use crate::adapt::{AdaptResults, Standing};
use crate::{Error, theta};
use gaitfit_adapt::{JointParameter, RobotNumber};
use std::path::Path;
use toml::{Table, Value};

/// Kinds of parameters that logs have determined; none of a fit in doubt, whose values may stand for something else.
pub fn of_fit(results: &AdaptResults, file: &Path) -> Result<Vec<String>, Error> {
    if results.standing != Standing::Sound {
        return Ok(Vec::new());
    }
    // A parameter that was not judged counts as determined: only a clear no keeps its draw.
    let unknown = |name: &str| {
        results.parameters.iter().any(|one| one.found.name == name && one.identified == Some(false))
    };
    // From the file and not from the results, because trainings read the file.
    let parameters = theta::read(file)?.parameter;
    Ok(parameters.into_iter().filter(|one| !unknown(&one.name)).map(|one| one.kind).collect())
}

/// As [`of_fit`], for a round that is over.
pub fn of_round(round: &RoundResult) -> Result<Vec<String>, Error> {
    if round.fallback.is_some() {
        return Ok(Vec::new());
    }
    of_fit(&round.adapt, Path::new(&round.theta))
}

/// Kinds of parameters of a file of known numbers.
pub fn of_file(file: &Path) -> Result<Vec<String>, Error> {
    Ok(theta::read(file)?.parameter.into_iter().map(|one| one.kind).collect())
}

/// `task`, the changes of a training's task, without random draws of what these kinds settle. What the changes ask for
/// themselves stays.
pub fn without_draws(mut task: Table, kinds: &[String]) -> Table {
    let has = |kind: &str| kinds.iter().any(|one| one == kind);
    let (number, joint) = (RobotNumber::name, JointParameter::name);
    // A scale of the torque multiplies what both gains give; a load moves both mass and centre of mass.
    let strength = has(joint(JointParameter::TorqueScale));
    let load = has(number(RobotNumber::PayloadMass));
    let pair = |value: f64| Value::Array(vec![Value::Float(value); 2]);
    let settled = [
        // A draw of the mass on top of a fitted mass would undo the fit.
        (load || has(number(RobotNumber::BaseMass)), "base_mass", pair(0.0)),
        (
            load || has(number(RobotNumber::BaseComX)) && has(number(RobotNumber::BaseComY)),
            "base_com",
            Value::Float(0.0),
        ),
        // A factor on the model's friction, so 1 is no change. The mass above is added, so 0 is none.
        (has(number(RobotNumber::FloorFriction)), "floor_friction", pair(1.0)),
        (strength || has(joint(JointParameter::KpScale)), "kp", pair(1.0)),
        (strength || has(joint(JointParameter::KdScale)), "kd", pair(1.0)),
    ];
    // Nothing to add must not leave an empty table behind.
    let settled: Vec<_> = settled.into_iter().filter(|(known, ..)| *known).collect();
    if settled.is_empty() {
        return task;
    }
    let draws = task.entry("randomisation").or_insert_with(|| Value::Table(Table::new()));
    if let Value::Table(draws) = draws {
        for (_, key, value) in settled {
            // Only where the configuration has no value of its own.
            draws.entry(key).or_insert(value);
        }
    }
    task
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn what_a_fit_found_is_not_drawn_and_the_rest_is() {
        let asked: Table = toml::from_str("tracking_width = 0.2\nrandomisation.kd = [0.8, 1.2]\n").unwrap();
        let kinds = ["armature", "base_mass", "torque_scale", "base_com_x"].map(str::to_owned);
        let got = without_draws(asked.clone(), &kinds);
        let want = "tracking_width = 0.2\n[randomisation]\nkd = [0.8, 1.2]\nbase_mass = [0.0, 0.0]\nkp = [1.0, 1.0]\n";
        assert_eq!(got, toml::from_str::<Table>(want).unwrap());
        let load = without_draws(Table::new(), &["payload_mass".to_owned()]);
        assert_eq!(
            load,
            toml::from_str::<Table>("[randomisation]\nbase_mass = [0.0, 0.0]\nbase_com = 0.0\n").unwrap()
        );
        assert_eq!(without_draws(asked.clone(), &["frictionloss".to_owned(), "delay".to_owned()]), asked);
    }
}
