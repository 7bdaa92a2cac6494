//! Graphs that are not what is read here.

use super::constant::Constant;
use super::graph::{decode, walk};
use super::proto::{
    Attribute, DOUBLE, Dimension, FLOAT, Graph, INT64, Model, Node, Tensor, TensorShape, TensorType, Type,
    ValueInfo,
};
use super::write_memory::remember;
use super::write_network;
use gaitfit_policy::network::{Activation, Cell, Network, Recurrent, RecurrentShape, Scratch, Shape};
use prost::Message;

pub(super) fn node(operator: &str, inputs: &[&str], output: &str) -> Node {
    Node {
        input: inputs.iter().map(|&name| name.to_owned()).collect(),
        output: vec![output.to_owned()],
        name: format!("the_{output}"),
        op_type: operator.to_owned(),
        ..Node::default()
    }
}

pub(super) fn with(mut node: Node, attribute: Attribute) -> Node {
    node.attribute.push(attribute.encode_to_vec());
    node
}

pub(super) fn integer(name: &str, i: i64) -> Attribute {
    Attribute { name: name.into(), i, ..Attribute::default() }
}

pub(super) fn tensor(name: &str, dims: &[i64], values: &[f32]) -> Tensor {
    let (name, dims) = (name.to_owned(), dims.to_vec());
    Tensor { name, dims, data_type: FLOAT, float_data: values.to_vec(), ..Tensor::default() }
}

/// A 2 × 3 and a 3 × 1 matrix, and vectors.
pub(super) fn constants() -> Vec<Tensor> {
    vec![
        tensor("w", &[2, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        tensor("b", &[3], &[0.5, 0.0, -0.5]),
        tensor("v", &[3, 1], &[1.0, -1.0, 2.0]),
        tensor("two", &[], &[2.0]),
        tensor("one", &[1, 1], &[1.0]),
        tensor("pair", &[1, 2], &[1.0, 3.0]),
        tensor("column", &[2, 1], &[1.0, 2.0]),
    ]
}

fn value(name: &str) -> Vec<u8> {
    let dim = Dimension { dim_value: Some(2), dim_param: None }.encode_to_vec();
    let shape = Some(TensorShape { dim: vec![dim.clone(), dim] });
    let kind = Some(Type { tensor: Some(TensorType { elem_type: FLOAT, shape }) });
    ValueInfo { name: name.into(), kind }.encode_to_vec()
}

pub(super) fn model(nodes: &[Node], constants: &[Tensor]) -> Vec<u8> {
    let graph = Graph {
        node: nodes.iter().map(Message::encode_to_vec).collect(),
        name: "test".into(),
        initializer: constants.iter().map(Message::encode_to_vec).collect(),
        input: vec![value("x")],
        output: vec![value("y")],
    };
    Model { graph: Some(graph.encode_to_vec()), ..Model::default() }.encode_to_vec()
}

fn network(nodes: &[Node]) -> Result<Network, String> {
    let chain = decode(&model(nodes, &constants()), None).and_then(|model| walk(&model));
    chain.and_then(|chain| chain.read(None)).map(|read| read.network).map_err(|error| error.to_string())
}

fn output(nodes: &[Node], x: &[f32]) -> Vec<f32> {
    let network = network(nodes).unwrap();
    let mut y = vec![0.0; network.shape.outputs];
    network.forward(1, x, &mut y, &mut Scratch::new());
    y
}

#[test]
fn elementwise_operators_are_folded_into_layers() {
    // ((x − pair) / 2) w = [0.5, −1] w for x = (2, 1), w in rows of inputs.
    let before = [
        node("Sub", &["x", "pair"], "a"),
        node("Div", &["a", "two"], "b2"),
        node("MatMul", &["b2", "w"], "c"),
    ];
    let mut plain = before.to_vec();
    plain.push(node("Identity", &["c"], "y"));
    assert_eq!(output(&plain, &[2.0, 1.0]), [-3.5, -4.0, -4.5]);
    // 2 − 2 (c + b).
    let mut after = before.to_vec();
    after.push(node("Add", &["b", "c"], "d"));
    after.push(node("Mul", &["d", "two"], "e"));
    after.push(node("Sub", &["two", "e"], "y"));
    assert_eq!(output(&after, &[2.0, 1.0]), [8.0, 10.0, 12.0]);
}

#[test]
fn everything_else_is_refused_by_node_and_operator() {
    let matmul = node("MatMul", &["x", "w"], "h");
    let last = node("MatMul", &["a", "v"], "y");
    let relu = node("Relu", &["h"], "a");
    let cases: Vec<(Vec<Node>, &str)> = vec![
        (vec![node("Conv", &["x", "w"], "y")], "node the_y (Conv): it is not understood"),
        (vec![matmul.clone(), node("Softmax", &["h"], "y")], "node the_y (Softmax)"),
        (vec![node("Relu", &["x"], "y")], "it stands before the first layer"),
        (vec![matmul.clone(), node("MatMul", &["h", "v"], "y")], "without an activation between"),
        (
            vec![matmul.clone(), relu.clone(), node("Mul", &["a", "two"], "b2"), last.clone()],
            "it stands behind an activation",
        ),
        (
            vec![matmul.clone(), relu.clone(), node("Add", &["a", "h"], "y")],
            "it takes `h`, which is not what",
        ),
        (vec![matmul.clone(), node("Add", &["h", "h"], "y")], "it needs a constant beside"),
        (
            vec![matmul.clone(), node("Add", &["h", "pair"], "y")],
            "has 2 numbers, the layer before it gives 3",
        ),
        (vec![node("Add", &["x", "column"], "y")], "does not act alike on every row"),
        (vec![node("MatMul", &["x", "b"], "y")], "a matrix is needed"),
        (vec![node("MatMul", &["w", "x"], "y")], "node the_y (MatMul): it is not understood"),
        (vec![matmul.clone(), relu.clone(), node("MatMul", &["a", "w"], "y")], "it takes 2 numbers"),
        (vec![with(node("Gemm", &["x", "w"], "y"), integer("transA", 1))], "transA"),
        (
            vec![with(matmul.clone(), integer("n", 0)), relu.clone()],
            "its output y is not what the last layer",
        ),
        (vec![node("MatMul", &["x", "w"], "x")], "a name that is taken"),
        (vec![node("Identity", &["x"], "y")], "its graph has no layers"),
        (vec![with(node("Flatten", &["x"], "y"), integer("axis", 0))], "(Flatten)"),
        (vec![node("Reshape", &["x", "b"], "y")], "it reshapes rows"),
        (vec![node("Div", &["two", "x"], "y")], "it divides by what the layers give"),
        (vec![node("Tan", &["w"], "t")], "it computes a constant"),
        (vec![Node { domain: "com.example".into(), ..matmul.clone() }], "operator set `com.example`"),
        (
            vec![
                matmul.clone(),
                relu,
                node("MatMul", &["a", "v"], "h2"),
                node("Tanh", &["h2"], "a2"),
                node("MatMul", &["a2", "one"], "y"),
            ],
            "the layer before it has tanh, others relu",
        ),
        (
            vec![
                matmul.clone(),
                with(
                    node("Elu", &["h"], "a"),
                    Attribute { name: "alpha".into(), f: -0.5, ..Attribute::default() },
                ),
                last,
            ],
            "its parameter is out of range (elu(-0.5))",
        ),
        (vec![matmul.clone(), node("LayerNormalization", &["h", "pair"], "y")], "its weights are not 3"),
        (vec![node("LayerNormalization", &["x", "pair"], "y")], "it does not follow a layer"),
        (
            vec![matmul, node("LayerNormalization", &["h", "b"], "y")],
            "a layer norm stands behind its last layer",
        ),
    ];
    for (nodes, message) in cases {
        let found = network(&nodes).unwrap_err();
        assert!(found.contains(message), "`{message}` is not in `{found}`");
    }
}

#[test]
fn tensors_that_lie_about_their_size_are_refused() {
    let good = tensor("w", &[2, 3], &[0.0; 6]);
    let cases = [
        (Tensor { dims: vec![i64::MAX, i64::MAX], ..good.clone() }, "impossible shape"),
        (Tensor { dims: vec![-2, 3], ..good.clone() }, "impossible shape"),
        (Tensor { dims: vec![2, 4], ..good.clone() }, "so 8 numbers, but the file holds 6"),
        (Tensor { raw_data: vec![0; 25], float_data: vec![], ..good.clone() }, "6 and a torn one"),
        (Tensor { data_type: 10, ..good.clone() }, "ONNX data type 10"),
        (Tensor { data_type: INT64, ..good.clone() }, "the file holds 0"),
        (Tensor { data_type: DOUBLE, ..good.clone() }, "the file holds 0"),
        (Tensor { data_location: 1, ..good }, "lie in another file"),
    ];
    for (tensor, message) in cases {
        let found = decode(&model(&[], &[tensor]), None).map(|_| ()).unwrap_err().to_string();
        assert!(found.contains(message) && found.contains("tensor w"), "`{message}` is not in `{found}`");
    }
}

#[test]
fn double_precision_is_rounded() {
    let double =
        Tensor { data_type: DOUBLE, float_data: vec![], double_data: vec![0.1; 6], ..constants()[0].clone() };
    let bytes = model(&[node("MatMul", &["x", "w"], "y")], &[double]);
    let network = walk(&decode(&bytes, None).unwrap()).unwrap().read(None).unwrap().network;
    assert_eq!(network.parameters[..6], [0.1_f32; 6]);
}

/// As [`network`], with an input of this shape.
fn shaped(nodes: &[Node], dims: &[i64]) -> Result<Network, String> {
    let mut decoded = decode(&model(nodes, &constants()), None).unwrap();
    let length = |&length: &i64| Dimension { dim_value: Some(length), dim_param: None }.encode_to_vec();
    let shape = Some(TensorShape { dim: dims.iter().map(length).collect() });
    let kind = Some(Type { tensor: Some(TensorType { elem_type: FLOAT, shape }) });
    decoded.inputs = vec![ValueInfo { name: "x".into(), kind }];
    let chain = walk(&decoded).and_then(|chain| chain.read(None));
    chain.map(|read| read.network).map_err(|error| error.to_string())
}

#[test]
fn a_layer_norm_is_over_the_last_axis() {
    let layer = node("MatMul", &["x", "w"], "h");
    let rest = [node("Relu", &["n"], "a"), node("MatMul", &["a", "v"], "y")];
    let formula = |axis: i64| {
        let axes = Attribute { name: "axes".into(), ints: vec![axis], ..Attribute::default() };
        let mean = |from: &str, to: &str| with(node("ReduceMean", &[from], to), axes.clone());
        let norm = [
            layer.clone(),
            mean("h", "mean"),
            node("Sub", &["h", "mean"], "d"),
            node("Mul", &["d", "d"], "square"),
            mean("square", "variance"),
            node("Add", &["variance", "two"], "sum"),
            node("Sqrt", &["sum"], "root"),
            node("Div", &["d", "root"], "n"),
        ];
        [&norm[..], &rest].concat()
    };
    let operator = |axis: i64| {
        let norm = with(node("LayerNormalization", &["h", "b"], "n"), integer("axis", axis));
        [&[layer.clone(), norm][..], &rest].concat()
    };
    for (axis, dims, last) in [
        (1, &[1, 2][..], true),
        (-1, &[1, 2], true),
        (0, &[1, 2], false),
        (1, &[1, 1, 2], false),
        (2, &[1, 1, 2], true),
        (-1, &[1, 1, 2], true),
    ] {
        for nodes in [formula(axis), operator(axis)] {
            let found = shaped(&nodes, dims);
            assert_eq!(found.is_ok(), last, "{axis} of {dims:?}: {found:?}");
        }
    }
}

#[test]
fn several_rows_of_a_robot_are_no_row() {
    let flat = |dims: &[i64]| {
        shaped(&[node("Flatten", &["x"], "f"), node("MatMul", &["f", "w"], "y")], dims)
            .map(|network| network.shape.inputs)
    };
    assert_eq!((flat(&[1, 2, 1]), flat(&[1, 1, 2])), (Ok(2), Ok(2)));
    let found = shaped(&[node("MatMul", &["x", "w"], "y")], &[1, 5, 2]).unwrap_err();
    assert!(found.contains("node the_y (MatMul): it works on several rows"), "{found}");
    assert!(shaped(&[node("MatMul", &["x", "w"], "y")], &[1, 1, 2]).is_ok());
    // Axis 1 is not that of the numbers here.
    let cut = |axis: i64| {
        let halves = Attribute { name: "split".into(), ints: vec![1, 2], ..Attribute::default() };
        let split = with(with(node("Split", &["h"], "y"), halves), integer("axis", axis));
        let split = Node { output: vec!["y".into(), "z".into()], ..split };
        shaped(&[node("MatMul", &["x", "w"], "h"), split], &[1, 1, 2]).map(|network| network.shape.outputs)
    };
    assert_eq!(cut(2), Ok(1));
    assert!(cut(1).unwrap_err().contains("it cuts between rows"));
}

#[test]
fn layers_take_their_own_states_also_if_these_are_counted_from_the_end() {
    let shape = RecurrentShape { cell: Cell::Gru, inputs: 2, hidden: vec![3, 3] };
    let memory = Recurrent::random(&shape, 1, 0);
    let walked = |starts: [f64; 2]| {
        let (mut nodes, mut parts) = (Vec::new(), Vec::new());
        let head = remember(&mut nodes, &mut parts, &memory, "x".to_owned());
        nodes.push(node("MatMul", &[&head, "v"], "y"));
        let mut decoded = decode(&model(&nodes, &constants()), None).unwrap();
        for bytes in &parts {
            let tensor = Tensor::decode(bytes.as_slice()).unwrap();
            decoded.constants.insert(tensor.name.clone(), Constant::read(tensor).unwrap());
        }
        for (place, start) in starts.into_iter().enumerate() {
            decoded.constants.insert(format!("memory.place_{place}"), Constant::wholes(vec![start]));
        }
        decoded.inputs.push(ValueInfo { name: "h_in".into(), kind: None });
        walk(&decoded).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!([walked([0.0, 1.0]), walked([-2.0, -1.0]), walked([0.0, -1.0])], [Ok(()), Ok(()), Ok(())]);
    for swapped in [[1.0, 0.0], [-1.0, -2.0], [-1.0, 0.0], [-3.0, 1.0]] {
        assert!(walked(swapped).unwrap_err().contains("another layer's state"), "{swapped:?}");
    }
}

#[test]
fn a_network_alone_comes_back() {
    let shape = Shape { inputs: 6, hidden: vec![8, 4], outputs: 1, activation: Activation::Tanh };
    let network = Network::random(shape, 3, 0, 1.0).unwrap();
    let scale: Vec<(f32, f32)> = (0..6).map(|i| (0.5 + 0.1 * i as f32, 0.2 - 0.3 * i as f32)).collect();
    let bytes = write_network("resid", &network, &scale).unwrap();
    let back = walk(&decode(&bytes, None).unwrap()).unwrap().read(None).unwrap().network;
    let input: Vec<f32> = (0..6 * 20).map(|i| (0.37 * i as f32).sin()).collect();
    let scaled: Vec<f32> =
        input.iter().enumerate().map(|(i, x)| x * scale[i % 6].0 + scale[i % 6].1).collect();
    let (mut found, mut want) = (vec![0.0; 20], vec![0.0; 20]);
    back.forward(20, &input, &mut found, &mut Scratch::new());
    network.forward(20, &scaled, &mut want, &mut Scratch::new());
    assert!(found.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {want:?}");
    assert!(want.iter().any(|y| y.abs() > 0.1));
    assert!(write_network("resid", &network, &scale[1..]).is_err());
}

#[test]
fn constants_cannot_multiply_without_end() {
    // Each node copies a million numbers; a thousand of them would fill the memory.
    let big = tensor("big", &[1 << 20], &vec![1.0; 1 << 20]);
    let mut nodes = vec![node("Add", &["big", "big"], "c0")];
    for index in 1..1000 {
        nodes.push(node("Identity", &[&format!("c{}", index - 1)], &format!("c{index}")));
    }
    let found = decode(&model(&nodes, &[big]), None)
        .and_then(|model| walk(&model))
        .map(|_| ())
        .unwrap_err()
        .to_string();
    assert!(found.contains("constants have more than"), "{found}");
    let many = vec![node("Identity", &["x"], "y"); 2000];
    let found = decode(&model(&many, &[]), None).map(|_| ()).unwrap_err().to_string();
    assert!(found.contains("it has 2000 nodes"), "{found}");
}
