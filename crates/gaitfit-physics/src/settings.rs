//! How hard the step works.

use gaitfit_model::{Cone, Integrator, Options};

/// How joint damping enters the integrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damping {
    /// As MuJoCo does it: the constraint solver sees M, the integrator solves again with M + h·B.
    Implicit,
    /// M + h·B is used in the solver itself: one solve less, and the same result where no constraint acts.
    Folded,
    /// Explicit: forces only (MuJoCo with `eulerdamp` disabled).
    Explicit,
}

/// Solver effort and integration of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Physics step, s.
    pub timestep: f64,
    /// Friction cone.
    pub cone: Cone,
    /// Newton iterations.
    pub iterations: usize,
    /// Line-search evaluations in each iteration; 0 takes the full Newton step.
    pub line_search: usize,
    /// Joint damping.
    pub damping: Damping,
    /// Whether PD control and damping are centred in time: forces of a step stand for the interval around its
    /// start, and dampers act on the mean of the velocities before and after. With it a fit does not depend on
    /// the step to first order; without it, as in MuJoCo, inertia and damping absorb terms like `timestep · kd`.
    pub centred: bool,
    /// Step of the simulation, or period of the motor boards, that this simulation stands for with a step of its own, s.
    ///
    /// In semi-implicit Euler a velocity belongs to half a step before its position, so forces that depend on velocity
    /// (PD, dampers, friction, contacts) act half a step late. With this setting they act half of `emulated_step` late,
    /// whatever the step, to first order in it; with the step itself nothing changes. It stands above `centred`.
    pub emulated_step: Option<f64>,
    /// Whether the velocity gain of actuators is integrated implicitly too (MuJoCo's `implicitfast`).
    pub implicit_actuators: bool,
}

/// Named solver efforts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// 2 full Newton steps with pyramidal cones, 6 with a line search with elliptic ones: for training, where the
    /// truncation is far below the randomisation.
    Fast,
    /// 4 Newton steps with a line search; 8 with elliptic cones.
    Accurate,
    /// 50 Newton steps with 20 line-search evaluations: the unique minimum, for comparisons.
    Converged,
}

impl Preset {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Fast => "fast",
            Preset::Accurate => "accurate",
            Preset::Converged => "converged",
        }
    }
}

impl std::str::FromStr for Preset {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "fast" => Ok(Preset::Fast),
            "accurate" => Ok(Preset::Accurate),
            "converged" => Ok(Preset::Converged),
            _ => Err(format!("unknown preset `{text}`; use fast, accurate or converged")),
        }
    }
}

impl Settings {
    /// How much later than the simulation's velocities those are that it stands for, s: readings are
    /// `velocity + lead · acceleration`. 0 without [`Self::emulated_step`].
    pub fn lead(&self) -> f64 {
        self.emulated_step.map_or(0.0, |step| 0.5 * (self.timestep - step))
    }

    /// How much later than the simulation's velocities those are that PD control and joint dampers act on, s. The
    /// interval over which a target counts begins as much earlier.
    pub(crate) fn drive_lead(&self) -> f64 {
        match self.emulated_step {
            Some(_) => self.lead(),
            None if self.centred => 0.5 * self.timestep,
            None => 0.0,
        }
    }

    /// The preset with the model's own options for everything else.
    pub fn new(options: &Options, preset: Preset) -> Self {
        // A pyramid's cost is quadratic in pieces. An ellipse's bends, and has kinks the narrower the larger `impratio`
        // is: full steps jump to and fro across them for ever.
        let (iterations, line_search) = match (preset, options.cone) {
            (Preset::Fast, Cone::Pyramidal) => (2, 0),
            (Preset::Fast, Cone::Elliptic) => (6, 2),
            (Preset::Accurate, Cone::Pyramidal) => (4, 1),
            (Preset::Accurate, Cone::Elliptic) => (8, 3),
            (Preset::Converged, _) => (50, 20),
        };
        let damping = match (options.integrator, options.eulerdamp, preset) {
            (Integrator::Euler, false, _) => Damping::Explicit,
            (_, _, Preset::Converged) => Damping::Implicit,
            _ => Damping::Folded,
        };
        Self {
            timestep: options.timestep,
            cone: options.cone,
            iterations,
            line_search,
            damping,
            centred: false,
            emulated_step: None,
            implicit_actuators: options.integrator == Integrator::ImplicitFast,
        }
    }
}
