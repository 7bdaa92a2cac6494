//! Joints that a policy holds.

use super::*;
use gaitfit_policy::Held;

#[test]
fn held_joints_have_the_gains_with_which_the_policy_holds_them() {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let walk = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2-walk.safetensors");
    let mut policy = gaitfit_policy_files::read(&walk).unwrap();
    let interface = &mut policy.interface;
    let joint = interface.joints.pop().unwrap();
    interface.kp.pop();
    interface.kd.pop();
    interface.held.push(Held { joint: joint.clone(), position: -1.5, kp: 7.0, kd: 0.5 });
    let stated = fit::of_policy(&policy, &walk, &model).unwrap();
    assert!(stated.notes[0].contains(&format!("`{joint}` -1.5")), "{:?}", stated.notes);
    let weak =
        "format = 2\n[[parameter]]\nname = \"w\"\nkind = \"torque_scale\"\njoints = [\"*\"]\nvalue = 0.5\n";
    let file = ThetaFile::parse(weak).unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported =
        files_of(&file, &model, builtin::GO2, false, &candidate, Some(&stated.gains), STEP).unwrap();
    let again = read_mjcf_str(content(&exported, "robot.xml"), &ReadOptions::default()).unwrap();
    let place = again.find_joint(&joint).unwrap();
    let pd = again.actuators.iter().find(|actuator| actuator.joint == place).unwrap();
    assert_eq!((pd.gain, pd.bias[2]), (3.5, -0.25));
    let name = &model.joints[place].name;
    assert!(content(&exported, "isaac_lab.py").contains(&format!("\"{name}\": 3.5")));
    assert!(content(&exported, "mjlab_robot.py").contains(&format!("servo((\"{name}\", ), kp=3.5, kd=0.25")));
}
