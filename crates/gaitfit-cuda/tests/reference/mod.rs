//! The loss's gradient over all samples in `f64`, by plain loops.

use gaitfit_learn::ppo::{Learner, Samples};
use gaitfit_policy::network::{Activation, Network, Normaliser};

/// The error function by its series.
fn erf(x: f64) -> f64 {
    let (mut term, mut sum) = (x, x);
    for n in 1..200 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * std::f64::consts::FRAC_2_SQRT_PI
}

/// A function and its derivative.
fn function(activation: Activation, x: f64) -> [f64; 2] {
    match activation {
        Activation::Elu if x > 0.0 => [x, 1.0],
        Activation::Elu => [x.exp_m1(), x.exp()],
        Activation::Relu => [x.max(0.0), if x > 0.0 { 1.0 } else { 0.0 }],
        Activation::Tanh => [x.tanh(), 1.0 - x.tanh().powi(2)],
        Activation::Silu => {
            let share = 1.0 / (1.0 + (-x).exp());
            [x * share, share + x * share * (1.0 - share)]
        }
        Activation::Gelu => {
            let share = 0.5 * (1.0 + erf(x * std::f64::consts::FRAC_1_SQRT_2));
            [x * share, share + x * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()]
        }
        other => panic!("{other}"),
    }
}

/// One row through a network: the outputs of all layers, the input first; and the derivatives of the layers' functions.
fn forward(network: &Network, input: Vec<f64>) -> [Vec<Vec<f64>>; 2] {
    let layers = network.shape.layers();
    let (mut all, mut slopes) = (vec![input], Vec::new());
    for (index, layer) in layers.iter().enumerate() {
        let x = &all[index];
        let weight = &network.parameters[layer.weight.clone()];
        let mut y: Vec<f64> = network.parameters[layer.bias.clone()].iter().map(|&b| f64::from(b)).collect();
        for (x, row) in x.iter().zip(weight.chunks_exact(layer.outputs)) {
            y.iter_mut().zip(row).for_each(|(y, &w)| *y += x * f64::from(w));
        }
        let hidden = index + 1 < layers.len();
        let activation = if hidden { Some(network.shape.activation) } else { network.output };
        let of = |&y: &f64| activation.map_or([y, 1.0], |activation| function(activation, y));
        slopes.push(y.iter().map(|y| of(y)[1]).collect());
        all.push(y.iter().map(|y| of(y)[0]).collect());
    }
    [all, slopes]
}

/// Adds one row's derivatives by the parameters, from those by the output.
fn backward(network: &Network, [all, slopes]: &[Vec<Vec<f64>>; 2], output: Vec<f64>, gradient: &mut [f64]) {
    let mut derivative = output;
    for (index, layer) in network.shape.layers().iter().enumerate().rev() {
        derivative.iter_mut().zip(&slopes[index]).for_each(|(d, slope)| *d *= slope);
        let x = &all[index];
        for (g, d) in gradient[layer.bias.clone()].iter_mut().zip(&derivative) {
            *g += d;
        }
        let weight = &network.parameters[layer.weight.clone()];
        let mut next = vec![0.0; layer.inputs];
        let rows = gradient[layer.weight.clone()].chunks_exact_mut(layer.outputs);
        for ((g, w), (x, next)) in rows.zip(weight.chunks_exact(layer.outputs)).zip(x.iter().zip(&mut next)) {
            for ((g, &w), d) in g.iter_mut().zip(w).zip(&derivative) {
                *g += x * d;
                *next += f64::from(w) * d;
            }
        }
        derivative = next;
    }
}

fn normalised(row: &[f32], normaliser: Option<&Normaliser>) -> Vec<f64> {
    match normaliser {
        None => row.iter().map(|&x| f64::from(x)).collect(),
        Some(n) => {
            row.iter().zip(n.scale()).map(|(&x, (factor, offset))| f64::from(x * factor + offset)).collect()
        }
    }
}

/// Gradient of actor, critic and ln σ over one tile's samples as one minibatch, with their `advantage` and `returns`.
pub fn gradient(learner: &Learner, samples: &Samples) -> Vec<f64> {
    let settings = learner.settings();
    let rows = samples.rows();
    let weight = 1.0 / rows as f64;
    let [actor, critic] = [learner.actor(), learner.critic()];
    let mut of_actor = vec![0.0; actor.parameters.len()];
    let mut of_critic = vec![0.0; critic.parameters.len()];
    let log_std: Vec<f64> = learner.log_std().iter().map(|&s| f64::from(s)).collect();
    let mut of_std = vec![-f64::from(settings.entropy_coefficient as f32); log_std.len()];
    for row in 0..rows {
        let widths = samples.widths;
        let input = &samples.observation[row * widths.observation..(row + 1) * widths.observation];
        let all = forward(actor, normalised(input, learner.normaliser()));
        let action = &samples.action[row * widths.action..(row + 1) * widths.action];
        let z: Vec<f64> = (0..widths.action)
            .map(|c| (f64::from(action[c]) - all[0][all[0].len() - 1][c]) / log_std[c].exp())
            .collect();
        let log_probability: f64 =
            z.iter().zip(&log_std).map(|(z, s)| -0.5 * z * z - s - 0.5 * std::f64::consts::TAU.ln()).sum();
        let ratio = (log_probability - f64::from(samples.log_probability[row])).exp();
        let advantage = f64::from(samples.advantage[row]);
        let (plain, clip) = (-advantage * ratio, settings.clip);
        let held = -advantage * ratio.clamp(1.0 - clip, 1.0 + clip) > plain;
        let pull = if held { 0.0 } else { plain * weight };
        let derivative = z.iter().zip(&log_std).map(|(z, s)| pull * z / s.exp()).collect();
        of_std.iter_mut().zip(&z).for_each(|(g, z)| *g += pull * (z * z - 1.0));
        backward(actor, &all, derivative, &mut of_actor);

        let width = widths.critic_observation;
        let input = &samples.critic_observation[row * width..(row + 1) * width];
        let all = forward(critic, normalised(input, learner.critic_normaliser()));
        let value = all[0][all[0].len() - 1][0];
        let (old, target) = (f64::from(samples.value[row]), f64::from(samples.returns[row]));
        let bounded = old + (value - old).clamp(-clip, clip);
        let held = settings.clipped_value_loss && (bounded - target).powi(2) > (value - target).powi(2);
        let error = if held { 0.0 } else { value - target };
        let derivative = vec![2.0 * settings.value_coefficient * weight * error];
        backward(critic, &all, derivative, &mut of_critic);
    }
    [of_actor, of_critic, of_std].concat()
}
