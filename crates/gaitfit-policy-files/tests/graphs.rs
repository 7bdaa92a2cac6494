//! Policies that are no plain perceptrons: fixtures of `tools/make_graph_fixtures.py`.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{along, fixture, largest_difference, rows};
use gaitfit_policy::network::Scratch;
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{Front, Policy};
use gaitfit_policy_files::{Description, deploy, files_of, onnx, read, weights};

/// All that there are, with words of what [`gaitfit_policy::Graph::describe`] says of them.
const GRAPHS: [(&str, &str); 11] = [
    ("operators", "inputs obs (45 numbers)"),
    ("him", "inputs obs_history (270 numbers)"),
    ("him_old", "inputs obs_history (270 numbers)"),
    ("dreamwaq", "inputs obs (45 numbers), obs_history (225 numbers)"),
    ("wtw", "inputs obs_history (180 numbers)"),
    ("rma", "inputs obs (45 numbers), obs_history (450 numbers)"),
    ("rma_old", "inputs obs (45 numbers), obs_history (450 numbers)"),
    ("moe", "inputs obs (45 numbers)"),
    ("estimator", "inputs obs (45 numbers), h_in (8 remembered)"),
    ("estimator_old", "inputs obs (45 numbers), h_in (8 remembered)"),
    ("bounds", "inputs obs (45 numbers)"),
];

fn graph(name: &str) -> Policy {
    read(&fixture(&format!("graphs/{name}.toml"))).unwrap()
}

#[test]
fn graphs_give_onnxruntimes_actions_for_any_number_of_robots() {
    for (name, words) in GRAPHS {
        let policy = graph(name);
        let Some(Front::Graph(front)) = &policy.front else { panic!("{name} is no graph") };
        assert!(front.describe().ends_with(words), "{}", front.describe());
        assert!(policy.notes[0].contains("run node by node"), "{:?}", policy.notes);
        assert!(policy.untrainable().unwrap().contains("graph"));
        assert_eq!(policy.is_recurrent(), name.starts_with("estimator"));
        let [observation, wanted] = rows(&format!("graphs/{name}_rows.json"));
        let alone = along(&policy, &observation, 1).concat();
        let difference = largest_difference(&alone, &wanted);
        assert!(difference < 5e-6, "{name}: {difference}");
        // More robots than pass through the steps together.
        for (together, alone) in along(&policy, &observation, 70).iter().zip(alone.chunks_exact(12)) {
            let difference = largest_difference(together, &alone.repeat(70));
            assert!(difference < 5e-6, "{name}: {difference}");
        }
    }
}

#[test]
fn a_graph_forgets_when_an_episode_begins() {
    let policy = graph("estimator");
    let [observation, _] = rows("graphs/estimator_rows.json");
    let (mut memory, mut scratch) = (policy.memory(2), Scratch::default());
    let first = observation[..45].repeat(2);
    let act = |memory: &mut _, scratch: &mut _| {
        let mut actions = vec![f32::NAN; 24];
        policy.act_with(2, &first, memory, &mut actions, scratch);
        actions
    };
    let fresh = act(&mut memory, &mut scratch);
    let second = act(&mut memory, &mut scratch);
    assert!(largest_difference(&fresh, &second) > 1e-3, "it remembers");
    memory.begin(1);
    let third = act(&mut memory, &mut scratch);
    assert_eq!(third[12..], fresh[12..]);
    assert!(largest_difference(&third[..12], &fresh[..12]) > 1e-3);
}

#[test]
fn a_file_of_this_program_holds_the_graph() {
    for (name, _) in GRAPHS {
        let policy = graph(name);
        let own = weights::read(&weights::write(&policy).unwrap()).unwrap();
        assert_eq!(Policy { notes: policy.notes.clone(), ..own }, policy, "{name}");
    }
    // Other files have no place for it.
    let policy = graph("him");
    for error in
        [onnx::write(&policy).err(), deploy::cxx(&policy, None).err(), deploy::bundle(&policy, None).err()]
    {
        let error = error.unwrap().to_string();
        assert!(error.contains("ONNX file"), "{error}");
    }
}

/// The error or the policy of a description changed from `from` to `to`.
fn changed(name: &str, from: &str, to: &str) -> Result<Policy, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(fixture(&format!("graphs/{name}.onnx")), folder.path().join(format!("{name}.onnx")))
        .unwrap();
    let text = std::fs::read_to_string(fixture(&format!("graphs/{name}.toml"))).unwrap();
    assert!(text.contains(from), "{from}");
    let path = folder.path().join(format!("{name}.toml"));
    std::fs::write(&path, text.replace(from, to)).unwrap();
    read(&path).map_err(|error| error.to_string())
}

#[test]
fn a_description_says_what_inputs_take_and_which_output_acts() {
    let named = "inputs = { obs = \"present\", obs_history = \"all\" }\nkp =";
    let policy = changed("dreamwaq", "kp =", named).unwrap();
    let [observation, wanted] = rows("graphs/dreamwaq_rows.json");
    assert!(largest_difference(&along(&policy, &observation, 1).concat(), &wanted) < 2e-6);
    assert!(!policy.notes.iter().any(|note| note.contains("widths")), "{:?}", policy.notes);
    // Guessed, it is said.
    assert!(graph("dreamwaq").notes[1].contains("obs = \"present\", obs_history = \"all\""));
    // Terms in another order than the observation has them.
    let turned = "inputs = { obs = [\"projected_gravity\", \"base_angular_velocity\", \"command\", \"joint_position\", \
                  \"joint_velocity\", \"last_action\"] }\nkp =";
    let policy = changed("dreamwaq", "kp =", turned).unwrap();
    let found = along(&policy, &observation, 1).concat();
    assert!(largest_difference(&found, &wanted) > 1e-3);
    let error = |name: &str, to: &str| changed(name, "kp =", &format!("{to}\nkp =")).unwrap_err();
    for (name, to, words) in [
        (
            "dreamwaq",
            "inputs = { obs = \"all\" }",
            "its input obs: it has the shape [1, 45], and takes 225 numbers",
        ),
        (
            "dreamwaq",
            "inputs = { seen = \"all\" }",
            "`inputs` names seen, and the graph's inputs are obs, obs_history",
        ),
        (
            "dreamwaq",
            "inputs = { obs = [\"gait_phase\"] }",
            "names gait_phase, which is not in `observation`",
        ),
        (
            "dreamwaq",
            "output = \"torques\"",
            "it has no output torques, which `output` names; it has actions",
        ),
        ("estimator", "output = \"velocity\"", "its output velocity gives 3 numbers"),
        (
            "estimator",
            "inputs = { h_in = \"all\" }",
            "its input h_in: it has the shape [1, 1, 8], and takes 45 numbers",
        ),
    ] {
        let found = error(name, to);
        assert!(found.contains(words), "`{words}` is not in `{found}`");
    }
    let found = changed("dreamwaq", "history = 5", "history = 4").unwrap_err();
    assert!(
        found.contains("its input obs_history takes 225 numbers")
            && found.contains("45 in its present frame"),
        "{found}"
    );
    let found = changed("him", "him.onnx\"", "him.onnx\"\nencoder = { file = \"him.onnx\" }").unwrap_err();
    assert!(found.contains("`encoder` is given"), "{found}");
}

#[test]
fn another_interface_of_a_written_graph_gives_its_inputs_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let policy = graph("dreamwaq");
    std::fs::write(folder.path().join("policy.safetensors"), weights::write(&policy).unwrap()).unwrap();
    let text = std::fs::read_to_string(fixture("graphs/dreamwaq.toml")).unwrap();
    let path = folder.path().join("policy.toml");
    let text = text
        .replace("dreamwaq.onnx", "policy.safetensors")
        .replace("order = \"frames\"", "order = \"newest_first\"");
    std::fs::write(&path, &text).unwrap();
    let turned = read(&path).unwrap();
    // The same frames, the newest first: the present one is found, the history is another one.
    let [observation, wanted] = rows("graphs/dreamwaq_rows.json");
    let newest: Vec<f32> = observation
        .chunks_exact(225)
        .flat_map(|row| row.chunks_exact(45).rev().flatten().copied().collect::<Vec<f32>>())
        .collect();
    let found = along(&turned, &newest, 1).concat();
    assert!(largest_difference(&found, &wanted) > 1e-3);
    let straight = text.replace("newest_first", "frames");
    std::fs::write(&path, straight).unwrap();
    assert!(largest_difference(&along(&read(&path).unwrap(), &observation, 1).concat(), &wanted) < 2e-6);
    assert_eq!(files_of(&path).unwrap().len(), 2);
}

#[test]
fn the_observation_of_walk_these_ways_is_described() {
    let page = std::fs::read_to_string(common::root().join("docs/policies-convert.md")).unwrap();
    let block = page.split("```toml").nth(1).unwrap().split("```").next().unwrap();
    let joints = r#"joints = ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k", "l"]"#;
    let rest = "file = \"policy.onnx\"\ndefault_pose = 0.0\naction_scale = 0.25\nkp = 20.0\nkd = 0.5\ncontrol_dt = 0.02\n";
    let parsed = |text: &str| Description::parse(&format!("{rest}{joints}\n{text}")).unwrap();
    let interface = parsed(block).interface().unwrap();
    assert_eq!(interface.observation_width(), 30 * 70);
    let layout = Layout::new(&interface, &interface.observation);
    let mut row = vec![f32::NAN; layout.width()];
    layout.write(&Sensed { clock: 0.25, ..Sensed::new(12) }, None, |_, _| (), &mut row);
    let frame = &row[29 * 70..];
    assert_eq!(frame[6..12], [0.0, 3.0, 0.5, 0.0, 0.0, 0.5]);
    assert_eq!(frame[66..], [-1.0, 1.0, 1.0, -1.0]);
    assert!(row[..29 * 70].iter().all(|&number| number == 0.0), "frames before the first are zeros");
    // Term after term, constants are the same in all frames, and sines are refused.
    let constants = "history = { order = \"terms\" }\nobservation = [{ quantity = \"constant\", scale = [1.0, 2.0], history = 3 }]";
    let interface = parsed(constants).interface().unwrap();
    assert_eq!(interface.scales(&interface.observation), [1.0, 2.0, 1.0, 2.0, 1.0, 2.0]);
    let error = parsed(&block.replace("order = \"frames\"", "order = \"terms\""))
        .interface()
        .unwrap_err()
        .to_string();
    assert!(error.contains("set history.order to"), "{error}");
}
