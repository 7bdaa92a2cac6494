//! Graphs that are refused, and graphs by hand.

use super::super::graph::decode;
use super::super::proto::{Attribute, Node};
use super::super::tests::{constants, integer, model, node, tensor, with};
use super::compile;
use gaitfit_policy::Inputs;
use gaitfit_policy::network::Scratch;
use gaitfit_policy::{Graph, Interface, Quantity, Term};

/// Two numbers are observed, three joints moved.
fn interface() -> Interface {
    Interface {
        robot: String::new(),
        joints: ["a", "b", "c"].map(str::to_owned).to_vec(),
        default_pose: vec![0.0; 3],
        action_scale: vec![0.5; 3],
        action_clip: None,
        kp: vec![20.0; 3],
        kd: vec![0.5; 3],
        velocity_joints: Vec::new(),
        held: Vec::new(),
        control_dt: 0.02,
        gait_frequency: Some(1.0),
        reference: None,
        history: Default::default(),
        observation: vec![Term::new(Quantity::GaitPhase)],
        critic_observation: Vec::new(),
    }
}

/// Of nodes on `x`, whose two rows are taken as one robot's.
fn graph(nodes: &[Node]) -> Result<Graph, String> {
    let model = decode(&model(nodes, &constants()), None).unwrap();
    let (one, both) = (Inputs::new(), interface());
    compile(&model, &both, &one, None, Vec::new()).map(|(graph, _)| graph).map_err(|error| error.to_string())
}

/// As [`graph`], `x` a row.
fn row(nodes: &[Node]) -> Result<Graph, String> {
    let mut bytes = decode(&model(nodes, &constants()), None).unwrap();
    bytes.inputs[0].kind = None;
    compile(&bytes, &interface(), &Inputs::new(), None, Vec::new())
        .map(|(graph, _)| graph)
        .map_err(|error| error.to_string())
}

fn act(nodes: &[Node], x: &[f32]) -> Vec<f32> {
    let graph = row(nodes).unwrap();
    let mut actions = Vec::new();
    graph.act(x.len() / 2, x, &mut graph.memory(x.len() / 2), &mut actions, &mut Scratch::new());
    actions
}

#[test]
fn a_value_is_used_twice() {
    // y = x w; actions = y + max(y, 2) + b.
    let nodes = [
        node("MatMul", &["x", "w"], "h"),
        node("Max", &["h", "two"], "m"),
        node("Add", &["h", "m"], "s"),
        node("Add", &["b", "s"], "y"),
    ];
    // x = (1, 0): h = (1, 2, 3); x = (0, −1): h = (−4, −5, −6).
    assert_eq!(act(&nodes, &[1.0, 0.0, 0.0, -1.0]), [3.5, 4.0, 5.5, -1.5, -3.0, -4.5]);
}

#[test]
fn whole_numbers_are_divided_and_cast_towards_zero() {
    let of = |number: Attribute, name: &str| with(node("Constant", &[], name), number);
    let float = |f: f32| Attribute { name: "value_float".into(), f, ..Attribute::default() };
    let cast = |from: &str, to: i64, name: &str| with(node("Cast", &[from], name), integer("to", to));
    // −7 / 2 is −3, and −2.7 is −2: the actions are x w times their sum, −5.
    let nodes = [
        of(integer("value_int", -7), "seven"),
        of(integer("value_int", 2), "by"),
        node("Div", &["seven", "by"], "three"),
        of(float(-2.7), "long"),
        cast("long", 7, "short"),
        node("Add", &["three", "short"], "sum"),
        cast("sum", 1, "factor"),
        node("MatMul", &["x", "w"], "h"),
        node("Mul", &["h", "factor"], "y"),
    ];
    assert_eq!(act(&nodes, &[1.0, 0.0]), [-5.0, -10.0, -15.0]);
    // Numbers with fractions keep them.
    let halves = [
        of(float(7.0), "seven"),
        node("Div", &["seven", "two"], "factor"),
        node("MatMul", &["x", "w"], "h"),
        node("Mul", &["h", "factor"], "y"),
    ];
    assert_eq!(act(&halves, &[1.0, 0.0]), [3.5, 7.0, 10.5]);
}

#[test]
fn parts_of_whole_numbers_are_divided_as_such() {
    let both = Attribute { name: "value_ints".into(), ints: vec![7, 2], ..Attribute::default() };
    let split = Node {
        output: vec!["seven".into(), "by".into()],
        ..with(node("Split", &["both"], "seven"), integer("axis", 0))
    };
    // 7 / 2 is 3.
    let nodes = [
        with(node("Constant", &[], "both"), both),
        split,
        node("Div", &["seven", "by"], "three"),
        node("MatMul", &["x", "w"], "h"),
        node("Mul", &["h", "three"], "y"),
    ];
    assert_eq!(act(&nodes, &[1.0, 0.0]), [3.0, 6.0, 9.0]);
}

#[test]
fn a_dead_branch_may_hold_anything() {
    let nodes = [node("NonZero", &["x"], "unused"), node("MatMul", &["x", "w"], "y")];
    assert_eq!(act(&nodes, &[1.0, 1.0]), [5.0, 7.0, 9.0]);
}

#[test]
fn graphs_that_do_not_fit_are_refused_by_node() {
    let matmul = node("MatMul", &["x", "w"], "h");
    let listed = |name: &str, ints: &[i64]| Attribute {
        name: name.into(),
        ints: ints.to_vec(),
        ..Attribute::default()
    };
    let expand = |count: i64| {
        let shape = Attribute {
            name: "value".into(),
            t: Some(tensor("shape", &[2], &[count as f32, 3.0])),
            ..Attribute::default()
        };
        vec![
            with(node("Constant", &[], "shape"), shape),
            matmul.clone(),
            node("Expand", &["h", "shape"], "y"),
        ]
    };
    let cases: Vec<(Vec<Node>, &str)> = vec![
        (vec![matmul.clone(), node("Tan", &["h"], "y")], "node the_y (Tan): it is not run here"),
        (vec![node("MatMul", &["nothing", "w"], "h"), node("Add", &["h", "x"], "y")], "it takes `nothing`"),
        (
            vec![matmul.clone(), node("Add", &["h", "x"], "y")],
            "[[1, 3], [1, 2]], which do not fit each other",
        ),
        (vec![node("MatMul", &["x", "v"], "y")], "the shapes [1, 2] and [3, 1]"),
        (
            vec![matmul.clone(), node("Relu", &["h"], "h"), node("Identity", &["h"], "y")],
            "a name that is taken",
        ),
        (vec![node("Relu", &["x"], "y")], "joints names 3 joints, its output y gives 2 numbers [1, 2]"),
        (vec![node("Identity", &["w"], "y")], "its output y does not depend on the observation"),
        (
            vec![Node { domain: "com.example".into(), ..node("Relu", &["x"], "y") }],
            "operator set `com.example`",
        ),
        (
            vec![matmul.clone(), with(node("ReduceSum", &["h"], "y"), listed("axes", &[2]))],
            "it names axis 2 of [1, 3]",
        ),
        (vec![matmul.clone(), with(node("Softmax", &["h"], "y"), integer("axis", -3))], "names axis -3"),
        (
            vec![matmul.clone(), with(node("Split", &["h"], "y"), listed("split", &[1, 3]))],
            "its parts [1, 3]",
        ),
        (vec![matmul.clone(), node("Reshape", &["h", "v"], "y")], "does not fit its input of shape [1, 3]"),
        (vec![matmul.clone(), node("Reshape", &["h", "x"], "y")], "where it cuts depends on the observation"),
        (vec![matmul.clone(), with(node("Cast", &["h"], "y"), integer("to", 7))], "whole numbers of values"),
        (
            vec![
                matmul.clone(),
                with(
                    node("Elu", &["h"], "y"),
                    Attribute { name: "alpha".into(), f: -1.0, ..Attribute::default() },
                ),
            ],
            "out of range",
        ),
        (vec![node("Conv", &["x", "w"], "y")], "its input has the shape [1, 2], its weight [2, 3]"),
        (vec![node("Gemm", &["w", "x"], "y")], "its weight is not a constant"),
        (vec![node("BatchNormalization", &["x", "w", "w", "w", "w"], "y")], "not constants of its channels"),
        (vec![node("LSTM", &["x", "w", "w"], "y")], "[1, gates, inputs]"),
        (vec![with(node("LpNormalization", &["x"], "y"), integer("p", 3))], "its p is 3"),
        (expand(100_000), "more than 262144"),
        (expand(0), "shape [0, 3]"),
    ];
    for (nodes, message) in cases {
        let found = row(&nodes).unwrap_err();
        assert!(found.contains(message), "`{message}` is not in `{found}`");
    }
}

#[test]
fn a_graph_of_several_robots_is_not_of_one() {
    let found = graph(&[node("MatMul", &["x", "w"], "y")]).unwrap_err();
    assert!(found.contains("its input x: it has the shape [2, 2], and takes 2 numbers"), "{found}");
}

#[test]
fn values_and_products_cannot_grow_without_end() {
    // Each node doubles the numbers of the one before it.
    let mut nodes = vec![node("MatMul", &["x", "w"], "c0")];
    for index in 1..40 {
        let before = format!("c{}", index - 1);
        nodes.push(node("Concat", &[&before, &before], &format!("c{index}")));
    }
    nodes.push(node("Identity", &["c39"], "y"));
    let found = row(&nodes).unwrap_err();
    assert!(found.contains("too many numbers") || found.contains("more than 262144"), "{found}");
    // Outer products of a long row with itself.
    let mut nodes = vec![
        node("MatMul", &["x", "long"], "a"),
        node("Transpose", &["a"], "b"),
        node("MatMul", &["b", "a"], "c"),
    ];
    nodes.extend(
        (0..3).map(|index| node("MatMul", &["c", if index == 0 { "c" } else { "d0" }], &format!("d{index}"))),
    );
    nodes.push(node("MatMul", &["d2", "b"], "y"));
    let long = tensor("long", &[2, 500], &[0.1; 1000]);
    let mut decoded = decode(&model(&nodes, &[long]), None).unwrap();
    decoded.inputs[0].kind = None;
    let found = compile(&decoded, &interface(), &Inputs::new(), None, Vec::new()).unwrap_err().to_string();
    assert!(found.contains("more than"), "{found}");
}
