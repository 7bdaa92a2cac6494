//! Policies trained elsewhere: fixtures of `tools/make_policy_fixtures.py`.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{act, fixture, go2, largest_difference, rows};
use gaitfit_policy::network::Activation;
use gaitfit_policy_files::{onnx, read, weights};

#[test]
fn an_onnx_policy_trained_elsewhere_gives_onnxruntimes_actions() {
    let policy = read(&fixture("foreign.toml")).unwrap();
    let [observation, actions] = rows("foreign_rows.json");
    assert_eq!(actions.len(), 5 * 12);
    let difference = largest_difference(&act(&policy, &observation), &actions);
    assert!(difference < 1e-5, "{difference}");
    assert_eq!(policy.actor.shape.to_string(), "45-16-8-12");
    assert_eq!(policy.interface.scales(&policy.interface.observation)[6..9], [2.0, 2.0, 0.25]);
    // Its joints are in another order than the robot's: hips first.
    assert_eq!(policy.interface.resolve(&go2()).unwrap()[..5], [0, 3, 6, 9, 1]);
    assert_eq!(policy.log_std, [0.5_f32.ln(); 12]);
}

#[test]
fn safetensors_of_a_trainer_give_its_actions() {
    let policy = read(&fixture("trainer.toml")).unwrap();
    let [observation, actions] = rows("trainer_rows.json");
    let difference = largest_difference(&act(&policy, &observation), &actions);
    assert!(difference < 1e-5, "{difference}");
    assert!((policy.log_std[0] - 0.2_f32.ln()).abs() < 1e-6);
    // What was imported goes through the project's own files unchanged.
    assert_eq!(weights::read(&weights::write(&policy).unwrap()).unwrap(), policy);
    assert_eq!(onnx::read(&onnx::write(&policy).unwrap()).unwrap().actor, policy.actor);
}

#[test]
fn functions_that_exporters_write_in_several_nodes_are_put_together() {
    for (name, activation) in [
        ("silu", Activation::Silu),
        ("gelu", Activation::Gelu),
        ("gelu_tanh", Activation::GeluTanh),
        ("leaky_relu", Activation::LeakyRelu(0.2)),
        ("selu", Activation::Selu),
        ("norm", Activation::EluOf(0.5)),
    ] {
        let policy = read(&fixture(&format!("functions/{name}.toml"))).unwrap();
        assert_eq!(policy.actor.shape.activation, activation);
        assert_eq!(policy.actor.output, (name == "norm").then_some(Activation::Tanh));
        assert_eq!(policy.actor.norms.iter().flatten().count(), if name == "norm" { 2 } else { 0 });
        let [observation, actions] = rows(&format!("functions/{name}_rows.json"));
        let difference = largest_difference(&act(&policy, &observation), &actions);
        assert!(difference < 1e-5, "{name}: {difference}");
        // Written again and read again it is the same.
        assert_eq!(onnx::read(&onnx::write(&policy).unwrap()).unwrap().actor, policy.actor, "{name}");
    }
}

#[test]
fn an_onnx_file_alone_asks_for_its_description() {
    let error = read(&fixture("foreign.onnx")).unwrap_err().to_string();
    assert!(error.contains("foreign.onnx") && error.contains("TOML"), "{error}");
}

/// The error of a description changed from `from` to `to`, beside the fixtures' weights.
fn error(stem: &str, from: &str, to: &str) -> String {
    let text = std::fs::read_to_string(fixture(&format!("{stem}.toml"))).unwrap();
    assert!(text.contains(from), "{from}");
    let file = tempfile::NamedTempFile::with_suffix(".toml").unwrap();
    let folder = fixture("");
    let text = text.replacen(from, to, 1).replace("file = \"", &format!("file = \"{}/", folder.display()));
    std::fs::write(file.path(), text).unwrap();
    read(file.path()).unwrap_err().to_string()
}

#[test]
fn descriptions_that_do_not_fit_are_named() {
    let cases = [
        ("foreign", "quantity = \"last_action\"", "quantity = \"base_linear_velocity\"", "takes 45"),
        ("foreign", "\"last_action\"", "\"last_acton\"", "line 16, column 18: unknown variant `last_acton`"),
        ("foreign", "kp = 25", "kp = [25, 25]", "kp has 2 numbers for 12 joints"),
        ("foreign", "kp = 25", "kp = \"stiff\"", "give one number for all joints"),
        ("foreign", "kd = 0.5\n", "", "missing field `kd`"),
        ("foreign", "kd = 0.5", "kd = 0.5\nspeed = 1", "unknown field `speed`"),
        ("foreign", "\"FL_hip_joint\", ", "", "default_pose has 12 numbers for 11 joints"),
        ("foreign", "foreign.onnx", "nothing.onnx", "cannot read"),
        ("foreign", "foreign.onnx", "trainer.toml", "`file` must name"),
        ("foreign", "robot =", "activation = \"elu\"\nrobot =", "`activation` is for safetensors"),
        ("trainer", "activation = \"tanh\"\n", "", "add activation"),
        (
            "trainer",
            "robot =",
            "actor = \"policy\"\nrobot =",
            "tensor policy.0.weight is missing; the file holds actor",
        ),
        ("trainer", "\"tanh\"", "\"tan\"", "unknown activation `tan`; known: elu, relu, tanh, leaky_relu"),
        ("trainer", "\"tanh\"", "{ tanh = 0.1 }", "activation `tanh` has no parameter"),
        ("trainer", "\"tanh\"", "{ leaky_relu = -0.1 }", "must be from 0 to 1000"),
        ("trainer", "normalizer._std", "normalizer._var", "_var is missing"),
        ("trainer", "robot =", "critic = \"actor\"\nrobot =", "critic_observation has no terms"),
    ];
    for (stem, from, to, message) in cases {
        let found = error(stem, from, to);
        assert!(found.contains(message) && found.contains(".toml"), "`{message}` is not in `{found}`");
    }
}
