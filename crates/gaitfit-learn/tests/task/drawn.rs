//! What is drawn at random: commands, robots, starts, pushes; and settings that are refused.

use super::*;

#[test]
fn commands_are_drawn_anew_in_their_time_and_ranges() {
    let mut task = calm();
    task.command.seconds = 0.06;
    (task.command.x, task.command.y, task.command.yaw) = ([-0.2, 1.0], [0.3, 0.4], [-2.0, -1.0]);
    task.command.standing = 0.25;
    let scene = scene(&task);
    let count = 32;
    let mut environment = Environment::new(&scene, None, 9, 0, count).unwrap();
    let mut drawn = environment.commands().to_vec();
    for number in 1..=36 {
        let before = environment.commands().to_vec();
        step(&mut environment, number, 0.0);
        let changed = (0..count).filter(|&index| environment.commands()[index] != before[index]).count();
        if number % 3 == 0 {
            assert!(changed > count / 2, "{changed} of {count} commands are new after step {number}");
            drawn.extend(environment.commands());
        } else {
            assert_eq!(changed, 0, "after step {number}");
        }
    }
    let standing = drawn.iter().filter(|command| **command == [0.0; 3]).count();
    // 416 draws of share 1/4: 104, standard deviation 8.8.
    assert!((64..=144).contains(&standing), "{standing} of {} commands stand", drawn.len());
    for (k, [low, high]) in [[-0.2f32, 1.0], [0.3, 0.4], [-2.0, -1.0]].into_iter().enumerate() {
        let moving = drawn.iter().filter(|command| **command != [0.0; 3]).map(|command| command[k]);
        let (least, most) = moving.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
        let margin = 0.05 * (high - low);
        assert!(low <= least && least < low + margin, "smallest of command {k} is {least}");
        assert!(high - margin < most && most <= high, "greatest of command {k} is {most}");
    }
    environment.hold_command(3, [0.5, 0.0, 0.0]);
    let held = environment.commands().to_vec();
    (37..=42).for_each(|number| drop(step(&mut environment, number, 0.0)));
    assert!(environment.commands() == held && held[3] == [0.5, 0.0, 0.0]);
}

#[test]
fn errors_are_against_the_command_that_the_step_had() {
    let mut task = calm();
    // One control period.
    (task.command.seconds, task.command.standing) = (0.02, 0.0);
    let scene = scene(&task);
    let [mut drawn, mut held] = [(); 2].map(|()| Environment::new(&scene, None, 5, 0, 1).unwrap());
    held.hold_command(0, drawn.commands()[0]);
    for environment in [&mut drawn, &mut held] {
        step(environment, 1, 0.3);
    }
    assert_ne!(drawn.commands(), held.commands(), "a new one was drawn");
    assert_eq!(drawn.tracking_error(0), held.tracking_error(0));
}

#[test]
fn gains_vary_within_their_ranges() {
    let mut task = calm();
    // One physics step a period, after which the torque is still that of the start.
    (task.substeps, task.control_dt) = (1, 0.005);
    (task.randomisation.kp, task.randomisation.kd) = ([0.8, 1.1], [0.5, 2.0]);
    task.start.joint_velocity = 1.0;
    task.start.joint_position = 0.0;
    let scene = scene(&task);
    let count = 64;
    let mut environment = Environment::new(&scene, None, 2, 0, count).unwrap();
    let start = environment.motion().joint_velocity.clone();
    // The first half of the robots has actions, too small for the torque limits.
    let mut actions = vec![0.0; 12 * count];
    actions[..6 * count].fill(0.5);
    environment.step(1, &actions, &mut vec![0.0; count], &mut vec![Ended::No; count]);
    let (mut kd, mut kp) = (Vec::new(), Vec::new());
    for index in 0..count {
        let torque = |j: usize| environment.motion().torque[12 * index + j];
        let velocity = |j: usize| start[12 * index + j];
        if index >= count / 2 {
            // At the default pose: torque = −kd q̇.
            let shares: Vec<f32> = (0..12).map(|j| -torque(j) / velocity(j) / 0.5).collect();
            assert!(shares.iter().all(|share| (share - shares[0]).abs() < 0.01 * shares[0]), "{shares:?}");
            kd.push(shares[0]);
        } else {
            // Two joints with torque = kp · 0.125 rad − kd q̇ give both gains.
            let fast = (1..12).max_by(|&a, &b| {
                let far = |j: usize| (velocity(j) - velocity(0)).abs();
                far(a).total_cmp(&far(b))
            });
            let fast = fast.unwrap();
            let damping = -(torque(fast) - torque(0)) / (velocity(fast) - velocity(0));
            kp.push((torque(0) + damping * velocity(0)) / 0.125 / 25.0);
            kd.push(damping / 0.5);
        }
    }
    for (name, gains, low, high) in [("kp", kp, 0.8, 1.1), ("kd", kd, 0.5, 2.0)] {
        let least = gains.iter().copied().fold(f32::MAX, f32::min);
        let most = gains.iter().copied().fold(f32::MIN, f32::max);
        // 32 draws leave an outer fifth empty once in a thousand times; the seed is fixed.
        let fifth = 0.2 * (high - low);
        assert!(low - 0.01 <= least && least <= low + fifth, "smallest {name} scale {least}");
        assert!(high - fifth <= most && most <= high + 0.01, "greatest {name} scale {most}");
    }
}

#[test]
fn what_is_randomised_is_the_robots_own_number() {
    let model = go2();
    let plain = scene(&calm());
    let nominal = plain.walker.robot(&Candidate::nominal(&model));
    assert!(nominal.kp == [25.0; 12] && nominal.kd == [0.5; 12]);
    type Vary = fn(&mut TaskSettings);
    type Change = fn(&mut Robot);
    let same: [(&str, Vary, Change); 5] = [
        ("base_mass", |t| t.randomisation.base_mass = [2.0; 2], |r| r.base_mass = 2.0),
        ("kp", |t| t.randomisation.kp = [1.5; 2], |r| r.kp_scale.fill(1.5)),
        ("kd", |t| t.randomisation.kd = [2.0; 2], |r| r.kd_scale.fill(2.0)),
        (
            "frictionloss",
            |t| t.randomisation.frictionloss = [0.25; 2],
            |r| r.frictionloss.iter_mut().for_each(|loss| *loss += 0.25),
        ),
        (
            "armature",
            |t| t.randomisation.armature = [0.125; 2],
            |r| r.armature.iter_mut().for_each(|inertia| *inertia += 0.125),
        ),
    ];
    let play = |scene: &Task, candidate: Option<&Candidate>| {
        let mut environment = Environment::new(scene, candidate, 3, 0, 1).unwrap();
        (1..=6).for_each(|number| drop(step(&mut environment, number, 0.8)));
        environment.motion().clone()
    };
    let usual = play(&plain, None);
    let drawn = |change: Vary| {
        let mut task = calm();
        change(&mut task);
        play(&scene(&task), None)
    };
    for (name, change_task, change_robot) in same {
        let drawn = drawn(change_task);
        let mut candidate = Candidate::nominal(&model);
        change_robot(&mut candidate.robot);
        assert!(drawn == play(&plain, Some(&candidate)), "{name} is not the robot's");
        assert!(drawn != usual, "{name} has no effect");
    }
    let slippery = drawn(|t| t.randomisation.floor_friction = [0.05; 2]);
    assert!(slippery != usual, "floor_friction has no effect");
}

#[test]
fn delays_and_robots_of_a_list_are_those_of_single_robots() {
    let motion = |mut environment: Environment<'_>| {
        for number in 1..=6 {
            // Where actions stay the same, so do targets, however late.
            step(&mut environment, number, if number % 2 == 0 { 0.8 } else { -0.4 });
        }
        environment.motion().clone()
    };
    // A delay that is drawn is that of a robot that has it.
    let mut task = calm();
    task.randomisation.delay = [0.012; 2];
    let drawn = scene(&task);
    let plain = calm();
    let interface = drawn.walker.interface.clone();
    let model = drawn.walker.model().clone();
    let late = Task::with_interface(&model, &plain, interface, Preset::Fast, 0.012).unwrap();
    let with_delay = |delay: f64, noise: f64| {
        let mut candidate = Candidate::nominal(&model);
        candidate.robot.delay.fill(delay);
        candidate.torque_noise = noise;
        candidate
    };
    let robot = with_delay(0.012, 0.0);
    let alone = |scene, robot: &Candidate| motion(Environment::new(scene, Some(robot), 3, 0, 1).unwrap());
    assert!(motion(Environment::new(&drawn, None, 3, 0, 1).unwrap()) == alone(&late, &robot));
    assert!(alone(&late, &robot) != alone(&late, &with_delay(0.0, 0.0)), "the delay has an effect");

    // Of several robots each environment takes one in turn, with its own noise.
    let robots = [with_delay(0.0, 0.0), with_delay(0.012, 2.0)];
    let both = motion(Environment::among(&late, &robots, 3, 0, 4).unwrap());
    let row = |motion: &gaitfit_sim::Motion, index: usize| {
        motion.joint_position[12 * index..12 * (index + 1)].to_vec()
    };
    for (number, robot) in robots.iter().enumerate() {
        let same = motion(Environment::new(&late, Some(robot), 3, 0, 4).unwrap());
        for index in [number, number + 2] {
            assert!(row(&both, index) == row(&same, index), "environment {index} has robot {number}");
        }
    }
    assert!(row(&both, 0) != row(&both, 1));
    assert!(Environment::among(&late, &[], 3, 0, 4).is_err());
}

#[test]
fn robots_start_within_their_ranges() {
    for (name, up) in [("velocity", [0.0, 0.0, 1.0]), ("biped", [1.0, 0.0, 0.0])] {
        let mut task = built_in(name);
        (task.start.joint_velocity, task.start.linear_velocity, task.start.angular_velocity) =
            (0.3, 0.2, 0.1);
        let scene = scene(&task);
        let count = 32;
        let environment = Environment::new(&scene, None, 4, 0, count).unwrap();
        let motion = environment.motion();
        let spread = |what: &str, values: &mut dyn Iterator<Item = f32>, half: f32| {
            let most = values.fold(0.0f32, |most, value| most.max(value.abs()));
            assert!(most <= half * 1.0001 && most >= 0.8 * half, "{name}: {what} up to {most}, not {half}");
        };
        let from_pose = |(k, q): (usize, &f32)| q - scene.start_pose[k % 12];
        spread("joint positions", &mut motion.joint_position.iter().enumerate().map(from_pose), 0.1);
        spread("joint velocities", &mut motion.joint_velocity.iter().copied(), 0.3);
        spread("turn rates", &mut motion.base_angular.iter().copied(), 0.1);
        let linear = motion.base_linear.chunks_exact(3);
        spread("velocities", &mut linear.flat_map(|v| [v[0], v[1]]), 0.2);
        assert!(motion.base_linear.iter().skip(2).step_by(3).all(|&v| v == 0.0));
        // Roll and pitch of at most 5° each, about the task's posture; headings all around.
        let mut quadrants = [0; 4];
        for quaternion in motion.base_quaternion.chunks_exact(4) {
            let turned = to_body(quaternion, [0.0, 0.0, 1.0]);
            let cos: f64 = (0..3).map(|k| turned[k] * up[k]).sum();
            assert!(cos > (7.1f64).to_radians().cos(), "{name}: tilted by {}°", cos.acos().to_degrees());
            let q: [f64; 4] = std::array::from_fn(|k| f64::from(quaternion[k]));
            let left = rotate(q, [0.0, 1.0, 0.0]);
            quadrants[usize::from(left[0] > 0.0) + 2 * usize::from(left[1] > 0.0)] += 1;
        }
        assert!(quadrants.iter().all(|&robots| robots > 0), "{name}: headings by quadrant {quadrants:?}");
        let (least, most) = motion
            .base_position
            .iter()
            .skip(2)
            .step_by(3)
            .fold((9.0, 0.0), |(a, b), &z| (f32::min(a, z), f32::max(b, z)));
        assert!(0.2 < least && most < 0.7, "{name}: heights from {least} to {most} m");
    }
}

#[test]
fn pushes_come_in_their_time_and_size() {
    let mut task = calm();
    (task.push.seconds, task.push.velocity) = (0.1, 0.5);
    let (pushed, still) = (scene(&task), scene(&calm()));
    let count = 8;
    let mut with = Environment::new(&pushed, None, 6, 0, count).unwrap();
    let mut without = Environment::new(&still, None, 6, 0, count).unwrap();
    let mut first = vec![None; count];
    for number in 1..=7 {
        step(&mut with, number, 0.0);
        step(&mut without, number, 0.0);
        for index in 0..count {
            let row = 3 * index..3 * index + 3;
            let (a, b) = (&with.motion().base_linear[row.clone()], &without.motion().base_linear[row]);
            if a != b && first[index].is_none() {
                first[index] = Some(number);
                // What the push gave, less what the feet took in one period.
                assert!(
                    (0..2).all(|k| (a[k] - b[k]).abs() <= 0.55),
                    "robot {index} jumps from {b:?} to {a:?}"
                );
            }
        }
    }
    let times: Vec<u32> = first.into_iter().map(Option::unwrap).collect();
    // Every five steps, not in the first one of an episode, and not all robots at once.
    assert!(times.iter().all(|time| (2..=6).contains(time)), "{times:?}");
    assert!(times.iter().any(|time| *time != times[0]), "{times:?}");
}

#[test]
fn bad_settings_are_refused_by_name() {
    let model = go2();
    type Change = fn(&mut TaskSettings);
    let wrong: [(Change, &str, &str); 23] = [
        (
            |t| t.rewards.extend([("walk".to_owned(), 1.0)]),
            "task.rewards",
            "`walk`; known terms: track_linear",
        ),
        (|t| t.rewards["gait"] = f64::NAN, "task.rewards", "gives `gait` the weight NaN"),
        (|t| t.feet = vec!["paw".to_owned()], "task.feet", "paw"),
        (|t| t.feet.clear(), "task.feet", "has 0 names"),
        (|t| t.gait[0][1] = "FR_paw".to_owned(), "task.gait", "`FR_paw`, which is not in task.feet"),
        (
            |t| t.fall.contacts = vec!["tail".to_owned()],
            "task.fall.contacts",
            "`tail`, which matches no geom of go2",
        ),
        (|t| t.fall.contacts = vec!["[".to_owned()], "task.fall.contacts", "`[`, which is no pattern"),
        (|t| t.fall.tilt = 0.0, "task.fall.tilt", "is 0"),
        (|t| t.control_dt = f64::NAN, "task.control_dt", "is NaN"),
        (|t| t.substeps = 0, "substeps", "is 0"),
        (|t| t.episode_seconds = -1.0, "task.episode_seconds", "is -1"),
        (|t| t.command.x = [1.0, -1.0], "task.command.x", "is [1, -1]"),
        (|t| t.command.standing = 1.5, "task.command.standing", "is 1.5"),
        (|t| t.randomisation.kp = [-0.1, 1.0], "task.randomisation.kp", "is [-0.1, 1]"),
        (|t| t.noise.set(Quantity::JointVelocity, f64::INFINITY), "task.noise.joint_velocity", "is inf"),
        (|t| t.noise.set(Quantity::Command, 0.1), "task.noise.command", "is no reading of a sensor"),
        (|t| t.start.tilt = -1.0, "task.start.tilt", "is -1"),
        (|t| t.push.velocity = f64::NAN, "task.push.velocity", "is NaN"),
        (|t| t.posture = [0.0, 0.0, -2.0], "task.posture", "length 1"),
        (
            |t| t.policy.default_pose.extend([("*_tail".to_owned(), 0.0)]),
            "task.policy.default_pose",
            "`*_tail`",
        ),
        (|t| t.start.pose.extend([("knee".to_owned(), 0.0)]), "task.start.pose", "`knee`"),
        (
            |t| t.policy.observation[0].scale = vec![1.0; 2],
            "task.policy.observation",
            "2 numbers; give one or 3",
        ),
        (
            |t| t.policy.observation.push(Term::new(Quantity::GaitPhase)),
            "task.policy.gait_frequency",
            "is missing",
        ),
    ];
    for (change, setting, what) in wrong {
        let mut task = TaskSettings::default();
        change(&mut task);
        let error = Task::new(&model, &task, Preset::Fast).err().unwrap().to_string();
        assert!(error.starts_with(setting) && error.contains(what), "`{setting}` and `{what}`: {error}");
    }
    let clamped = gaitfit_model::ReadOptions { root: Some(gaitfit_model::Root::Fixed), ..Default::default() };
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let model = gaitfit_model::read(path.as_ref(), &clamped).unwrap();
    let error = Task::new(&model, &TaskSettings::default(), Preset::Fast).err().unwrap().to_string();
    assert!(error.contains("go2 is clamped"), "{error}");
}

#[test]
fn joints_that_follow_others_start_where_their_leaders_put_them() {
    let file = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml")).unwrap();
    // The first coupling's leader follows the second's, in turn.
    let couplings = "</worldbody><equality>\
        <joint joint1=\"RR_thigh_joint\" joint2=\"FR_thigh_joint\" polycoef=\"0 1 0 0 0\"/>\
        <joint joint1=\"FR_thigh_joint\" joint2=\"FL_thigh_joint\" polycoef=\"0.1 0.9 0 0 0\"/></equality>";
    let coupled = file.replacen("</worldbody>", couplings, 1);
    let model = gaitfit_model::read_mjcf_str(&coupled, &Default::default()).unwrap();
    let mut task = built_in("velocity");
    task.start.pose.insert("*_thigh".to_owned(), 0.7);
    task.start.joint_velocity = 1.5;
    let scene = Task::new(&model, &task, Preset::Fast).unwrap();
    let place = |joint: &str| model.find_joint(joint).unwrap();
    let [leader, follower, last] = ["FL_thigh_joint", "FR_thigh_joint", "RR_thigh_joint"].map(place);
    let starts = |angles: &[f32]| {
        let wanted = 0.1 + 0.9 * angles[leader];
        assert!(
            (angles[follower] - wanted).abs() < 1e-6 && (angles[last] - wanted).abs() < 1e-6,
            "{angles:?}"
        );
    };
    starts(&scene.start_pose);
    let environment = Environment::new(&scene, None, 4, 0, 4).unwrap();
    let motion = environment.motion();
    motion.joint_position.chunks_exact(12).for_each(starts);
    for velocities in motion.joint_velocity.chunks_exact(12) {
        let wanted = 0.9 * velocities[leader];
        assert!(
            velocities[leader] != 0.0
                && [follower, last].map(|j| (velocities[j] - wanted).abs() < 1e-6) == [true; 2],
            "{velocities:?}"
        );
    }
    assert!(motion.joint_position[leader] != motion.joint_position[12 + leader]);
}
