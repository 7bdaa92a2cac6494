// What all kernels of the update share.

// Numbers in `state`, all f64.
enum {
    LEARNING_RATE,
    STEPS,
    // Of the minibatch's step: factor on the gradient, learning rate / (1 - beta1^t), sqrt(1 - beta2^t).
    FACTOR,
    RATE,
    CORRECTION,
    // 0, or 1 + what was not finite; FAULT_SAMPLES if the samples were not.
    FAULT,
    FAULT_EPOCH,
    FAULT_MINIBATCH,
    // Sums over the minibatches.
    POLICY_LOSS,
    VALUE_LOSS,
    ENTROPY,
    KL,
    KL_LAST,
    K1,
    K3,
    CLIP_FRACTION,
    GRADIENT_NORM,
    EXPLAINED_VARIANCE,
    MEAN_STD,
    STATE_SIZE
};
#define FAULT_SAMPLES 100.0

// Numbers in `control`, which the host writes before an update.
enum { ITERATION, CRITIC_ALONE, RESET_MOMENTS, SEED_LOW, SEED_HIGH, CONTROL_SIZE };

#define HALF_LOG_TAU 0.9189385332046728

KERNEL fill(u32* words, u32 count, u32 value) {
    for (u32 i = blockIdx.x * blockDim.x + threadIdx.x; i < count; i += gridDim.x * blockDim.x) words[i] = value;
}
