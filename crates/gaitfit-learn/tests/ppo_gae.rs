//! Generalised advantage estimation, by hand.

use gaitfit_learn::ppo::{Samples, Widths};

#[test]
fn advantages_worked_by_hand() {
    // γ = λ = 0.5, so γλ = 0.25. Rewards 1, 2, 3, values 0.5, 1, 1.5, then 2, in both environments.
    let mut samples = Samples::new(3, 2, Widths { observation: 1, critic_observation: 1, action: 1 });
    samples.reward = vec![1.0, 1.0, 2.0, 2.0, 3.0, 3.0];
    samples.value = vec![0.5, 0.5, 1.0, 1.0, 1.5, 1.5];
    samples.last_value = vec![2.0, 2.0];
    // The second environment's episode ends with step 1.
    samples.done = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    samples.estimate_advantages(0.5, 0.5);
    // First:  δ₂ = 3 + 0.5·2 − 1.5 = 2.5             A₂ = 2.5
    //         δ₁ = 2 + 0.5·1.5 − 1 = 1.75            A₁ = 1.75 + 0.25·2.5 = 2.375
    //         δ₀ = 1 + 0.5·1 − 0.5 = 1               A₀ = 1 + 0.25·2.375 = 1.59375
    // Second: A₂ = 2.5; δ₁ = 2 − 1 = 1, A₁ = 1;      A₀ = 1 + 0.25·1 = 1.25
    assert_eq!(samples.advantage, [1.59375, 1.25, 2.375, 1.0, 2.5, 2.5]);
    assert_eq!(samples.returns, [2.09375, 1.75, 3.375, 2.0, 4.0, 4.0]);
}

#[test]
fn with_lambda_one_the_returns_are_the_discounted_rewards() {
    let mut samples = Samples::new(4, 1, Widths { observation: 1, critic_observation: 1, action: 1 });
    samples.reward = vec![1.0, -2.0, 4.0, 8.0];
    samples.value = vec![3.0, 1.0, -5.0, 2.0];
    samples.last_value = vec![16.0];
    samples.estimate_advantages(0.5, 1.0);
    // R₃ = 8 + 16/2 = 16, R₂ = 4 + 8 = 12, R₁ = −2 + 6 = 4, R₀ = 1 + 2 = 3.
    assert_eq!(samples.returns, [3.0, 4.0, 12.0, 16.0]);
}
