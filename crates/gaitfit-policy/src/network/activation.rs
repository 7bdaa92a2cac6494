//! The function between two layers.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

/// Slope of [`Activation::LeakyRelu`] below 0 where nothing says another, as in PyTorch.
const SLOPE: f32 = 0.01;
/// Largest parameter.
const MAX_PARAMETER: f32 = 1e3;

/// Activation of every hidden layer, or of the output.
///
/// In files it is its name, or for those with a parameter a table of name and parameter: `"elu"`,
/// `{ leaky_relu = 0.2 }`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub enum Activation {
    /// x where x > 0, else eˣ − 1 (Clevert, Unterthiner, Hochreiter 2016, with α = 1).
    #[default]
    Elu,
    /// max(x, 0).
    Relu,
    /// Hyperbolic tangent.
    Tanh,
    /// x where x > 0, else α (eˣ − 1), with this α ≥ 0.
    EluOf(f32),
    /// x where x > 0, else x times this slope ≥ 0.
    LeakyRelu(f32),
    /// λ x where x > 0, else λ α (eˣ − 1) (Klambauer et al. 2017).
    Selu,
    /// x σ(x), also called swish (Hendrycks, Gimpel 2016).
    Silu,
    /// x Φ(x), Φ the normal distribution (Hendrycks, Gimpel 2016).
    Gelu,
    /// Its approximation by a hyperbolic tangent, as PyTorch has it.
    GeluTanh,
}

/// α and λ of SELU.
pub const SELU: [f64; 2] = [1.673_263_242_354_377_2, 1.050_700_987_355_480_5];

impl Activation {
    /// Its name in files, without its parameter.
    pub fn name(self) -> &'static str {
        match self {
            Self::Elu | Self::EluOf(_) => "elu",
            Self::Relu => "relu",
            Self::Tanh => "tanh",
            Self::LeakyRelu(_) => "leaky_relu",
            Self::Selu => "selu",
            Self::Silu => "silu",
            Self::Gelu => "gelu",
            Self::GeluTanh => "gelu_tanh",
        }
    }

    /// Its parameter, where it has one.
    pub fn parameter(self) -> Option<f32> {
        match self {
            Self::EluOf(parameter) | Self::LeakyRelu(parameter) => Some(parameter),
            _ => None,
        }
    }

    /// Whether its derivative follows from its output. Where it does not, a training keeps the derivative beside the output.
    pub fn slope_follows_from_output(self) -> bool {
        !matches!(self, Self::Silu | Self::Gelu | Self::GeluTanh)
    }

    /// ELU with this α.
    pub fn elu(alpha: f32) -> Self {
        // α = 1 is always written in one way, so that equal functions compare as equal.
        if alpha == 1.0 { Self::Elu } else { Self::EluOf(alpha) }
    }

    /// Whether its parameter is one that it can have.
    pub fn is_sound(self) -> bool {
        // Below 0 the output of a negative x would be positive. The way back could not tell from it which slope
        // holds.
        self.parameter().is_none_or(|parameter| (0.0..=MAX_PARAMETER).contains(&parameter))
    }
}

impl fmt::Display for Activation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.parameter() {
            Some(parameter) => write!(f, "{}({parameter})", self.name()),
            None => f.write_str(self.name()),
        }
    }
}

/// As files have it.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "give a name, for example \"elu\", or a name and its parameter, { leaky_relu = 0.2 }"
)]
enum Written {
    Name(String),
    With(BTreeMap<String, f32>),
}

impl From<Activation> for Written {
    fn from(activation: Activation) -> Self {
        let name = activation.name().to_owned();
        match activation.parameter() {
            Some(parameter) => Self::With(BTreeMap::from([(name, parameter)])),
            None => Self::Name(name),
        }
    }
}

impl TryFrom<Written> for Activation {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        let (name, parameter) = match &written {
            Written::Name(name) => (name.as_str(), None),
            Written::With(one) => match one.iter().next() {
                Some((name, &parameter)) if one.len() == 1 => (name.as_str(), Some(parameter)),
                _ => return Err("give one activation, for example { leaky_relu = 0.2 }".to_owned()),
            },
        };
        let activation = match (name, parameter) {
            ("elu", None) => Self::Elu,
            ("elu", Some(alpha)) => Self::elu(alpha),
            ("relu", None) => Self::Relu,
            ("tanh", None) => Self::Tanh,
            // `lrelu` is its name in rsl_rl.
            ("leaky_relu" | "lrelu", slope) => Self::LeakyRelu(slope.unwrap_or(SLOPE)),
            ("selu", None) => Self::Selu,
            ("silu" | "swish", None) => Self::Silu,
            ("gelu", None) => Self::Gelu,
            ("gelu_tanh", None) => Self::GeluTanh,
            (_, Some(_)) => {
                return Err(format!("activation `{name}` has no parameter; elu and leaky_relu have one"));
            }
            _ => {
                return Err(format!(
                    "unknown activation `{name}`; known: elu, relu, tanh, leaky_relu, selu, silu, gelu, gelu_tanh"
                ));
            }
        };
        if activation.is_sound() {
            Ok(activation)
        } else {
            Err(format!("the parameter of {activation} must be from 0 to {MAX_PARAMETER}"))
        }
    }
}
