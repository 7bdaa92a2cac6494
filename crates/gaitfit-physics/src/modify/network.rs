//! A small network of one joint's motion: what ActionDelta and ResidAct evaluate.

use crate::{Owner, Params, Real, Slot, State};

/// Inputs: angle and velocity of the joint, now and at the two samples before.
const INPUTS: usize = 6;
/// Units of the hidden layers (Dao and Fern; He et al. 2025).
const HIDDEN: [usize; 2] = [8, 4];
/// Weights of one network.
pub const NETWORK_WEIGHTS: usize = (INPUTS + 1) * HIDDEN[0] + (HIDDEN[0] + 1) * HIDDEN[1] + HIDDEN[1] + 1;
/// Samples that a network remembers, angle and velocity each.
pub(super) const PAST: usize = INPUTS - 2;

/// Units of a network's inputs and output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkScales {
    /// Factor on the joint's angle less its rest angle, 1/rad.
    pub position: f64,
    /// Factor on the joint's velocity, s/rad.
    pub velocity: f64,
    /// The unit of the output: rad or N·m.
    pub output: f64,
}

/// y = W₃ tanh(W₂ tanh(W₁ x + b₁) + b₂) + b₃ of one joint, with
/// x = (q − rest, q̇) now, a sample ago and two samples ago, newest first, times their scales. Angles are as the
/// encoder reports them.
#[derive(Clone, Debug, PartialEq)]
pub struct JointNetwork<K> {
    /// The joint.
    pub(super) joint: usize,
    weights: [K; NETWORK_WEIGHTS],
}

impl<K: Copy> JointNetwork<K> {
    /// A network of joint `joint`. `weights`: layer by layer, `inputs × outputs` row-major, then biases. `rest` in
    /// rad. The scales and the rest angle are folded into the weights.
    pub fn new<T: Real<K = K>>(
        joint: usize,
        weights: &[f64; NETWORK_WEIGHTS],
        scales: NetworkScales,
        rest: f64,
    ) -> Self {
        let mut folded = *weights;
        let width = HIDDEN[0];
        for input in 0..INPUTS {
            // Inputs alternate between angle and velocity.
            let position = input % 2 == 0;
            for unit in 0..width {
                let weight = &mut folded[input * width + unit];
                // scale · (q − rest) = scale · q − scale · rest: the second part is constant and goes into
                // the bias.
                *weight *= if position { scales.position } else { scales.velocity };
                if position {
                    folded[INPUTS * width + unit] -= rest * folded[input * width + unit];
                }
            }
        }
        // The last layer is linear, so its weights and bias carry the output's unit.
        for weight in &mut folded[NETWORK_WEIGHTS - HIDDEN[1] - 1..] {
            *weight *= scales.output;
        }
        Self { joint, weights: folded.map(T::constant) }
    }

    /// Calls `visit` with every weight as it is used, scales folded in.
    pub(super) fn visit_weights_mut(&mut self, name: &'static str, visit: &mut impl FnMut(Slot, &mut K)) {
        let first = Slot::new(Owner::Joint(self.joint), name);
        for (index, weight) in self.weights.iter_mut().enumerate() {
            visit(Slot { index, ..first }, weight);
        }
    }

    /// The weights of the three layers.
    #[inline(always)]
    fn layers(&self) -> [&[K]; 3] {
        let (first, rest) = self.weights.split_at((INPUTS + 1) * HIDDEN[0]);
        let (second, last) = rest.split_at((HIDDEN[0] + 1) * HIDDEN[1]);
        [first, second, last]
    }

    /// Both hidden layers and the output for the inputs x, unscaled.
    #[inline(always)]
    fn evaluate<T: Real<K = K>>(&self, x: &[T; INPUTS]) -> ([T; HIDDEN[0]], [T; HIDDEN[1]], T) {
        let [first, second, last] = self.layers();
        let a = layer(x, first).map(T::tanh);
        let b = layer(&a, second).map(T::tanh);
        let [y] = layer(&b, last);
        (a, b, y)
    }

    /// Output for the inputs x, unscaled (angle in rad and velocity in rad/s of the joint now, a call ago and two calls
    /// ago), N·m or rad, and its derivative by the joint's velocity now, x₁.
    #[inline(always)]
    pub fn evaluate_with_slope<T: Real<K = K>>(&self, x: &[T; INPUTS]) -> (T, T) {
        let [first, second, last] = self.layers();
        let (a, b, y) = self.evaluate(x);
        // The derivative of tanh is 1 − tanh².
        let slope = |tanh: T| tanh.fnma(tanh, T::lit(1.0));
        // The chain rule from the first layer on: only the input x₁ varies, whose weights are the matrix's
        // second row.
        let a: [T; HIDDEN[0]] = std::array::from_fn(|unit| slope(a[unit]) * T::k(first[HIDDEN[0] + unit]));
        let mut dy = T::zero();
        for unit in 0..HIDDEN[1] {
            let mut sum = T::zero();
            for input in 0..HIDDEN[0] {
                sum = a[input].fma(T::k(second[input * HIDDEN[1] + unit]), sum);
            }
            dy = (slope(b[unit]) * sum).fma(T::k(last[unit]), dy);
        }
        (y, dy)
    }

    /// Output for the joint's motion; afterwards the motion is part of the past.
    #[inline(always)]
    pub(super) fn advance<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>, past: &mut [T]) -> T {
        let x = self.inputs(params, state, past);
        // The sample now and the one before it stay; the oldest drops out.
        past.copy_from_slice(&x[..PAST]);
        self.evaluate(&x).2
    }

    /// As [`Self::advance`], with the output's derivative by the joint's velocity.
    #[inline(always)]
    pub(super) fn advance_with_slope<T: Real<K = K>>(
        &self,
        params: &Params<T>,
        state: &State<T>,
        past: &mut [T],
    ) -> (T, T) {
        let x = self.inputs(params, state, past);
        past.copy_from_slice(&x[..PAST]);
        self.evaluate_with_slope(&x)
    }

    /// A past in which the joint was where it is and as fast as it is.
    pub(super) fn settle<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>, past: &mut [T]) {
        let (q, qd) = self.motion(params, state);
        past.copy_from_slice(&[q, qd, q, qd]);
    }

    #[inline(always)]
    fn inputs<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>, past: &[T]) -> [T; INPUTS] {
        let (q, qd) = self.motion(params, state);
        [q, qd, past[0], past[1], past[2], past[3]]
    }

    #[inline(always)]
    fn motion<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>) -> (T, T) {
        (state.qpos[self.joint] + params.joints[self.joint].encoder_bias, state.qvel[self.joint])
    }
}

/// W x + b.
#[inline(always)]
fn layer<T: Real, const N: usize, const M: usize>(x: &[T; N], weights: &[T::K]) -> [T; M] {
    let (matrix, bias) = weights.split_at(N * M);
    let mut y = [T::zero(); M];
    for unit in 0..M {
        let mut sum = T::k(bias[unit]);
        for input in 0..N {
            sum = x[input].fma(T::k(matrix[input * M + unit]), sum);
        }
        y[unit] = sum;
    }
    y
}
