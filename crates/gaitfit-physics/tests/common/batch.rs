//! Sets of values seen as flat lists, so that scalars of any kind can be filled, packed and compared.

use gaitfit_physics::{
    ActionDelta, JointModification, JointNetwork, Lanes, NetworkScales, Params, Real, ResidAct, State, Tree,
};

/// Every number of a state.
pub fn values<T: Real>(state: &State<T>) -> Vec<T> {
    let mut all = Vec::new();
    state.visit(|_, &number| all.push(number));
    all
}

/// The state with the numbers of [`values`].
pub fn state_of<T: Real>(tree: &Tree<T::K>, values: &[T]) -> State<T> {
    let mut state = State::<T>::new(tree);
    let mut next = values.iter();
    state.visit_mut(|_, number| *number = *next.next().unwrap());
    assert!(next.next().is_none());
    state
}

/// Every number of a parameter set.
pub fn param_values(params: &Params<f64>) -> Vec<f64> {
    let mut all = Vec::new();
    params.visit(|_, &number| all.push(number));
    all
}

/// One lane each of `columns` (as long as the others), packed number by number.
pub fn pack<T: Lanes>(columns: &[Vec<f64>]) -> Vec<T> {
    assert_eq!(columns.len(), T::LANES);
    (0..columns[0].len())
        .map(|i| T::load(&columns.iter().map(|column| column[i] as f32).collect::<Vec<_>>()))
        .collect()
}

/// Parameter sets, one a lane.
pub fn pack_params<T: Lanes>(sets: &[Params<f64>]) -> Params<T> {
    Params::in_lanes(&sets.iter().collect::<Vec<_>>())
}

/// Number `i` of lane `lane` at `[lane][i]`.
pub fn unpack<T: Lanes>(packed: &[T]) -> Vec<Vec<f32>> {
    let mut lanes = vec![Vec::with_capacity(packed.len()); T::LANES];
    let mut buffer = vec![0.0f32; T::LANES];
    for value in packed {
        value.store(&mut buffer);
        for (lane, x) in lanes.iter_mut().zip(&buffer) {
            lane.push(*x);
        }
    }
    lanes
}

/// What single precision makes of a number.
pub fn rounded(values: &[f64]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x as f32)).collect()
}

/// One ActionDelta and one ResidAct on all joints, with weights that matter.
pub fn networks<T: Real>(joints: usize) -> Vec<JointModification<T::K>> {
    let network = |joint: usize, output: f64| {
        let weights = std::array::from_fn(|i| 0.8 * (1.3 * i as f64 + 5.0 * joint as f64 + output).sin());
        let scales = NetworkScales { position: 1.0, velocity: 0.05, output };
        JointNetwork::new::<T>(joint, &weights, scales, 0.1)
    };
    vec![
        JointModification::ActionDelta(ActionDelta((0..joints).map(|joint| network(joint, 0.05)).collect())),
        JointModification::ResidAct(ResidAct((0..joints).map(|joint| network(joint, 2.0)).collect())),
    ]
}
