//! The trainings of `gaitfit init --train`: first each guess, then more iterations of the one that is nearest to walking.

use super::{Files, write_configuration};
use crate::cli::{Devices, Init};
use crate::exit::Failure;
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output};
use gaitfit::device::Device;
use gaitfit::evaluate::{Evaluated, GroundChoice};
use gaitfit::init::{Look, Prepared, other_guesses};
use gaitfit::settings::{self, TrainConfig};
use gaitfit::world::WorldSettings;
use gaitfit::{EvaluateSettings, train};
use gaitfit_model::argument;
use gaitfit_physics::Preset;
use serde::Serialize;
use std::cmp::Ordering;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// One training.
#[derive(Serialize)]
pub(super) struct Training {
    /// Number of the guess, from 1.
    guess: usize,
    /// Its gains.
    gains: String,
    /// Iterations of its policy since its first training began.
    iterations: u32,
    /// Mean reward of a control step at the end; absent where no seed was trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    reward: Option<f64>,
    /// How far its policy is from walking (`shortfall` of the verdict of `evaluate`); absent without an evaluation.
    #[serde(skip_serializing_if = "Option::is_none")]
    shortfall: Option<f64>,
    /// Whether its policy walks.
    pub(super) walks: bool,
    /// Why not, or where the policy is.
    result: String,
    #[serde(skip)]
    pub(super) policy: Option<String>,
    /// Name of the run.
    #[serde(skip)]
    name: String,
    /// How long it took, evaluation included.
    #[serde(skip)]
    took: Duration,
}

impl Training {
    /// Orders trainings: one that walks last; else the nearer to walking, the later; without an evaluation, the higher the
    /// reward.
    fn order(&self, other: &Self) -> Ordering {
        // Without an evaluation the training itself showed that nothing was learnt, so it is the farthest.
        let nearness = |one: &Self| -one.shortfall.unwrap_or(f64::INFINITY);
        // `total_cmp` puts NaN above all numbers, so a diverged training would win.
        let reward = |one: &Self| one.reward.filter(|reward| reward.is_finite()).unwrap_or(f64::NEG_INFINITY);
        let by_reward = || reward(self).total_cmp(&reward(other));
        let by_walks = self.walks.cmp(&other.walks);
        by_walks.then(nearness(self).total_cmp(&nearness(other))).then_with(by_reward)
    }
}

/// The last training of the guess that is nearest to walking after its last training.
fn nearest(trainings: &[Training]) -> Option<&Training> {
    let is_last = |one: &&Training| {
        !trainings.iter().any(|other| other.guess == one.guess && other.iterations > one.iterations)
    };
    trainings.iter().filter(is_last).max_by(|a, b| a.order(b))
}

/// Whether a guess was trained further. The first training of each guess has as many iterations as the others.
fn was_continued(trainings: &[Training]) -> bool {
    trainings.iter().any(|training| training.iterations > trainings[0].iterations)
}

/// Trains the guesses one after the other until a policy walks. If none does, it trains the guess that is nearest to walking
/// further while there is time; if that makes it worse than another guess, the other is next. At the end the configuration has
/// the guess that walks or is nearest to walking; if no guess was trained further, the first one.
pub(super) fn train_guesses(
    args: &Init,
    files: &Files,
    prepared: &Prepared,
) -> Result<Vec<Training>, Failure> {
    interrupt::listen()?;
    let begun = Instant::now();
    let others = other_guesses(&prepared.model, &prepared.look);
    let looks: Vec<&Look> = std::iter::once(&prepared.look).chain(&others).collect();
    let mut trainings: Vec<Training> = Vec::new();
    // Every guess gets one round before any gets more.
    for (number, look) in looks.iter().enumerate() {
        output::note(&format!("guess {} of {}: {}", number + 1, looks.len(), gains(look)));
        let training = train_one(args, files, look, number + 1, None)?;
        let walks = training.walks;
        trainings.push(training);
        if walks {
            return Ok(trainings);
        }
    }
    // Each further training adds as many iterations as the first, so the time of the last one predicts it.
    let round = trainings.first().map_or(0, |first| first.iterations);
    while let Some(best) = nearest(&trainings)
        && !best.walks
        && is_time_for(args.minutes, begun.elapsed(), best.took)
    {
        let (guess, iterations) = (best.guess, best.iterations.saturating_add(round));
        output::note(&format!(
            "no policy walks yet: guess {guess}, the nearest to walking, is trained further, to {iterations} iterations \
             ({:.1} of {} minutes are over)",
            begun.elapsed().as_secs_f64() / 60.0,
            args.minutes
        ));
        let training = train_one(args, files, looks[guess - 1], guess, Some(iterations))?;
        trainings.push(training);
    }
    match nearest(&trainings).filter(|_| was_continued(&trainings)) {
        Some(best) => {
            write_configuration(args, files, &looks[best.guess - 1].with_iterations(best.iterations))?;
        }
        None => write_configuration(args, files, &prepared.look)?,
    }
    Ok(trainings)
}

/// Whether a training should end in time. `minutes`: the limit for all trainings; `since`: the time since the first one began;
/// `takes`: how long the training will take, by the last one.
fn is_time_for(minutes: f64, since: Duration, takes: Duration) -> bool {
    (since + takes).as_secs_f64() <= 60.0 * minutes
}

/// Trains a guess and evaluates its policy. `guess`: its number, from 1; `further`: the number of iterations up to which its last
/// training continues, or `None` for a training from the start.
fn train_one(
    args: &Init,
    files: &Files,
    look: &Look,
    guess: usize,
    further: Option<u32>,
) -> Result<Training, Failure> {
    let begun = Instant::now();
    let threads = args.threads.map_or_else(gaitfit::machine::threads, NonZeroUsize::get);
    // A training reads the file as `gaitfit train` would, so that both agree.
    write_configuration(args, files, look)?;
    let mut config: TrainConfig = settings::load(Some(&files.configuration), &args.set)?;
    let stem = files.configuration.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    // The same name for all trainings of a guess: the further ones resume the first one's run.
    let name = format!("{}-guess-{guess}", stem.unwrap_or_default());
    config.name = Some(name.clone());
    config.train.iterations = further.unwrap_or(config.train.iterations);
    let iterations = config.train.iterations;
    let devices = Devices::choose(args.device.clone(), None);
    let setup = train::setup(&config, &name, Some(&files.configuration), threads, &devices)?;
    output::devices(&setup.devices);
    let results =
        watched(crate::commands::train::LINES, |watch| train::train(&setup, further.is_some(), watch))?;
    let seed = results.seeds.first();
    let policy = seed.map(|seed| seed.policy.clone());
    // What the training itself shows as not learnt need not be evaluated.
    let Judged { walks, shortfall, result } = match (results.unlearnt(), &policy) {
        (None, Some(policy)) => judge(policy, &config, threads)?,
        (failed, _) => Judged { walks: false, shortfall: None, result: failed.unwrap_or_default() },
    };
    let (gains, reward, took) = (gains(look), seed.map(|seed| seed.reward), begun.elapsed());
    Ok(Training { guess, gains, iterations, reward, shortfall, walks, result, policy, name, took })
}

/// Number of trajectories with random commands that decide whether a policy walks.
const TRAJECTORIES: usize = 500;

/// What an evaluation says of a policy.
struct Judged {
    walks: bool,
    shortfall: Option<f64>,
    /// The evidence, in a sentence.
    result: String,
}

/// Whether a policy walks by the rule of `evaluate`. The evaluation has no exploration and no pushes, unlike the training.
fn judge(policy: &str, config: &TrainConfig, threads: usize) -> Result<Judged, Failure> {
    let settings = EvaluateSettings {
        world: WorldSettings {
            policy: PathBuf::from(policy),
            robot: None,
            lenient: config.lenient,
            task: None,
            theta: None,
            spring: Vec::new(),
            torque_noise: 0.0,
            randomised: false,
            // Not the preset of trainings: a policy that walks only with rough contacts must not pass.
            preset: Preset::Accurate,
            seed: 0,
            threads: NonZeroUsize::new(threads),
        },
        trajectories: TRAJECTORIES,
        seconds: None,
        drift: 0,
        drift_speeds: None,
        ground: GroundChoice::Flat,
        ground_robots: 1,
        // So few robots are done on the CPU before a GPU's program is compiled.
        device: Device::Cpu,
        // A diagnosis looks for another order of joints, and this policy was trained on this very robot.
        diagnose: false,
    };
    let Evaluated { verdict, measured, .. } =
        watched(Lines::Seconds(5), |watch| gaitfit::evaluate(&settings, watch))?;
    let shortfall =
        verdict.as_ref().map(|verdict| verdict.shortfall).filter(|shortfall| shortfall.is_finite());
    let (walks, text) = match verdict {
        Some(verdict) => (verdict.walks, verdict.text),
        // `evaluate` gives no verdict for a task without walking. The training has judged such a policy, so here it fails only if a
        // robot diverges.
        None => match measured.evaluation.divergence() {
            Some(why) => (false, why),
            None => (true, "no robot of its evaluation diverged".to_owned()),
        },
    };
    Ok(Judged { walks, shortfall, result: format!("{policy}: {text}") })
}

/// A guess's gains in words; empty if it has none.
fn gains(look: &Look) -> String {
    let gains = look.guesses.iter().find(|guess| guess.what == "gains");
    gains.map(|guess| guess.found.clone()).unwrap_or_default()
}

/// The message if no policy walks, with what to do. `configuration`: its file.
pub(super) fn remedy(args: &Init, trainings: &[Training], configuration: &Path) -> String {
    let written = configuration.display();
    let Some(best) = nearest(trainings).filter(|_| was_continued(trainings)) else {
        return format!(
            "no guess learned to walk in its training; {written} has the first one. Look at the stance in the page. Then \
             train longer: --minutes N trains the best guess further, --set train.iterations=N trains each guess longer"
        );
    };
    // A run that resumes needs a number above the one it has reached.
    let iterations = format!("train.iterations={}", best.iterations.saturating_mul(2));
    let sets = args.set.iter().chain([&iterations]).map(|set| argument(Path::new(set)));
    let sets: Vec<String> = sets.collect();
    let sets = sets.join(" --set ");
    format!(
        "no policy learned to walk; {written} has guess {}, the nearest to walking. Look at the stance in the page. To go \
         on with it: gaitfit train {} --name {} --resume --set {sets}",
        best.guess,
        argument(configuration),
        argument(Path::new(&best.name)),
    )
}

/// Each training in two lines, as the program prints them.
pub(super) fn tried(trainings: &[Training]) -> String {
    let line = |training: &Training| {
        let Training { guess, gains, iterations, result, .. } = training;
        format!("guess {guess}, {iterations} iterations: {gains}\n  {result}\n")
    };
    trainings.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::{Training, is_time_for, nearest, was_continued};
    use std::time::Duration;

    #[test]
    fn the_guess_that_is_nearest_to_walking_is_next() {
        let training = |guess, iterations, shortfall, reward| Training {
            guess,
            gains: String::new(),
            iterations,
            reward,
            shortfall,
            walks: false,
            result: String::new(),
            policy: None,
            name: String::new(),
            took: Duration::ZERO,
        };
        // By falls and error, not by the reward.
        let mut trainings =
            vec![training(1, 400, Some(1.5), Some(0.1)), training(2, 400, Some(4.8), Some(0.3))];
        assert_eq!(nearest(&trainings).map(|best| best.guess), Some(1));
        // Made worse, it gives way to the other.
        trainings.push(training(1, 800, Some(5.0), Some(0.2)));
        assert_eq!(nearest(&trainings).map(|best| best.guess), Some(2));
        // Without evaluations the reward decides; a guess with an evaluation comes first.
        let blind = vec![training(1, 1, None, Some(0.2)), training(2, 1, None, Some(0.3))];
        assert_eq!(nearest(&blind).map(|best| best.guess), Some(2));
        let mixed = vec![training(1, 1, Some(40.0), None), training(2, 1, None, Some(0.3))];
        assert_eq!(nearest(&mixed).map(|best| best.guess), Some(1));
        assert!(nearest(&[]).is_none());
        // A task without walking has no verdict: one whose robots do not diverge is done, whatever the rewards are.
        let done = Training { walks: true, ..training(1, 2, None, Some(0.1)) };
        let trainings = vec![training(1, 1, None, Some(0.1)), training(2, 1, None, Some(0.3)), done];
        assert_eq!(nearest(&trainings).map(|best| (best.guess, best.walks)), Some((1, true)));
        assert!(was_continued(&trainings) && !was_continued(&trainings[..2]));
    }

    #[test]
    fn a_training_begins_if_it_ends_in_time() {
        let [since, takes] = [100, 20].map(Duration::from_secs);
        assert!(is_time_for(2.0, since, takes));
        assert!(!is_time_for(1.99, since, takes));
        assert!(!is_time_for(0.0, since, takes));
    }
}
