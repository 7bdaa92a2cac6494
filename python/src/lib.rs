//! What Python sees of gaitfit: the native half of the package `gaitfit`. The Python half gives it keyword arguments,
//! results and plots.

mod cma;
mod costs;
mod cuda_env;
mod dlpack;
mod errors;
mod forked;
mod logs;
mod observer;
mod own_policy;
mod own_simulator;
mod policy_file;
mod program;
mod settings;
mod share;
mod stages;
mod tables;
mod task;
mod terms;
mod vec_env;
mod vec_rows;
mod watch;

use pyo3::prelude::*;

#[pymodule]
mod _gaitfit {
    use super::*;

    #[pymodule_export]
    use super::cma::Cma;
    #[pymodule_export]
    use super::costs::wasserstein;
    #[pymodule_export]
    use super::cuda_env::{CudaRobots, robots_device};
    #[pymodule_export]
    use super::dlpack::{DeviceArray, DeviceInput};
    #[pymodule_export]
    use super::errors::{GaitfitError, Stopped};
    #[pymodule_export]
    use super::logs::{check_log, read_log, write_log};
    #[pymodule_export]
    use super::observer::Observer;
    #[pymodule_export]
    use super::own_policy::{interface_of, observation_width};
    #[pymodule_export]
    use super::own_simulator::fit_simulator;
    #[pymodule_export]
    use super::policy_file::PolicyFile;
    #[pymodule_export]
    use super::program::{explain, program, robot_numbers};
    #[pymodule_export]
    use super::settings::{read_toml, resolve_settings};
    #[pymodule_export]
    use super::share::Helper;
    #[pymodule_export]
    use super::stages::{
        adapt, adapt_plan, collect, compare, evaluate, finetune, finetune_plan, run_loop, train, train_plan,
        validate,
    };
    #[pymodule_export]
    use super::tables::{reproduce, reproduce_part, reproduce_plan};
    #[pymodule_export]
    use super::task::Task;
    #[pymodule_export]
    use super::vec_env::Robots;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // The class has None. An exception of a stage with a run folder has that folder.
        module.getattr("Stopped")?.setattr("run_folder", module.py().None())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
