//! Rewards written as expressions.

use super::*;
use gaitfit_learn::task::expression::Quantity;
use gaitfit_learn::task::{Ended, Environment, TaskError, TaskSettings};
use gaitfit_learn::{Training, TrainingError, TrainingSettings, ppo};
use gaitfit_random::{Purpose, Stream};
use task_common::step;

fn names(scene: &Task) -> Names<'_> {
    Names::new(&scene.settings, &scene.walker)
}

fn read(scene: &Task, text: &str) -> Expression {
    Expression::new(text, &names(scene)).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn built_in_terms_have_the_bits_of_plain_loops() {
    ["velocity", "biped"].iter().for_each(|name| has_the_bits_of_loops(&scene(&built_in(name))));
    // Feet of which one has no group, and one foot alone.
    let mut settings = calm();
    settings.gait[1].pop();
    has_the_bits_of_loops(&scene(&settings));
    settings.feet.truncate(1);
    settings.gait = vec![settings.feet.clone()];
    has_the_bits_of_loops(&scene(&settings));
}

fn has_the_bits_of_loops(scene: &Task) {
    let noise = Stream::new(4, Purpose::BOOTSTRAP);
    for draw in 0..100u32 {
        let drawn = |from: u32| noise.normal(1000 * draw + from) as f32;
        let row = |from: u32| -> [f32; 12] { std::array::from_fn(|k| drawn(from + k as u32)) };
        let three = |from: u32| -> [f32; 3] { std::array::from_fn(|k| drawn(from + k as u32)) };
        let [qpos, qacc, tau, action, last] = [100, 120, 140, 160, 180].map(row);
        let foot = |k: u32| {
            let touching = drawn(200 + k) > 0.0;
            Foot {
                touching,
                landed: touching && drawn(210 + k) > 0.0,
                air: if touching { 0.0 } else { drawn(220 + k).abs() },
                contact: if touching { drawn(260 + k).abs() } else { 0.0 },
                last_air: 0.25 * drawn(230 + k).abs(),
                height: 0.1 * drawn(240 + k),
                speed: drawn(250 + k).abs(),
                ..Foot::default()
            }
        };
        let feet: Vec<Foot> = (0..scene.settings.feet.len()).map(|k| foot(k as u32)).collect();
        let moment = Moment {
            command: three(0),
            walking: drawn(3) > -0.5,
            velocity: three(4),
            angular_velocity: three(7),
            yaw_rate: drawn(10),
            uprightness: drawn(11).tanh(),
            height: 0.3 + 0.1 * drawn(12),
            joint_position: &qpos,
            joint_acceleration: &qacc,
            torque: &tau,
            action: &action,
            last_action: &last,
            body_contacts: draw as usize % 3,
            clock: drawn(13).abs().fract(),
            fallen: draw % 5 == 0,
            ..moment(scene, &feet)
        };
        let looped = reward::TERMS.iter().filter_map(|term| Some((term, loops::value(term.name, &moment)?)));
        assert_eq!(looped.clone().count(), 21, "a term was renamed or is gone");
        for (term, wanted) in looped {
            // An empty sum is −0 in Rust.
            let (found, wanted) = (value(term.name, &moment) + 0.0, wanted + 0.0);
            assert_eq!(found.to_bits(), wanted.to_bits(), "{} is {wanted}, not {found}", term.name);
        }
    }
}

#[test]
fn values_by_hand() {
    let scene = scene(&calm());
    let mut ramp = [0.0; 12];
    for (j, slot) in ramp.iter_mut().enumerate() {
        *slot = j as f32;
    }
    let feet = [down(), up(0.1, 0.05), up(0.2, 0.2), down()];
    let m = Moment { torque: &ramp, target: &ramp, joint_velocity: &ramp, ..moment(&scene, &feet) };
    for (text, wanted) in [
        // Joints go hip, thigh, calf by leg: the calves are 2, 5, 8, 11.
        (r#"sum(tau["*_calf"])"#, 26.0),
        (r#"sum(abs(-tau["*_calf_joint"]))"#, 26.0),
        (r#"max(tau["FL_*", "FR_hip"])"#, 3.0),
        (r#"tau["FR_hip"] + 1"#, 4.0),
        (r#"mean(tau["*_calf"] - tau["*_thigh"])"#, 1.0),
        ("norm(tau['FR_thigh', 'FR_hip'])", 5.0),
        ("sum(tau * qvel - target^2)", 0.0),
        // A fold inside a row: Σ (τ − mean τ) = 0 and its largest, 11 − 5.5.
        ("max(tau - mean(tau))", 5.5),
        ("sum(contact)", 2.0),
        (r#"sum(foot_height["F*"])"#, 0.05),
        (r#"contact["RR_foot"] - contact["RL_foot"]"#, 1.0),
        ("sum(air_time > 0.15)", 1.0),
        ("sum(air_time > 0.05 and foot_height < 0.1)", 1.0),
        ("sum(not contact or air_time == 0)", 4.0),
        ("min(1, 2) + max(1, 2) + clamp(5, 0, 3) + clamp(-5, 0, 3)", 6.0),
        ("select(height < 0.2, 1, -2)", -2.0),
        // Squares are tighter than signs, signs than products.
        ("-2^2 + 2 * -3 + 2^3 + 2^-1 + 7 / 2 / 2", -4.0 - 6.0 + 8.0 + 0.5 + 1.75),
        ("1 - 2 - 3 < -3 and 1 <= 1 or 0", 1.0),
        ("2^3^0", 2.0),
        ("ln(exp(1)) + sqrt(4) + sin(0) + cos(0) + tanh(0) + .5e1", 9.0),
        ("gravity['z'] + walking + clock + fallen", 0.0),
        ("mean(contact_time) * 20", 1.0),
        ("floor(2.9) + floor(-0.1) + floor(3)", 4.0),
        // Six pairs of four feet: (FR, FL), (RL, FL), (RL, FR), (RR, FL), (RR, FR), (RR, RL).
        ("sum(first(contact) == second(contact))", 2.0),
        ("sum(first(foot_height) - second(foot_height))", 0.05 + 0.2 + 0.15 + 0.0 - 0.05 - 0.2),
        ("sum(second(air_time) * 0 + 1)", 6.0),
        // Two feet are one pair; a single number has none.
        ("sum(first(foot_height['FL_foot', 'FR_foot']))", 0.05),
        ("1 + sum(first(height) == second(height))", 1.0),
        ("max(second(gait_group['F*'])) + sum(first(height)) + mean(gait_group)", 0.5),
        ("tracking_width + yaw_tracking_width + wanted_height + swing_height + swing_seconds + dt", 1.67),
    ] {
        let found = f64::from(read(&scene, text).value(&m));
        assert!((found - wanted).abs() < 1e-6, "`{text}` is {found}, by hand {wanted}");
    }
    // What is not a number stays that.
    for text in ["min(ln(-1), 1)", "max(1, ln(-1))", "clamp(0/0, 0, 1)", "max(sqrt(-tau - 1))"] {
        assert!(read(&scene, text).value(&m).is_nan(), "{text}");
    }
}

#[test]
fn wrong_expressions_are_refused_with_place_and_remedy() {
    let scene = scene(&calm());
    let names = names(&scene);
    let long = "1+".repeat(600);
    let deep = "(".repeat(200);
    let much = format!("1{}", "+1".repeat(300));
    let sums = format!("0{}", "+sum(tau)".repeat(40));
    for (text, column, words) in [
        ("", 1, &["`the end`", "a number"][..]),
        ("1 +", 4, &["`the end`", "a number, a quantity"]),
        ("1 2", 3, &["`2`", "an operator or the end"]),
        ("tau", 1, &["a row of 12 numbers", "sum, mean, norm"]),
        ("sum(torqe)", 5, &["no `torqe`", "Quantities: command, velocity,", "Functions: abs,"]),
        ("sum(taus)", 5, &["did you mean `tau`?"]),
        ("foot_hight", 1, &["did you mean `foot_height`?"]),
        ("3 * summ(tau)", 5, &["did you mean `sum`?"]),
        (r#"sum(tau["*_claf"])"#, 9, &["`*_claf`", "`tau`", "FL_calf_joint"]),
        (r#"contact["FL_fot"]"#, 9, &["`FL_fot`", "FL_foot, FR_foot, RL_foot, RR_foot"]),
        (r#"command["yaw", "z"]"#, 16, &["`z`", "x, y, yaw"]),
        (r#"tau["[a"]"#, 5, &["no joint pattern"]),
        ("tau[3]", 5, &["`3`", "a name or pattern in quotes"]),
        (r#"height["x"]"#, 7, &["`height` is a single number"]),
        ("sum(tau + contact)", 9, &["4 numbers", "12"]),
        ("sum(select(contact, tau, 0))", 5, &["do not go together"]),
        ("1 < 2 < 3", 7, &["compare two at a time", "`and`"]),
        ("clamp(1, 2)", 1, &["`clamp`", "its minimum and its maximum", "not 2"]),
        ("1 + clamp(height, 2, 1)", 5, &["`clamp` goes from 2 to 1", "exchange"]),
        ("clamp(height, -0.1, -(1 + 1))", 1, &["from -0.1 to -2"]),
        ("abs(1, 2)", 1, &["one value, not 2"]),
        ("min(1, 2, 3)", 1, &["a row, or two values, not 3"]),
        ("sum 3", 5, &["`3`", "`(`"]),
        ("(1", 3, &["`the end`", "`)`"]),
        ("1e99", 1, &["`1e99` is no number"]),
        ("2x", 1, &["`2x` is no number"]),
        ("1 & 2", 3, &["`&` means nothing"]),
        ("α", 1, &["`α` means nothing"]),
        (r#"tau["FL"#, 8, &["the closing \""]),
        (&long, 1, &["1200 bytes, more than 1000"]),
        (&deep, 34, &["inside each other"]),
        (&much, 256, &["more than 256 operators"]),
        ("sum(second(first(tau)))", 5, &["pairs of a row of 66 numbers, more than 32"]),
        ("first(contact)", 1, &["a row of 6 numbers"]),
        ("sum(first(contact) + contact)", 20, &["4 numbers", "6"]),
        (&sums, 291, &["more than 32 sums"]),
    ] {
        let error = Expression::new(text, &names).unwrap_err();
        let message = error.to_string();
        assert!(words.iter().all(|word| message.contains(word)), "`{text}`: {message}");
        assert_eq!(error.column, column, "`{text}`: {message}");
    }
}

#[test]
fn no_text_makes_the_parser_panic() {
    let scene = scene(&calm());
    let names = names(&scene);
    let feet = [down(); 4];
    let m = moment(&scene, &feet);
    let pieces = [
        "tau", "contact", "height", "sum", "min", "clamp", "select", "(", ")", "[", "]", ",", "\"*\"",
        "'F*'", "+", "-", "*", "/", "^", "<", ">=", "and", "or", "not", "1", "2.5", ".", "e5", " ", "é",
        "\"", "\u{0}",
    ];
    let draws = Stream::new(9, Purpose::BOOTSTRAP);
    let mut read = 0;
    for k in 0..20_000u32 {
        let count = 1 + (draws.uniform(64 * k) * 12.0) as u32;
        let text: String = (0..count)
            .map(|place| pieces[(draws.uniform(64 * k + 1 + place) * pieces.len() as f64) as usize])
            .collect();
        if let Ok(expression) = Expression::new(&text, &names) {
            expression.value(&m);
            read += 1;
        }
    }
    assert!(read > 100, "{read}");
}

/// The velocity task with these terms and weights alone.
fn task(terms: &[(&str, &str)], rewards: &[(&str, f64)]) -> TaskSettings {
    TaskSettings {
        terms: terms.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect(),
        rewards: rewards.iter().map(|(name, weight)| ((*name).to_owned(), *weight)).collect(),
        ..TaskSettings::default()
    }
}

#[test]
fn a_written_term_pays_as_the_built_in_one() {
    let weights = |names: [&'static str; 3]| [(names[0], -2e-4), (names[1], 0.5), (names[2], -0.04)];
    let built_in = scene(&task(&[], &weights(["torque", "height", "action_rate"])));
    let terms = [
        ("spare", "sum(tau^2)"),
        ("stand", "exp(-square((height - 0.3) / 0.1))"),
        ("calm", "sum(square(action - last_action))"),
        ("off", "height"),
    ];
    let mut settings = task(&terms, &weights(["spare", "stand", "calm"]));
    settings.rewards.insert("off".to_owned(), 0.0);
    let text = toml::to_string(&settings).unwrap();
    assert_eq!(toml::from_str::<TaskSettings>(&text).unwrap(), settings, "a policy's file keeps terms");
    let written = scene(&settings);
    assert_eq!(written.reward_names(), ["spare", "stand", "calm"]);
    let run = |scene: &Task| {
        let mut environment = Environment::new(scene, None, 3, 0, 9).unwrap();
        let paid: Vec<f32> =
            (0..10).flat_map(|number| step(&mut environment, number, 0.1 * number as f32).0).collect();
        (paid, environment.take_terms())
    };
    let ((paid, terms), wanted) = (run(&written), run(&built_in));
    assert!(paid.iter().any(|paid| *paid != 0.0) && terms.iter().all(|term| *term != 0.0));
    assert_eq!((paid, terms), wanted);
}

#[test]
fn targets_of_a_policy_are_seen() {
    let settings = task(&[("away", "max(abs(target - default_pose))")], &[("away", 1.0)]);
    let scene = scene(&settings);
    let mut environment = Environment::new(&scene, None, 3, 0, 1).unwrap();
    // 0.25 rad an action of 1; a step pays its duration.
    let (paid, _) = step(&mut environment, 0, 0.8);
    assert!((paid[0] - 0.2 * 0.02).abs() < 1e-6, "{paid:?}");
}

#[test]
fn terms_and_weights_must_belong_together() {
    let refused = |terms: &[(&str, &str)], rewards: &[(&str, f64)]| {
        Task::new(&task_common::go2(), &task(terms, rewards), gaitfit_physics::Preset::Fast)
            .map(|_| ())
            .unwrap_err()
    };
    for (terms, rewards, words) in [
        (&[("low", "height")][..], &[][..], &["task.terms has `low`", "no weight"][..]),
        (&[], &[("low", 1.0)], &["task.rewards has `low`", "torque", "task.terms"]),
        (&[("low", "height")], &[("lwo", 1.0)], &["task.rewards has `lwo`", "fall, low"]),
        (&[("torque", "height")], &[("torque", 1.0)], &["`torque`, which is built in"]),
        (&[("my term", "height")], &[], &["`my term`", "a name begins with a letter"]),
        (
            &[("low", "hight")],
            &[("low", 0.0)],
            &["task.terms.low: `hight` is wrong at character 1", "`height`"],
        ),
        (&[("low", "height")], &[("low", f64::NAN)], &["`low` the weight NaN"]),
    ] {
        let message = refused(terms, rewards).to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
    let error = refused(&[("low", "tau")], &[("low", 1.0)]);
    assert!(matches!(&error, TaskError::Expression { term, .. } if term == "low"), "{error}");
    let scene = scene(&task(&[("low", "height")], &[("low", 0.0)]));
    let error = scene.with_term("low", 1.0, |_| 0.0).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("has a term `low` already"), "{error}");
}

#[test]
fn a_term_that_is_not_finite_stops_the_training_by_name() {
    let settings = task(&[("odd", "ln(height - 100)")], &[("torque", -1e-4), ("odd", 1.0)]);
    let scene = scene(&settings);
    let mut environment = Environment::new(&scene, None, 3, 0, 2).unwrap();
    let (paid, ended) = step(&mut environment, 0, 0.0);
    assert_eq!((paid, ended), (vec![0.0; 2], vec![Ended::Diverged; 2]));
    let learner = Training::fresh_learner(&scene, &ppo::Settings::default(), 1).unwrap();
    let size = TrainingSettings { environments: 4, steps: 3, iterations: 1 };
    let error = Training::new(&scene, None, &size, learner, 1).unwrap().iterate(1).unwrap_err();
    assert!(matches!(&error, TrainingError::Diverged { term: Some(term), .. } if term == "odd"), "{error}");
    assert!(error.to_string().contains("the reward term `odd`"), "{error}");
}

#[test]
fn the_documentation_lists_every_name() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/tasks.md");
    let text = std::fs::read_to_string(path).unwrap();
    for quantity in Quantity::ALL {
        assert!(text.contains(&format!("`{}`", quantity.name())), "{} is not documented", quantity.name());
    }
}

#[test]
fn quantities_of_what_a_robot_lacks_are_refused() {
    let wheels = Names { joints: vec!["wheel"], velocity_joints: vec![0], ..Names::default() };
    for text in ["sum(contact)", "sum(qpos)"] {
        let error = Expression::new(text, &wheels).unwrap_err();
        assert!(error.to_string().contains("they are none") && error.column == 5, "{error}");
    }
    Expression::new("height + sum(qvel) + qpos['wheel']", &wheels).unwrap();
}
