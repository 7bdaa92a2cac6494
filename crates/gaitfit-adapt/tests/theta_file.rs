//! What a fit found, written, read back and applied: the same candidate, and bad files named.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::{
    Found, JointParameter, NetworkName, NetworkRule, ParameterRule, RobotNumber, RobotRule, Rules, Sharing,
    Theta, ThetaFile, ThetaFileError,
};
use gaitfit_model::{Model, ReadOptions, read_mjcf_str};
use gaitfit_sim::{Candidate, NetworkKind};

const ROBOT: &str = r#"<mujoco model="legs"><worldbody><body name="base">
    <geom type="sphere" size="0.1" mass="1"/>
    <body name="left"><joint name="left_hip_joint" axis="0 1 0"/>
      <geom type="sphere" size="0.1" pos="0 0 -0.2" mass="1"/></body>
    <body name="right"><joint name="right_hip_joint" axis="0 1 0"/>
      <geom type="sphere" size="0.1" pos="0 0 -0.2" mass="1"/></body>
  </body></worldbody></mujoco>"#;

fn model() -> Model {
    read_mjcf_str(ROBOT, &ReadOptions::default()).unwrap()
}

fn joints(model: &Model) -> Vec<String> {
    model.joints.iter().map(|joint| joint.name.clone()).collect()
}

fn theta(model: &Model) -> Theta {
    let joint = ParameterRule { per: Sharing::Joint, ..ParameterRule::new(JointParameter::FrictionLoss) };
    let rules = Rules {
        parameter: vec![joint],
        network: vec![
            NetworkRule { output_scale: 10.0, ..NetworkRule::new(NetworkName::ResidAct) },
            NetworkRule { joints: vec!["right_*".into()], ..NetworkRule::new(NetworkName::ActionDelta) },
        ],
        robot: vec![RobotRule::new(RobotNumber::TorqueNoise), RobotRule::new(RobotNumber::BaseMass)],
    };
    rules.theta(&[], &joints(model), &[0.3, -0.3]).unwrap()
}

fn values(theta: &Theta) -> Vec<f64> {
    (0..theta.len()).map(|index| (0.37 * index as f64).sin().abs()).collect()
}

fn file(model: &Model) -> ThetaFile {
    let theta = theta(model);
    let estimates: Vec<Found> =
        values(&theta).into_iter().map(|value| Found { value, spread: Some(0.01) }).collect();
    ThetaFile::new(&theta, &estimates, "legs", "wass", 0.25)
}

#[test]
fn what_is_written_gives_the_same_candidate() {
    let model = model();
    let theta = theta(&model);
    let mut direct = Candidate::nominal(&model);
    theta.apply(&values(&theta), &joints(&model), &mut direct);
    assert_eq!(direct.networks[1].kind, NetworkKind::ActionDelta);

    let file = file(&model);
    let text = file.to_toml().unwrap();
    let read = ThetaFile::parse(&text).unwrap();
    assert_eq!(read, file);
    assert_eq!(read.candidate(&model).unwrap(), direct);
    assert_eq!(text.matches("[[network]]").count(), 3, "{text}");
    assert!(text.contains("name = \"resid_act_left_hip\""), "{text}");
}

#[test]
fn an_unknown_key_and_an_edit_under_the_checksum_are_refused() {
    let model = model();
    let text = file(&model).to_toml().unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("checksum = ")).count(), 1, "{text}");
    let value = text.lines().find(|line| line.starts_with("value = ")).unwrap();
    let edited = text.replacen(value, "value = 0.125", 1);
    assert_ne!(edited, text);
    let error = ThetaFile::parse(&edited).unwrap_err();
    assert_eq!(error, ThetaFileError::Checksum);
    assert!(error.to_string().contains("delete the line that begins with `checksum`"), "{error}");
    // As the message says.
    let without: String =
        edited.lines().filter(|line| !line.starts_with("checksum")).flat_map(|line| [line, "\n"]).collect();
    let read = ThetaFile::parse(&without).unwrap();
    assert_eq!(read.parameter[0].value, 0.125);
    read.candidate(&model).unwrap();
    // Everything that the fit wrote counts, and nothing changes unseen: one bit of any character.
    let good = ThetaFile { network: Vec::new(), ..file(&model) };
    let numbers = good.to_toml().unwrap();
    let mut unseen = 0;
    for at in 0..numbers.len() {
        let mut bytes = numbers.clone().into_bytes();
        bytes[at] ^= 1 << (at % 7);
        let Ok(changed) = String::from_utf8(bytes) else { continue };
        match ThetaFile::parse(&changed) {
            Ok(read) => {
                assert_eq!(read, good, "byte {at}");
                unseen += 1;
            }
            Err(error) => assert!(error.to_string().len() < 900, "{error}"),
        }
    }
    // The comment above the checksum, and spaces at the ends of lines.
    assert!(unseen < 80, "{unseen}");
    for (key, unknown) in
        [("upper", "u0per"), ("robot", "robto"), ("weights", "wieghts"), ("position_scale", "scale")]
    {
        let changed = text.replacen(&format!("{key} = "), &format!("{unknown} = "), 1);
        let error = ThetaFile::parse(&changed).unwrap_err().to_string();
        assert!(error.contains("line ") && error.contains(&format!("unknown field `{unknown}`")), "{error}");
    }
    let text = "format = 2\n[[number]]\nname = \"soft\"\nkind = \"ground_softness\"\nvalue = 0.1\n";
    let error = ThetaFile::parse(text).unwrap_err().to_string();
    assert!(error.contains("[[parameter]] without `joints`"), "{error}");
    let long = format!("format = 2\nrobot = \"go2\"\n{} = 1\n", "a".repeat(90_000));
    let error = ThetaFile::parse(&long).unwrap_err().to_string();
    assert!(error.contains("line 3, column 1") && error.len() < 600, "{} bytes", error.len());
}

#[test]
fn files_without_networks_are_read_as_before() {
    let model = model();
    let text = "format = 1\nrobot = \"legs\"\ncost_name = \"matcho\"\ncost = 0.1\n\n[[parameter]]\nname = \
                \"delay\"\nkind = \"delay\"\njoints = [\"left_hip\", \"right_hip_joint\"]\nvalue = 0.01\nunit = \
                \"s\"\nlower = 0.0\nupper = 0.1\nat_bound = false\n";
    let candidate = ThetaFile::parse(text).unwrap().candidate(&model).unwrap();
    assert_eq!(candidate.robot.delay, [0.01, 0.01]);
}

#[test]
fn what_does_not_fit_is_named() {
    let model = model();
    let with = |change: &dyn Fn(&mut ThetaFile)| {
        let mut file = file(&model);
        change(&mut file);
        file.candidate(&model).unwrap_err()
    };
    let error = with(&|file| file.parameter[0].kind = "frictionlos".into());
    assert!(matches!(error, ThetaFileError::Kind { .. }), "{error}");
    let error = with(&|file| file.parameter[0].joints = vec!["knee".into()]);
    assert!(
        error.to_string().ends_with("no joint `knee`; it has left_hip_joint, right_hip_joint"),
        "{error}"
    );
    let error = with(&|file| {
        file.robot = "arms".into();
        file.parameter[0].joints = vec!["knee".into()];
    });
    assert!(error.to_string().contains("was fitted to `arms`: give one that was fitted to legs"), "{error}");
    let file = ThetaFile { robot: "arms".into(), ..self::file(&model) };
    assert!(file.robot_doubt(&model).unwrap().contains("`arms`, and this is `legs`"));
    assert_eq!(self::file(&model).robot_doubt(&model), None);
    let parameter = &self::file(&model).parameter[0];
    let (upper, wide) = (parameter.upper.unwrap(), parameter.upper.unwrap() - parameter.lower.unwrap());
    let rounded = ThetaFile { parameter: vec![parameter.clone()], network: Vec::new(), ..self::file(&model) };
    let at = |value: f64| {
        let mut file = rounded.clone();
        file.parameter[0].value = value;
        file.candidate(&model).map(|_| ())
    };
    at(upper + 1e-9 * wide).unwrap();
    assert!(at(upper + 0.01 * wide).unwrap_err().to_string().contains("`lower` 0 and `upper`"));
    let error = with(&|file| file.parameter[0].value = -1.0);
    assert!(matches!(error, ThetaFileError::Value { .. }), "{error}");
    let error = with(&|file| file.parameter[0].value = 1e30);
    assert!(error.to_string().contains("is 1e30; it must be a number from 0 to 1e6"), "{error}");
    let error = with(&|file| {
        (file.parameter[0].kind, file.parameter[0].value) = ("delay".into(), 100.0);
    });
    assert!(error.to_string().contains("is 100; it must be a number from 0 to 1"), "{error}");
    let error = with(&|file| file.parameter[0].upper = Some(f64::NAN));
    assert!(matches!(error, ThetaFileError::OutOfBounds { .. }), "{error}");
    let error = with(&|file| file.parameter[0].joints.clear());
    assert!(matches!(error, ThetaFileError::NoJoints { .. }), "{error}");
    let error = with(&|file| file.parameter.push(file.parameter[0].clone()));
    assert!(error.to_string().contains("second of its kind"), "{error}");
    let error = with(&|file| file.network[0].weights.truncate(96));
    assert!(matches!(error, ThetaFileError::Network { count: 96, .. }), "{error}");
    let error = with(&|file| file.network[0].weights[3] = f64::NAN);
    assert!(matches!(error, ThetaFileError::Network { .. }), "{error}");
    let error = with(&|file| file.network[1].joint = file.network[0].joint.clone());
    assert!(matches!(error, ThetaFileError::Twice { .. }), "{error}");
    assert_eq!(ThetaFile::parse("format = 3").unwrap_err(), ThetaFileError::Format(3));
    let error = ThetaFile::parse("format = 1\n[[parameter]]\nname = \"a\"\nkind = 3\n").unwrap_err();
    assert!(error.to_string().contains("line 4"), "{error}");
    let one = |kind: &str| format!("[[parameter]]\nname = \"a\"\nkind = \"{kind}\"\nvalue = 0.1\n");
    let twice = format!("format = 2\n{}{}", one("base_mass"), one("torque_noise"));
    let error = ThetaFile::parse(&twice).unwrap_err();
    assert!(error.to_string().contains("two parameters are called `a`"), "{error}");
}

#[test]
fn networks_at_another_physics_step_are_doubted() {
    let file = ThetaFile { physics_step: Some(0.005), ..file(&model()) };
    assert!(!file.network.is_empty());
    assert_eq!(file.step_doubt(0.005), None);
    let doubt = file.step_doubt(0.0025).unwrap();
    assert!(doubt.contains("0.005 s") && doubt.contains("0.0025 s"), "{doubt}");
    let numbers_only = ThetaFile { network: Vec::new(), ..file.clone() };
    assert_eq!(numbers_only.step_doubt(0.0025), None, "numbers mean the same at every step");
    let mut at_policy_rate = file.clone();
    at_policy_rate.network.retain(|network| network.kind == NetworkName::ActionDelta);
    assert!(!at_policy_rate.network.is_empty());
    assert_eq!(at_policy_rate.step_doubt(0.0025), None, "action_delta acts at the policy's rate");
    let before = ThetaFile { physics_step: None, ..file };
    assert_eq!(before.step_doubt(0.0025), None, "files of earlier versions do not say");
}

#[test]
fn values_that_do_nothing_or_cannot_be_are_doubted() {
    let file = |rows: &[(&str, f64)]| {
        let rows = rows.iter().map(|(kind, value)| {
            format!(
                "[[parameter]]\nname = \"{kind}\"\nkind = \"{kind}\"\njoints = [\"*\"]\nvalue = {value:?}\n"
            )
        });
        ThetaFile::parse(&format!("format = 2\n{}", rows.collect::<String>())).unwrap()
    };
    let whole =
        [("stall_torque", 30.0), ("no_load_speed", 20.0), ("encoder_bias", 0.02), ("link_com_y", -0.03)];
    assert!(file(&whole).value_doubts().is_empty());
    let doubts = file(&[("stall_torque", 30.0), ("stribeck_velocity", 0.1)]).value_doubts();
    assert!(doubts[0].contains("only together with no_load_speed"), "{doubts:?}");
    assert!(doubts[1].contains("only together with stiction") && doubts.len() == 2, "{doubts:?}");
    let doubts = file(&[("encoder_bias", 50.0), ("link_com_y", -100.0)]).value_doubts();
    assert!(doubts[0].contains("50 rad") && doubts[1].contains("-100 m") && doubts.len() == 2, "{doubts:?}");
}

/// A file written by hand says what is known of a robot's motors by pattern.
#[test]
fn joints_may_be_patterns() {
    let model = model();
    let text = |joints: &str| {
        format!(
            "format = 2\n[[parameter]]\nname = \"speed\"\nkind = \"no_load_speed\"\njoints = [{joints}]\nvalue = 30.0\n\
             [[parameter]]\nname = \"torque\"\nkind = \"stall_torque\"\njoints = [\"left_hip_joint\"]\nvalue = 25.0\n"
        )
    };
    let robot = |joints: &str| {
        ThetaFile::parse(&text(joints)).unwrap().candidate(&model).map(|candidate| candidate.robot)
    };
    let candidate = robot("\"*_hip\"").unwrap();
    assert_eq!(candidate.no_load_speed, [30.0, 30.0]);
    assert_eq!(candidate.stall_torque[0], 25.0);
    assert_eq!(robot("\"right*\"").unwrap().no_load_speed, [f64::INFINITY, 30.0]);
    // All that a pattern may have, names beside it, and patterns that overlap.
    let all = ["\"{left,right}_hip\"", "\"lef?_hip\", \"[r]ight_hip\"", "\"*\", \"left_hip\", \"*_hip*\""];
    assert!(all.iter().all(|joints| robot(joints).unwrap().no_load_speed == [30.0, 30.0]));
    assert!(matches!(robot("\"[\"").unwrap_err(), ThetaFileError::Pattern { .. }));
    assert!(matches!(robot("\"left_hip\", \"left_hip\"").unwrap_err(), ThetaFileError::Twice { .. }));
    let error = robot("\"*_knee\"").unwrap_err();
    assert!(matches!(error, ThetaFileError::Pattern { .. }), "{error}");
    assert!(error.to_string().contains("*_knee") && error.to_string().contains("speed"), "{error}");
    let twice = text("\"*_hip\"").replace("stall_torque", "no_load_speed");
    let error = ThetaFile::parse(&twice).unwrap().candidate(&model).unwrap_err();
    assert!(matches!(error, ThetaFileError::Twice { .. }), "{error}");
}
