//! What can go wrong when a model is prepared for stepping.

/// Why a model cannot be stepped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhysicsError {
    /// An impedance curve too steep for single precision.
    #[error("{object}: solimp power {power} is not from 1 to 8; the default is 2")]
    ImpedancePower {
        /// What the curve belongs to.
        object: String,
        /// The power found.
        power: f64,
    },
    /// A contact dimension MuJoCo does not know.
    #[error("contact of geom `{geom}`: condim {condim} is not 1, 3, 4 or 6")]
    ContactDimension {
        /// The geom.
        geom: String,
        /// The dimension found.
        condim: u8,
    },
    /// Both limits of a joint would be active at once.
    #[error(
        "joint `{joint}`: its range is narrower than twice its limit margin, so both limits act at once; widen the range or lower the margin"
    )]
    NarrowRange {
        /// The joint.
        joint: String,
    },
    /// A number that is not finite or has the wrong sign.
    #[error("{object}: {quantity} is {value}; it must be {must}")]
    Value {
        /// What the number belongs to.
        object: String,
        /// Which number.
        quantity: &'static str,
        /// The value found.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A shape whose contact with an obstacle is not computed.
    #[error(
        "geom `{geom}` is a {shape} and may touch `{obstacle}`: only spheres and capsules touch boxes and height fields; use these, or a flat floor"
    )]
    ObstacleShape {
        /// The geom.
        geom: String,
        /// Its shape.
        shape: &'static str,
        /// The box or height field.
        obstacle: String,
    },
    /// Own parts whose contact is not computed.
    #[error(
        "{geom} and {other} cannot touch each other: spheres touch spheres, capsules and boxes, and capsules touch capsules; leave the pair out"
    )]
    SelfContactShapes {
        /// The first geom with its shape.
        geom: String,
        /// The second.
        other: String,
    },
    /// A ball larger than the cells of a height field allow.
    #[error(
        "geom `{geom}` has a radius of {radius} m and height field `{obstacle}` cells of {cell} m: cells must be at least twice the radius; take fewer rows and columns"
    )]
    FieldCells {
        /// The geom.
        geom: String,
        /// Its radius, m.
        radius: f64,
        /// The height field.
        obstacle: String,
        /// The shorter side of a cell, m.
        cell: f64,
    },
    /// A per-joint array of the wrong length.
    #[error("{what} has {found} entries; the robot needs {expected}")]
    Length {
        /// Which array.
        what: &'static str,
        /// Length found.
        found: usize,
        /// Length needed.
        expected: usize,
    },
}
