//! Content of a replay: robots as trees of bodies with simple shapes or meshes, and their motion by control steps.
//!
//! Lengths are in m, angles in rad, times in s; z is up. Quaternions are wxyz and need not be of unit length. The
//! page holds only base poses and joint angles: it computes the poses of bodies itself.

use serde::Serialize;

/// One page: robots that move side by side in the same time.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Replay {
    /// Heading.
    pub title: String,
    /// A sentence below the heading, e.g. which policy and simulator; may be empty.
    pub note: String,
    /// Time between frames, s.
    pub dt: f64,
    /// The robots, drawn side by side in this order.
    pub robots: Vec<ReplayRobot>,
}

/// One robot and its motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ReplayRobot {
    /// Label, e.g. `before` or the name of the policy.
    pub name: String,
    /// Bodies, parents before children; the first is the base and has no parent.
    pub bodies: Vec<Body>,
    /// Shapes that are drawn.
    pub geoms: Vec<Geom>,
    /// Meshes that geoms look like; robots of one page may have the same.
    pub meshes: Vec<Mesh>,
    /// Names of the feet, in the order of [`Frame::contacts`]; by convention FL, FR, RL, RR.
    pub feet: Vec<String>,
    /// The motion; robots of one page may have different numbers of frames.
    pub frames: Vec<Frame>,
    /// Uneven ground under it; without, the ground is flat at z = 0.
    pub ground: Option<Ground>,
}

/// Heights over a grid, drawn as a surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Ground {
    /// x and y of the first height, m.
    pub corner: [f64; 2],
    /// Distance of neighbouring heights, m.
    pub step: f64,
    /// Heights of a row along x.
    pub columns: usize,
    /// Heights, m: row by row from the lowest y, each from the lowest x.
    pub heights: Vec<f64>,
}

/// A rigid body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Body {
    /// Its name.
    pub name: String,
    /// Index of the body that carries it; none for the base.
    pub parent: Option<usize>,
    /// Origin in the parent's frame where the joint's position is zero, m; not used for the base.
    pub position: [f64; 3],
    /// Orientation in the parent's frame where the joint's position is zero, wxyz; not used for the base.
    pub quaternion: [f64; 4],
    /// The hinge or slide between parent and body; `None` if the body is fixed to its parent.
    pub joint: Option<Joint>,
}

/// A hinge or a slide.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// Axis in the body's frame; any length but zero.
    pub axis: [f64; 3],
    /// A point on the axis in the body's frame, m.
    pub anchor: [f64; 3],
    /// Index of its angle in [`Frame::joints`].
    pub index: usize,
    /// Whether it slides along its axis instead of turning about it: its position is in m.
    pub slides: bool,
}

/// A shape fixed to a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Geom {
    /// Index of the body that carries it.
    pub body: usize,
    /// Shape and size.
    pub shape: Shape,
    /// Its centre in the body's frame, m.
    pub position: [f64; 3],
    /// Its orientation in the body's frame, wxyz.
    pub quaternion: [f64; 4],
    /// Index in [`ReplayRobot::feet`] if it is a foot: feet light up while they touch the ground.
    pub foot: Option<usize>,
}

/// Triangles that share corners.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Mesh {
    /// Corners, m; their middle is near the origin.
    pub vertices: Vec<[f64; 3]>,
    /// Corners of each triangle.
    pub triangles: Vec<[u16; 3]>,
}

/// A shape about its own centre; axes of revolution are z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A box.
    Box {
        /// Half lengths of its edges, m.
        half: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// A cylinder.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Half of its length, m.
        half_length: f64,
    },
    /// A cylinder with half a ball on either end.
    Capsule {
        /// Radius, m.
        radius: f64,
        /// Half of the cylinder's length, without the ends, m.
        half_length: f64,
    },
    /// A mesh.
    Mesh {
        /// Index in [`ReplayRobot::meshes`].
        mesh: usize,
    },
}

/// One instant. Numbers that are not finite repeat the frame before.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Frame {
    /// Origin of the base in the world, m.
    pub base_position: [f64; 3],
    /// Orientation of the base in the world, wxyz.
    pub base_quaternion: [f64; 4],
    /// Joint angles, rad; [`Joint::index`] says whose.
    pub joints: Vec<f64>,
    /// Whether each foot touches the ground, in the order of [`ReplayRobot::feet`].
    pub contacts: Vec<bool>,
    /// Commanded velocity: forward and left (m/s), yaw rate (rad/s), in the base's heading frame.
    pub command: [f64; 3],
    /// Measured velocity, same frame and units. A robot without a finite velocity in any frame is shown without its
    /// command and velocity.
    pub velocity: [f64; 3],
}

impl Default for Body {
    fn default() -> Self {
        Body {
            name: String::new(),
            parent: None,
            position: [0.0; 3],
            quaternion: [1.0, 0.0, 0.0, 0.0],
            joint: None,
        }
    }
}
