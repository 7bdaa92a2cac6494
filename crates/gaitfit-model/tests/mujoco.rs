//! The compiled model against MuJoCo 4.0.0's, number by number (fixtures by tools/make_model_fixtures.py).
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::{Path, PathBuf};

use gaitfit_model::{
    Cone, Ground, Integrator, Model, ModelError, ReadOptions, Root, Shape, read, read_mjcf_str,
};
use serde_json::Value;

const TOLERANCE: f64 = 1e-12;

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn fixture(name: &str) -> Value {
    let text = std::fs::read_to_string(here(&format!("tests/fixtures/{name}.json"))).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn strict(path: &str) -> Model {
    read(&here(path), &ReadOptions::default()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        Value::Bool(b) => vec![f64::from(u8::from(*b))],
        other => vec![other.as_f64().unwrap()],
    }
}

fn close(what: &str, got: &[f64], want: &Value) {
    let want = numbers(want);
    assert_eq!(got.len(), want.len(), "{what}");
    for (g, w) in got.iter().zip(&want) {
        assert!((g - w).abs() <= TOLERANCE * w.abs().max(1.0), "{what}: {got:?} is not {want:?}");
    }
}

/// Quaternions turn alike with either sign.
fn same_turn(what: &str, got: [f64; 4], want: &Value) {
    let want = numbers(want);
    let dot: f64 = got.iter().zip(&want).map(|(a, b)| a * b).sum();
    let signed = got.map(|x| x * dot.signum());
    close(what, &signed, &Value::from(want));
}

fn rotation(q: [f64; 4]) -> [[f64; 3]; 3] {
    let [w, x, y, z] = q;
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Principal axes are free up to order and sign; the tensor is not.
fn tensor(quat: [f64; 4], moments: [f64; 3]) -> Vec<f64> {
    let r = rotation(quat);
    (0..9).map(|i| (0..3).map(|k| r[i / 3][k] * moments[k] * r[i % 3][k]).sum()).collect()
}

fn array<const N: usize>(value: &Value) -> [f64; N] {
    numbers(value).try_into().unwrap()
}

/// Compares everything; `first` is MuJoCo's number of the model's first body.
fn compare(model: &Model, want: &Value, first: usize) {
    assert_eq!(model.nq(), want["nq"].as_u64().unwrap() as usize);
    assert_eq!(model.nv(), want["nv"].as_u64().unwrap() as usize);
    assert_eq!(model.nu(), want["nu"].as_u64().unwrap() as usize);
    compare_options(model, &want["option"]);
    let b = &want["body"];
    for (i, body) in model.bodies.iter().enumerate() {
        let k = first + i;
        assert_eq!(body.name, b["name"][k].as_str().unwrap());
        let parent = b["parent"][k].as_u64().unwrap() as usize;
        assert_eq!(body.parent.map_or(0, |p| p + first), parent, "parent of {}", body.name);
        close(&body.name, &body.pos, &b["pos"][k]);
        same_turn(&body.name, body.quat, &b["quat"][k]);
        close(&format!("mass of {}", body.name), &[body.mass], &b["mass"][k]);
        close(&format!("centre of {}", body.name), &body.ipos, &b["ipos"][k]);
        let reference = tensor(array(&b["iquat"][k]), array(&b["inertia"][k]));
        close(
            &format!("inertia of {}", body.name),
            &tensor(body.iquat, body.inertia),
            &Value::from(reference),
        );
    }
    compare_joints(model, &want["joint"], first);
    compare_contacts(model, want, first);
    compare_actuators(model, &want["actuator"]);
    for (i, key) in model.keyframes.iter().enumerate() {
        let k = &want["key"];
        let name = k["name"][i].as_str().unwrap();
        assert!(name.is_empty() || key.name == name);
        close("key qpos", &key.qpos, &k["qpos"][i]);
        close("key qvel", &key.qvel, &k["qvel"][i]);
        close("key ctrl", &key.ctrl, &k["ctrl"][i]);
    }
    assert_eq!(model.keyframes.len(), want["key"]["name"].as_array().unwrap().len());
    for (i, site) in model.sites.iter().enumerate() {
        let s = &want["site"];
        assert_eq!(site.name, s["name"][i].as_str().unwrap());
        assert_eq!(site.body + first, s["body"][i].as_u64().unwrap() as usize);
        close(&site.name, &site.pos, &s["pos"][i]);
        same_turn(&site.name, site.quat, &s["quat"][i]);
    }
    assert_eq!(model.sites.len(), want["site"]["name"].as_array().unwrap().len());
}

fn compare_options(model: &Model, want: &Value) {
    let o = &model.options;
    close("timestep", &[o.timestep], &want["timestep"]);
    close("gravity", &o.gravity, &want["gravity"]);
    close("impratio", &[o.impratio], &want["impratio"]);
    assert_eq!(o.cone == Cone::Elliptic, want["cone"].as_u64() == Some(1));
    assert_eq!(o.integrator == Integrator::ImplicitFast, want["integrator"].as_u64() == Some(3));
    assert_eq!(Some(u64::from(o.iterations)), want["iterations"].as_u64());
    assert_eq!(Some(u64::from(o.ls_iterations)), want["ls_iterations"].as_u64());
}

fn compare_joints(model: &Model, want: &Value, first: usize) {
    for (i, joint) in model.joints.iter().enumerate() {
        assert_eq!(joint.name, want["name"][i].as_str().unwrap());
        assert_eq!(joint.body + first, want["body"][i].as_u64().unwrap() as usize);
        let check =
            |name: &str, got: &[f64]| close(&format!("{name} of {}", joint.name), got, &want[name][i]);
        check("pos", &joint.pos);
        check("axis", &joint.axis);
        check("reference", &[joint.reference]);
        check("springref", &[joint.springref]);
        check("margin", &[joint.margin]);
        check("solref", &joint.solref_limit);
        check("solimp", &joint.solimp_limit);
        check("dof_solref", &joint.solref_friction);
        check("dof_solimp", &joint.solimp_friction);
        check("stiffness", &[joint.stiffness]);
        check("armature", &[joint.armature]);
        check("damping", &[joint.damping]);
        check("limited", &[f64::from(u8::from(joint.range.is_some()))]);
        if let Some(range) = joint.range {
            check("range", &range);
        }
        check("actfrclimited", &[f64::from(u8::from(joint.actuatorfrcrange.is_some()))]);
        if let Some(range) = joint.actuatorfrcrange {
            check("actfrcrange", &range);
        }
    }
}

fn compare_contacts(model: &Model, want: &Value, first: usize) {
    let g = &want["geom"];
    let number =
        |name: &str| g["name"].as_array().unwrap().iter().position(|n| n.as_str() == Some(name)).unwrap();
    for geom in &model.geoms {
        let k = number(&geom.name);
        assert_eq!(geom.body + first, g["body"][k].as_u64().unwrap() as usize);
        close(&geom.name, &geom.pos, &g["pos"][k]);
        same_turn(&geom.name, geom.quat, &g["quat"][k]);
        let (kind, size) = match geom.shape {
            Shape::Sphere { radius } => (2, vec![radius]),
            Shape::Capsule { radius, half_length } => (3, vec![radius, half_length]),
            Shape::Cylinder { radius, half_length } => (5, vec![radius, half_length]),
            Shape::Box { half_size } => (6, half_size.to_vec()),
        };
        assert_eq!(g["type"][k].as_u64(), Some(kind), "{}", geom.name);
        let sizes = Value::from(g["size"][k].as_array().unwrap()[..size.len()].to_vec());
        close(&format!("size of {}", geom.name), &size, &sizes);
    }
    // Every geom of MuJoCo's that can touch something is here, unless the robot does not own it.
    for (k, name) in g["name"].as_array().unwrap().iter().enumerate() {
        let touches = g["contype"][k].as_i64() != Some(0) || g["conaffinity"][k].as_i64() != Some(0);
        if touches && g["type"][k].as_u64() != Some(0) {
            assert!(model.geoms.iter().any(|m| Some(m.name.as_str()) == name.as_str()), "{name}");
        }
    }
    let p = &want["plane"];
    for plane in &model.planes {
        let k =
            p["geom"].as_array().unwrap().iter().position(|n| n.as_u64() == Some(number(&plane.name) as u64));
        let k = k.unwrap();
        close(&plane.name, &plane.pos, &p["pos"][k]);
        close(&plane.name, rotation(plane.quat).as_flattened(), &p["mat"][k]);
    }
    let contacts = want["contact"].as_array().unwrap();
    assert_eq!(model.pairs.len(), contacts.len());
    for (pair, contact) in model.pairs.iter().zip(contacts) {
        let Ground::Plane(plane) = pair.ground else { panic!("{:?}", pair.ground) };
        let (plane, geom) = (&model.planes[plane].name, &model.geoms[pair.geom].name);
        let got = [number(plane) as f64, number(geom) as f64];
        close(&format!("order of {plane}/{geom}"), &got, &contact["geom"]);
        let check =
            |name: &str, got: &[f64]| close(&format!("{name} of {plane}/{geom}"), got, &contact[name]);
        check("dim", &[f64::from(pair.condim)]);
        check("friction", &pair.friction);
        check("solref", &pair.solref);
        check("solreffriction", &pair.solreffriction);
        check("solimp", &pair.solimp);
        check("includemargin", &[pair.margin]);
    }
}

fn compare_actuators(model: &Model, want: &Value) {
    for (i, actuator) in model.actuators.iter().enumerate() {
        let name = want["name"][i].as_str().unwrap();
        assert!(name.is_empty() || actuator.name == name);
        assert_eq!(model.joints[actuator.joint].name, want["joint"][i].as_str().unwrap());
        let check =
            |field: &str, got: &[f64]| close(&format!("{field} of {}", actuator.name), got, &want[field][i]);
        check("gear", &[actuator.gear]);
        check("gain", &[actuator.gain]);
        let affine = want["biastype"][i].as_u64() == Some(1);
        let bias = if affine { array(&want["bias"][i]) } else { [0.0; 3] };
        close("bias", &actuator.bias, &Value::from(bias.to_vec()));
        check("forcelimited", &[f64::from(u8::from(actuator.forcerange.is_some()))]);
        if let Some(range) = actuator.forcerange {
            check("forcerange", &range);
        }
        if let Some(range) = actuator.ctrlrange {
            check("ctrllimited", &[1.0]);
            check("ctrlrange", &range);
        }
    }
}

/// Everything but the values that option flags change.
fn compare_frictionloss(model: &Model, want: &Value) {
    for (i, joint) in model.joints.iter().enumerate() {
        close("frictionloss", &[joint.frictionloss], &want["joint"]["frictionloss"][i]);
    }
    for (i, actuator) in model.actuators.iter().enumerate() {
        let limited = want["actuator"]["ctrllimited"][i].as_u64() == Some(1)
            || want["actuator"]["ctrllimited"][i].as_bool() == Some(true);
        assert_eq!(actuator.ctrlrange.is_some(), limited, "{}", actuator.name);
    }
}

#[test]
fn go2_is_what_mujoco_compiles() {
    let model = strict("../../assets/go2.xml");
    compare(&model, &fixture("go2"), 1);
    compare_frictionloss(&model, &fixture("go2"));
    assert_eq!(model.root, Root::Floating);
    assert!((model.total_mass() - 15.206408).abs() < 1e-12);
    let calf = model.find_joint("RR_calf").unwrap();
    assert_eq!(model.effort(calf), Some(45.43));
    assert_eq!(model.joints[calf].velocity_limit, Some(15.70));
    assert_eq!(model.effort(model.find_joint("RR_hip_joint").unwrap()), Some(23.7));
}

#[test]
fn biped_is_what_mujoco_compiles() {
    let model = strict("tests/robots/biped.xml");
    compare(&model, &fixture("biped"), 2);
    compare_frictionloss(&model, &fixture("biped"));
    assert!(!model.options.eulerdamp);
    assert!(model.dropped.iter().any(|d| d.what.contains("2 sensors")));
    assert!(model.dropped.iter().any(|d| d.what.contains("\"shell\"") && d.what.contains("visual")));
}

#[test]
fn humanoid_is_what_mujoco_compiles() {
    let model = strict("tests/robots/humanoid.xml");
    compare(&model, &fixture("humanoid"), 1);
    compare_frictionloss(&model, &fixture("humanoid"));
}

#[test]
fn arm_is_what_mujoco_compiles_with_its_flags_honoured() {
    let model = strict("tests/robots/arm.xml");
    compare(&model, &fixture("arm"), 1);
    assert_eq!(model.root, Root::Fixed);
    assert!(model.joints.iter().all(|j| j.frictionloss == 0.0), "flag frictionloss=disable");
    assert!(model.actuators.iter().all(|a| a.ctrlrange.is_none()), "flag clampctrl=disable");
    assert_eq!(model.name, "arm", "the file's stem names a model without a name");
}

/// MuJoCo 4.0.0: `actuator_gainprm` and `actuator_biasprm`.
#[test]
fn actuators_inherit_from_classes_as_in_mujoco() {
    let beside = r#"<default class="c"><position kp="5" kv="2"/><motor/></default>"#;
    let inside = r#"<position kp="5" kv="2"/><default class="c"><motor/></default>"#;
    let mixed = r#"<velocity kv="7"/><default class="c"><position kp="5" kv="2"/><motor/></default>"#;
    let general = r#"<general gainprm="3" biastype="affine" biasprm="1 2 -3"/><default class="c"/>"#;
    let after = r#"<velocity kv="5"/><default class="c"><general gainprm="6"/></default>"#;
    let affine = r#"general biastype="affine""#;
    // MuJoCo 4 writes servos so.
    let input = r#"general input="pos" gainprm="3" biastype="affine" biasprm="0 -3 -1""#;
    for (defaults, kind, gain, bias) in [
        (beside, affine, 1.0, [0.0; 3]),
        (beside, r#"position kp="7""#, 7.0, [0.0, -7.0, 0.0]),
        (beside, "velocity", 1.0, [0.0, 0.0, -1.0]),
        (inside, affine, 1.0, [0.0; 3]),
        (inside, "position", 5.0, [0.0, -5.0, -2.0]),
        (inside, "motor", 1.0, [0.0; 3]),
        (mixed, "position", 1.0, [0.0, -1.0, 0.0]),
        (mixed, "velocity", 7.0, [0.0, 0.0, -7.0]),
        (general, "position", 3.0, [0.0, -3.0, -3.0]),
        (after, "position", 6.0, [0.0, -6.0, -5.0]),
        (general, input, 3.0, [0.0, -3.0, -1.0]),
    ] {
        let text = format!(
            r#"<mujoco><default>{defaults}</default><worldbody><body><joint name="j"/><geom size=".1"/></body>
            </worldbody><actuator><{kind} joint="j" class="c"/></actuator></mujoco>"#
        );
        let actuator = &read_mjcf_str(&text, &ReadOptions::default()).unwrap().actuators[0];
        assert_eq!((actuator.gain, actuator.bias), (gain, bias), "{kind} below {defaults}");
    }
}

/// The reference robots of the shared data, when they are at hand.
#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn shared_reference_robots_are_read() {
    for name in ["go2_full", "go2_feet"] {
        let path = here(&format!("../../../shared/data/mujoco_ref/{name}.xml"));
        let (reference, own) =
            (read(&path, &ReadOptions::default()).unwrap(), strict("../../assets/go2.xml"));
        assert_eq!(reference.pairs.len(), if name == "go2_full" { 23 } else { 4 });
        for (a, b) in reference.bodies.iter().zip(&own.bodies) {
            assert_eq!(
                (a.mass, a.ipos, a.iquat, a.inertia),
                (b.mass, b.ipos, b.iquat, b.inertia),
                "{}",
                a.name
            );
            assert_eq!((&a.name, a.pos), (&b.name, b.pos));
        }
        for (a, b) in reference.joints.iter().zip(&own.joints) {
            assert_eq!((&a.name, a.axis, a.range), (&b.name, b.axis, b.range));
        }
        for (a, b) in reference.actuators.iter().zip(&own.actuators) {
            assert_eq!((&a.name, a.ctrlrange), (&b.name, b.ctrlrange));
        }
    }
}

#[test]
fn the_root_can_be_clamped_and_freed() {
    let fixed = ReadOptions { root: Some(Root::Fixed), ..Default::default() };
    let clamped = read(&here("../../assets/go2.xml"), &fixed).unwrap();
    assert_eq!((clamped.root, clamped.nq(), clamped.nv()), (Root::Fixed, 12, 12));
    assert_eq!(clamped.bodies[0].pos, [0.0, 0.0, 0.445]);
    let home = clamped.keyframe("home").unwrap();
    assert_eq!(home.qpos[..3], [0.1, 0.8, -1.5]);
    assert_eq!((home.qpos.len(), home.qvel.len()), (12, 12));
    // The base moves with the world now: its geoms touch nothing, the legs' still do.
    let trunk = clamped.geoms.iter().position(|g| g.name == "trunk").unwrap();
    assert!(clamped.pairs.iter().all(|p| p.geom != trunk));
    assert_eq!(clamped.pairs.len(), 20);

    let floating = ReadOptions { root: Some(Root::Floating), ..Default::default() };
    let text = r#"<mujoco><worldbody><body pos="0 0 2"><geom size=".1"/><body><joint/><geom size=".1"/></body>
        </body></worldbody><keyframe><key name="k" qpos="0.5"/></keyframe></mujoco>"#;
    let free = read_mjcf_str(text, &floating).unwrap();
    assert_eq!((free.root, free.nq()), (Root::Floating, 8));
    assert_eq!(free.keyframe("k").unwrap().qpos, [0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.5]);
    let arm = read(&here("tests/robots/arm.xml"), &floating);
    assert!(matches!(arm, Err(ModelError::Invalid { .. })), "an arm that turns on its base cannot float");
}
