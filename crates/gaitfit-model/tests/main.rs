//! The tests of `gaitfit-model`: one program, one module for each subject.

mod attach;
mod coupling;
mod free_joint;
mod ground;
mod hostile;
mod looks;
mod mend;
mod mujoco;
mod refuse;
mod replicate;
mod robots;
mod slides;
mod templates;
mod terrain;
mod urdf;
mod work;
