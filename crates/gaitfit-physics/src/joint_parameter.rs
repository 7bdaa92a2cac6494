//! The one table of the step's parameters: those of joints, and numbers of the robot as a whole. [`Robot`](crate::Robot),
//! [`JointParams`](crate::JointParams), [`RobotParams`](crate::RobotParams) and what a fit may search of joints are made from
//! it: a new parameter is a row here, and its use in the step.

use gaitfit_model::{JointKind, Model};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Hands the table to the macro `$then`. A row: documentation, variant, field; unit; smallest value with a meaning;
/// value of joint `j` as the model has it; what a search takes by default (lower, upper, start, deviation), if a fit
/// may search it. Rows of `step` are fields of the step's parameters; rows of `factors` multiply one of these;
/// rows of `links` change the link that the joint moves. Rows of `robot` are numbers of the whole robot that the step
/// takes: documentation, field; smallest value, if others are refused; value of the model.
/// Every parameter may differ from one environment to the next.
macro_rules! joint_parameters {
    ($then:ident) => {
        $then! {
            step {
                /// Dry (Coulomb) friction torque, N·m.
                FrictionLoss frictionloss; "N·m"; 0.0; |model, j| model.joints[j].frictionloss;
                // Friction loss and armature: Dao and Fern's FricArm.
                Some((0.0, 0.5, 0.0, 0.1))

                /// Dry friction at rest above that in motion (`frictionloss`), N·m.
                Stiction stiction; "N·m"; 0.0; |_, _| 0.0;
                Some((0.0, 0.5, 0.0, 0.1))

                /// Velocity at which 1/e of `stiction` is left, rad/s (Stribeck velocity).
                StribeckVelocity stribeck_velocity; "rad/s"; 1e-3; |model, j| model.joints[j].kind.like("rad/s", 0.1);
                Some((0.01, 1.0, 0.1, 0.05))

                /// Dry friction that grows with load: N·m of friction for each N·m of the motor's torque.
                LoadFriction load_friction; "-"; 0.0; |_, _| 0.0;
                Some((0.0, 0.5, 0.0, 0.05))

                /// Play (backlash) between motor and link, rad: the whole width. Encoders are at the motor; so are the rotor's
                /// inertia, dry friction and damping.
                Play play; "rad"; 0.0; |_, _| 0.0;
                Some((0.0, 0.1, 0.0, 0.01))

                /// Compliance of the gear between motor and link, rad/(N·m): the inverse of its stiffness.
                Compliance compliance; "rad/(N·m)"; 0.0; |_, _| 0.0;
                Some((0.0, 0.02, 0.0, 0.002))

                /// Reflected rotor inertia, kg·m².
                Armature armature; "kg·m²"; 0.0; |model, j| model.joints[j].armature;
                Some((0.0, 0.5, 0.0, 0.05))

                /// Viscous damping, N·m·s/rad.
                Damping damping; "N·m·s/rad"; 0.0; |model, j| model.joints[j].damping;
                Some((0.0, 2.0, 0.0, 0.1))

                /// Time from a position target being sent to it acting, s.
                Delay delay; "s"; 0.0; |_, _| 0.0;
                Some((0.0, 0.1, 0.0, 0.01))

                /// Encoder reading minus true joint angle, rad.
                EncoderBias encoder_bias; "rad"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-0.1, 0.1, 0.0, 0.01))

                /// Delivered torque over commanded torque.
                TorqueScale torque_scale; "-"; 0.0; |_, _| 1.0;
                Some((0.5, 1.5, 1.0, 0.05))

                /// Constant torque added to the PD torque, N·m: weight, springs and cables that the model lacks.
                TorqueOffset torque_offset; "N·m"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-1.0, 1.0, 0.0, 0.1))

                /// Stiffness of a spring on the joint beside the model's own, N·m/rad.
                Stiffness stiffness; "N·m/rad"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-100.0, 400.0, 0.0, 2.0))

                /// Torque of that spring at angle 0, N·m: its stiffness times its rest angle.
                SpringTorque spring_torque; "N·m"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-800.0, 800.0, 0.0, 2.0))

                /// Position gain, N·m/rad.
                Kp kp; "N·m/rad"; 0.0; |_, _| 0.0;
                None

                /// Velocity gain, N·m·s/rad.
                Kd kd; "N·m·s/rad"; 0.0; |_, _| 0.0;
                None

                /// Largest torque magnitude, N·m.
                TorqueLimit torque_limit; "N·m"; 0.0; crate::joint_parameter::torque_limit;
                None

                /// Speed at which the motor's largest torque has fallen to 0, rad/s; infinite if it does not fall.
                NoLoadSpeed no_load_speed; "rad/s"; 1e-3; |_, _| f64::INFINITY;
                Some((5.0, 100.0, 30.0, 5.0))

                /// Largest torque at standstill on the line that falls to 0 at `no_load_speed`, N·m. It stands beside
                /// `torque_limit`: the smaller of the two holds.
                StallTorque stall_torque; "N·m"; 1e-3; crate::joint_parameter::torque_limit;
                Some((1.0, 200.0, 40.0, 5.0))
            }
            factors {
                /// True position gain over the stated one.
                KpScale kp_scale of kp; "-"; 0.0; |_, _| 1.0;
                Some((0.5, 2.0, 1.0, 0.1))

                /// True velocity gain over the stated one.
                KdScale kd_scale of kd; "-"; 0.0; |_, _| 1.0;
                Some((0.5, 2.0, 1.0, 0.1))
            }
            links {
                /// True mass and inertia of the link that the joint moves over the model's: the body with all that is
                /// welded to it.
                LinkMass link_mass; "-"; 1e-3; |_, _| 1.0;
                Some((0.5, 2.0, 1.0, 0.1))

                /// Shift of that link's centre of mass along x, m, axes of the joint's body.
                LinkComX link_com_x; "m"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-0.05, 0.05, 0.0, 0.01))

                /// The same along y; with the other sign on joints to the right of the base, so that mirrored legs share
                /// a value.
                LinkComY link_com_y; "m"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-0.05, 0.05, 0.0, 0.01))

                /// The same along z.
                LinkComZ link_com_z; "m"; f64::NEG_INFINITY; |_, _| 0.0;
                Some((-0.05, 0.05, 0.0, 0.01))
            }
            robot {
                /// Factor on all contact friction coefficients.
                friction_scale; None; 1.0

                /// By which part the time constant of the ground's contacts (MuJoCo's `solref`) is longer than the model's: 1
                /// for twice as long, which lets feet sink in four times as deep.
                ground_softness; None; 0.0

                /// Least impedance of the ground's contacts at first touch (the first number of MuJoCo's `solimp`): 0 leaves the
                /// model's. It ends at the second number.
                ground_impedance; None; 0.0

                /// Time constant of the filter through which sensors read joint velocities, s; 0 for none. The motion does
                /// not depend on it. See [`VelocityFilter`](crate::VelocityFilter).
                velocity_lag; Some(0.0); 0.0

                /// Age of the inertial unit's readings, s; 0 if they arrive at once. The motion does not depend on it. See
                /// [`LateImu`](crate::LateImu).
                imu_delay; Some(0.0); 0.0
            }
        }
    };
}
pub(crate) use joint_parameters;

/// What a search takes where nothing else is said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchDefaults {
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// First mean.
    pub start: f64,
    /// First standard deviation.
    pub deviation: f64,
}

macro_rules! define {
    (
        step { $($(#[doc = $doc:literal])* $variant:ident $field:ident; $unit:expr; $least:expr; $nominal:expr; $search:expr)* }
        factors { $($(#[doc = $fdoc:literal])* $fvariant:ident $ffield:ident of $of:ident; $funit:expr; $fleast:expr; $fnominal:expr; $fsearch:expr)* }
        links { $($(#[doc = $ldoc:literal])* $lvariant:ident $lfield:ident; $lunit:expr; $lleast:expr; $lnominal:expr; $lsearch:expr)* }
        robot { $($robot:tt)* }
    ) => {
        /// A parameter of a joint or of the PD controller that drives it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum JointParameter {
            $($(#[doc = $doc])* $variant,)*
            $($(#[doc = $fdoc])* $fvariant,)*
            $($(#[doc = $ldoc])* $lvariant,)*
        }

        impl JointParameter {
            /// Every one.
            pub const ALL: &[Self] = &[$(Self::$variant,)* $(Self::$fvariant,)* $(Self::$lvariant),*];

            /// Those that change the link that a joint moves.
            pub const LINKS: &[Self] = &[$(Self::$lvariant),*];

            /// Name in files, tables and code.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => stringify!($field),)*
                    $(Self::$fvariant => stringify!($ffield),)*
                    $(Self::$lvariant => stringify!($lfield),)*
                }
            }

            /// Unit for hinges, see [`JointKind::unit`]; `-` for a ratio.
            pub fn unit(self) -> &'static str {
                match self {
                    $(Self::$variant => $unit,)*
                    $(Self::$fvariant => $funit,)*
                    $(Self::$lvariant => $lunit,)*
                }
            }

            /// Smallest value with a meaning.
            pub fn least(self) -> f64 {
                match self {
                    $(Self::$variant => $least,)*
                    $(Self::$fvariant => $fleast,)*
                    $(Self::$lvariant => $lleast,)*
                }
            }

            /// What a fit's search takes by default; `None` if a fit does not search it.
            pub fn search(self) -> Option<SearchDefaults> {
                let range: Option<(f64, f64, f64, f64)> = match self {
                    $(Self::$variant => $search,)*
                    $(Self::$fvariant => $fsearch,)*
                    $(Self::$lvariant => $lsearch,)*
                };
                range.map(|(lower, upper, start, deviation)| SearchDefaults { lower, upper, start, deviation })
            }

            /// The same for joints of this kind, in their unit.
            pub fn search_of(self, kind: JointKind) -> Option<SearchDefaults> {
                let like = |value: f64| kind.like(self.unit(), value);
                self.search().map(|SearchDefaults { lower, upper, start, deviation }| SearchDefaults {
                    // In the unit of a slide the bound may fall below the smallest value that is allowed.
                    lower: like(lower).max(self.least()),
                    upper: like(upper),
                    start: like(start),
                    deviation: like(deviation),
                })
            }
        }
    };
}
joint_parameters!(define);

impl JointParameter {
    /// Those that a fit may search, in the order of tables.
    pub fn searched() -> impl Iterator<Item = Self> {
        Self::ALL.iter().copied().filter(|parameter| parameter.search().is_some())
    }
}

impl Serialize for JointParameter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// Reads the name of a parameter that a fit may search.
impl<'de> Deserialize<'de> for JointParameter {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        static NAMES: std::sync::LazyLock<Vec<&'static str>> =
            std::sync::LazyLock::new(|| JointParameter::searched().map(JointParameter::name).collect());
        let name = String::deserialize(deserializer)?;
        Self::searched()
            .find(|parameter| parameter.name() == name)
            .ok_or_else(|| serde::de::Error::unknown_variant(&name, &NAMES))
    }
}

/// Torque limit of joint `j`, what the joint and its actuators can give; infinite where nothing bounds it.
pub(crate) fn torque_limit(model: &Model, j: usize) -> f64 {
    model.effort(j).unwrap_or(f64::INFINITY)
}
