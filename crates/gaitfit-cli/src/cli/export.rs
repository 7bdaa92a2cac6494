//! Arguments of `export`.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `export`: those of a policy, of a log and of fitted parameters.
#[derive(Debug, Args)]
pub struct Export {
    /// Policy (.safetensors, .onnx, .toml, or the run folder of a training), log (.csv), or fitted parameters (the
    /// theta.toml of a fit)
    pub file: PathBuf,
    /// Policy: write the actor as an ONNX graph; its metadata describes observations, actions and gains
    #[arg(long, value_name = "FILE.onnx")]
    pub onnx: Option<PathBuf>,
    /// Policy: write actor, critic and interface in gaitfit's own format
    #[arg(long, value_name = "FILE.safetensors")]
    pub safetensors: Option<PathBuf>,
    /// Policy: write a folder for programs that run it without gaitfit: ONNX, controller.yaml for ROS 2, and
    /// deploy.yaml of unitree_rl_lab
    #[arg(long, value_name = "FOLDER")]
    pub bundle: Option<PathBuf>,
    /// Policy: write it as C++17 without dependencies: policy.hpp, which contains the network, and example.cpp
    #[arg(long, value_name = "FOLDER")]
    pub cpp: Option<PathBuf>,
    /// Policy: overwrite files of an earlier bundle or C++ folder
    #[arg(long)]
    pub force: bool,
    /// Log: MCAP file to write, for Foxglove and PlotJuggler. Parameters: folder for the files of MuJoCo, Isaac Lab and
    /// mjlab
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Robot (.xml, .mjcf, .urdf): the fitted one, or the one with the effort limits for bundle and C++ [default: that
    /// of the fit or of the policy's training, or the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Parameters: position gain of every joint's PD controller, N·m/rad
    #[arg(long, value_name = "KP", requires = "kd")]
    pub kp: Option<f64>,
    /// Parameters: velocity gain of every joint's PD controller, N·m·s/rad
    #[arg(long, value_name = "KD", requires = "kp")]
    pub kd: Option<f64>,
    /// Parameters: policy that states the PD gains
    #[arg(long, value_name = "POLICY", conflicts_with_all = ["kp", "kd"])]
    pub policy: Option<PathBuf>,
    /// Parameters: physics step of the other simulator, s; Isaac Lab and mjlab count delays in such steps [default: the
    /// fit's]
    #[arg(long, value_name = "SECONDS")]
    pub step: Option<f64>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
