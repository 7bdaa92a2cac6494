//! Looks of marks: an ink, and whether the line is dashed, thin or faint.

use std::fmt;

/// The style sheet of all charts. Its colours are CSS variables with values for light and dark pages.
pub const STYLE: &str = include_str!("chart.css");

/// Colours of series that have no meaning of their own.
const COLORS: [&str; 8] = ["c0", "c1", "c2", "c3", "c4", "c5", "c6", "c7"];

/// The look of a series. It is shown as the classes of the style sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    ink: &'static str,
    mode: &'static str,
}

impl Look {
    /// Measurements of the robot.
    pub const MEASURED: Look = Look::ink("measured");
    /// Results of the fitted simulator.
    pub const FITTED: Look = Look::ink("fitted");
    /// Results of the simulator before the fit; dashed.
    pub const NOMINAL: Look = Look::ink("nominal");
    /// Targets and commands.
    pub const TARGET: Look = Look::ink("target");
    /// A mean over the other series.
    pub const MEAN: Look = Look::ink("mean");
    /// A limit; dashed.
    pub const LIMIT: Look = Look::ink("limit");
    /// A quiet fill.
    pub const AREA: Look = Look::ink("area");
    /// Where something is wrong; a light fill.
    pub const WRONG: Look = Look::ink("wrong");
    /// Where something is doubtful; a light fill.
    pub const DOUBTFUL: Look = Look::ink("doubtful");
    /// A box with something in it; a light fill.
    pub const CELL: Look = Look::ink("cell");
    /// The first of two things side by side.
    pub const FIRST: Look = Look::ink("first");
    /// The second of two things side by side.
    pub const SECOND: Look = Look::ink("second");

    /// A value that rests on a bound.
    pub(crate) const HIT: Look = Look::ink("hit");
    /// A value that is not determined; an empty circle.
    pub(crate) const OPEN: Look = Look::ink("open");

    /// One of eight colours that can be told apart, in turn.
    pub fn color(number: usize) -> Look {
        Look::ink(COLORS[number % COLORS.len()])
    }

    /// Returns the same ink with a dashed line.
    pub const fn dashed(self) -> Look {
        Look { mode: "dashed", ..self }
    }

    /// Returns the same ink with a thin line.
    pub const fn thin(self) -> Look {
        Look { mode: "thin", ..self }
    }

    /// Returns the same ink, hardly visible and not read out under the pointer.
    pub const fn faint(self) -> Look {
        Look { mode: "faint", ..self }
    }

    const fn ink(ink: &'static str) -> Look {
        Look { ink, mode: "" }
    }
}

impl Default for Look {
    fn default() -> Self {
        Look::color(0)
    }
}

impl fmt::Display for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.mode.is_empty() { f.write_str(self.ink) } else { write!(f, "{} {}", self.ink, self.mode) }
    }
}

impl serde::Serialize for Look {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}
