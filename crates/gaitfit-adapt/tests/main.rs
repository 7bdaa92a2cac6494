//! The tests of `gaitfit-adapt`: one program, one module for each subject.

mod cmaes_functions;
mod cmaes_resume;
mod cmaes_traces;
mod cost_oracle;
mod fit;
mod ground;
mod indirect;
mod least_squares;
mod pieces;
mod regression;
mod simulator;
mod theta_file;
