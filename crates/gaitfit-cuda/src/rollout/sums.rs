//! What a rollout adds up in every environment: the reward, each reward term, then these.

macro_rules! sums {
    ($($(#[doc = $doc:literal])+ $variant:ident = $name:literal;)*) => {
        /// A sum after the reward and its terms.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum Sum { $($(#[doc = $doc])+ $variant,)* }

        impl Sum {
            /// The kernels' names, in order.
            const NAMES: [&'static str; [$($name),*].len()] = [$($name,)*];
        }
    };
}

sums! {
    /// Sum of the horizontal velocity's error, m/s.
    VelocityError = "VELOCITY_ERROR";
    /// Sum of the yaw rate's error, rad/s.
    YawError = "YAW_ERROR";
    /// Episodes that ended.
    Episodes = "EPISODES";
    /// Episodes that a fall or a divergence ended.
    Falls = "FALLS";
    /// Steps of the episodes that ended.
    EpisodeSteps = "EPISODE_STEPS";
    /// Rewards of the episodes that ended.
    EpisodeReturn = "EPISODE_RETURN";
    /// Simulations that diverged.
    Diverged = "DIVERGED";
    /// Steps that falls cut off.
    LostSteps = "LOST_STEPS";
    /// Sum of the levels of the ground that robots are on; 0 without levels.
    Level = "LEVEL";
    /// No sum: the step of the first divergence, from 1; 0 without one.
    BrokenAt = "BROKEN_AT";
    /// No sum: the reward term that was not finite then, from 1; 0 if it was the robot's state.
    BrokenTerm = "BROKEN_TERM";
}

impl Sum {
    /// Numbers of an environment with so many reward terms.
    pub fn count(terms: usize) -> usize {
        1 + terms + Self::NAMES.len()
    }

    /// Its place among the numbers of an environment.
    pub fn place(self, terms: usize) -> usize {
        1 + terms + self as usize
    }

    /// The kernels' list of places, with `TALLIES`, the numbers of an environment, at its end.
    pub fn text(terms: usize) -> String {
        let [first, rest @ ..] = Self::NAMES;
        format!("enum {{ {first} = {}, {}, TALLIES }};\n", 1 + terms, rest.join(", "))
    }
}
