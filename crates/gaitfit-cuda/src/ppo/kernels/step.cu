// From the blocks' gradients to the next parameters.

// One step of Adam (Kingma and Ba 2015) on one parameter.
DEVICE float adam_step(float parameter, float gradient, float* first, float* second, const double* state) {
    float g = gradient * (float)state[FACTOR];
    *first += (float)(1.0 - 0.9) * (g - *first);
    *second += (float)(1.0 - 0.999) * (g * g - *second);
    return parameter - (float)state[RATE] * *first / (sqrtf(*second) / (float)state[CORRECTION] + 1e-8f);
}

// Looks at the minibatch's sums, moves the learning rate, limits the gradient's norm, steps ln sigma. For one block.
DEVICE void finish(
    u32 epoch, u32 minibatch, u32 rows, u32 reduce_blocks, const u32* control, const volatile double* squares, float* parameters, float* gradient, float* moments,
    const float* old_log_std, float* constants, double* state, u32 memory_blocks, const double* memory_squares
) {
    __shared__ double totals[LOSSES + ACTIONS], corrections[2];
    __shared__ int fault;
    if (state[FAULT] != 0.0) return;
    bool critic_alone = control[CRITIC_ALONE], learn_std = LEARN_STD && !critic_alone;
    double of_actor = 0.0, of_critic = 0.0;
    for (u32 b = threadIdx.x; b < reduce_blocks; b += blockDim.x) {
        of_actor += squares[b];
        of_critic += squares[reduce_blocks + b];
    }
    for (u32 b = threadIdx.x; b < memory_blocks; b += blockDim.x) {
        of_actor += memory_squares[b];
        of_critic += memory_squares[memory_blocks + b];
    }
    of_actor = block_sum(of_actor);
    of_critic = block_sum(of_critic);
    // The corrections of Adam's moments, meanwhile.
    double t = state[STEPS] + 1.0;
    if (threadIdx.x == blockDim.x - 1) corrections[0] = 1.0 - pow(0.9, t);
    if (threadIdx.x == blockDim.x - 33) corrections[1] = sqrt(1.0 - pow(0.999, t));
    __syncthreads();
    for (u32 q = threadIdx.x; q < LOSSES + ACTIONS; q += blockDim.x) totals[q] = squares[2 * reduce_blocks + q];
    __syncthreads();
    const u32 first_std = ACTOR_PARAMETERS + CRITIC_PARAMETERS;
    float* log_std = parameters + first_std;
    if (threadIdx.x < ACTIONS)
        gradient[first_std + threadIdx.x] =
            learn_std ? (float)totals[LOSSES + threadIdx.x] - ENTROPY_COEFFICIENT : 0.0f;
    __syncthreads();
    if (threadIdx.x == 0) {
        double count = rows, kl = totals[DIVERGENCE] / count, of_std = 0.0, entropy = 0.0;
        for (u32 c = 0; c < ACTIONS; c++) {
            double g = gradient[first_std + c];
            of_std += g * g;
            entropy += (double)log_std[c] + HALF_LOG_TAU + 0.5;
        }
        double checked[6] = {totals[SURROGATE], totals[VALUE], kl, of_actor, of_critic, of_std};
        fault = 0;
        for (int k = 5; k >= 0; k--)
            if (!is_finite(checked[k])) fault = k + 1;
        if (fault) {
            state[FAULT] = fault, state[FAULT_EPOCH] = epoch, state[FAULT_MINIBATCH] = minibatch;
        } else {
            // Before the actor's first step the policy is the one that sampled: its divergence says nothing.
            bool unmoved = critic_alone || (epoch == 0 && minibatch == 0);
            double rate = state[LEARNING_RATE];
            if (ADAPTIVE && !unmoved) {
                if (kl > 2.0 * DESIRED_KL) rate = fmax(rate / 1.5, MIN_RATE);
                else if (kl < 0.5 * DESIRED_KL) rate = fmin(rate * 1.5, MAX_RATE);
            }
            double norm = sqrt(of_actor + of_critic + of_std);
            state[LEARNING_RATE] = rate;
            state[STEPS] = t;
            state[FACTOR] = fmin(MAX_GRADIENT_NORM / (norm + 1e-6), 1.0);
            state[RATE] = rate / corrections[0];
            state[CORRECTION] = corrections[1];
            state[POLICY_LOSS] += totals[SURROGATE] / count;
            state[VALUE_LOSS] += totals[VALUE] / count;
            state[ENTROPY] += entropy;
            state[KL] += kl;
            state[KL_LAST] = kl;
            state[K1] += totals[RATIO_K1] / count;
            state[K3] += totals[RATIO_K3] / count;
            state[CLIP_FRACTION] += totals[CLIPPED] / count;
            state[GRADIENT_NORM] += norm;
        }
    }
    __syncthreads();
    if (fault) return;
    if (learn_std && threadIdx.x < ACTIONS) {
        u32 i = first_std + threadIdx.x;
        parameters[i] = adam_step(parameters[i], gradient[i], &moments[i], &moments[PARAMETERS + i], state);
    }
    __syncthreads();
    policy_constants(log_std, old_log_std, constants, state);
}

// Adds up the blocks' sums of each loss, in order, into `totals`.
DEVICE void add_losses(u32 blocks, const double* sums, double* totals) {
    __shared__ double parts[8];
    // Eight threads a loss: one alone would wait for memory too often.
    for (u32 q = blockIdx.x; q < LOSSES + ACTIONS; q += gridDim.x) {
        if (threadIdx.x < 8) {
            double sum = 0.0;
#pragma unroll 8
            for (u32 b = threadIdx.x; b < blocks; b += 8) sum += sums[b * (LOSSES + ACTIONS) + q];
            parts[threadIdx.x] = sum;
        }
        __syncthreads();
        if (threadIdx.x == 0) {
            double sum = 0.0;
            for (u32 part = 0; part < 8; part++) sum += parts[part];
            totals[q] = sum;
        }
        __syncthreads();
    }
}

// Adds up the blocks' parts of the derivative by parameter `i`, in order. `map`: where it lies in its network's gradient.
DEVICE float add_parts(
    u32 i, u32 actor_blocks, u32 critic_blocks, const u32* control, const float* partial, const u32* map
) {
    bool actor = i < ACTOR_PARAMETERS;
    u32 blocks = actor ? actor_blocks : critic_blocks, apart = actor ? ACTOR_GRADIENT : CRITIC_GRADIENT;
    const float* from = partial + (actor ? 0 : (u64)actor_blocks * ACTOR_GRADIENT) + map[i];
    float sum = 0.0f;
    if (!(actor && control[CRITIC_ALONE]))
#pragma unroll 16
        for (u32 b = 0; b < blocks; b++) sum += from[(u64)b * apart];
    return sum;
}

// Adds up the squares of the gradient, of which this thread has `sum`. `squares`: 2 x blocks of this launch, the sums of
// squares of the actor's and of the critic's part, and behind them the sums of the losses.
// The last block to be done, counted by `reduced`, finishes the step but for the networks' parameters.
DEVICE void finish_last(
    float sum, u32 epoch, u32 minibatch, u32 rows, const u32* control, float* gradient, double* squares, u32* reduced,
    float* parameters, float* moments, const float* old_log_std, float* constants, double* state, u32 memory_blocks,
    const double* memory_squares
) {
    __shared__ bool last;
    bool actor = blockIdx.x * blockDim.x + threadIdx.x < ACTOR_PARAMETERS;
    double square = (double)sum * sum;
    double of_actor = block_sum(actor ? square : 0.0), of_critic = block_sum(actor ? 0.0 : square);
    if (threadIdx.x == 0) {
        squares[blockIdx.x] = of_actor, squares[gridDim.x + blockIdx.x] = of_critic;
        __threadfence();
        last = atomicAdd(reduced, 1u) + 1 == gridDim.x;
        if (last) *reduced = 0;
    }
    __syncthreads();
    if (!last) return;
    __threadfence();
    finish(
        epoch, minibatch, rows, gridDim.x, control, squares, parameters, gradient, moments, old_log_std, constants, state,
        memory_blocks, memory_squares);
}

// The gradient of a minibatch on one GPU, and the rest of the step but for the networks' parameters.
KERNEL reduce(
    u32 epoch, u32 minibatch, u32 rows, u32 actor_blocks, u32 critic_blocks, const u32* control, const float* partial,
    const u32* map, float* gradient, double* squares, u32* reduced, const double* sums, float* parameters, float* moments,
    const float* old_log_std, float* constants, double* state
#if MEMORY
    , u32 memory_blocks, const double* memory_squares
#endif
) {
#if !MEMORY
    const u32 memory_blocks = 0;
    const double* memory_squares = nullptr;
#endif
    add_losses(actor_blocks + critic_blocks, sums, squares + 2 * gridDim.x);
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    float sum = 0.0f;
    if (i < ACTOR_PARAMETERS + CRITIC_PARAMETERS)
        gradient[i] = sum = add_parts(i, actor_blocks, critic_blocks, control, partial, map);
    finish_last(
        sum, epoch, minibatch, rows, control, gradient, squares, reduced, parameters, moments, old_log_std, constants, state,
        memory_blocks, memory_squares);
}

// Where a GPU's gradient begins behind its losses, and how many doubles both take.
#define SHARE_SIZE (LOSSES + ACTIONS + (ACTOR_PARAMETERS + CRITIC_PARAMETERS + 1) / 2)
#define GRADIENT_OF(share) ((float*)((share) + LOSSES + ACTIONS))

// Of several GPUs: this one's part of the losses and of the gradient.
KERNEL reduce_share(
    u32 actor_blocks, u32 critic_blocks, const u32* control, const float* partial, const u32* map, const double* sums,
    double* share
) {
    add_losses(actor_blocks + critic_blocks, sums, share);
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < ACTOR_PARAMETERS + CRITIC_PARAMETERS)
        GRADIENT_OF(share)[i] = add_parts(i, actor_blocks, critic_blocks, control, partial, map);
}

// As `reduce`, from the parts of all `count` GPUs, in their order.
KERNEL reduce_together(
    u32 epoch, u32 minibatch, u32 rows, u32 count, const u32* control, const double* shares, float* gradient,
    double* squares, u32* reduced, float* parameters, float* moments, const float* old_log_std, float* constants,
    double* state
#if MEMORY
    , u32 memory_blocks, const double* memory_squares
#endif
) {
#if !MEMORY
    const u32 memory_blocks = 0;
    const double* memory_squares = nullptr;
#endif
    if (blockIdx.x == 0)
        for (u32 q = threadIdx.x; q < LOSSES + ACTIONS; q += blockDim.x) {
            double total = 0.0;
            for (u32 c = 0; c < count; c++) total += shares[(u64)c * SHARE_SIZE + q];
            squares[2 * gridDim.x + q] = total;
        }
    __syncthreads();
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    float sum = 0.0f;
    if (i < ACTOR_PARAMETERS + CRITIC_PARAMETERS) {
        for (u32 c = 0; c < count; c++) sum += GRADIENT_OF(shares + (u64)c * SHARE_SIZE)[i];
        gradient[i] = sum;
    }
    finish_last(
        sum, epoch, minibatch, rows, control, gradient, squares, reduced, parameters, moments, old_log_std, constants, state,
        memory_blocks, memory_squares);
}

// Steps the networks' parameters and renews both copies of each. `forth`, `back`: where they lie; a parameter without a
// place has none. `alone`: take no step, only copy.
KERNEL adam(
    u32 alone, const u32* control, const double* state, const u32* forth, const u32* back, const float* gradient,
    float* moments, float* parameters, float* packed
) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= ACTOR_PARAMETERS + CRITIC_PARAMETERS) return;
    bool actor = i < ACTOR_PARAMETERS;
    if (!alone) {
        if (state[FAULT] != 0.0 || (actor && control[CRITIC_ALONE])) return;
        parameters[i] = adam_step(parameters[i], gradient[i], &moments[i], &moments[PARAMETERS + i], state);
    }
    // A bias is added in full precision.
    float* own = packed + (actor ? 0 : ACTOR_PACKED);
    float x = parameters[i];
    if (back[i] == 0xFFFFFFFFu) own[forth[i]] = x;
    else ((Number*)own)[forth[i]] = ((Number*)own)[back[i]] = rounded(x);
}
