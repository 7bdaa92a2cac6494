//! Settings joint by joint, policies over some of the joints, and feet of any shape.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::task_common;

use gaitfit_learn::evaluate::{Subject, record_gait};
use gaitfit_learn::task::expression::{Expression, Names};
use gaitfit_learn::task::{Ended, Environment, JointNumber, Task, TaskSettings};
use gaitfit_model::{Model, SelfContact, Shape};
use gaitfit_physics::Preset;
use gaitfit_policy::{ActionClip, Quantity};
use gaitfit_sim::{Candidate, Start};
use task_common::{calm, constant_policy, go2, scene};

fn table(entries: &[(&str, f64)]) -> JointNumber {
    JointNumber::Table(entries.iter().map(|(pattern, value)| ((*pattern).to_owned(), *value)).collect())
}

fn wrong(change: impl Fn(&mut TaskSettings)) -> String {
    let mut task = calm();
    change(&mut task);
    Task::new(&go2(), &task, Preset::Fast).map(|_| ()).unwrap_err().to_string()
}

#[test]
fn gains_scales_and_clips_are_by_pattern() {
    let mut task = calm();
    task.policy.kp = table(&[("*", 20.0), ("*_calf", 30.0), ("FL_calf_joint", 40.0)]);
    task.policy.kd = table(&[("*", 0.5), ("RR_*", 0.0)]);
    task.policy.action_scale = table(&[("*_hip", 0.1), ("*_{thigh,calf}", 0.3)]);
    task.policy.action_clip = Some(table(&[("*", 2.0), ("*_hip", 0.5)]));
    let scene = scene(&task);
    let interface = &scene.walker.interface;
    assert_eq!(interface.kp[..6], [20.0, 20.0, 40.0, 20.0, 20.0, 30.0]);
    assert_eq!(interface.kd[9..], [0.0; 3]);
    assert_eq!(interface.action_scale[..3], [0.1, 0.3, 0.3]);
    assert!(matches!(&interface.action_clip, Some(ActionClip::Each(clips)) if clips[..2] == [0.5, 2.0]));
    let robot = scene.walker.robot(&Candidate::nominal(&go2()));
    assert_eq!((robot.kp[2], robot.kd[11]), (40.0, 0.0));
    let mut targets = vec![0.0; 12];
    scene.walker.targets(&[10.0; 12], &mut targets);
    assert_eq!(targets[0], scene.walker.default_pose[0] + 0.1_f32 * 0.5);
    assert_eq!(targets[1], scene.walker.default_pose[1] + 0.3_f32 * 2.0);

    let text = toml::to_string(&task).unwrap();
    assert_eq!(toml::from_str::<TaskSettings>(&text).unwrap(), task);
    let plain = toml::to_string(&calm()).unwrap();
    assert!(plain.contains("kp = 25.0") && !plain.contains("action_clip"), "{plain}");
}

#[test]
fn wrong_numbers_of_joints_are_named() {
    type Change = fn(&mut TaskSettings);
    let cases: [(Change, &str); 12] = [
        (|t| t.gait[1][0] = "FL_foot".to_owned(), "task.gait names `FL_foot` twice; a foot is in one group"),
        (|t| t.gait[0][1] = "FL_foot".to_owned(), "task.gait names `FL_foot` twice"),
        (
            |t| {
                t.policy.default_pose.insert("RR_calf".to_owned(), 1.5);
            },
            "task.policy.default_pose puts `RR_calf_joint` at 1.5 rad, and its range is -2.7227 to -0.83776 rad",
        ),
        (
            |t| t.policy.default_pose.retain(|name, _| !name.contains("calf")),
            "puts `FL_calf_joint` at 0 rad, and its range is -2.7227 to -0.83776 rad; a joint that no pattern",
        ),
        (|t| t.policy.kp = JointNumber::All(0.0), "task.policy.kp is 0; it must be above 0"),
        (
            |t| t.policy.kp = table(&[("*_calf", -1.0)]),
            "task.policy.kp is -1 for `*_calf`; it must be from 0",
        ),
        (|t| t.policy.kd = JointNumber::All(f64::NAN), "task.policy.kd is NaN; it must be from 0"),
        (|t| t.policy.action_scale = table(&[("*", 0.0)]), "task.policy.action_scale is 0 for `*`"),
        (|t| t.policy.action_clip = Some(JointNumber::All(-1.0)), "task.policy.action_clip is -1"),
        (|t| t.policy.kp = table(&[("*_calf", 1.0)]), "task.policy.kp has no number for `FL_hip_joint`; add"),
        (|t| t.policy.kd = table(&[("*_claf", 1.0)]), "task.policy.kd is wrong: `*_claf` matches no joint"),
        (|t| t.policy.joints = vec!["*_arm".to_owned()], "task.policy.joints is wrong: `*_arm` matches no"),
    ];
    for (change, message) in cases {
        let error = wrong(change);
        assert!(error.contains(message), "{error}");
    }
}

/// The task with velocities for the hips: they turn as wheels do.
fn turning() -> TaskSettings {
    let mut task = calm();
    task.policy.velocity_joints = vec!["*_hip".to_owned()];
    task.policy.kp = table(&[("*", 25.0), ("*_hip", 0.0)]);
    task.policy.kd = table(&[("*", 0.5), ("*_hip", 2.0)]);
    task.policy.action_scale = table(&[("*", 0.25), ("*_hip", 3.0)]);
    task.policy.default_pose.retain(|name, _| !name.contains("hip"));
    task
}

#[test]
fn joints_with_velocity_targets_turn_at_the_velocity_asked_for() {
    let mut model = go2();
    model.joints.iter_mut().filter(|joint| joint.name.contains("hip")).for_each(|joint| joint.range = None);
    // Legs in the air, far above the ground.
    let mut settings = turning();
    settings.fall.height = -1e3;
    settings.fall.tilt = 180.0;
    settings.fall.contacts.clear();
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    let interface = &task.walker.interface;
    assert_eq!(interface.velocity_joints.len(), 4);
    let hips: Vec<usize> = (0..12).filter(|&joint| interface.velocity_targets()[joint]).collect();
    assert_eq!(hips, [0, 3, 6, 9]);
    // Actions of half a unit: 1.5 rad/s on the hips, the default pose of the others and an eighth of a radian.
    let mut targets = vec![0.0; 12];
    task.walker.targets(&[0.5; 12], &mut targets);
    assert_eq!((targets[0], targets[1]), (1.5, task.walker.default_pose[1] + 0.125));
    let robot = task.walker.robot(&Candidate::nominal(&model)).params(task.walker.model()).unwrap();
    let mut tile = task.walker.engine.tile(&task.walker.batch, &[robot], &[]).unwrap();
    let angles: Vec<f64> = task.walker.default_pose.iter().map(|&angle| f64::from(angle)).collect();
    let stands = task.walker.standing([0.0; 2], [1.0, 0.0, 0.0, 0.0], &angles);
    tile.place(0, &Start { base_position: [0.0, 0.0, 20.0], ..stands });
    let mut motion = task.walker.batch.motion(1);
    tile.observe(&mut motion);
    for _ in 0..50 {
        tile.step(&targets, &[], &mut motion);
    }
    for &hip in &hips {
        let velocity = motion.joint_velocity[hip];
        assert!((velocity - 1.5).abs() < 0.2, "joint {hip} turns at {velocity} rad/s");
        assert!(motion.joint_position[hip] > 1.0, "joint {hip} has not turned");
    }
}

#[test]
fn angles_of_joints_with_velocity_targets_are_neither_seen_nor_paid_for() {
    let scene = scene(&turning());
    let interface = &scene.walker.interface;
    let first = interface.observation.iter().find(|term| term.quantity == Quantity::JointPosition).unwrap();
    assert_eq!(first.scale, [0.0, 1.0, 1.0].repeat(4));
    let names = Names::new(&scene.settings, &scene.walker);
    let width = |text: &str| match Expression::new(text, &names).unwrap().folds() {
        [fold] => fold.width,
        folds => panic!("{folds:?}"),
    };
    assert_eq!((width("sum(qpos - default_pose)"), width("sum(qvel)")), (8, 12));
    assert_eq!(width("sum(qpos[\"*_hip\", \"FL_calf\"])"), 5, "a pattern picks wheels too");
    let bounds = scene.action_bounds();
    assert_eq!((bounds[0], bounds[1][0] < -1.0), ([-100.0 / 3.0, 100.0 / 3.0], true));

    let text = toml::to_string(&turning()).unwrap();
    assert_eq!(toml::from_str::<TaskSettings>(&text).unwrap(), turning());
    let held = wrong(|task| {
        *task = turning();
        task.policy.joints = vec!["*_thigh".to_owned(), "*_calf".to_owned()];
    });
    assert!(
        held.contains("task.policy.velocity_joints covers `FL_hip_joint`, which the policy does not"),
        "{held}"
    );
    let stiff = wrong(|task| {
        *task = turning();
        task.policy.kp = JointNumber::All(20.0);
    });
    assert!(stiff.contains("velocity_joints names FL_hip_joint, whose kp is 20"), "{stiff}");
}

#[test]
fn no_joints_are_not_all_joints() {
    let text = toml::to_string(&calm()).unwrap().replace("[policy]\n", "[policy]\njoints = []\n");
    let error = toml::from_str::<TaskSettings>(&text).unwrap_err().to_string();
    assert!(error.contains("`joints` is empty") && error.contains("leave it out"), "{error}");
}

#[test]
fn robots_fall_down() {
    for (gravity, shown) in
        [([0.0, -9.81, 0.0], "0 -9.81 0"), ([0.0, 0.0, 9.81], "0 0 9.81"), ([0.0; 3], "0 0 0")]
    {
        let mut model = go2();
        model.options.gravity = gravity;
        let error = Task::new(&model, &calm(), Preset::Fast).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(&format!("gravity `{shown}`")) && error.contains("along -z"), "{error}");
    }
}

/// A policy over eight joints moves as one over all twelve that leaves the other four at action zero.
#[test]
fn joints_without_a_policy_are_held_in_the_default_pose() {
    let mut some = TaskSettings::default();
    some.policy.joints = vec!["*_thigh".to_owned(), "*_calf".to_owned()];
    some.policy.action_scale = table(&[("*_thigh", 0.2), ("*_calf", 0.3)]);
    let mut all = some.clone();
    all.policy.joints.clear();
    all.policy.action_scale = table(&[("*", 0.2), ("*_calf", 0.3)]);
    let (some, all) = (scene(&some), scene(&all));
    let interface = &some.walker.interface;
    assert_eq!((interface.joints.len(), interface.held.len()), (8, 4));
    assert_eq!((interface.held[0].joint.as_str(), interface.held[0].position), ("FL_hip_joint", 0.1));
    assert_eq!((interface.held[1].kp, interface.held[1].kd), (25.0, 0.5));
    assert_eq!(some.walker.other_joints, [0, 3, 6, 9]);

    let count = 5;
    let run = |scene: &Task, wide: bool| {
        let mut environment = Environment::new(scene, None, 4, 0, count).unwrap();
        let (mut reward, mut ended) = (vec![0.0; count], vec![Ended::No; count]);
        let mut seen = Vec::new();
        for step in 1..=40 {
            let mut actions = Vec::new();
            for robot in 0..count {
                for joint in 0..12 {
                    let action = ((robot * 12 + joint) as f32 + step as f32 * 0.3).sin();
                    match (joint % 3 == 0, wide) {
                        (true, true) => actions.push(0.0),
                        (true, false) => {}
                        (false, _) => actions.push(action),
                    }
                }
            }
            environment.step(step, &actions, &mut reward, &mut ended);
            environment.begin_episodes(step, &ended);
            seen.extend_from_slice(&environment.motion().joint_position);
            seen.extend_from_slice(&environment.motion().base_position);
            seen.extend_from_slice(environment.targets());
        }
        seen
    };
    assert_eq!(run(&some, false), run(&all, true));
}

/// The Go2 with other shapes in the place of its feet.
fn feet_of(shape: Shape) -> Model {
    let mut model = go2();
    for geom in model.geoms.iter_mut().filter(|geom| geom.name.ends_with("_foot")) {
        geom.shape = shape;
    }
    model
}

#[test]
fn box_feet_stand_as_balls_do() {
    let shapes = [Shape::Box { half_size: [0.03, 0.02, 0.02] }, Shape::Sphere { radius: 0.022 }];
    for shape in shapes {
        let model = feet_of(shape);
        let task = Task::new(&model, &calm(), Preset::Fast).unwrap();
        let policy = constant_policy(&task, &[0.0; 12]);
        let subject =
            Subject { task: &task, policy: &policy, candidate: None, seed: 3, cancel: None, moved: None };
        let gait = record_gait(&subject, &[(1.0, [0.0; 3])]).unwrap();
        assert!(!gait.fell, "{shape:?}");
        let heights: Vec<f64> = gait.base.iter().skip(2).step_by(7).copied().collect();
        let (first, last) = (heights[0], heights[heights.len() - 1]);
        let highest = heights.iter().copied().fold(0.0, f64::max);
        assert!(highest < first + 0.01 && (last - first).abs() < 0.15, "{shape:?}: {first} {highest} {last}");
        let end = gait.steps() - 1;
        assert!(gait.contact[4 * end..].iter().all(|&contact| contact), "{shape:?}");
        for clearance in &gait.foot_clearance[4 * end..] {
            // The Go2's feet are soft: a corner sinks in deeper than a ball.
            assert!((-0.025..0.004).contains(clearance), "{shape:?}: {clearance}");
        }
        // In the first moment the feet are just above the ground.
        let least = gait.foot_clearance[..4].iter().copied().fold(f64::MAX, f64::min);
        assert!((-0.01..0.004).contains(&least), "{shape:?}: {least}");
    }
}

#[test]
fn a_body_is_a_foot_with_all_its_geoms() {
    let mut model = go2();
    // A second ball on each calf, in front of the foot.
    for leg in ["FL", "FR", "RL", "RR"] {
        let place = model.geoms.iter().position(|geom| geom.name == format!("{leg}_lower_calf")).unwrap();
        let foot = model.geoms.iter().find(|geom| geom.name == format!("{leg}_foot")).unwrap().clone();
        let toe = &mut model.geoms[place];
        (toe.shape, toe.quat) = (foot.shape, foot.quat);
        toe.pos = [foot.pos[0] + 0.04, foot.pos[1], foot.pos[2]];
    }
    let mut settings = calm();
    let bodies: Vec<String> = ["FL", "FR", "RL", "RR"].iter().map(|leg| format!("{leg}_calf")).collect();
    settings.gait =
        vec![vec![bodies[0].clone(), bodies[3].clone()], vec![bodies[1].clone(), bodies[2].clone()]];
    settings.feet = bodies;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    let names = |places: &[usize]| -> Vec<&str> {
        let contacts = task.walker.batch.contact_geoms();
        places.iter().map(|&place| model.geoms[contacts[place]].name.as_str()).collect()
    };
    let mut geoms = names(&task.foot_geoms()[0].geoms);
    geoms.sort_unstable();
    assert_eq!(geoms, ["FL_foot", "FL_lower_calf", "FL_upper_calf"]);
    assert!(task.foot_geoms().iter().all(|foot| foot.geoms.iter().all(|p| !task.body_geoms().contains(p))));
    let policy = constant_policy(&task, &[0.0; 12]);
    let subject =
        Subject { task: &task, policy: &policy, candidate: None, seed: 3, cancel: None, moved: None };
    let gait = record_gait(&subject, &[(1.0, [0.0; 3])]).unwrap();
    let end = gait.steps() - 1;
    assert!(!gait.fell && gait.contact[4 * end..].iter().all(|&contact| contact));
}

#[test]
fn wrong_feet_are_named_with_what_there_is() {
    let feet = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        wrong(move |task| {
            task.feet = names.clone();
            task.gait = Vec::new();
        })
    };
    let error = feet(&["FL_fot", "FR_foot"]);
    assert!(error.starts_with("task.feet has `FL_fot`, which is no geom or body of go2; "), "{error}");
    assert!(error.contains("the nearest names are FL_foot,"), "{error}");
    let error = feet(&["FL_foot", "FL_calf"]);
    assert!(error.contains("task.feet has `FL_foot` and `FL_calf`, which share a geom"), "{error}");
    let error = feet(&["floor"]);
    assert!(error.contains("`floor`"), "{error}");
    let error = wrong(|task| task.gait[0][0] = "FL_fot".to_owned());
    assert!(
        error.contains("task.gait names `FL_fot`, which is not in task.feet (FL_foot, FR_foot"),
        "{error}"
    );
    let error = wrong(|task| task.fall.contacts = vec!["trnk".to_owned()]);
    assert!(error.contains("task.fall.contacts has `trnk`") && error.contains("are trunk,"), "{error}");
    assert!(!feet(&["\u{1b}[2J"]).contains('\u{1b}'));
}

#[test]
fn own_parts_touch_where_the_task_says_so() {
    let mut task = calm();
    let off = toml::to_string(&task).unwrap();
    assert!(!off.contains("self_contact"), "{off}");
    task.self_contact = SelfContact::Pairs(vec![["*_foot".to_owned(), "*_foot".to_owned()]]);
    let text = toml::to_string(&task).unwrap();
    assert_eq!(toml::from_str::<TaskSettings>(&text).unwrap(), task);
    let feet = scene(&task);
    assert_eq!((feet.walker.model().self_pairs.len(), feet.remarks.len()), (6, 0));
    assert!(feet.walker.touches_itself() && !scene(&calm()).walker.touches_itself());
    task.self_contact = SelfContact::Limbs;
    let limbs = scene(&task);
    assert_eq!(limbs.walker.model().self_pairs.len(), 6);
    assert!(limbs.remarks[0].contains("(cylinder)"), "{:?}", limbs.remarks);
    let error = wrong(|task| {
        task.self_contact = SelfContact::Pairs(vec![["FL_foto".to_owned(), "FR_foot".to_owned()]]);
    });
    assert!(error.starts_with("task.self_contact: `FL_foto`") && error.contains("FL_foot"), "{error}");
}
