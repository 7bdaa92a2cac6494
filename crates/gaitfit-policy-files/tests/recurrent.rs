//! Recurrent and two-part policies: fixtures of `tools/make_policy_fixtures.py`, files.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{fixture, largest_difference, numbers, policy, root, rows};
use gaitfit_policy::network::{Activation, Cell, Network, Recurrent, RecurrentShape, Scratch, Shape};
use gaitfit_policy::{Encoder, Front, Interface, Latent, Policy, Quantity, Term};
use gaitfit_policy_files::{files_of, onnx, read, weights};

/// Actions along a sequence of rows of one robot.
fn along(policy: &Policy, observation: &[f32]) -> Vec<f32> {
    let (mut memory, mut scratch) = (policy.memory(1), Scratch::default());
    let joints = policy.interface.joints.len();
    let mut actions = Vec::new();
    for row in observation.chunks_exact(policy.interface.observation_width()) {
        let mut action = vec![f32::NAN; joints];
        policy.act_with(1, row, &mut memory, &mut action, &mut scratch);
        actions.extend(action);
    }
    actions
}

#[test]
fn lstm_and_gru_of_rsl_rls_exporter_give_onnxruntimes_actions_along_a_sequence() {
    for name in ["lstm", "gru"] {
        let policy = read(&fixture(&format!("{name}.toml"))).unwrap();
        let Some(Front::Recurrent(memory)) = &policy.front else { panic!("{name} is not recurrent") };
        assert_eq!((memory.cell.name(), memory.layers.len(), memory.outputs()), (name, 2, 12));
        let [observation, actions] = rows(&format!("{name}_rows.json"));
        assert_eq!(actions.len(), 40 * 12);
        let difference = largest_difference(&along(&policy, &observation), &actions);
        assert!(difference < 1e-5, "{name}: {difference}");
        // Without its memory it acts otherwise.
        let mut forgetful = vec![0.0; actions.len()];
        policy.act(40, &observation, &mut forgetful, &mut Scratch::default());
        assert!(largest_difference(&forgetful, &actions) > 1e-2);
        assert_eq!(weights::read(&weights::write(&policy).unwrap()).unwrap(), policy);
        // ONNX holds all but the critic.
        let back = onnx::read(&onnx::write(&policy).unwrap()).unwrap();
        assert_eq!(back, Policy { critic: None, critic_normaliser: None, ..policy.clone() });
        let mut uneven = policy;
        if let Some(Front::Recurrent(memory)) = &mut uneven.front {
            let shape = RecurrentShape { hidden: vec![7, 12], ..memory.shape() };
            *memory = Recurrent::random(&shape, 1, 0);
        }
        let refused = onnx::write(&uneven).unwrap_err().to_string();
        assert!(refused.contains("--safetensors"), "{refused}");
    }
}

/// With one layer and two, with a normaliser and a critic that remembers.
#[test]
#[ignore = "needs the packages of tools/setup_venv.sh"]
fn python_onnxruntime_runs_recurrent_policies_as_exported() {
    for (cell, hidden) in
        [(Cell::Lstm, vec![9]), (Cell::Lstm, vec![8, 8]), (Cell::Gru, vec![9]), (Cell::Gru, vec![8, 8, 8])]
    {
        let policy = remembering(cell, &hidden);
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("p.onnx"), onnx::write(&policy).unwrap()).unwrap();
        std::fs::write(path("p.safetensors"), weights::write(&policy).unwrap()).unwrap();
        let output = std::process::Command::new(root().join(".venv/bin/python"))
            .arg(root().join("tools/check_onnx.py"))
            .arg(path("p.onnx"))
            .arg("--weights")
            .arg(path("p.safetensors"))
            .output()
            .unwrap();
        let said = [output.stdout, output.stderr].concat();
        assert!(output.status.success(), "{cell:?} {hidden:?}: {}", String::from_utf8_lossy(&said));
    }
}

/// The tests' policy behind recurrent layers, its critic too.
fn remembering(cell: Cell, hidden: &[usize]) -> Policy {
    let plain = policy(Activation::Elu);
    let memory = |inputs: usize, index: u32| {
        let shape = RecurrentShape { cell, inputs, hidden: hidden.to_vec() };
        Recurrent::random(&shape, 3, index)
    };
    let behind = |network: &Network, index: u32| {
        let shape = Shape { inputs: *hidden.last().unwrap(), ..network.shape.clone() };
        Network::random(shape, 3, index, 1.0).unwrap()
    };
    let critic = plain.critic.as_ref().unwrap();
    Policy {
        front: Some(Front::Recurrent(memory(45, 2))),
        actor: behind(&plain.actor, 0),
        critic_memory: Some(memory(critic.shape.inputs, 3)),
        critic: Some(behind(critic, 1)),
        ..plain.clone()
    }
}

#[test]
fn files_hold_both_memories_and_name_what_does_not_fit() {
    for (cell, hidden) in [(Cell::Lstm, vec![9]), (Cell::Gru, vec![8, 8, 8])] {
        let policy = remembering(cell, &hidden);
        assert_eq!(weights::read(&weights::write(&policy).unwrap()).unwrap(), policy);
        let back = onnx::read(&onnx::write(&policy).unwrap()).unwrap();
        let alone = Policy { critic: None, critic_memory: None, critic_normaliser: None, ..policy.clone() };
        assert_eq!(back, alone);
        let wrong = |change: &dyn Fn(&mut Policy)| {
            let mut other = policy.clone();
            change(&mut other);
            weights::write(&other).unwrap_err().to_string()
        };
        let found = wrong(&|other| other.critic = alone.critic.clone());
        assert!(found.contains("critic"), "{found}");
        let found = wrong(&|other| other.critic_memory.as_mut().unwrap().layers[0].bias_hh[0] = f32::NAN);
        assert!(found.contains("the critic's memory holds NaN"), "{found}");
        let found = wrong(&|other| {
            let shape = RecurrentShape { cell, inputs: 47, hidden: hidden.clone() };
            other.critic_memory = Some(Recurrent::random(&shape, 1, 0));
        });
        assert!(found.contains("the critic's memory takes 47"), "{found}");
        let found = wrong(&|other| {
            let shape = RecurrentShape { cell, inputs: 48, hidden: vec![5] };
            other.critic_memory = Some(Recurrent::random(&shape, 1, 0));
        });
        assert!(found.contains("the critic's memory gives 5 numbers, the critic takes"), "{found}");
    }
}

/// Graphs that PyTorch itself exported, with its Slices and Squeezes around every layer.
#[test]
#[ignore = "needs PyTorch: tools/setup_venv.sh --torch"]
fn torch_lstm_and_gru_that_pytorch_exports_give_onnxruntimes_actions() {
    for (cell, layers) in [("lstm", "1"), ("lstm", "2"), ("gru", "1"), ("gru", "2")] {
        let folder = tempfile::tempdir().unwrap();
        let output = std::process::Command::new(root().join(".venv/bin/python"))
            .arg(root().join("tools/export_lstm_torch.py"))
            .args(["--cell", cell, "--layers", layers, "--out"])
            .arg(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let policy = read(&folder.path().join(format!("{cell}.toml"))).unwrap();
        let [observation, actions] = rows(folder.path().join(format!("{cell}_rows.json")).to_str().unwrap());
        assert_eq!(actions.len(), 60 * 12);
        assert!(actions.iter().any(|action| action.abs() > 0.1), "actions of zero would prove nothing");
        let difference = largest_difference(&along(&policy, &observation), &actions);
        assert!(difference < 1e-5, "{cell}: {difference}");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        eprintln!("{cell}, {layers} layers: off by {difference:e}; {said}");
    }
}

#[test]
fn robots_side_by_side_remember_apart_and_begin_anew() {
    let policy = read(&fixture("lstm.toml")).unwrap();
    let [observation, _] = rows("lstm_rows.json");
    let (mut memory, mut scratch) = (policy.memory(2), Scratch::default());
    let row = |k: usize| &observation[45 * k..45 * (k + 1)];
    let mut both = vec![0.0; 24];
    for k in 0..10 {
        if k == 5 {
            memory.begin(1);
        }
        policy.act_with(2, &[row(k), row(k)].concat(), &mut memory, &mut both, &mut scratch);
    }
    let whole = along(&policy, &observation[..450]);
    let late = along(&policy, &observation[225..450]);
    assert!(largest_difference(&both[..12], &whole[9 * 12..]) < 1e-6);
    assert!(largest_difference(&both[12..], &late[4 * 12..]) < 1e-6);
    assert!(largest_difference(&both[..12], &both[12..]) > 1e-4);
}

#[test]
fn an_encoder_gives_its_latent_beside_what_is_passed_on() {
    let plain = policy(Activation::Elu);
    let encoder = Shape { inputs: 45, hidden: vec![8], outputs: 3, activation: Activation::Elu };
    let network = Network::random(encoder, 5, 0, 1.0).unwrap();
    let actor = Shape { inputs: 5, ..plain.actor.shape.clone() };
    let front = |latent| Front::Encoder(Encoder { network: network.clone(), passed: vec![44, 0], latent });
    let two = Policy {
        actor: Network::random(actor, 6, 0, 1.0).unwrap(),
        front: Some(front(Latent::First)),
        normaliser: None,
        ..plain
    };
    let observation = numbers(45, 4);
    let mut code = [0.0; 3];
    network.forward(1, &observation, &mut code, &mut Scratch::default());
    let seen = [&code[..], &[observation[44], observation[0]]].concat();
    let mut wanted = [0.0; 12];
    two.actor.forward(1, &seen, &mut wanted, &mut Scratch::default());
    assert_eq!(common::act(&two, &observation), wanted);
    assert_eq!(weights::read(&weights::write(&two).unwrap()).unwrap(), two);
    let last = Policy { front: Some(front(Latent::Last)), ..two.clone() };
    assert_ne!(common::act(&last, &observation), wanted);
    for (change, message) in [
        (
            Encoder { network: network.clone(), passed: vec![45, 0], latent: Latent::Last },
            "number 45 of an observation",
        ),
        (
            Encoder { network, passed: vec![0], latent: Latent::Last },
            "the encoder gives 4 numbers, the actor takes 5",
        ),
    ] {
        let wrong = Policy { front: Some(Front::Encoder(change)), ..two.clone() };
        let found = weights::write(&wrong).unwrap_err().to_string();
        assert!(found.contains(message), "`{message}` is not in `{found}`");
    }
}

#[test]
fn a_described_lstm_is_read_from_pytorchs_tensors() {
    // The fixture's own file, its memory's tensors under PyTorch's names.
    let policy = read(&fixture("lstm.toml")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let without_critic = Policy { critic: None, critic_normaliser: None, ..policy.clone() };
    std::fs::write(
        folder.path().join("without-critic.safetensors"),
        weights::write(&without_critic).unwrap(),
    )
    .unwrap();
    let text = std::fs::read_to_string(fixture("lstm.toml")).unwrap();
    let describe = |more: &str| {
        let text =
            text.replace("file = \"lstm.onnx\"", &format!("file = \"without-critic.safetensors\"\n{more}"));
        let path = folder.path().join("described.toml");
        std::fs::write(&path, text).unwrap();
        read(&path).map_err(|error| error.to_string())
    };
    let memory = "memory = { cell = \"lstm\", tensors = \"memory\" }";
    let described = describe(&format!("activation = \"elu\"\n{memory}")).unwrap();
    assert_eq!((&described.front, &described.actor), (&policy.front, &policy.actor));
    let wrong =
        describe("activation = \"elu\"\nmemory = { cell = \"gru\", tensors = \"memory\" }").unwrap_err();
    assert!(wrong.contains("gru layer 1"), "{wrong}");
    let wrong =
        describe("activation = \"elu\"\nmemory = { cell = \"lstm\", tensors = \"rnn\" }").unwrap_err();
    assert!(wrong.contains("tensor rnn.weight_ih_l0 is missing"), "{wrong}");
    // Two parts: the memory's output as a latent is not what the actor takes.
    let two = "activation = \"elu\"\nencoder = { tensors = \"actor\", passes = \"present\" }";
    let wrong = describe(two).unwrap_err();
    assert!(wrong.contains("takes 12"), "{wrong}");
}

/// A network as an ONNX file, which its metadata says to be of a robot with as many joints as it has outputs.
fn onnx_of(network: &Network) -> Vec<u8> {
    let plain = policy(Activation::Elu);
    let joints = network.shape.outputs;
    let interface = Interface {
        joints: (0..joints).map(|joint| format!("joint {joint}")).collect(),
        default_pose: vec![0.0; joints],
        action_scale: vec![1.0; joints],
        kp: vec![1.0; joints],
        kd: vec![1.0; joints],
        observation: vec![Term::new(Quantity::Command).with_history(network.shape.inputs / 3)],
        critic_observation: Vec::new(),
        ..plain.interface
    };
    let actor = network.clone();
    onnx::write(&Policy {
        interface,
        actor,
        critic: None,
        normaliser: None,
        critic_memory: None,
        critic_normaliser: None,
        log_std: vec![0.0; joints],
        ..plain
    })
    .unwrap()
}

#[test]
fn a_two_part_policy_is_read_from_two_onnx_files() {
    let network = |inputs, outputs, seed| {
        let shape = Shape { inputs, hidden: vec![8], outputs, activation: Activation::Elu };
        Network::random(shape, seed, 0, 1.0).unwrap()
    };
    // Two frames of 12 numbers, the present one of which the actor sees beside a latent of 3.
    let (encoder, actor) = (network(24, 3, 1), network(15, 12, 2));
    let folder = tempfile::tempdir().unwrap();
    for (name, network) in [("encoder", &encoder), ("actor", &actor), ("narrow", &network(15, 3, 3))] {
        std::fs::write(folder.path().join(format!("{name}.onnx")), onnx_of(network)).unwrap();
    }
    let joints: Vec<String> = policy(Activation::Elu).interface.joints;
    let describe = |encoder: &str| {
        let text = format!(
            "file = \"actor.onnx\"\n{encoder}\njoints = {joints:?}\ndefault_pose = 0.0\naction_scale = 0.25\nkp = 20.0\n\
             kd = 0.5\ncontrol_dt = 0.02\nobservation = [{{ quantity = \"joint_position\", history = 2 }}]\n"
        );
        let path = folder.path().join("two.toml");
        std::fs::write(&path, text).unwrap();
        read(&path).map_err(|error| error.to_string())
    };
    let two = describe("encoder = { file = \"encoder.onnx\", passes = \"present\" }").unwrap();
    let observation = numbers(24, 4);
    let mut code = [0.0; 3];
    encoder.forward(1, &observation, &mut code, &mut Scratch::default());
    // Frames lie from the oldest to the present one.
    let seen = [&observation[12..], &code[..]].concat();
    let mut wanted = [0.0; 12];
    actor.forward(1, &seen, &mut wanted, &mut Scratch::default());
    assert_eq!(common::act(&two, &observation), wanted);
    let files = files_of(&folder.path().join("two.toml")).unwrap();
    assert_eq!(files.len(), 3);
    assert!(files.contains(&folder.path().join("encoder.onnx")));
    for (encoder, message) in [
        ("encoder = { file = \"narrow.onnx\" }", "the encoder takes 15 numbers, the observation has 24"),
        ("encoder = { file = \"none.onnx\" }", "none.onnx"),
        ("encoder = { tensors = \"encoder\" }", "needs `file`"),
        (
            "encoder = { file = \"encoder.onnx\", activation = \"elu\" }",
            "`encoder.activation` is for safetensors",
        ),
    ] {
        let wrong = describe(encoder).unwrap_err();
        assert!(wrong.contains(message), "`{message}` is not in `{wrong}`");
    }
}
