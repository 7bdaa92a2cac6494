//! Policies with what other programs write beside their networks: fixtures of `tools/make_policy_fixtures.py`.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{act, fixture, go2, largest_difference, policy, rows};
use gaitfit_policy::network::Activation;
use gaitfit_policy::{FrameOrder, History, Policy};
use gaitfit_policy_files::{files_of, onnx, read, weights};
use std::path::Path;

#[test]
fn an_mjlab_file_is_read_with_its_own_metadata() {
    let policy = read(&fixture("mjlab.onnx")).unwrap();
    let [observation, actions] = rows("mjlab_rows.json");
    let difference = largest_difference(&act(&policy, &observation), &actions);
    assert!(difference < 1e-5, "{difference}");
    let interface = &policy.interface;
    assert_eq!(interface.observation_width(), 48);
    assert_eq!(
        interface.describe(&interface.observation),
        "48 numbers (3 base_linear_velocity + 3 base_angular_velocity + 3 projected_gravity + 12 joint_position + 12 \
         joint_velocity + 12 last_action + 3 command)"
    );
    assert_eq!(interface.joints[..2], ["FR_hip_joint", "FR_thigh_joint"]);
    assert_eq!(interface.resolve(&go2()).unwrap()[..4], [3, 4, 5, 0]);
    assert_eq!((interface.kp[2], interface.kd[2], interface.default_pose[1]), (40.0, 2.0, 0.9));
    assert_eq!((interface.action_scale[2], interface.control_dt), (0.249, 0.02));
    // What the metadata lacks is said.
    assert!(policy.notes.len() == 1 && policy.notes[0].contains("taken as 0.02 s"), "{:?}", policy.notes);
    // In the project's own files nothing is assumed any more.
    let own = weights::read(&weights::write(&policy).unwrap()).unwrap();
    assert_eq!(Policy { notes: policy.notes.clone(), ..own }, policy);
    assert!(onnx::read(&onnx::write(&policy).unwrap()).unwrap().interface == policy.interface);
}

#[test]
fn a_deploy_yaml_gives_gains_in_the_sdks_order_and_a_history() {
    let path = fixture("unitree/exported/policy.onnx");
    let policy = read(&path).unwrap();
    let interface = &policy.interface;
    assert_eq!(
        interface.joints[..5].join(" "),
        "FL_hip_joint FR_hip_joint RL_hip_joint RR_hip_joint FL_thigh_joint"
    );
    // Calves have 30 N·m/rad; the policy's last four joints are the calves.
    assert_eq!((&interface.kp[..8], &interface.kp[8..]), (&[25.0; 8][..], &[30.0; 4][..]));
    assert_eq!(interface.default_pose[8..], [-1.5; 4]);
    assert_eq!((interface.history, interface.observation[0].history), (History::default(), 5));
    assert_eq!((policy.actor.shape.inputs, interface.observation_width()), (225, 225));
    let scales = interface.scales(&interface.observation);
    assert_eq!((scales[0], scales[14], scales[15], scales[3 * 15 + 60]), (0.2, 0.2, 1.0, 0.05));
    assert!(policy.notes[0].contains("Go2"), "{:?}", policy.notes);
    let files = files_of(&path).unwrap();
    assert!(files.len() == 2 && files[1].ends_with("params/deploy.yaml"), "{files:?}");
}

#[test]
fn a_description_says_what_is_still_assumed_of_a_deploy_yaml() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["exported/policy.onnx", "params/deploy.yaml"] {
        let to = folder.path().join(file.split('/').next_back().unwrap());
        std::fs::copy(fixture(&format!("unitree/{file}")), to).unwrap();
    }
    let path = folder.path().join("policy.toml");
    let noted = |more: &str| {
        let text = "file = \"policy.onnx\"\ncontrol_dt = 0.02\nobservation = [{ quantity = \"joint_position\", history = 18 }, \
                    { quantity = \"command\", history = 3 }]\n";
        std::fs::write(&path, format!("{text}{more}")).unwrap();
        read(&path).unwrap().notes.iter().any(|note| note.contains("Go2"))
    };
    let joints = read(&folder.path().join("policy.onnx")).unwrap().interface.joints;
    assert!(noted("") && noted("kp = 25\n"));
    assert!(!noted(&format!("joints = {joints:?}\nkp = 25\nkd = 0.5\n")));
}

/// The policy, or the error, of a deploy.yaml that is changed.
fn changed(change: impl Fn(String) -> String) -> Result<Policy, String> {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(fixture("unitree/params/deploy.yaml")).unwrap();
    let other = change(text.clone());
    assert!(other != text);
    std::fs::write(folder.path().join("deploy.yaml"), other).unwrap();
    let path = folder.path().join("policy.onnx");
    std::fs::copy(fixture("unitree/exported/policy.onnx"), &path).unwrap();
    read(&path).map_err(|error| error.to_string())
}

/// The error of a deploy.yaml changed from `from` to `to`.
fn deploy(from: &str, to: &str) -> String {
    changed(|text| text.replacen(from, to, 1)).unwrap_err()
}

/// A slice of Isaac Lab, as the exporter of 2025 writes it.
const SLICE: &str = "!!python/object/apply:builtins.slice [null, null, null]";

#[test]
fn a_deploy_yaml_may_have_slices_nulls_and_one_group() {
    let plain = read(&fixture("unitree/exported/policy.onnx")).unwrap();
    let all = "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]";
    let cfg = format!("params: {{asset_cfg: {{name: robot, joint_ids: {all}}}}}");
    for (from, to) in [
        (SLICE, "null"),
        (SLICE, all),
        ("params: {}", &format!("params: {{asset_cfg: {{joint_ids: {SLICE}}}}}")),
        ("  joint_pos_rel:\n    params: {}", &format!("  joint_pos_rel:\n    {cfg}")),
        ("observations:\n", "observations:\n  scale_first: true\n"),
    ] {
        assert_eq!(changed(|text| text.replacen(from, to, 1)).unwrap().interface, plain.interface, "{to}");
    }
    let grouped = |first: &str| {
        changed(|text| {
            let (head, terms) = text.split_once("observations:\n").unwrap();
            let terms: Vec<String> = terms.lines().map(|line| format!("  {line}\n")).collect();
            format!("{head}observations:\n  obs:\n{first}{}", terms.concat())
        })
    };
    assert_eq!(grouped("").unwrap().interface, plain.interface);
    let frames = grouped("    use_gym_history: true\n").unwrap().interface.history;
    assert_eq!(frames.order, FrameOrder::Frames);
    // The program takes no scale for a factor of 1.
    let scale = "scale: [0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25]";
    assert_eq!(changed(|text| text.replace(scale, "scale: null")).unwrap().interface.action_scale, [1.0; 12]);
}

#[test]
fn deploy_files_that_are_not_understood_are_named() {
    let cases = [
        ("step_dt", "step_td", "step_dt"),
        ("velocity_commands", "height_scan", "it observes `height_scan`"),
        ("    clip: null\n    joint_names", "    clip: [[-1.0, 1.0]]\n    joint_names", "clips targets"),
        ("offset: [0.1,", "offset: [0.2,", "offset is not default_joint_pos"),
        (
            "offset: [0.1, -0.1, 0.1, -0.1, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]",
            "offset: null",
            "offset is not default_joint_pos",
        ),
        (SLICE, "[0, 1, 2]", "some of the joints"),
        (SLICE, "[1, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]", "in another order"),
        (
            "  joint_vel_rel:\n    params: {}",
            "  joint_vel_rel:\n    params: {asset_cfg: {joint_ids: [1, 0]}}",
            "`joint_vel_rel` has some of the joints, or in another order",
        ),
        ("observations:\n", "observations:\n  obs: {height: {}}\n", "`obs` is a group of observations"),
        ("observations:\n", "observations:\n  obs: {}\n", "it observes `obs`"),
        ("observations:\n", "observations:\n  concatenate_terms: true\n", "`concatenate_terms: true`"),
        (
            "  joint_vel_rel:\n    params: {}",
            "  joint_vel_rel:\n    params: {asset_cfg: {joint_ids: [-1, -2]}}",
            "neither a term",
        ),
        ("  joint_vel_rel:\n    params: {}", "  joint_vel_rel:\n    params: [1, 2]", "neither a term"),
        ("JointPositionAction", "JointVelocityAction", "only JointPositionAction"),
        ("joint_ids_map: [3,", "joint_ids_map: [33,", "do not belong together"),
        ("joint_ids_map: [3,", "joint_ids_map: [0, 0,", "has place 0 twice"),
        ("stiffness: [25.0, ", "stiffness: [", "gains of 11 joints"),
        ("    clip: null\n    scale: [0.2", "    clip: [-1.0, 1.0]\n    scale: [0.2", "is clipped to"),
        ("    clip: null\n    scale: [0.2", "    clip: [100.0, 200.0]\n    scale: [0.2", "is clipped to"),
        ("    params: {}\n", "    use_gym_history: true\n", "neither a term"),
        ("history_length: 5", "history_length: 4", "the actor takes 225"),
        ("history_length: 5", "history_length: 100000000000", "has a history of 100000000000 frames"),
    ];
    for (from, to, message) in cases {
        let found = deploy(from, to);
        assert!(found.contains(message) && found.contains("policy.onnx"), "`{message}` is not in `{found}`");
    }
}

/// The error, or the policy, of a description beside fixtures.
fn described(text: &str) -> Result<Policy, String> {
    let folder = tempfile::tempdir().unwrap();
    for file in ["mjlab.onnx", "foreign.onnx"] {
        std::fs::copy(fixture(file), folder.path().join(file)).unwrap();
    }
    let own = policy(Activation::Tanh);
    std::fs::write(folder.path().join("own.safetensors"), weights::write(&own).unwrap()).unwrap();
    let path = folder.path().join("changed.toml");
    std::fs::write(&path, text).unwrap();
    read(&path).map_err(|error| error.to_string())
}

#[test]
fn a_description_changes_single_entries_of_what_a_file_says() {
    let changed = described("file = \"mjlab.onnx\"\ncontrol_dt = 0.01\nkp = 33\n").unwrap();
    let plain = read(&fixture("mjlab.onnx")).unwrap();
    assert_eq!((changed.interface.control_dt, changed.interface.kp[3]), (0.01, 33.0));
    assert_eq!((&changed.interface.kd, &changed.actor), (&plain.interface.kd, &plain.actor));
    let own = policy(Activation::Tanh);
    let changed = described("file = \"own.safetensors\"\nrobot = \"a1\"\naction_scale = 0.5\n").unwrap();
    assert_eq!((&changed.interface.robot[..], changed.interface.action_scale[11]), ("a1", 0.5));
    let expected = Policy { interface: changed.interface.clone(), ..own.clone() };
    assert_eq!(changed, expected);
    // Another observation without a critic's: the critic goes.
    let bare = "critic_observation = []\n";
    let changed = described(&format!("file = \"own.safetensors\"\n{bare}")).unwrap();
    assert_eq!((&changed.critic, &changed.critic_normaliser, &changed.actor), (&None, &None, &own.actor));
    for (text, message) in [
        (
            "observation = [{ quantity = \"command\" }]",
            "observation is 3 numbers (3 command), the actor takes 45",
        ),
        ("normaliser = { mean = \"a\", std = \"b\" }", "`normaliser` is for files of other programs"),
        ("std = 0.5", "`std` is for files of other programs"),
        ("actor = \"actor\"", "`actor` is for files of other programs"),
        ("output_activation = \"tanh\"", "`output_activation` is for files of other programs"),
        ("layer_norm_epsilon = 1e-5", "`layer_norm_epsilon` is for files of other programs"),
        ("inputs = { x = [\"command\"] }", "`inputs` is for files of other programs"),
        ("output = \"y\"", "`output` is for files of other programs"),
        ("speed = 1", "unknown field `speed`"),
    ] {
        let found = described(&format!("file = \"own.safetensors\"\n{text}")).unwrap_err();
        assert!(found.contains(message) && found.contains("changed.toml"), "`{message}` is not in `{found}`");
    }
    let missing = described("file = \"foreign.onnx\"\n").unwrap_err();
    assert!(missing.contains("missing field `joints`"), "{missing}");
}

#[test]
fn a_bare_onnx_file_says_what_is_missing_and_shows_the_description_to_write() {
    // Of graphs: their ends, and a history where whole frames of the usual terms are seen.
    let cases: [(&str, &[&str]); 4] = [
        (
            "graphs/him.onnx",
            &["takes 270 numbers, gives 12 actions", "scale = 0.25, history = 6 }", "order = "],
        ),
        ("graphs/dreamwaq.onnx", &["takes obs (45), obs_history (225) numbers", "\"command\", history = 5"]),
        ("graphs/estimator.onnx", &["takes 45 numbers, gives actions (12), velocity (3) actions"]),
        (
            "trainers/sb3_ppo.onnx",
            &["takes 45 numbers, gives 53 (12), 24 (1), 51 (any) actions", "# 12 names"],
        ),
    ];
    for (name, parts) in cases {
        let error = read(&fixture(name)).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "`{part}` is not in `{error}`");
        }
    }
    let error = read(&fixture("foreign.onnx")).unwrap_err().to_string();
    for part in
        ["no metadata of gaitfit, mjlab", "file = \"foreign.onnx\"", "takes 45 numbers, gives 12", "joints ="]
    {
        assert!(error.contains(part), "`{part}` is not in `{error}`");
    }
}

#[test]
fn pytorch_files_are_refused_with_the_lines_that_convert_them() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read(Path::new(&path)).unwrap_err().to_string()
    };
    let script = refused("walk.pt", b"PK\x03\x04....walk/code/__torch__.py....");
    assert!(script.contains("TorchScript") && script.contains("torch.jit.load(\"walk.pt\""), "{script}");
    assert!(script.contains("torch.onnx.export(") && script.contains("\"walk.onnx\""), "{script}");
    let checkpoint = refused("model.pth", b"PK\x03\x04....model/data.pkl....");
    assert!(
        checkpoint.contains("save_file(") && checkpoint.contains("\"model.safetensors\""),
        "{checkpoint}"
    );
}
