//! Going on from given networks: the critic learns alone first, and normalisers only if they are asked to.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_learn::ppo::{Diagnostics, Learner, Settings, Widths, bench};
use gaitfit_policy::network::Normaliser;

const WIDTHS: Widths = Widths { observation: 9, critic_observation: 11, action: 3 };

fn settings(critic_warmup: Option<u32>) -> Settings {
    Settings {
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        fixed_std: Some(0.5),
        critic_warmup,
        ..Settings::default()
    }
}

fn update(learner: &mut Learner, iteration: u32) -> Diagnostics {
    let mut tiles = bench::synthetic(learner, 2, 40, 10, u64::from(iteration));
    learner.update(&mut tiles, iteration, 2).unwrap()
}

#[test]
fn the_critic_learns_alone_and_then_both() {
    let mut learner = Learner::new(settings(Some(2)), WIDTHS, 7).unwrap();
    let first = (learner.actor().clone(), learner.log_std().to_vec());
    let mut critic = learner.critic().clone();
    for iteration in 0..2 {
        let report = update(&mut learner, iteration);
        assert_eq!((learner.actor(), learner.log_std()), (&first.0, first.1.as_slice()));
        assert_ne!(*learner.critic(), critic);
        critic = learner.critic().clone();
        assert_eq!(report.learning_rate, learner.settings().learning_rate);
        assert!(report.kl == 0.0 && report.gradient_norm > 0.0, "{report:?}");
    }
    update(&mut learner, 2);
    assert_ne!(*learner.actor(), first.0);
    assert_eq!(learner.log_std(), first.1);
    // Fresh moments: those of one update, not of three.
    let mut fresh = Learner::new(settings(None), WIDTHS, 7).unwrap();
    update(&mut fresh, 0);
    assert_eq!(learner.scalars().steps, fresh.scalars().steps);
}

/// A critic far from its returns gets near them in the warm-up, which a clipped value loss would not let it.
#[test]
fn a_critic_far_off_is_not_held_by_the_clip() {
    let far = |critic_warmup| {
        let settings = Settings { learning_rate: 1e-2, epochs: 20, ..settings(critic_warmup) };
        let start = Learner::new(settings.clone(), WIDTHS, 7).unwrap();
        let mut critic = start.critic().clone();
        // The last number is the output's bias.
        *critic.parameters.last_mut().unwrap() = 5.0;
        let (actor, log_std) = (start.actor().clone(), start.log_std().to_vec());
        let mut learner = Learner::with_networks(settings, WIDTHS, 7, actor, critic, log_std).unwrap();
        // One update on samples with returns about 0, then the loss of the next.
        let mut tiles = bench::synthetic(&learner, 2, 40, 10, 1);
        for tile in &mut tiles {
            tile.reward.fill(0.0);
            tile.last_value.fill(0.0);
            tile.done.fill(1.0);
        }
        let mut again = tiles.clone();
        learner.update(&mut tiles, 0, 1).unwrap();
        learner.update(&mut again, 1, 1).unwrap().value_loss
    };
    let (free, clipped) = (far(Some(2)), far(None));
    assert!(free < 0.5 * clipped, "{free} {clipped}");
}

#[test]
fn given_normalisers_are_kept_and_learn_only_if_asked() {
    for normalise_observations in [false, true] {
        let settings = Settings { normalise_observations, ..settings(None) };
        let mut learner = Learner::new(settings, WIDTHS, 7).unwrap();
        let given = |width| Normaliser { mean: vec![0.3; width], variance: vec![2.0; width], count: 100.0 };
        learner.set_normalisers(Some(given(9)), Some(given(11))).unwrap();
        update(&mut learner, 0);
        let kept = learner.normaliser() == Some(&given(9)) && learner.critic_normaliser() == Some(&given(11));
        assert_eq!(kept, !normalise_observations);
    }
}
