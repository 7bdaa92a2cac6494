//! An interface against itself and against robots.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{go2, interface};
use gaitfit_model::read_mjcf_str;
use gaitfit_policy::observation::Layout;
use gaitfit_policy::{ActionClip, FrameOrder, Held, Interface, Quantity, Term};

/// The error of an interface changed by `change`.
fn error(change: impl Fn(&mut Interface)) -> String {
    let mut interface = interface();
    change(&mut interface);
    interface.check().unwrap_err().to_string()
}

#[test]
fn layout_and_scales_follow_the_terms() {
    let interface = interface();
    interface.check().unwrap();
    assert_eq!((interface.observation_width(), interface.critic_width()), (45, 48));
    let layout = Layout::new(&interface, &interface.observation);
    let place = |slot: usize| (layout.slots()[slot].quantity, layout.slots()[slot].present.clone());
    assert_eq!(place(2), (Quantity::Command, 6..9));
    assert_eq!(place(5), (Quantity::LastAction, 33..45));
    let scales = interface.scales(&interface.observation);
    assert_eq!(scales.len(), 45);
    assert_eq!((scales[0], scales[3], scales[6], scales[8], scales[21]), (0.25, 1.0, 2.0, 0.5, 0.05));
    assert!(
        interface.describe(&interface.observation).starts_with("45 numbers (3 base_angular_velocity + 3 ")
    );
}

fn held(joint: &str, kp: f64) -> Held {
    Held { joint: joint.to_owned(), position: 0.5, kp, kd: 1.0 }
}

#[test]
fn contradictions_are_named() {
    type Change = fn(&mut Interface);
    let wrong: &[(Change, &str)] = &[
        (|i| i.kp.truncate(11), "kp has 11 numbers for 12 joints"),
        (|i| i.kp[3] = -1.0, "kp of FR_hip_joint is -1"),
        (|i| i.kp.fill(0.0), "kp is zero for every joint"),
        (|i| i.default_pose[2] = f64::NAN, "default_pose of FL_calf_joint is NaN"),
        (|i| i.action_scale[0] = 1e300, "action_scale of FL_hip_joint"),
        (|i| i.control_dt = 0.0, "control_dt is 0"),
        (|i| i.control_dt = 1e-9, "control_dt is 0.000000001 s; give 0.001 to 1 s"),
        (|i| i.action_clip = Some(ActionClip::All(f64::INFINITY)), "action_clip is inf"),
        (
            |i| i.action_clip = Some(ActionClip::Each(vec![1.0; 11])),
            "action_clip has 11 numbers for 12 joints",
        ),
        (|i| i.held = vec![held("arm", 1.0), held("arm", 1.0)], "held joint arm is listed twice"),
        (|i| i.held = vec![held("FL_hip_joint", 1.0)], "held joint FL_hip_joint is listed twice, or is one"),
        (|i| i.held = vec![held("", 1.0)], "held: `` is no name"),
        (|i| i.held = vec![held("arm", -1.0)], "kp of held joint arm is -1"),
        (
            |i| i.velocity_joints = vec!["FL_hip_joint".into(); 2],
            "velocity_joints names FL_hip_joint, whose kp is",
        ),
        (|i| i.velocity_joints = vec!["FL_wheel".into()], "names FL_wheel, which is not among joints"),
        (
            |i| {
                i.velocity_joints = vec!["FL_hip_joint".into()];
                i.kp[0] = 0.0;
                i.kd[0] = 0.0;
            },
            "whose kd is 0; its torque is kd (target - velocity)",
        ),
        (
            |i| {
                i.velocity_joints = vec!["FL_thigh_joint".into()];
                i.kp[1] = 0.0;
            },
            "whose default_pose is 0.8; action 0 is the velocity 0",
        ),
        (|i| i.joints[1] = "FL_hip_joint".into(), "joints names FL_hip_joint twice"),
        (|i| i.joints.clear(), "joints names 0 joints"),
        (|i| i.robot = "go2\n".into(), "robot: `go2\\n` is no name"),
        (|i| i.observation.clear(), "observation has no terms"),
        (
            |i| i.observation[0].scale = vec![1.0; 2],
            "scale of base_angular_velocity in observation has 2 numbers",
        ),
        (|i| i.observation[0].scale = vec![f32::NAN], "scale of base_angular_velocity in observation is NaN"),
        (|i| i.critic_observation.push(Term::new(Quantity::GaitPhase)), "gait_frequency is missing"),
        (|i| i.observation[1].history = 0, "history of projected_gravity in observation is 0; give 1 to 256"),
        (|i| i.critic_observation[3].history = 257, "history of joint_position in critic_observation is 257"),
        (
            |i| (i.history.order, i.observation[0].history) = (FrameOrder::Frames, 5),
            "history of projected_gravity in observation is 1, of base_angular_velocity 5; whole frames",
        ),
        (
            |i| {
                i.observation = vec![Term::new(Quantity::JointPosition).with_history(256); 22];
            },
            "observation has 67584 numbers; at most 65536",
        ),
    ];
    for &(change, message) in wrong {
        let text = error(change);
        assert!(text.contains(message), "`{message}` is not in `{text}`");
    }
}

#[test]
fn joints_are_found_by_name_in_any_order() {
    let (model, mut interface) = (go2(), interface());
    assert_eq!(interface.resolve(&model).unwrap(), (0..12).collect::<Vec<_>>());
    interface.joints.reverse();
    interface.joints[0] = "RR_calf".into();
    assert_eq!(interface.resolve(&model).unwrap(), (0..12).rev().collect::<Vec<_>>());
}

#[test]
fn joints_that_are_missing_or_named_twice_are_refused() {
    let (model, mut interface) = (go2(), interface());
    interface.joints[4] = "FR_tigh_joint".into();
    let missing = interface.resolve(&model).unwrap_err().to_string();
    assert!(
        missing.starts_with("joints: robot")
            && missing.contains("no joint `FR_tigh_joint`; the nearest name is `FR_thigh_joint`"),
        "{missing}"
    );
    interface.joints[4] = "FL_hip".into();
    let twice = interface.resolve(&model).unwrap_err().to_string();
    assert!(twice.contains("`FL_hip_joint` and `FL_hip` are both joint `FL_hip_joint`"), "{twice}");
}

#[test]
fn a_policy_of_a_robot_with_another_name_runs_on_the_same_joints_with_a_note() {
    let text = std::fs::read_to_string(common::root().join("assets/go2.xml")).unwrap();
    let other = text.replace("model=\"go2\"", "model=\"go1\"");
    let model = read_mjcf_str(&other, &Default::default()).unwrap();
    let interface = interface();
    assert_eq!(interface.resolve(&model).unwrap(), (0..12).collect::<Vec<_>>());
    let note = interface.other_robot(&model).unwrap();
    assert!(note.contains("`go2`") && note.contains("`go1`"), "{note}");
    assert_eq!(interface.other_robot(&go2()), None);
    let unknown = Interface { robot: String::new(), ..interface };
    unknown.check().unwrap();
    assert_eq!(unknown.other_robot(&model), None);
}
