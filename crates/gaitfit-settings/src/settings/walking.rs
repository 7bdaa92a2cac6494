//! Defaults of fits of walking logs: what is fitted, by which cost, and how long. They stand in for settings that a file
//! leaves out, and differ from those of a clamped robot's logs.
//!
//! On walks of a real Go2 the distributions of whole walks (`wass`) with the load, the floor and the strength among the
//! parameters come as near to walks that were not fitted as the robot comes to itself; short predictions (`matchr`) with
//! friction and armature alone come out further off than the robot before the fit. See docs/results/accuracy.md.

use super::AdaptConfig;
use super::load::merge;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The defaults as a configuration has them.
pub(super) const WALK_DEFAULTS: &str = include_str!("walk.toml");
/// Lists of what is fitted. Who gives one of them chooses all of it.
const FITTED: [&str; 3] = ["parameter", "network", "number"];
/// The list of numbers of the whole robot.
const NUMBERS: &str = "number";
/// Numbers that only fits by `wass` search by default. Any torque noise makes predictions worse, and the impedance of
/// contacts was tried with `wass` only.
const OF_DISTRIBUTIONS: [&str; 2] = ["torque_noise", "ground_impedance"];
/// Tables of how `wass` is searched.
const SEARCH: [&str; 2] = ["optimizer", "simulation"];
/// Settings of the simulation that go with the default parameters alone. Whoever chooses the parameters chooses these too.
const OF_DEFAULTS: [&str; 2] = ["starts", "robot_timestep"];
/// Settings that use what logs show without a simulation: priors from legs in the air, and parameters for effects. They are
/// defaults only with the default parameters and the default cost.
const FROM_LOGS_ALONE: [&str; 2] = ["swings", "effects"];
/// The default period of motor boards.
const MOTOR_BOARD_PERIOD: &str = "simulation.robot_timestep = 0.001";
/// The cost of the defaults.
const COST: &str = "wass";

/// Whether the settings are of walking logs: `base` says so, or there is a policy that walked.
fn walks(table: &DeTable<'_>) -> bool {
    // `base` decides where it is given. A value that is no text is refused when the table is read.
    match table.get("base").map(Spanned::get_ref) {
        Some(DeValue::String(base)) => base == "free",
        Some(_) => false,
        None => table.contains_key("policy"),
    }
}

/// The defaults of fits of walking logs. Settings without one keep the default of a clamped robot's fit.
pub fn walk_defaults() -> AdaptConfig {
    toml::from_str(WALK_DEFAULTS).unwrap_or_default()
}

/// Fills in what settings of walking logs leave out.
pub(super) fn complete(table: &mut DeTable<'_>) {
    if !walks(table) {
        return;
    }
    let given = std::mem::take(table);
    // The text is a part of the program and is read by tests, so parsing it does not fail.
    let mut defaults = DeTable::parse(WALK_DEFAULTS).map(Spanned::into_inner).unwrap_or_default();
    trim(&mut defaults, &given);
    merge(&mut defaults, given);
    *table = defaults;
}

/// Takes from the `defaults` of walking logs what does not go with the settings that a file has: parameters beside those
/// that it chooses, the search of another cost.
pub(super) fn trim(defaults: &mut DeTable<'_>, own: &DeTable<'_>) {
    // A fit of other parameters is another fit: the default lists, and what goes with them, are taken out
    // together.
    if FITTED.iter().any(|list| own.contains_key(*list)) {
        FITTED.iter().for_each(|list| drop(defaults.remove(*list)));
        FROM_LOGS_ALONE.iter().for_each(|key| drop(defaults.remove(*key)));
        if let Some(DeValue::Table(simulation)) = defaults.get_mut(SEARCH[1]).map(Spanned::get_mut) {
            OF_DEFAULTS.iter().for_each(|key| drop(simulation.remove(*key)));
        }
    }
    // Other costs have a search of their own, whose settings are the defaults of a clamped robot's fit.
    if !searches_distributions(own) {
        SEARCH.iter().for_each(|name| drop(defaults.remove(*name)));
        FROM_LOGS_ALONE.iter().for_each(|key| drop(defaults.remove(*key)));
        if let Some(DeValue::Array(numbers)) = defaults.get_mut(NUMBERS).map(Spanned::get_mut) {
            let kept = numbers.iter().filter(|one| !of_distributions(one.get_ref())).cloned();
            *numbers = kept.collect();
        }
    }
}

/// Sets the period of motor boards in a loop's fits to the default of fits of walks. It is for loops that begin with logs: if
/// the target is a simulated robot, the loop knows the period.
pub(super) fn set_motor_board_period(fitted: &mut DeTable<'_>) {
    merge(fitted, DeTable::parse(MOTOR_BOARD_PERIOD).map(Spanned::into_inner).unwrap_or_default());
}

/// Whether a number of the robot is a default of `wass` alone.
fn of_distributions(number: &DeValue<'_>) -> bool {
    let DeValue::Table(table) = number else { return false };
    matches!(table.get("kind").map(Spanned::get_ref), Some(DeValue::String(kind)) if OF_DISTRIBUTIONS.contains(&kind.as_ref()))
}

/// Whether the first cost is that of the defaults.
pub(super) fn searches_distributions(own: &DeTable<'_>) -> bool {
    // A list that is left out is that of the defaults, which begins with `COST`.
    match own.get("costs").map(Spanned::get_ref) {
        Some(DeValue::Array(costs)) => {
            matches!(costs.iter().next().map(Spanned::get_ref), Some(DeValue::String(first)) if first == COST)
        }
        Some(_) => false,
        None => true,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use crate::settings::{AdaptConfig, Base, DEFAULTS, LoopConfig, load};
    use gaitfit_adapt::cost::CostKind;
    use gaitfit_adapt::{JointParameter, RobotNumber};
    use std::io::Write;

    fn read(text: &str) -> AdaptConfig {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        load(Some(file.path()), &[]).unwrap()
    }

    #[test]
    fn policy_and_logs_alone_give_the_walking_fit() {
        let settings = read("policy = \"p.safetensors\"\nlogs = [\"a.csv\"]\n");
        assert_eq!((settings.base, settings.costs.as_slice()), (Base::Free, &[CostKind::Wass][..]));
        let fitted: Vec<JointParameter> = settings.parameter.iter().map(|rule| rule.kind).collect();
        use JointParameter::{
            Armature, Damping, Delay, EncoderBias, FrictionLoss, KpScale, LoadFriction, TorqueScale,
        };
        assert_eq!(
            fitted,
            [FrictionLoss, LoadFriction, Armature, Damping, Delay, TorqueScale, KpScale, EncoderBias]
        );
        let numbers: Vec<RobotNumber> = settings.number.iter().map(|rule| rule.kind).collect();
        use RobotNumber::{BaseMass, FloorFriction, GroundImpedance, TorqueNoise};
        assert_eq!(numbers, [FloorFriction, GroundImpedance, BaseMass, TorqueNoise]);
        assert!(settings.optimizer.patience > 0 && settings.optimizer.population > 0);
        assert_eq!(read("base = \"free\"\n").parameter, settings.parameter);
        assert_eq!(read("base = \"fixed\"\npolicy = \"p\"\n").base, Base::Fixed, "what a file has stays");
    }

    /// The two lists of defaults stand in files that users read, so each is written out.
    #[test]
    fn loops_fit_what_fits_of_walks_fit() {
        let of_loop = load::<LoopConfig>(None, &[]).unwrap().adapt;
        let of_fit = read("policy = \"p.safetensors\"\nlogs = [\"a.csv\"]\n");
        assert_eq!((of_loop.parameter, of_loop.number), (of_fit.parameter, of_fit.number));
    }

    #[test]
    fn what_a_file_chooses_stays_alone() {
        let chosen = read("policy = \"p\"\n[[parameter]]\nkind = \"armature\"\n[optimizer]\nseeds = 3\n");
        assert!(chosen.parameter.len() == 1 && chosen.number.is_empty());
        assert_eq!(
            (chosen.optimizer.seeds, chosen.optimizer.population),
            (3, read("policy = \"p\"\n").optimizer.population)
        );
        assert_eq!((chosen.simulation.starts, chosen.simulation.robot_timestep), (1, None));
        let short = read("policy = \"p\"\ncosts = [\"matchr1\"]\n");
        assert_eq!(short.optimizer, AdaptConfig::default().optimizer, "another search");
        assert!(short.number.iter().all(|rule| rule.kind != RobotNumber::TorqueNoise), "{:?}", short.number);
        assert!(short.parameter.iter().any(|rule| rule.kind == JointParameter::Delay));
    }

    #[test]
    fn the_printed_settings_have_the_walking_defaults_as_a_comment() {
        let commented: String = super::WALK_DEFAULTS
            .lines()
            .map(|line| format!("# {line}").trim_end().to_owned() + "\n")
            .collect();
        assert!(DEFAULTS.ends_with(&commented), "adapt.toml ends with walk.toml, each line behind `# `");
    }

    #[test]
    fn the_printed_settings_list_every_cost() {
        for cost in ["\"wass\"", "\"matcho\"", "\"matchs", "\"matchr"] {
            assert!(DEFAULTS.contains(cost), "{cost}");
        }
    }
}
