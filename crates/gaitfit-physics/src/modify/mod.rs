//! Changes of what drives the joints, made inside the step.
//!
//! A modification is the same for all environments of a block; what it must remember of each environment lies in
//! its part of the block's memory. A new one is a file here with a [`Modify`], and a line in
//! the list of [`JointModification`].

mod action_delta;
mod gears;
mod late_imu;
mod network;
mod resid_act;
mod velocity_filter;

pub use action_delta::ActionDelta;
pub use gears::{Engaged, Gears};
pub use late_imu::{IMU_PERIODS, IMU_READING, LateImu};
pub use network::{JointNetwork, NETWORK_WEIGHTS, NetworkScales};
pub use resid_act::ResidAct;
pub use velocity_filter::VelocityFilter;

use crate::{Drive, Owner, Params, Real, Robot, Settings, Slot, State};

/// A change of targets or torques, with numbers of its own that are the same for all environments: a candidate's
/// weights. `memory` holds [`Modify::memory`] numbers an environment.
pub trait Modify<K: Copy> {
    /// Numbers it remembers from one physics step to the next.
    fn memory(&self) -> usize;

    /// What a number that it remembers belongs to.
    fn memory_owner(&self, place: usize) -> Owner;

    /// Whether [`Modify::settle`] writes zeros. Otherwise it writes readings of joints' angles and velocities in turn.
    fn settles_at_zero(&self) -> bool {
        true
    }

    /// Calls `visit` with every weight and its name, to change it.
    fn visit_weights_mut(&mut self, _visit: impl FnMut(Slot, &mut K)) {}

    /// Writes the memory of a robot that has been in this state for long.
    #[inline(always)]
    fn settle<T: Real<K = K>>(&self, _params: &Params<T>, _state: &State<T>, memory: &mut [T]) {
        memory.fill(T::zero());
    }

    /// May change the position targets about to be sent (rad, one a joint); once a control period, which has `_substeps`
    /// physics steps.
    #[inline(always)]
    fn targets<T: Real<K = K>>(
        &self,
        _substeps: usize,
        _params: &Params<T>,
        _state: &State<T>,
        _memory: &mut [T],
        _targets: &mut [T],
    ) {
    }

    /// May change the torques, which are the PD controller's after its limits; at every physics step.
    #[inline(always)]
    fn torques<T: Real<K = K>>(
        &self,
        _settings: &Settings,
        _params: &Params<T>,
        _state: &State<T>,
        _memory: &mut [T],
        _drives: &mut [Drive<T>],
    ) {
    }

    /// Before the solver, after all torques are known: may replace the joints' motion by the motion of their links, and what
    /// drives them by what drives the links; at every physics step.
    #[inline(always)]
    fn engage<T: Real<K = K>>(
        &self,
        _settings: &Settings,
        _params: &Params<T>,
        _state: &mut State<T>,
        _memory: &[T],
        _drives: &mut [Drive<T>],
    ) {
    }

    /// After the integration: takes back what [`Modify::engage`] replaced.
    #[inline(always)]
    fn release<T: Real<K = K>>(
        &self,
        _settings: &Settings,
        _params: &Params<T>,
        _state: &mut State<T>,
        _memory: &mut [T],
        _drives: &mut [Drive<T>],
    ) {
    }
}

/// Makes [`JointModification`] and [`Parts`] of their list. A row: documentation, variant, what it holds. If parameters alone
/// decide whether a robot has it: its field of [`Parts`], the names of these parameters, and the one of a robot with this
/// many joints. A robot has the part if one of the parameters is not 0. Those of sensors come last.
macro_rules! modifications {
    ($(
        $(#[doc = $doc:literal])* $variant:ident($held:ty)
        $(if $part:ident: [$($name:literal),*], $make:expr)?;
    )*) => {
        /// Any modification.
        #[derive(Clone, Debug, PartialEq)]
        pub enum JointModification<K> {
            $($(#[doc = $doc])* $variant($held),)*
        }

        impl<K: Copy> Modify<K> for JointModification<K> {
            fn memory(&self) -> usize {
                match self {
                    $(Self::$variant(one) => Modify::<K>::memory(one),)*
                }
            }

            fn memory_owner(&self, place: usize) -> Owner {
                match self {
                    $(Self::$variant(one) => Modify::<K>::memory_owner(one, place),)*
                }
            }

            fn settles_at_zero(&self) -> bool {
                match self {
                    $(Self::$variant(one) => Modify::<K>::settles_at_zero(one),)*
                }
            }

            fn visit_weights_mut(&mut self, visit: impl FnMut(Slot, &mut K)) {
                match self {
                    $(Self::$variant(one) => Modify::<K>::visit_weights_mut(one, visit),)*
                }
            }

            #[inline(always)]
            fn settle<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>, memory: &mut [T]) {
                match self {
                    $(Self::$variant(one) => one.settle(params, state, memory),)*
                }
            }

            #[inline(always)]
            fn targets<T: Real<K = K>>(
                &self,
                substeps: usize,
                params: &Params<T>,
                state: &State<T>,
                memory: &mut [T],
                targets: &mut [T],
            ) {
                match self {
                    $(Self::$variant(one) => one.targets(substeps, params, state, memory, targets),)*
                }
            }

            #[inline(always)]
            fn torques<T: Real<K = K>>(
                &self,
                settings: &Settings,
                params: &Params<T>,
                state: &State<T>,
                memory: &mut [T],
                drives: &mut [Drive<T>],
            ) {
                match self {
                    $(Self::$variant(one) => one.torques(settings, params, state, memory, drives),)*
                }
            }

            #[inline(always)]
            fn engage<T: Real<K = K>>(
                &self,
                settings: &Settings,
                params: &Params<T>,
                state: &mut State<T>,
                memory: &[T],
                drives: &mut [Drive<T>],
            ) {
                match self {
                    $(Self::$variant(one) => one.engage(settings, params, state, memory, drives),)*
                }
            }

            #[inline(always)]
            fn release<T: Real<K = K>>(
                &self,
                settings: &Settings,
                params: &Params<T>,
                state: &mut State<T>,
                memory: &mut [T],
                drives: &mut [Drive<T>],
            ) {
                match self {
                    $(Self::$variant(one) => one.release(settings, params, state, memory, drives),)*
                }
            }
        }

        /// Modifications that a robot has if its parameters say so.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct Parts {
            $($(#[doc = concat!("Whether it has [`", stringify!($variant), "`].")] pub $part: bool,)?)*
        }

        impl Parts {
            /// Those of `robot`.
            pub fn from_robot(robot: &Robot) -> Self {
                let differs = |name: &str| robot.named(name).iter().any(|&number| number != 0.0);
                Self { $($($part: [$($name),*].into_iter().any(differs),)?)* }
            }

            /// The part that a parameter of this name decides about is there.
            fn add(&mut self, name: &str) {
                $($(self.$part |= [$($name),*].contains(&name);)?)*
            }

            /// Those of either.
            pub fn or(self, other: Self) -> Self {
                Self { $($($part: self.$part || other.$part,)?)* }
            }

            /// Whether a parameter of this name decides about a part that is not here.
            pub(crate) fn lack(self, name: &str) -> bool {
                false $($(|| !self.$part && [$($name),*].contains(&name))?)*
            }

            /// The modifications of a robot of `joints` joints.
            pub fn modifications<K: Copy>(self, joints: usize) -> Vec<JointModification<K>> {
                let mut all = Vec::new();
                $($(if self.$part {
                    let make: fn(usize) -> $held = $make;
                    all.push(JointModification::$variant(make(joints)));
                })?)*
                all
            }
        }
    };
}

modifications! {
    /// Networks that correct position targets.
    ActionDelta(ActionDelta<K>);

    /// Networks that add torques.
    ResidAct(ResidAct<K>);

    /// Gears with play and compliance between motors and links.
    Gears(Gears) if gears: ["play", "compliance"], |joints| Gears { joints };

    /// Joint velocities as slow sensors read them.
    VelocityFilter(VelocityFilter) if filter: ["velocity_lag"], |joints| VelocityFilter { joints };

    /// What a late inertial unit reads.
    LateImu(LateImu) if late_imu: ["imu_delay"], |_| LateImu;
}

impl Parts {
    /// Those that at least one of these robots has.
    pub fn from_params<'a>(robots: impl IntoIterator<Item = &'a Params<f64>>) -> Self {
        let mut all = Self::default();
        for robot in robots {
            robot.visit(|slot, &number| {
                if number != 0.0 {
                    all.add(slot.name);
                }
            });
        }
        all
    }
}

/// Numbers that all of `modifications` remember of an environment together.
pub fn memory_of<K: Copy>(modifications: &[JointModification<K>]) -> usize {
    modifications.iter().map(Modify::memory).sum()
}

/// Where sensors with a memory are among all numbers that modifications remember. They come after all other modifications.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorPlaces {
    /// The first number of any sensor; all later ones are of sensors, too.
    pub begin: usize,
    /// What sensors read beyond the true velocity of the first joint; those of the other joints follow. Absent if sensors read
    /// true velocities.
    pub velocities: Option<usize>,
    /// What the inertial unit reads beyond the true orientation, followed by what it reads beyond the true angular velocity
    /// ([`IMU_READING`] numbers). Absent if it reads the present.
    pub imu: Option<usize>,
}

impl SensorPlaces {
    /// Those of `modifications`.
    pub fn new<K: Copy>(modifications: &[JointModification<K>]) -> Self {
        // Without sensors that remember, `begin` is the end of the memory.
        let mut places = Self { begin: memory_of(modifications), velocities: None, imu: None };
        let mut place = 0;
        for one in modifications {
            let sensor = match one {
                JointModification::VelocityFilter(_) => Some(&mut places.velocities),
                JointModification::LateImu(_) => Some(&mut places.imu),
                _ => None,
            };
            if let Some(sensor) = sensor {
                *sensor = Some(place);
                places.begin = places.begin.min(place);
            }
            place += one.memory();
        }
        places
    }
}

/// What each number that `modifications` remember belongs to, and whether [`settle`] makes it 0.
pub(crate) fn memory_places<K: Copy>(modifications: &[JointModification<K>]) -> Vec<(Owner, bool)> {
    let places = |one: &JointModification<K>| {
        let zero = one.settles_at_zero();
        (0..one.memory()).map(|place| (one.memory_owner(place), zero)).collect::<Vec<_>>()
    };
    modifications.iter().flat_map(places).collect()
}

/// Calls `act` on each modification with its part of `memory`.
#[inline(always)]
pub(crate) fn for_each<K: Copy, T>(
    modifications: &[JointModification<K>],
    mut memory: &mut [T],
    mut act: impl FnMut(&JointModification<K>, &mut [T]),
) {
    for modification in modifications {
        let (part, rest) = memory.split_at_mut(modification.memory());
        act(modification, part);
        memory = rest;
    }
}

/// Writes the memory of robots that have been in this state for long.
pub fn settle<T: Real>(
    modifications: &[JointModification<T::K>],
    params: &Params<T>,
    state: &State<T>,
    memory: &mut [T],
) {
    for_each(modifications, memory, |modification, part| modification.settle(params, state, part));
}
