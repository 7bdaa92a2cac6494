//! Everything a loop needs, read and checked before anything is written.

use crate::Error;
use crate::device::{Device, Devices};
use crate::evaluate::{self, Plan};
use crate::robot::Hold;
use crate::run::{Inputs, bound};
use crate::settings::{LOOP_FREE, LoopConfig, MAX_SEED, TargetConfig, TargetKind};
use crate::target::{self, Command, PolicyFiles, Robot, Simulated, Target};
use crate::walk::log_files;
use crate::world::{self, World, WorldSettings};
use crate::{collect, finetune, paths, policy_file, robot, robot_file, theta};
use gaitfit_adapt::ThetaFile;
use gaitfit_learn::task::TaskSettings;
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_policy_files::weights;
use std::path::{Path, PathBuf};

/// A loop.
pub struct Setup {
    /// Settings.
    pub config: LoopConfig,
    /// Where they were read, which relative paths may start from.
    pub config_path: PathBuf,
    /// The robot of the file.
    pub model: Model,
    /// Its file; the built-in Go2 without one.
    pub robot: Option<PathBuf>,
    /// The policy that walks at first.
    pub policy: Policy,
    /// As the program writes it.
    pub policy_bytes: Vec<u8>,
    /// The task that all policies are measured on: the first one's.
    pub task: TaskSettings,
    /// Logs of the first round, if the target does not record them.
    pub logs: Vec<PathBuf>,
    /// Simulated target: what is different there.
    pub truth: Option<ThetaFile>,
    /// The file of `controls.truth`.
    pub known: Option<PathBuf>,
    /// What the result depends on.
    pub inputs: Inputs,
    /// The program `gaitfit`, which runs robots.
    pub program: PathBuf,
    /// What fits and trains; several share a fit's candidates and a training's seeds.
    pub devices: Devices,
    /// Threads.
    pub threads: usize,
    /// Things to know before the loop.
    pub warnings: Vec<String>,
}

impl Setup {
    /// Reads policy and robot, finds the logs, and checks that settings fit them.
    pub fn open(mut config: LoopConfig, config_path: &Path, threads: usize) -> Result<Self, Error> {
        let mut files = Vec::new();
        // Every file that is found is one that the result depends on, so it is noted for the hashes.
        let mut find = |named: &str, what: &str| {
            let mut path = paths::find(named, what, config_path)?;
            // A policy may be named by the folder of its training.
            if what == "policy" {
                path = policy_file::find(&path)?.path;
            }
            files.push(path.clone());
            Ok::<_, Error>(path)
        };
        let policy_path = find(&config.policy, "policy")?;
        let mut robot = if config.robot.is_empty() { None } else { Some(find(&config.robot, "robot")?) };
        if let Some(theta) = config.target.as_ref().and_then(|target| target.theta.as_deref()) {
            find(theta, "target.theta")?;
        }
        let known = config.controls.truth.as_ref().map(|truth| find(&truth.theta, "controls.truth.theta"));
        let known = known.transpose()?;
        let mut logs = Vec::new();
        let mut doubts = Vec::new();
        if !config.logs.is_empty() {
            let (log_files, warnings) = log_files::find(&config.logs, config_path)?;
            doubts.extend(warnings);
            logs.extend(log_files.into_iter().map(|file| file.path));
            files.extend(logs.iter().cloned());
        }
        let policy = gaitfit_policy_files::read(&policy_path)?;
        // In one format, whatever the file was: policies of a loop are compared by their bytes.
        let policy_bytes = weights::write(&policy)?;
        // Without a robot of its own the loop takes that of the policy's training.
        if let (None, Some(recorded)) = (&robot, &policy.provenance.robot_file) {
            let (path, note) = robot_file::find(&policy_path, recorded, &policy.interface.robot)?;
            config.robot = path.display().to_string();
            config.lenient |= recorded.lenient;
            files.push(path.clone());
            doubts.extend(note);
            robot = Some(path);
        }
        let model = match &robot {
            Some(path) => robot::read(path, config.lenient, Hold::File)?,
            None => robot::go2()?,
        };
        doubts.extend(robot::remarks(&model));
        if let Some(why) = policy.untrainable() {
            // Said now, not after the fit.
            return Err(Error::failed(format!(
                "{}: the policy has {why}, which is not trained here, so a loop cannot train it further; `gaitfit fit` with the same \
                 configuration fits its logs alone",
                policy_path.display()
            )));
        }
        doubts.extend(policy.notes.iter().cloned());
        doubts.extend(policy.interface.other_robot(&model));
        if let Some(known) = &known {
            // Read now, not after an hour.
            theta::candidate(&theta::read(known)?, known, &model)?;
        }
        let truth = match &config.target {
            Some(target) if target.kind == TargetKind::Simulated => {
                let (truth, target_doubts) = target::truth(target, config_path, &model)?;
                doubts.extend(target_doubts);
                Some(truth)
            }
            _ => None,
        };
        // The run is bound to the settings that count and to its files, by their hashes.
        let resolved = config
            .resolved()
            .map_err(|error| Error::failed(format!("cannot write the configuration: {error}")))?;
        let bound = bound(resolved, &LOOP_FREE);
        let inputs = Inputs::new(files.iter().map(PathBuf::as_path), &model, &bound)?;
        let setup = Self {
            task: TaskSettings::default(),
            config_path: config_path.to_owned(),
            config,
            model,
            robot,
            policy,
            policy_bytes,
            logs,
            truth,
            known,
            inputs,
            threads,
            program: PathBuf::from("gaitfit"),
            devices: Device::Cpu.into(),
            warnings: doubts,
        };
        // The task needs the rest of the setup, so it is filled in afterwards.
        let task = world::task(&setup.world_arguments(None), &setup.policy)?;
        let setup = Self { task, ..setup };
        setup.check_lengths().map_err(|error| error.within(format!("{}:", config_path.display())))?;
        // All stages are checked now: a setting that does not fit would stop the loop hours later.
        let training = finetune::check(&setup.config.finetune, &setup.world_arguments(None), &setup.policy);
        training.map_err(|error| error.within(format!("{}: [finetune]", config_path.display())))?;
        setup.check_fit()?;
        setup.check_target()?;
        Ok(setup)
    }

    /// Refuses a target that cannot be made: a spring on no joint, a place to fill in that there is not. It is found now, not
    /// after an hour.
    fn check_target(&self) -> Result<(), Error> {
        let Some(target) = &self.config.target else { return Ok(()) };
        match self.target(target, PathBuf::new(), None)? {
            Target::Simulated(mut target) => {
                // The file of its numbers is written when the loop begins.
                target.arguments.theta = None;
                let policy = self.policy.clone();
                let [safetensors, onnx] = [PathBuf::new(), PathBuf::new()];
                let world = target.world(&PolicyFiles { name: String::new(), safetensors, onnx, policy });
                world.map_err(|error| error.within(format!("{}: [target]", self.config_path.display())))?;
            }
            Target::Robot(robot) => robot.check_person()?,
            // Its programs are checked when the loop begins, when `{python}` is known.
            Target::Command(_) => {}
        }
        Ok(())
    }

    /// Refuses trajectories shorter than the policy's control period, or more of them than can be.
    fn check_lengths(&self) -> Result<(), Error> {
        let period = self.policy.interface.control_dt;
        let evaluate = &self.config.evaluate;
        evaluate::check_speeds("`evaluate.drift_speeds`", evaluate.drift_speeds)?;
        evaluate::check_length("`evaluate.seconds`", evaluate.trajectories, evaluate.seconds, period)?;
        match &self.config.target {
            Some(target) => {
                collect::check_length("`target.seconds`", target.trajectories, target.seconds, period)
            }
            None => Ok(()),
        }
    }

    /// Refuses parameters that the robot cannot have.
    fn check_fit(&self) -> Result<(), Error> {
        // Neither policy nor logs matter for whether the parameters fit the robot.
        let adapt = self.config.adapt(1, String::new(), Vec::new());
        let joints: Vec<String> = self.model.joints.iter().map(|joint| joint.name.clone()).collect();
        let theta = adapt
            .by_kind(&self.model)
            .and_then(|adapt| adapt.rules().theta(&adapt.groups(&joints), &joints, &vec![0.0; joints.len()]));
        theta
            .map(|_| ())
            .map_err(|error| Error::settings(format!("{}: [adapt] {error}", self.config_path.display())))
    }

    /// The robot. `theta`: where a simulated one's numbers were written; `python`: the one that runs a command.
    pub fn target(
        &self,
        target: &TargetConfig,
        theta: PathBuf,
        python: Option<&str>,
    ) -> Result<Target, Error> {
        match target.kind {
            TargetKind::Simulated => {
                // Such a cost compares the base's state, which only a simulated robot can log.
                let privileged = self.config.adapt.costs.iter().any(|cost| cost.is_privileged());
                Ok(Target::Simulated(Box::new(Simulated::new(
                    &self.config,
                    target,
                    self.robot.clone(),
                    theta,
                    self.task.clone(),
                    privileged,
                    self.threads,
                    // The few logs of a common loop are the CPU's, whatever fits and trains.
                    self.devices.first().as_found().for_trajectories(target.trajectories),
                ))))
            }
            TargetKind::Command => Command::new(target, python)
                .map(Target::Command)
                .map_err(|wrong| Error::settings(format!("{}: {wrong}", self.config_path.display()))),
            TargetKind::Robot | TargetKind::SimulatedGo2 => {
                Ok(Target::Robot(Robot::new(target, &self.program)))
            }
        }
    }

    /// The robot of the file with fitted parameters.
    pub fn world_arguments(&self, theta: Option<PathBuf>) -> WorldSettings {
        WorldSettings {
            policy: PathBuf::new(),
            robot: self.robot.clone(),
            lenient: self.config.lenient,
            task: None,
            theta,
            spring: Vec::new(),
            torque_noise: 0.0,
            randomised: false,
            preset: self.config.evaluate.preset,
            seed: 0,
            threads: None,
        }
    }

    /// A policy in a fitted simulator, whose forces act as late as in the fit.
    pub fn adapted(&self, policy: &PolicyFiles, theta: PathBuf) -> Result<World, Error> {
        self.world(&policy.policy, &self.world_arguments(Some(theta)))
    }

    /// A policy in a simulator like that of the fits, of a robot that these settings describe.
    pub fn world(&self, policy: &Policy, arguments: &WorldSettings) -> Result<World, Error> {
        // Without the noise, pushes and random robots of the training: policies are measured on the same robot.
        let mut task = self.task.calm();
        task.robot_timestep = self.config.adapt.simulation.robot_timestep.or(task.robot_timestep);
        if let Some(chosen) = &self.config.adapt.simulation.self_contact {
            task.self_contact = chosen.clone();
        }
        World::with_task(arguments, policy.clone(), task)
    }

    /// By what the best policy is chosen: as many other trajectories.
    pub fn choice(&self) -> Plan {
        let plan = self.plan();
        // The largest seed that TOML can hold has no next one.
        let seed = if plan.seed == MAX_SEED { 0 } else { plan.seed + 1 };
        Plan { seed, drift: 0, ..plan }
    }

    /// Plan of the measurement of every policy.
    pub fn plan(&self) -> Plan {
        let evaluate = &self.config.evaluate;
        Plan {
            trajectories: evaluate.trajectories,
            seconds: evaluate.seconds,
            drift: evaluate.drift,
            drift_speeds: evaluate.drift_speeds,
            seed: evaluate.seed,
            threads: self.threads,
            // Policies are compared on the same numbers, wherever they were trained.
            device: Device::Cpu,
        }
    }

    /// By what the policy of several trainings is chosen, in the simulator where they were trained: more of the
    /// trajectories that nothing is reported of.
    pub fn choice_of_trainings(&self) -> Plan {
        let plan = self.choice();
        // With few trajectories chance would choose.
        Plan { trajectories: plan.trajectories.max(256), ..plan }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings;

    #[test]
    fn policies_are_measured_in_the_simulation_that_the_robot_was_fitted_in() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folder = tempfile::tempdir().unwrap();
        let (config, theta) = (folder.path().join("l.toml"), folder.path().join("theta.toml"));
        let policy = root.join("assets/go2-walk.safetensors");
        std::fs::write(
            &config,
            format!("policy = {:?}\n[target]\nkind = \"simulated\"\n", policy.display().to_string()),
        )
        .unwrap();
        std::fs::write(&theta, "format = 2\n").unwrap();
        let fitted = |sets: &[&str]| {
            let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
            let setup = Setup::open(settings::load(Some(&config), &sets).unwrap(), &config, 1).unwrap();
            let [safetensors, onnx] = [PathBuf::new(), PathBuf::new()];
            let policy = PolicyFiles { name: String::new(), safetensors, onnx, policy: setup.policy.clone() };
            setup.adapted(&policy, theta.clone()).unwrap().scene
        };
        let scene = fitted(&["adapt.simulation.robot_timestep=0.001"]);
        assert_eq!(scene.settings.robot_timestep, Some(0.001));
        let scene = fitted(&["adapt.simulation.self_contact=[['*_foot', '*_foot']]"]);
        assert_eq!(scene.walker.model().self_pairs.len(), 6);
        let scene = fitted(&[]);
        assert_eq!((scene.settings.robot_timestep, scene.walker.touches_itself()), (None, false));
    }
}
