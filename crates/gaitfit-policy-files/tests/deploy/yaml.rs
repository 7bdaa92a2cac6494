//! `controller.yaml` and `deploy.yaml`, read back.

use super::{rich, seeing};
use crate::common::{fixture, go2, interface, policy, root};
use gaitfit_policy::network::Activation;
use gaitfit_policy::{
    ActionClip, FrameOrder, Held, History, HistoryStart, Interface, Policy, Quantity, Term,
};
use gaitfit_policy_files::{deploy, onnx, read};
use serde::Deserialize;
use serde_json::Value;

/// A file of a deployment as text.
fn text(made: &deploy::Deployment, name: &str) -> String {
    let found = made.files.iter().find(|(path, _)| path == name);
    String::from_utf8(found.unwrap_or_else(|| panic!("no {name}")).1.clone()).unwrap()
}

/// `controller.yaml` as another program reads it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Controller {
    robot: String,
    network: Value,
    control_rate: f64,
    joints: Vec<String>,
    command_interfaces: Vec<String>,
    state_interfaces: Vec<String>,
    default_position: Vec<f64>,
    action_scale: Vec<f64>,
    action_clip: Option<Vec<f64>>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    effort_limit: Option<Vec<f64>>,
    held: Option<HeldLists>,
    observation: Observation,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HeldLists {
    joints: Vec<String>,
    position: Vec<f64>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    effort_limit: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Observation {
    width: usize,
    terms: Vec<Quantity>,
    widths: Vec<usize>,
    present: Vec<usize>,
    history: Vec<usize>,
    scale: Vec<f32>,
    history_order: FrameOrder,
    history_start: HistoryStart,
    gait_frequency: Option<f64>,
}

fn controller(text: &str) -> Controller {
    let mut value: Value = serde_saphyr::from_str(text).unwrap();
    serde_json::from_value(value["policy_controller"]["ros__parameters"].take()).unwrap()
}

#[test]
fn controller_yaml_holds_the_whole_interface() {
    let mut odd = rich(FrameOrder::Terms, HistoryStart::First);
    odd.interface.robot = "a: \"b\" #c \\ é\u{2028}".to_owned();
    odd.interface.joints[0] = "{{ joint }}: 'x', [y]".to_owned();
    let all = [
        policy(Activation::Elu),
        rich(FrameOrder::Frames, HistoryStart::Zeros),
        rich(FrameOrder::NewestFirst, HistoryStart::First),
        odd,
        read(&root().join("assets/go2-walk.safetensors")).unwrap(),
    ];
    for policy in all {
        let wanted = &policy.interface;
        let found = controller(&text(&deploy::bundle(&policy, None).unwrap(), "controller.yaml"));
        let Controller { observation, held, .. } = found;
        let mut scale = observation.scale.iter().copied();
        let term = |index: usize| {
            let (quantity, width) = (observation.terms[index], observation.widths[index]);
            assert_eq!(width, quantity.width(wanted.joints.len()));
            Term {
                quantity,
                scale: (0..width).map(|_| scale.next().unwrap()).collect(),
                history: observation.history[index],
                ahead: 0,
            }
        };
        let observed: Vec<Term> = (0..observation.terms.len()).map(term).collect();
        assert_eq!(scale.next(), None);
        let held = held.map_or_else(Vec::new, |held| {
            assert!(held.effort_limit.is_none());
            let one = |index: usize| Held {
                joint: held.joints[index].clone(),
                position: held.position[index],
                kp: held.kp[index],
                kd: held.kd[index],
            };
            (0..held.joints.len()).map(one).collect()
        });
        let spread = |interface: &Interface| Interface {
            observation: interface
                .observation
                .iter()
                .map(|term| match term.scale[..] {
                    [] => term.clone().scaled(&vec![1.0; term.quantity.width(interface.joints.len())]),
                    [one] => term.clone().scaled(&vec![one; term.quantity.width(interface.joints.len())]),
                    _ => term.clone(),
                })
                .collect(),
            action_clip: interface.action_clip.as_ref().map(|clip| {
                ActionClip::Each((0..interface.joints.len()).map(|joint| clip.limit(joint)).collect())
            }),
            critic_observation: Vec::new(),
            ..interface.clone()
        };
        assert!((found.control_rate * wanted.control_dt - 1.0).abs() < 1e-12);
        let again = Interface {
            robot: found.robot,
            joints: found.joints,
            default_pose: found.default_position,
            action_scale: found.action_scale,
            action_clip: found.action_clip.map(ActionClip::Each),
            kp: found.kp,
            kd: found.kd,
            velocity_joints: Vec::new(),
            held,
            control_dt: wanted.control_dt,
            gait_frequency: observation.gait_frequency,
            reference: None,
            history: History { order: observation.history_order, start: observation.history_start },
            observation: observed,
            critic_observation: Vec::new(),
        };
        assert_eq!(again, spread(wanted));
        assert_eq!(observation.width, wanted.observation_width());
        let slots = gaitfit_policy::observation::Layout::new(wanted, &wanted.observation);
        let present: Vec<usize> = slots.slots().iter().map(|slot| slot.present.start).collect();
        assert_eq!(observation.present, present);
        assert_eq!(found.network["file"], "exported/policy.onnx");
        assert_eq!((found.command_interfaces.len(), found.state_interfaces.len()), (1, 2));
        assert!(found.effort_limit.is_none());
    }
}

#[test]
fn effort_limits_are_the_robots() {
    let (policy, model) = (rich(FrameOrder::Terms, HistoryStart::First), go2());
    let made = deploy::bundle(&policy, Some(&model)).unwrap();
    let found = controller(&text(&made, "controller.yaml"));
    let limit = |name: &str| model.effort(model.find_joint(name).unwrap()).unwrap();
    let wanted: Vec<f64> = policy.interface.joints.iter().map(|name| limit(name)).collect();
    assert_eq!(found.effort_limit.unwrap(), wanted);
    assert_eq!(found.held.unwrap().effort_limit.unwrap(), [limit("RL_calf_joint")]);
    assert!(!made.unsaid.iter().any(|line| line.contains("--robot")), "{:?}", made.unsaid);
    let made = deploy::bundle(&policy, None).unwrap();
    assert!(made.unsaid.iter().any(|line| line.contains("--robot")), "{:?}", made.unsaid);
    let mut other = policy;
    other.interface.joints[2] = "tail".to_owned();
    let error = deploy::bundle(&other, Some(&model)).unwrap_err().to_string();
    assert!(error.contains("no joint `tail`"), "{error}");
}

#[test]
fn deploy_yaml_is_read_as_the_same_interface() {
    let mut walk = read(&root().join("assets/go2-walk.safetensors")).unwrap();
    walk.interface.kp = (0..12).map(|joint| 20.0 + f64::from(joint)).collect();
    walk.interface.observation[4].history = 3;
    let mut frames = walk.interface.clone();
    frames.observation.iter_mut().for_each(|term| term.history = 2);
    frames.history.order = FrameOrder::Frames;
    for interface in [walk.interface.clone(), frames] {
        let policy = Policy { provenance: walk.provenance.clone(), ..seeing(interface, &[8]) };
        let made = deploy::bundle(&policy, None).unwrap();
        // The program aborts if the first entry is no term.
        let written = text(&made, "params/deploy.yaml");
        let first = written.split_once("observations:\n").unwrap().1;
        assert!(first.lines().nth(1).unwrap().contains("params"), "{first}");
        let folder = tempfile::tempdir().unwrap();
        for name in ["exported", "params"] {
            std::fs::create_dir(folder.path().join(name)).unwrap();
        }
        for (name, bytes) in &made.files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        // The network has one row, whose width and pose stand in its end points.
        let network = folder.path().join("exported/policy.onnx");
        assert_eq!(read(&network).unwrap().interface, policy.interface);
        // Without its metadata the reader of unitree_rl_lab's files has to find everything in deploy.yaml.
        let scale = policy.normaliser.as_ref().unwrap().scale();
        std::fs::write(&network, onnx::write_network("bare", &policy.actor, &scale).unwrap()).unwrap();
        let again = read(&network).unwrap();
        assert!(again.notes[0].contains("deploy.yaml"), "{:?}", again.notes);
        let wanted = Interface {
            robot: String::new(),
            observation: policy
                .interface
                .observation
                .iter()
                .map(|term| {
                    let width = term.quantity.width(12);
                    let scale = term.scale.first().map_or(1.0, |&one| one);
                    let all = if term.scale.len() == width { term.scale.clone() } else { vec![scale; width] };
                    term.clone().scaled(&all)
                })
                .collect(),
            ..policy.interface.clone()
        };
        assert_eq!(again.interface, wanted);
        let value: Value = serde_saphyr::from_str(&text(&made, "params/deploy.yaml")).unwrap();
        let ranges = &value["commands"]["base_velocity"]["ranges"];
        assert_eq!(ranges["lin_vel_x"], serde_json::json!([-1.0, 1.0]));
        assert!(ranges["heading"].is_null() && value["actions"]["JointPositionAction"]["clip"].is_null());
        let says = |part: &str| made.unsaid.iter().any(|line| line.contains(part));
        assert!(says("places in Unitree's SDK") && !says("-1 to 1"), "{:?}", made.unsaid);
    }
}

#[test]
fn deploy_yaml_has_places_clips_and_the_clock_and_says_what_it_cannot() {
    let policy = rich(FrameOrder::Terms, HistoryStart::Zeros);
    let made = deploy::bundle(&policy, None).unwrap();
    let value: Value = serde_saphyr::from_str(&text(&made, "params/deploy.yaml")).unwrap();
    // FL 3 to 5, FR 0 to 2, RL 9 to 11, RR 6 to 8; the held one is RL_calf, at 11.
    assert_eq!(value["joint_ids_map"], serde_json::json!([3, 4, 5, 0, 1, 2, 9, 10]));
    assert_eq!(
        value["stiffness"],
        serde_json::json!([23.0, 24.0, 25.0, 20.0, 21.0, 22.0, 0.0, 0.0, 0.0, 26.0, 27.0, 60.0])
    );
    assert_eq!(value["damping"][11], 3.0);
    let bounds: Vec<[f64; 2]> =
        serde_json::from_value(value["actions"]["JointPositionAction"]["clip"].clone()).unwrap();
    // The second joint: pose 0.8, scale 0.21, clip 0.15.
    assert!((bounds[1][0] - (0.8 - 0.0315)).abs() < 1e-12 && (bounds[1][1] - (0.8 + 0.0315)).abs() < 1e-12);
    let names: Vec<&str> = value["observations"].as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(names.len(), 7);
    let phase = value["observations"]["gait_phase"]["params"]["period"].as_f64().unwrap();
    assert!((phase - 1.0 / 2.3).abs() < 1e-12);
    assert_eq!(value["observations"]["velocity_commands"]["params"]["command_name"], "base_velocity");
    assert_eq!(value["observations"]["velocity_commands"]["history_length"], 3);
    assert_eq!(value["commands"]["base_velocity"]["ranges"]["ang_vel_z"], serde_json::json!([-1.0, 1.0]));
    for part in ["held joint RL_calf_joint, -0.3 rad", "-1 to 1", "zeros", "gait clock", "effort limits"] {
        assert!(made.unsaid.iter().any(|line| line.contains(part)), "{part}: {:?}", made.unsaid);
    }
}

#[test]
fn what_unitree_rl_lab_cannot_run_has_no_deploy_yaml_and_a_reason() {
    let mut other = policy(Activation::Elu);
    other.interface.joints[0] = "tail".to_owned();
    let mut blind = interface();
    blind.observation.push(Term::new(Quantity::BaseLinearVelocity));
    let mut twice = interface();
    twice.observation.push(Term::new(Quantity::Command));
    for (policy, part) in [
        (other, "Unitree's robots"),
        (rich(FrameOrder::NewestFirst, HistoryStart::First), "newest frame"),
        (seeing(blind, &[8]), "does not measure"),
        (seeing(twice, &[8]), "command twice"),
    ] {
        let made = deploy::bundle(&policy, None).unwrap();
        assert!(!made.files.iter().any(|(name, _)| name.contains("deploy.yaml")));
        let why = made.unsaid.iter().find(|line| line.starts_with("no params/deploy.yaml")).unwrap();
        assert!(why.contains(part), "{why}");
    }
    // Targets that are velocities are named in what can hold them.
    let mut rolling = interface();
    rolling.velocity_joints = vec![rolling.joints[0].clone()];
    (rolling.kp[0], rolling.default_pose[0]) = (0.0, 0.0);
    let rolling = seeing(rolling, &[8]);
    let made = deploy::bundle(&rolling, None).unwrap();
    let why = made.unsaid.iter().find(|line| line.starts_with("no params/deploy.yaml")).unwrap();
    assert!(why.contains("the targets of FL_hip_joint are velocities"), "{why}");
    let controller = text(&made, "controller.yaml");
    for line in ["velocity_joints: [\"FL_hip_joint\"]", "command_interfaces: [\"position\", \"velocity\"]"] {
        assert!(controller.contains(line), "{controller}");
    }
    let header = text(&deploy::cxx(&rolling, None).unwrap(), "policy.hpp");
    assert!(header.contains("kVelocityTarget[kJoints] = {true, false, false,"), "no kVelocityTarget");
    let recurrent = read(&fixture("lstm.toml")).unwrap();
    let error = deploy::bundle(&recurrent, None).unwrap_err().to_string();
    assert!(error.contains("--cpp"), "{error}");
}
