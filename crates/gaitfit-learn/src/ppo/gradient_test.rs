//! The whole loss's derivative by every parameter, in f64, against central differences.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_random::{Purpose, Stream};

use super::{
    Settings, Widths,
    loss::{Constants, Sums, Targets},
    worker::{Point, Worker},
};
use gaitfit_policy::network::{Activation, Scalar, Shape, Weights};

const ROWS: usize = 40;
/// Rows in the first of two tiles.
const TILE_ROWS: usize = 29;
const WIDTHS: Widths = Widths { observation: 5, critic_observation: 7, action: 3 };

/// A minibatch of random numbers at a random point, in either float type.
struct Problem {
    settings: Settings,
    /// Function of the actor's output.
    output: Option<Activation>,
    shapes: (Shape, Shape),
    /// Actor, critic, ln σ.
    parameters: Vec<f64>,
    old_log_std: Vec<f64>,
    observation: Vec<f64>,
    critic_observation: Vec<f64>,
    targets: Targets<f64>,
}

fn normals(number: u32, size: usize, scale: f64) -> Vec<f64> {
    let stream = Stream::new(11, Purpose::BOOTSTRAP).environment(number);
    (0..size).map(|draw| scale * stream.normal(draw as u32)).collect()
}

impl Problem {
    fn new(settings: Settings, output: Option<Activation>) -> Self {
        let shapes = settings.shapes(WIDTHS).unwrap();
        let size = shapes.0.parameters() + shapes.1.parameters();
        let widest = shapes.0.widest().max(shapes.1.widest());
        let mut parameters = normals(0, size, (1.5 / widest as f64).sqrt());
        parameters.extend([-0.2, 0.1, 0.3]);
        let mut problem = Self {
            parameters,
            old_log_std: vec![-0.1, 0.05, 0.2],
            observation: normals(1, ROWS * WIDTHS.observation, 1.0),
            critic_observation: normals(2, ROWS * WIDTHS.critic_observation, 1.0),
            targets: Targets {
                action: normals(3, ROWS * WIDTHS.action, 1.0),
                mean: normals(4, ROWS * WIDTHS.action, 1.0),
                log_probability: vec![0.0; ROWS],
                advantage: normals(5, ROWS, 1.0),
                value: vec![0.0; ROWS],
                returns: vec![0.0; ROWS],
            },
            settings,
            output,
            shapes,
        };
        // Ratios and value changes around ± 0.4 of where the networks stand, so that every row of either clip is met.
        let (mean, value) = problem.outputs();
        let (ratio, moved, target) = (normals(6, ROWS, 0.2), normals(7, ROWS, 0.2), normals(8, ROWS, 0.3));
        for row in 0..ROWS {
            let log_probability: f64 = (0..WIDTHS.action)
                .map(|c| {
                    let log_std = problem.log_std()[c];
                    let i = row * WIDTHS.action + c;
                    let z = (problem.targets.action[i] - mean[i]) / log_std.exp();
                    -0.5 * z * z - log_std - super::loss::HALF_LOG_TAU
                })
                .sum();
            problem.targets.log_probability[row] = log_probability - ratio[row];
            problem.targets.value[row] = value[row] - moved[row];
            problem.targets.returns[row] = value[row] + target[row];
        }
        problem
    }

    fn log_std(&self) -> &[f64] {
        &self.parameters[self.parameters.len() - WIDTHS.action..]
    }

    /// Means and values of all rows, by loops of scalar products.
    fn outputs(&self) -> (Vec<f64>, Vec<f64>) {
        let run = |shape: &Shape, last: Option<Activation>, parameters: &[f64], input: &[f64]| {
            let mut output = Vec::new();
            for row in input.chunks_exact(shape.inputs) {
                let mut x = row.to_vec();
                let layers = shape.layers();
                for (number, layer) in layers.iter().enumerate() {
                    let y = (0..layer.outputs).map(|j| {
                        let w = |i: usize| parameters[layer.weight.start + i * layer.outputs + j];
                        let y = parameters[layer.bias.start + j]
                            + (0..layer.inputs).map(|i| x[i] * w(i)).sum::<f64>();
                        let function = if number + 1 == layers.len() { last } else { Some(shape.activation) };
                        match function {
                            Some(Activation::Elu) if y <= 0.0 => y.exp_m1(),
                            Some(Activation::Relu) if y <= 0.0 => 0.0,
                            Some(Activation::Tanh) => y.tanh(),
                            Some(Activation::EluOf(alpha)) if y <= 0.0 => f64::from(alpha) * y.exp_m1(),
                            Some(Activation::LeakyRelu(slope)) if y <= 0.0 => f64::from(slope) * y,
                            Some(Activation::Selu) => {
                                let below = 1.673_263_242_354_377_2 * y.exp_m1();
                                1.050_700_987_355_480_5 * if y > 0.0 { y } else { below }
                            }
                            Some(Activation::Silu) => y / (1.0 + (-y).exp()),
                            Some(Activation::GeluTanh) => {
                                let root = (2.0 / std::f64::consts::PI).sqrt();
                                0.5 * y * (1.0 + (root * (y + 0.044_715 * y.powi(3))).tanh())
                            }
                            _ => y,
                        }
                    });
                    x = y.collect();
                }
                output.extend(x);
            }
            output
        };
        let (actor, critic) = &self.shapes;
        let split = actor.parameters();
        (
            run(actor, self.output, &self.parameters[..split], &self.observation),
            run(critic, None, &self.parameters[split..], &self.critic_observation),
        )
    }

    /// Gradient and sums in either type, by the code under test.
    fn gradient<T: Scalar>(&self) -> (Vec<T>, Sums) {
        let convert = |numbers: &[f64]| numbers.iter().map(|&x| T::from_f64(x)).collect::<Vec<T>>();
        let (actor, critic) = &self.shapes;
        let parameters = convert(&self.parameters);
        let (split, end) = (actor.parameters(), actor.parameters() + critic.parameters());
        let log_std = convert(self.log_std());
        let constants = Constants::new(&self.settings, ROWS, &log_std, &convert(&self.old_log_std));
        let point = Point {
            actor: Weights::new(actor, &parameters[..split]).with_output(self.output),
            critic: Weights::new(critic, &parameters[split..end]),
            memories: [None, None],
            constants,
        };
        let mut worker = Worker::<T>::new(actor, critic);
        let mut gradient = vec![T::ZERO; parameters.len()];
        let mut sums = Sums::default();
        // Two tiles: what the second finds is added to what the first left.
        for rows in [0..TILE_ROWS, TILE_ROWS..ROWS] {
            let part =
                |numbers: &[f64], width: usize| convert(&numbers[rows.start * width..rows.end * width]);
            let observation = part(&self.observation, WIDTHS.observation);
            worker.observation[..observation.len()].copy_from_slice(&observation);
            let observation = part(&self.critic_observation, WIDTHS.critic_observation);
            worker.critic_observation[..observation.len()].copy_from_slice(&observation);
            worker.targets = Targets {
                action: part(&self.targets.action, WIDTHS.action),
                mean: part(&self.targets.mean, WIDTHS.action),
                log_probability: part(&self.targets.log_probability, 1),
                advantage: part(&self.targets.advantage, 1),
                value: part(&self.targets.value, 1),
                returns: part(&self.targets.returns, 1),
            };
            let (of_actor, rest) = gradient.split_at_mut(split);
            let (of_critic, of_log_std) = rest.split_at_mut(end - split);
            worker.policy(&point, rows.len(), of_actor, of_log_std, &mut sums);
            worker.value(&point, rows.len(), of_critic, &mut sums);
        }
        (gradient, sums)
    }

    /// The losses from their formulas, without the code under test: surrogate + coefficient × value, and KL.
    fn loss(&self) -> (f64, f64) {
        let (mean, value) = self.outputs();
        let (targets, clip) = (&self.targets, self.settings.clip);
        let (mut loss, mut kl) = (0.0, 0.0);
        for row in 0..ROWS {
            let mut log_ratio = -targets.log_probability[row];
            for c in 0..WIDTHS.action {
                let i = row * WIDTHS.action + c;
                let (std, old_std) = (self.log_std()[c].exp(), self.old_log_std[c].exp());
                let density = (-0.5 * ((targets.action[i] - mean[i]) / std).powi(2)).exp()
                    / (std * std::f64::consts::TAU.sqrt());
                log_ratio += density.ln();
                let shift = targets.mean[i] - mean[i];
                kl += (std / old_std).ln() + (old_std * old_std + shift * shift) / (2.0 * std * std) - 0.5;
            }
            let (ratio, advantage) = (log_ratio.exp(), targets.advantage[row]);
            loss += -(ratio * advantage).min(ratio.clamp(1.0 - clip, 1.0 + clip) * advantage);
            let bounded = targets.value[row] + (value[row] - targets.value[row]).clamp(-clip, clip);
            let plain = (value[row] - targets.returns[row]).powi(2);
            let clipped = (bounded - targets.returns[row]).powi(2);
            let value_loss = if self.settings.clipped_value_loss { plain.max(clipped) } else { plain };
            loss += self.settings.value_coefficient * value_loss;
        }
        (loss / ROWS as f64, kl / ROWS as f64)
    }
}

fn settings(activation: Activation, clipped_value_loss: bool) -> Settings {
    Settings {
        actor_hidden: vec![6, 4],
        critic_hidden: vec![5],
        activation,
        clipped_value_loss,
        value_coefficient: 0.7,
        ..Settings::default()
    }
}

/// Holds every `stride`-th element of the gradient against central differences.
fn check_by_differences(settings: Settings, stride: usize) {
    check_with_output(settings, None, stride);
}

/// As [`check_by_differences`], with this function of the actor's output.
fn check_with_output(settings: Settings, output: Option<Activation>, stride: usize) {
    let activation = settings.activation;
    let mut problem = Problem::new(settings, output);
    let (gradient, sums) = problem.gradient::<f64>();
    let (loss, kl) = problem.loss();
    let own = (sums.surrogate + problem.settings.value_coefficient * sums.value) / ROWS as f64;
    assert!((own - loss).abs() < 1e-12 && (sums.kl / ROWS as f64 - kl).abs() < 1e-12);
    let greatest = gradient.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    for (index, &derivative) in gradient.iter().enumerate().step_by(stride) {
        let (h, at) = (1e-6, problem.parameters[index]);
        problem.parameters[index] = at + h;
        let above = problem.loss().0;
        problem.parameters[index] = at - h;
        let below = problem.loss().0;
        problem.parameters[index] = at;
        let difference = (above - below) / (2.0 * h);
        assert!(
            (difference - derivative).abs() < 1e-7 * greatest,
            "{activation:?}, parameter {index}: {derivative} by hand, {difference} by differences"
        );
    }
}

/// Layers of more than one block of columns and of less, with columns left over, and none at all.
fn wide(activation: Activation) -> [Settings; 2] {
    let settings = settings(activation, true);
    [
        Settings { actor_hidden: vec![80, 64], critic_hidden: vec![70, 33], ..settings.clone() },
        Settings { actor_hidden: vec![], critic_hidden: vec![128], ..settings },
    ]
}

#[test]
fn gradient_is_that_of_the_formulas_by_central_differences() {
    // Functions with a kink: in wide layers some unit lies so near it that a difference steps over it.
    for activation in [Activation::EluOf(0.6), Activation::LeakyRelu(0.2), Activation::Selu] {
        check_by_differences(settings(activation, true), 1);
    }
    for activation in [Activation::Elu, Activation::Relu, Activation::Tanh] {
        for clipped_value_loss in [true, false] {
            check_by_differences(settings(activation, clipped_value_loss), 1);
        }
        for settings in wide(activation) {
            check_by_differences(settings, 67);
        }
    }
}

/// The tape keeps derivatives that do not follow from outputs, and those of functions of the output.
#[test]
fn gradient_of_swish_and_of_a_bounded_output_is_that_of_the_formulas() {
    for activation in [Activation::Silu, Activation::GeluTanh] {
        check_by_differences(settings(activation, true), 1);
        check_with_output(settings(activation, false), Some(Activation::Tanh), 1);
        for settings in wide(activation) {
            check_with_output(settings, Some(Activation::Silu), 67);
        }
    }
    check_with_output(settings(Activation::Tanh, true), Some(Activation::Selu), 1);
    // Actor and critic take turns in one tape: where the actor keeps slopes the critic has a wider layer without them.
    let settings =
        Settings { actor_hidden: vec![6], critic_hidden: vec![5, 40, 40], ..settings(Activation::Elu, true) };
    check_with_output(settings, Some(Activation::Tanh), 1);
}

#[test]
fn the_gradient_test_meets_every_branch_of_both_clips() {
    let problem = Problem::new(settings(Activation::Elu, true), None);
    let (_, value) = problem.outputs();
    let (_, sums) = problem.gradient::<f64>();
    assert!(sums.clipped > 5.0 && sums.clipped < 35.0, "{} of {ROWS} ratios outside the clip", sums.clipped);
    let clip = problem.settings.clip;
    let (mut inside, mut bounded, mut plain) = (0, 0, 0);
    for row in 0..ROWS {
        let (old, target) = (problem.targets.value[row], problem.targets.returns[row]);
        let moved = value[row] - old;
        let clipped = (old + moved.clamp(-clip, clip) - target).abs();
        match (moved.abs() < clip, clipped > (value[row] - target).abs()) {
            (true, _) => inside += 1,
            (false, true) => bounded += 1,
            (false, false) => plain += 1,
        }
    }
    assert!(inside > 3 && bounded > 3 && plain > 3, "{inside} {bounded} {plain}");
}

#[test]
fn tiles_without_a_derivative_add_nothing_and_rows_that_are_no_numbers_show() {
    let mut problem = Problem::new(settings(Activation::Elu, true), None);
    let actor = problem.shapes.0.parameters();
    let (with_all, _) = problem.gradient::<f64>();
    problem.targets.advantage.fill(0.0);
    let (gradient, _) = problem.gradient::<f64>();
    assert!(gradient[..actor].iter().all(|&g| g == 0.0), "no row pulls at the actor");
    let critic = actor..gradient.len() - WIDTHS.action;
    assert_eq!(gradient[critic.clone()], with_all[critic]);
    problem.targets.advantage[ROWS / 2] = f64::NAN;
    let (gradient, _) = problem.gradient::<f64>();
    assert!(gradient[..actor].iter().all(|g| g.is_nan()));
}

#[test]
fn single_precision_gradient_is_that_of_double() {
    for settings in [settings(Activation::Elu, true)].into_iter().chain(wide(Activation::Elu)) {
        let problem = Problem::new(settings, None);
        let (double, _) = problem.gradient::<f64>();
        let (single, _) = problem.gradient::<f32>();
        let greatest = double.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        for (single, double) in single.iter().zip(&double) {
            assert!((f64::from(*single) - double).abs() < 3e-6 * greatest, "{single} {double}");
        }
    }
}

#[test]
fn the_estimates_of_kl_agree_with_the_closed_form() {
    // Actions drawn from the old policy: −ln r and (r − 1) − ln r are then unbiased estimates.
    let rows = 200_000;
    let (log_std, old_log_std) = (vec![-0.1, 0.1], vec![0.0, 0.05]);
    let constants = Constants::<f64>::new(&Settings::default(), rows, &log_std, &old_log_std);
    let noise = normals(9, 2 * rows, 1.0);
    let action: Vec<f64> = noise.iter().enumerate().map(|(i, z)| z * old_log_std[i % 2].exp()).collect();
    let normaliser: f64 = old_log_std.iter().map(|s| s + super::loss::HALF_LOG_TAU).sum();
    let density = |z: &[f64]| -0.5 * (z[0] * z[0] + z[1] * z[1]) - normaliser;
    let log_probability = noise.chunks_exact(2).map(density).collect();
    let targets = Targets {
        action,
        mean: vec![0.0; 2 * rows],
        log_probability,
        advantage: vec![0.0; rows],
        ..Targets::default()
    };
    let mean = [0.05, -0.03].repeat(rows);
    let mut sums = Sums::default();
    super::loss::policy(&constants, &targets, &mean, &mut vec![0.0; 2 * rows], &mut [0.0; 2], &mut sums);
    let [kl, k1, k3] = [sums.kl, sums.k1, sums.k3].map(|sum| sum / rows as f64);
    assert!(kl > 0.005 && (k1 - kl).abs() < 0.1 * kl && (k3 - kl).abs() < 0.03 * kl, "{kl} {k1} {k3}");
}
