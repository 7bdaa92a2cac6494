//! Settings of PPO and of its networks.

use serde::{Deserialize, Serialize};

use gaitfit_policy::network::{Activation, Cell, MAX_PARAMETERS, RecurrentShape, Shape};

/// How the learning rate moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// After every minibatch: divided by 1.5 where the KL divergence from the sampling policy exceeds twice
    /// `desired_kl`, multiplied by 1.5 where it is below half, within `learning_rate_limits`.
    #[default]
    Adaptive,
    /// Constant.
    Fixed,
}

/// Recurrent layers before the actor, and as many of their own before the critic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MemorySettings {
    /// Kind of the layers, `gru` or `lstm`; a GRU if absent.
    pub cell: Cell,
    /// Units of every layer; 64 if absent.
    pub width: usize,
    /// Layers, one behind the other; one if absent.
    pub layers: usize,
}

impl Default for MemorySettings {
    fn default() -> Self {
        Self { cell: Cell::Gru, width: 64, layers: 1 }
    }
}

impl MemorySettings {
    /// Sizes for a row of `inputs` numbers.
    pub fn shape(&self, inputs: usize) -> RecurrentShape {
        RecurrentShape { cell: self.cell, inputs, hidden: vec![self.width; self.layers] }
    }
}

/// How exactly a GPU multiplies matrices in rollouts and updates; sums are always in `f32`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Factors, layers' outputs and derivatives rounded to 8 significant bits (bf16); losses and what networks give in
    /// `f32`.
    #[default]
    Bf16,
    /// Factors rounded to 11 significant bits (TF32).
    Tf32,
    /// Factors split into two such numbers and three products added: the error is about that of `f32`.
    F32,
}

/// Settings of the networks and of proximal policy optimisation (Schulman et al. 2017).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Widths of the actor's hidden layers.
    pub actor_hidden: Vec<usize>,
    /// Widths of the critic's hidden layers.
    pub critic_hidden: Vec<usize>,
    /// Activation of both networks.
    pub activation: Activation,
    /// Factor on the actor's first output weights: small, so that the first actions are near 0.
    pub output_gain: f64,
    /// Standard deviation of actions at the start, before any learning.
    pub initial_std: f64,
    /// Holds the standard deviation at this value instead of learning it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixed_std: Option<f64>,
    /// Whether observations are shifted and scaled by their running mean and deviation.
    pub normalise_observations: bool,
    /// Whether advantages are shifted and scaled to mean 0 and deviation 1 over the whole rollout.
    pub normalise_advantage: bool,
    /// γ, a control step.
    pub gamma: f64,
    /// λ of generalised advantage estimation.
    pub lambda: f64,
    /// ε: the probability ratio is clipped to 1 ± ε, and the value's change to ± ε.
    pub clip: f64,
    /// Whether the value loss is the greater of the clipped and the plain one.
    pub clipped_value_loss: bool,
    /// Factor on the value loss.
    pub value_coefficient: f64,
    /// Factor on the entropy bonus.
    pub entropy_coefficient: f64,
    /// Learning rate of Adam, at the start or always.
    pub learning_rate: f64,
    /// How it moves.
    pub schedule: Schedule,
    /// KL divergence that the adaptive schedule aims for, nats.
    pub desired_kl: f64,
    /// Min and max learning rate of the adaptive schedule.
    pub learning_rate_limits: [f64; 2],
    /// Limit on the Euclidean norm of the whole gradient (actor, critic and log-std together).
    pub max_gradient_norm: f64,
    /// Updates at the start in which only the critic learns, its loss unclipped and its learning rate constant. By default
    /// 0; of a fine-tuning 5, or 20 if the policy has no critic. A critic of another simulator, or a fresh one, then does not
    /// mislead the actor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub critic_warmup: Option<u32>,
    /// Passes over the samples in an update.
    pub epochs: usize,
    /// Gradient steps in a pass; with a memory each is over whole robots.
    pub minibatches: usize,
    /// Recurrent layers before both networks, which see what these make of their observations; without it each network
    /// sees its observation alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory: Option<MemorySettings>,
    /// How exactly a GPU multiplies matrices; a CPU does so in `f32`.
    pub precision: Precision,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            actor_hidden: vec![128; 3],
            critic_hidden: vec![128; 3],
            activation: Activation::Elu,
            output_gain: 0.1,
            initial_std: 1.0,
            fixed_std: None,
            normalise_observations: false,
            normalise_advantage: true,
            // From here to `minibatches`: the values of legged_gym (Rudin et al. 2022) and of rsl_rl, which it trains
            // with, except the entropy bonus (0.01 there) and `critic_warmup`.
            gamma: 0.99,
            lambda: 0.95,
            clip: 0.2,
            clipped_value_loss: true,
            value_coefficient: 1.0,
            entropy_coefficient: 0.005,
            learning_rate: 1e-3,
            schedule: Schedule::Adaptive,
            desired_kl: 0.01,
            learning_rate_limits: [1e-5, 1e-2],
            max_gradient_norm: 1.0,
            critic_warmup: None,
            epochs: 5,
            minibatches: 4,
            memory: None,
            precision: Precision::default(),
        }
    }
}

/// A setting that cannot be honoured.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{name}` is {value}: {remedy}")]
pub struct SettingsError {
    /// The setting.
    pub name: &'static str,
    /// Its value.
    pub value: String,
    /// Advice on possible values.
    pub remedy: &'static str,
}

/// Max number of hidden layers of a network, and of units of a layer.
const MAX_LAYERS: usize = 16;
const MAX_WIDTH: usize = 4096;
/// Max number of units and of layers of a memory.
const MAX_MEMORY: [usize; 2] = [1024, 8];
/// Largest limit on the gradient's norm: its square must stay far from the largest `f32`.
const MAX_GRADIENT_NORM: f64 = 1e9;

impl Settings {
    /// Refuses numbers outside their range.
    ///
    /// # Errors
    /// [`SettingsError`] naming the first bad setting.
    pub fn check(&self) -> Result<(), SettingsError> {
        let require = |fine: bool, name: &'static str, value: String, remedy: &'static str| {
            if fine { Ok(()) } else { Err(SettingsError { name, value, remedy }) }
        };
        // The update computes with these numbers in `f32`, which holds 1e-38 to 3e38: their products must fit
        // too.
        let positive = |name, x: f64| {
            require(x > 1e-30 && x < 1e30, name, format!("{x:?}"), "give a number above 1e-30 and below 1e30")
        };
        let not_negative = |name, x: f64| {
            require((0.0..1e30).contains(&x), name, format!("{x:?}"), "give 0 or more, below 1e30")
        };
        let fraction = |name, x: f64| require((0.0..=1.0).contains(&x), name, x.to_string(), "give 0 … 1");
        // Widths are bounded here, because `shapes` multiplies them without a check for overflow.
        for (name, hidden) in [("actor_hidden", &self.actor_hidden), ("critic_hidden", &self.critic_hidden)] {
            require(
                !hidden.contains(&0),
                name,
                format!("{hidden:?}"),
                "give every layer at least one number",
            )?;
            require(
                hidden.len() <= MAX_LAYERS && hidden.iter().all(|&width| width <= MAX_WIDTH),
                name,
                format!("{hidden:?}"),
                "give at most 16 layers of at most 4096",
            )?;
        }
        not_negative("output_gain", self.output_gain)?;
        positive("initial_std", self.initial_std)?;
        if let Some(std) = self.fixed_std {
            positive("fixed_std", std)?;
        }
        fraction("gamma", self.gamma)?;
        fraction("lambda", self.lambda)?;
        positive("clip", self.clip)?;
        not_negative("value_coefficient", self.value_coefficient)?;
        not_negative("entropy_coefficient", self.entropy_coefficient)?;
        positive("learning_rate", self.learning_rate)?;
        positive("desired_kl", self.desired_kl)?;
        let [min, max] = self.learning_rate_limits;
        require(
            min > 1e-30 && min <= max && max <= 1e3,
            "learning_rate_limits",
            format!("{:?}", self.learning_rate_limits),
            "give two numbers above 0, the lower first, at most 1000",
        )?;
        let norm = self.max_gradient_norm;
        require(
            norm > 0.0 && norm <= MAX_GRADIENT_NORM,
            "max_gradient_norm",
            norm.to_string(),
            "give a number above 0, at most 1e9",
        )?;
        require((1..=1000).contains(&self.epochs), "epochs", self.epochs.to_string(), "give 1 to 1000")?;
        let minibatches = self.minibatches;
        require(
            (1..=100_000).contains(&minibatches),
            "minibatches",
            minibatches.to_string(),
            "give 1 to 100000",
        )?;
        let Some(MemorySettings { width, layers, .. }) = self.memory else { return Ok(()) };
        require((1..=MAX_MEMORY[0]).contains(&width), "memory.width", width.to_string(), "give 1 to 1024")?;
        require((1..=MAX_MEMORY[1]).contains(&layers), "memory.layers", layers.to_string(), "give 1 to 8")
    }

    /// Shapes of the actor and the critic for rows of these widths. Behind a memory they take its output.
    ///
    /// # Errors
    /// [`SettingsError`] naming the first bad setting, or the network that would have more parameters than a policy
    /// file may.
    pub fn shapes(&self, widths: super::Widths) -> Result<(Shape, Shape), SettingsError> {
        self.check()?;
        let shape = |name, inputs, hidden: &[usize], outputs| {
            let shape = Shape { inputs, hidden: hidden.to_vec(), outputs, activation: self.activation };
            // `check` has bounded every width, so the count does not overflow.
            if shape.parameters() <= MAX_PARAMETERS {
                return Ok(shape);
            }
            let count = shape.parameters();
            let value = format!("{hidden:?}, {count} parameters where a policy has at most {MAX_PARAMETERS}");
            Err(SettingsError { name, value, remedy: "make it narrower" })
        };
        // Behind a memory a network sees the memory's output, which is as wide as each of its layers.
        let inputs = |observed: usize| self.memory.map_or(observed, |memory| memory.width);
        Ok((
            shape("actor_hidden", inputs(widths.observation), &self.actor_hidden, widths.action)?,
            shape("critic_hidden", inputs(widths.critic_observation), &self.critic_hidden, 1)?,
        ))
    }

    /// Shapes of the actor's and the critic's memory for rows of these widths, if the settings ask for them.
    ///
    /// # Errors
    /// [`SettingsError`] naming a memory that would have more parameters than a network may.
    pub fn memories(&self, widths: super::Widths) -> Result<Option<[RecurrentShape; 2]>, SettingsError> {
        let Some(memory) = self.memory else { return Ok(None) };
        let shapes = [widths.observation, widths.critic_observation].map(|inputs| memory.shape(inputs));
        match shapes.iter().map(RecurrentShape::parameters).find(|&count| count > MAX_PARAMETERS) {
            None => Ok(Some(shapes)),
            Some(count) => Err(SettingsError {
                name: "memory.width",
                value: format!(
                    "{}, {count} parameters where a network has at most {MAX_PARAMETERS}",
                    memory.width
                ),
                remedy: "make it narrower",
            }),
        }
    }
}
