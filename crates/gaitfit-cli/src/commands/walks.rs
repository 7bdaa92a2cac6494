//! What a robot walks under: the commands asked for, within the ranges that the policy was trained for.

use crate::cli::Run;
use crate::exit::Failure;
use gaitfit::world::WorldSettings;
use gaitfit_learn::task::TaskSettings;
use gaitfit_policy::Policy;
use gaitfit_robot::RobotError;
use gaitfit_robot::run::Script;

/// Longest run, s.
const LONGEST: f64 = 3600.0;
/// Room for the rounding of decimal numbers, m/s or rad/s.
const ROUNDING: f64 = 1e-6;

/// The commands asked for.
///
/// # Errors
/// A policy that does not walk on four legs; commands beyond its training, where that is not allowed; times out of range,
/// by the name of the option that says them.
pub fn script(args: &Run, policy: &Policy) -> Result<Script, Failure> {
    let task = task(args, policy)?;
    // Gravity of a robot on four legs is along −z.
    if task.posture[2] > -0.9 {
        return Err(Failure::usage(format!(
            "{}: the policy does not walk on four legs (its task has posture = {:?}); `run` stands the robot up on four and \
             lies it down from there, so take a policy that walks on four, for example assets/go2-walk.safetensors",
            args.policy.display(),
            task.posture
        )));
    }
    let Some(path) = &args.commands else { return random(args, policy, &task) };
    let script = Script::read(path).map_err(Failure::usage)?;
    // Of a policy trained elsewhere the ranges are not known; the script's own limit holds.
    if !policy.provenance.task.is_empty() && !args.beyond_training {
        let names = ["vx", "vy", "wz"];
        for (part, range) in task.command.ranges(1.0).iter().enumerate() {
            let [low, high] = *range;
            let found = script.extremes()[part];
            if let Some(beyond) =
                found.into_iter().find(|speed| *speed < low - ROUNDING || *speed > high + ROUNDING)
            {
                return Err(Failure::usage(format!(
                    "{}: {} = {} is beyond what the policy was trained for, {low} to {high}; give commands within \
                     that, or try the file with --robot simulated and take --beyond-training",
                    path.display(),
                    names[part],
                    beyond as f32
                )));
            }
        }
    }
    Ok(script)
}

/// The policy's task.
fn task(args: &Run, policy: &Policy) -> Result<TaskSettings, Failure> {
    let world = WorldSettings {
        policy: args.policy.clone(),
        robot: None,
        lenient: false,
        task: None,
        theta: None,
        spring: Vec::new(),
        torque_noise: 0.0,
        randomised: false,
        preset: gaitfit_physics::Preset::Fast,
        seed: args.seed,
        threads: None,
    };
    Ok(gaitfit::world::task(&world, policy)?)
}

/// Random commands, drawn from the task.
fn random(args: &Run, policy: &Policy, task: &TaskSettings) -> Result<Script, Failure> {
    let seconds = args.random.unwrap_or_default();
    let option = if args.of_collect { "--seconds" } else { "--random" };
    if !(1.0..=LONGEST).contains(&seconds) {
        return Err(Failure::usage(format!("{option}: {seconds} s; give 1 to {LONGEST}")));
    }
    let dt = policy.interface.control_dt;
    let walk = |seed: u64| gaitfit_learn::task::commands(&task.command, dt, seed, seconds);
    let script = match args.trajectories {
        Some(count) => {
            let pause = args.link.pause;
            if !(0.5..=60.0).contains(&pause) {
                return Err(Failure::usage(format!("--pause: {pause} s; give 0.5 to 60")));
            }
            let most = ((LONGEST + pause) / (seconds + pause)).floor();
            if count.get() as f64 > most {
                return Err(Failure::usage(format!(
                    "--trajectories: {count} of {seconds} s ({option}) with pauses of {pause} s (--pause) take longer than an \
                     hour; give at most {most}"
                )));
            }
            let walks: Vec<_> = (0..count.get() as u64).map(|k| walk(args.seed.wrapping_add(k))).collect();
            Script::of_walks(&walks, pause)
        }
        None => Script::new(walk(args.seed)),
    };
    script.map_err(|error: RobotError| Failure::usage(error))
}
