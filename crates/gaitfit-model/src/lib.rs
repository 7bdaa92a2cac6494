//! Robot models: MJCF and URDF files compiled to a [`Model`], joints by name.
//!
//! [`read`] takes a path; [`Model::find_joint`] matches a log's joint names; [`Model::summary`] is what
//! `gaitfit inspect` shows. Numbers mean what they mean in MuJoCo 4.0: a file that is read gives the
//! masses, limits, contact parameters and orders that MuJoCo compiles from it.
//!
//! The engine simulates one robot: a tree of hinges and slides below one floating or fixed root, touching planes and, with
//! spheres and capsules, static boxes and height fields.
//! Whatever a file says beyond that and that would change the motion is refused with file, line and
//! column; read leniently ([`ReadOptions::lenient`]) it is dropped and listed in [`Model::dropped`]. A floating robot
//! without a floor gets one where [`ReadOptions::add_floor`] asks for it.
//!
//! | MJCF | |
//! | --- | --- |
//! | read | `compiler`, `option` with `flag`, `default` classes, `include`, `body`, `frame`, `replicate`, `attach`, `inertial`, `freejoint`, hinges, slides, `geom` (sphere, capsule, cylinder, box, plane; ellipsoids for mass alone), `site`, `pair`, `exclude`, `motor`, `position`, `velocity`, `general` without dynamics, `equality joint`, `key`, the tuple `velocity_limit`, the text `gaitfit_source` |
//! | read of `asset` | `hfield`: elevations, MuJoCo's binary files, PNG pictures |
//! | passed over | other assets, `visual`, `statistic`, `size`, other `custom` data, lights, cameras |
//! | listed | visual geoms, sensors, self-collision ([`Model::touching_itself`] chooses pairs of it) |
//! | refused | ball joints, other `equality`, `tendon`, plugins, colliding meshes, obstacles of other shapes, boxes and cylinders that may touch obstacles, actuators with state, fluid, `composite`, RK4 and `implicit` |
//!
//! | URDF | |
//! | --- | --- |
//! | read | links, inertials, box, sphere and cylinder collisions, revolute, continuous, prismatic and fixed joints, limits, dynamics, `mimic` |
//! | added | a ground plane z = 0, a motor on every joint that follows no other, MuJoCo's defaults |
//! | changed | a massless root link fixed to its only child or below a floating joint, impossible inertias of light fixed links; [`Model::changed`] says so |
//! | listed | collision meshes, transmissions, annotations of other simulators (`contact`, `gazebo`, `dont_collapse`, ...) |
//! | refused | planar joints, floating ones but at the root, unknown elements |
//!
//! A mending reading ([`ReadOptions::mend`]) gives links mass, and keeps what a robot looks
//! like ([`Model::outlines`], with the readers of [`mesh`]); [`Model::to_mjcf`] writes the result as a file of its own.
//! [`Model::looks`] are the meshes of the file, for pictures.

mod actuator;
mod attach;
mod attributes;
mod bodies;
pub mod builtin;
mod cholesky;
mod compile;
mod contact;
mod coupling;
mod defaults;
mod error;
mod floor;
mod geom;
mod inertia;
mod inertial;
mod joint;
mod joint_kind;
mod keyframes;
pub mod kinematics;
mod listing;
mod looks;
mod mend;
pub mod mesh;
mod mjcf;
mod model;
mod names;
mod options;
mod orientation;
mod outline;
mod pairs;
pub mod patterns;
mod picture;
mod read;
mod replicate;
mod root;
pub mod rotation;
mod scan;
mod self_contact;
mod servo;
mod shown;
mod site;
mod spec;
mod summary;
mod surface;
mod terrain;
mod uneven;
mod urdf;
mod write;
mod xml;

pub use cholesky::Cholesky;
pub use contact::MIN_FRICTION;
pub use error::{ModelError, Place};
pub use joint_kind::{JointAxis, JointKind};
pub use listing::LeftOut;
pub use looks::{Look, Looks, Source};
pub use model::*;
pub use options::GRAVITY;
pub use outline::{Form, MeshFile, Outline};
pub use read::{ReadOptions, read, read_mjcf_str, read_urdf_str};
pub use self_contact::{Parts, SelfContact, SelfContactError, SelfPair};
pub use shown::{
    argument, counted, escaped, listed, shown, shown_number, shown_path, shown_sentence, significant,
    with_decimals, with_meant,
};
pub use summary::*;
pub use surface::{LeaningField, Surface, SurfaceBlock, SurfaceField};
pub use terrain::{Ground, HeightField, Obstacle, ObstacleShape};
pub use write::WriteError;
