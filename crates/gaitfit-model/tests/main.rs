//! The tests of `gaitfit-model`: one program, one module for each subject.

mod ground;
mod hostile;
mod mujoco;
mod refuse;
mod robots;
mod templates;
mod terrain;
mod urdf;
mod work;
