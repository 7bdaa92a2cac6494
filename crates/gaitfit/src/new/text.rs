//! The configuration as commented TOML.

use super::{BOARD_SECONDS, Inputs, quoted};
use crate::air::choices;
use crate::world::trained_task;
use gaitfit_log::PerJoint;
use gaitfit_model::JointKind;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Parameters that a fit of legs in the air finds, with their meaning. The delay is of all joints alike.
const IN_THE_AIR: [Parameter; 4] = [
    ("frictionloss", "group", ("dry friction", Some("N·m"))),
    ("armature", "group", ("rotor inertia", Some("kg·m²"))),
    ("damping", "group", ("viscous friction", Some("N·m·s/rad"))),
    ("delay", "all", ("from target to motor, s", None)),
];

/// Name, what shares it, and what it is with its unit for hinges.
type Parameter = (&'static str, &'static str, (&'static str, Option<&'static str>));

impl Inputs<'_> {
    /// The whole file.
    pub(super) fn text(&self) -> String {
        let walks = self.policy.is_some();
        let (what, command) = match (walks, self.trains()) {
            (true, true) => ("the loop of a robot that walked", "loop"),
            // `gaitfit fit` reads the same file.
            (true, false) => ("a fit of walks under a policy that is not trained here", "loop"),
            (false, _) => ("a fit of legs in the air", "fit"),
        };
        let mut text = format!(
            "# Written by `gaitfit new`: {what}.\n# Run it with `{}`. `gaitfit config {command}` prints all other settings.\n\n",
            self.next()
        );
        if let Some(policy) = &self.settings.policy {
            line(&mut text, "policy", &quoted(policy, self.out), "it walked while the logs were recorded");
        }
        if let Some(robot) = &self.settings.robot {
            line(&mut text, "robot", &quoted(robot, self.out), "");
        }
        if self.settings.lenient {
            line(&mut text, "lenient", "true", "leave out what the engine cannot simulate in the robot file");
        }
        if walks {
            self.walk(&mut text)
        } else {
            self.air(&mut text)
        }
        text
    }

    fn walk(&self, text: &mut String) {
        list(text, "logs", &self.settings.logs, self, "every fourth is not fitted but predicted at the end");
        // Comments of settings that are usual to change, with their defaults.
        text.push_str("\n[adapt]\n# costs = [\"wass\"]              # what is compared: docs/costs.md\n");
        self.write_groups(text, "adapt.groups");
        text.push_str("\n[adapt.simulation]\n");
        let (step, what) = self.robot_timestep();
        line(text, "robot_timestep", &format!("{step:?}"), what);
        if self.trains() {
            text.push_str("\n[finetune.train]\n# iterations = 160               # of the training in the fitted simulator\n");
        }
    }

    /// The step of the robot that made the logs, s, and where it is known from. A simulator whose task has a robot step of its own
    /// stands for a robot with that step, and its logs state the simulator's.
    fn robot_timestep(&self) -> (f64, &'static str) {
        let task = self.policy.as_ref().and_then(|policy| trained_task(policy).ok().flatten());
        let emulated = task.is_some_and(|task| task.robot_timestep.is_some());
        match self.logs.simulated_step().filter(|_| !emulated) {
            Some(step) => (step, "s, the simulator's step, as the logs state"),
            None => (BOARD_SECONDS, "s, assumed period of the robot's motor boards"),
        }
    }

    fn air(&self, text: &mut String) {
        // One log that is not fitted shows how well the fit predicts.
        let (fit, other) = match self.logs.files.as_slice() {
            [fit @ .., last] if !fit.is_empty() => (fit, std::slice::from_ref(last)),
            all => (all, &[][..]),
        };
        list(text, "logs", fit, self, "");
        if !other.is_empty() {
            list(text, "validate", other, self, "not fitted; predicted at the end");
        }
        if let Some(gains) = &self.gains {
            let _ = writeln!(text, "\n[gains]                          # PD gains: {}", gains.source);
            line(text, "kp", &per_joint(&gains.kp), "N·m/rad");
            line(text, "kd", &per_joint(&gains.kd), "N·m·s/rad");
        }
        self.write_groups(text, "groups");
        // A robot without slides gets rules that name no joints.
        let kinds = [JointKind::Hinge, JointKind::Slide];
        let kinds: Vec<JointKind> = kinds
            .into_iter()
            .filter(|kind| self.model.joints.iter().any(|joint| joint.kind == *kind))
            .collect();
        for parameter in IN_THE_AIR {
            // Where hinges and slides have other units, each gets rules of its own.
            let of_each = parameter.2.1.is_some_and(|unit| JointKind::Slide.unit(unit) != unit);
            for &kind in kinds.iter().take(if of_each { kinds.len() } else { 1 }) {
                self.parameter(text, parameter, kind, of_each && kinds.len() > 1);
            }
        }
        text.push_str("\n[[number]]                       # lag of joint velocities behind positions, s: a robot's filter or a simulator's step\n");
        text.push_str("kind = \"velocity_lag\"\n");
        let _ = writeln!(text, "\n[optimizer]\n{}", choices::SEARCH.trim_end());
        text.push_str("\n[simulation]\n");
        line(text, "timestep", &format!("{:?}", choices::STEP_S), "s, of the physics");
        text.push_str("\n[check]\n");
        line(text, "converged", "true", "exit code 3 if the search has not converged");
    }

    /// The rule of a parameter for joints of this kind. `named`: the robot has others too.
    fn parameter(
        &self,
        text: &mut String,
        (name, per, (what, unit)): Parameter,
        kind: JointKind,
        named: bool,
    ) {
        let unit = unit.map_or_else(String::new, |unit| format!(", {}", kind.unit(unit)));
        let _ = writeln!(
            text,
            "\n[[parameter]]                    # {what}{unit}\nkind = \"{name}\"\nper = \"{per}\""
        );
        if named {
            let of_kind = self.model.joints.iter().filter(|joint| joint.kind == kind);
            let names: Vec<&str> = of_kind.map(|joint| joint.name.as_str()).collect();
            let list = toml::Value::from(names).to_string();
            line(text, "joints", &list, if kind.is_hinge() { "hinges" } else { "slides" });
        }
        if name == "frictionloss" {
            let bound = format!("{:?}", choices::max_friction(&self.model, kind));
            let what = "the search's bound: 5 % of the largest torque limit, or twice the file's value";
            line(text, "upper", &bound, what);
        } else if let Some(bound) = self.wider(name, kind) {
            line(text, "upper", &format!("{bound:?}"), "the search's bound: twice the robot file's value");
        }
    }

    /// The search's bound where the robot file's value is more than half of the usual one.
    fn wider(&self, name: &str, kind: JointKind) -> Option<f64> {
        let twice = |value| choices::twice_file(&self.model, kind, value);
        let (usual, twice) = match name {
            "armature" => (kind.like("kg·m²", 0.5), twice(|joint| joint.armature)),
            "damping" => (kind.like("N·m·s/rad", 2.0), twice(|joint| joint.damping)),
            _ => return None,
        };
        (twice > usual).then_some(twice)
    }

    fn write_groups(&self, text: &mut String, table: &str) {
        let Some(groups) = &self.groups else { return };
        let _ = writeln!(
            text,
            "\n[{table}]                         # joints that share a value, by name without their leg"
        );
        for (name, joints) in groups {
            let joints: Vec<String> =
                joints.iter().map(|joint| toml::Value::from(joint.as_str()).to_string()).collect();
            let _ = writeln!(text, "{} = [{}]", toml::Value::from(name.as_str()), joints.join(", "));
        }
    }
}

/// A setting with a comment.
fn line(text: &mut String, key: &str, value: &str, comment: &str) {
    let setting = format!("{key} = {value}");
    let _ = match comment {
        "" => writeln!(text, "{setting}"),
        // Wide enough for most settings, so that the comments stand in one column.
        comment => writeln!(text, "{setting:<32} # {comment}"),
    };
}

/// A list of files, one a line.
fn list(text: &mut String, key: &str, files: &[PathBuf], inputs: &Inputs<'_>, comment: &str) {
    let comment = if comment.is_empty() { String::new() } else { format!("  # {comment}") };
    let _ = writeln!(text, "{key} = [{comment}");
    for file in files {
        let _ = writeln!(text, "    {},", quoted(file, inputs.out));
    }
    text.push_str("]\n");
}

fn per_joint(values: &PerJoint) -> String {
    match values {
        PerJoint::All(value) => format!("{value:?}"),
        PerJoint::List(values) => format!("{values:?}"),
        PerJoint::Named(values) => {
            let entries: Vec<String> = values
                .iter()
                .map(|(name, value)| format!("{} = {value:?}", toml::Value::from(name.as_str())))
                .collect();
            format!("{{ {} }}", entries.join(", "))
        }
    }
}
