// Before the first minibatch: faulty numbers, constants of the policy, advantages.

// The first number of each array that is not finite: `first` holds its index, 0xFFFFFFFF if there is none. The arrays are
// the grid's second dimension; `observed` and `critic_observed` are widths.
KERNEL check_finite(
    u32 rows, u32 environments, u32 observed, u32 critic_observed, const float* observation, const float* critic_observation,
    const float* action, const float* mean, const float* log_probability, const float* value, const float* reward,
    const float* done, const float* last_value, u32* first
) {
    u32 array = blockIdx.y, width = array == 0 ? observed : array == 1 ? critic_observed : array < 4 ? ACTIONS : 1;
    const float* numbers = array == 0 ? observation : array == 1 ? critic_observation : array == 2 ? action
        : array == 3 ? mean : array == 4 ? log_probability : array == 5 ? value : array == 6 ? reward
        : array == 7 ? done : last_value;
    u32 count = (array == 8 ? environments : rows) * width, threads = gridDim.x * blockDim.x;
    for (u32 i = blockIdx.x * blockDim.x + threadIdx.x; i < count; i += 8 * threads) {
        float x[8];
        // All loads before the first use.
#pragma unroll
        for (u32 k = 0; k < 8; k++) x[k] = i + k * threads < count ? numbers[i + k * threads] : 0.0f;
#pragma unroll
        for (u32 k = 0; k < 8; k++)
            if (!is_finite(x[k])) atomicMin(&first[array], i + k * threads);
    }
}

// What the losses need of ln sigma: 1/sigma of each action, then sum(ln sigma + ln(2 pi)/2), then the KL divergence of
// equal means, sum(ln(sigma/sigma0) + sigma0^2/(2 sigma^2) - 1/2). For all threads of a block.
DEVICE void policy_constants(const float* log_std, const float* old_log_std, float* constants, double* state) {
    __shared__ double terms[2][ACTIONS];
    u32 c = threadIdx.x;
    if (c < ACTIONS) {
        double now = log_std[c], d = (double)old_log_std[c] - now;
        terms[0][c] = 0.5 * exp(2.0 * d) - d - 0.5;
        terms[1][c] = exp(now);
        constants[c] = (float)exp(-now);
    }
    __syncthreads();
    if (c != 0) return;
    double normaliser = 0.0, kl = 0.0, std = 0.0;
    for (u32 k = 0; k < ACTIONS; k++) {
        normaliser += (double)log_std[k] + HALF_LOG_TAU;
        kl += terms[0][k];
        std += terms[1][k];
    }
    constants[ACTIONS] = (float)normaliser;
    constants[ACTIONS + 1] = (float)kl;
    state[MEAN_STD] = std / ACTIONS;
}

// Starts an update: one block. `first` has `arrays` entries of check_finite.
KERNEL begin_update(
    const u32* control, const u32* first, u32 arrays, const float* parameters, float* moments, u32 size, float* old_log_std,
    float* constants, double* state, u32* reduced
) {
    bool faulty = false;
    for (u32 k = 0; k < arrays; k++) faulty |= first[k] != 0xFFFFFFFFu;
    if (threadIdx.x == 0) {
        *reduced = 0;
        state[FAULT] = faulty ? FAULT_SAMPLES : 0.0;
        for (int k = POLICY_LOSS; k < STATE_SIZE; k++) state[k] = 0.0;
    }
    if (faulty) return;
    if (control[RESET_MOMENTS]) {
        for (u32 i = threadIdx.x; i < 2 * size; i += blockDim.x) moments[i] = 0.0f;
        if (threadIdx.x == 0) state[STEPS] = 0.0;
    }
    const float* log_std = parameters + size - ACTIONS;
    if (threadIdx.x < ACTIONS) old_log_std[threadIdx.x] = log_std[threadIdx.x];
    policy_constants(log_std, log_std, constants, state);
}

// Generalised advantage estimation (Schulman et al. 2016), a thread an environment.
KERNEL gae(
    u32 steps, u32 environments, float gamma, float decay, const float* reward, const float* value, const float* done,
    const float* last_value, float* advantage, float* returns
) {
    u32 environment = blockIdx.x * blockDim.x + threadIdx.x;
    if (environment >= environments) return;
    float next_value = last_value[environment], next_advantage = 0.0f;
    for (u32 step = steps; step-- > 0;) {
        u32 i = step * environments + environment;
        float alive = 1.0f - done[i];
        float delta = reward[i] + gamma * alive * next_value - value[i];
        next_advantage = delta + decay * alive * next_advantage;
        next_value = value[i];
        advantage[i] = next_advantage;
        returns[i] = next_advantage + next_value;
    }
}

// Numbers of a GPU that all GPUs need before they can normalise: three means, three sums of squared differences, and
// whether its samples are faulty.
enum { MEANS, SQUARES = 3, FAULTY = 6, ADVANTAGE_NUMBERS };

// Means of advantages, returns and the values' errors over this GPU's rows, and sums of squares about them: one block of
// 1024 threads.
KERNEL advantages_share(
    u32 rows, const float* advantage, const float* returns, const float* value, const double* state, double* share
) {
    double sums[3] = {}, squares[3] = {}, means[3];
#pragma unroll 8
    for (u32 i = threadIdx.x; i < rows; i += blockDim.x) {
        sums[0] += advantage[i];
        sums[1] += returns[i];
        sums[2] += (double)returns[i] - (double)value[i];
    }
    for (int k = 0; k < 3; k++) means[k] = block_sum(sums[k]) / (double)rows;
#pragma unroll 8
    for (u32 i = threadIdx.x; i < rows; i += blockDim.x) {
        double a = advantage[i] - means[0], r = returns[i] - means[1];
        double e = (double)returns[i] - (double)value[i] - means[2];
        squares[0] += a * a;
        squares[1] += r * r;
        squares[2] += e * e;
    }
    for (int k = 0; k < 3; k++) squares[k] = block_sum(squares[k]);
    if (threadIdx.x != 0) return;
    for (int k = 0; k < 3; k++) share[MEANS + k] = means[k], share[SQUARES + k] = squares[k];
    share[FAULTY] = state[FAULT];
}

// As `advantages`, for this GPU's rows, from the numbers of all `count` GPUs, which have `rows` rows each.
KERNEL advantages_together(u32 rows, u32 normalise, u32 count, const double* shares, float* advantage, double* state) {
    double means[3] = {}, squares[3] = {}, faulty = 0.0;
    for (u32 c = 0; c < count; c++) {
        for (int k = 0; k < 3; k++) means[k] += shares[c * ADVANTAGE_NUMBERS + MEANS + k];
        faulty = fmax(faulty, shares[c * ADVANTAGE_NUMBERS + FAULTY]);
    }
    for (int k = 0; k < 3; k++) means[k] /= (double)count;
    for (u32 c = 0; c < count; c++)
        for (int k = 0; k < 3; k++) {
            double apart = shares[c * ADVANTAGE_NUMBERS + MEANS + k] - means[k];
            squares[k] += shares[c * ADVANTAGE_NUMBERS + SQUARES + k] + (double)rows * apart * apart;
        }
    if (blockIdx.x == 0 && threadIdx.x == 0) {
        state[FAULT] = faulty;
        state[EXPLAINED_VARIANCE] = squares[1] > 0.0 ? 1.0 - squares[2] / squares[1] : 0.0;
    }
    if (!normalise) return;
    double all = (double)count * (double)rows;
    double factor = 1.0 / (sqrt(squares[0] / (all > 1.0 ? all - 1.0 : 1.0)) + 1e-8);
    for (u32 i = blockIdx.x * blockDim.x + threadIdx.x; i < rows; i += gridDim.x * blockDim.x)
        advantage[i] = (float)((advantage[i] - means[0]) * factor);
}

// Explained variance, and advantages of mean 0 and deviation 1 if `normalise`: one block of 1024 threads.
KERNEL advantages(u32 rows, u32 normalise, float* advantage, const float* returns, const float* value, double* state) {
    double sum_a = 0.0, sum_r = 0.0, sum_e = 0.0;
#pragma unroll 8
    for (u32 i = threadIdx.x; i < rows; i += blockDim.x) {
        sum_a += advantage[i];
        sum_r += returns[i];
        sum_e += (double)returns[i] - (double)value[i];
    }
    double count = rows;
    double mean_a = block_sum(sum_a) / count, mean_r = block_sum(sum_r) / count, mean_e = block_sum(sum_e) / count;
    double square_a = 0.0, square_r = 0.0, square_e = 0.0;
#pragma unroll 8
    for (u32 i = threadIdx.x; i < rows; i += blockDim.x) {
        double a = advantage[i] - mean_a, r = returns[i] - mean_r;
        double e = (double)returns[i] - (double)value[i] - mean_e;
        square_a += a * a;
        square_r += r * r;
        square_e += e * e;
    }
    square_a = block_sum(square_a);
    square_r = block_sum(square_r);
    square_e = block_sum(square_e);
    if (threadIdx.x == 0) state[EXPLAINED_VARIANCE] = square_r > 0.0 ? 1.0 - square_e / square_r : 0.0;
    if (!normalise) return;
    double factor = 1.0 / (sqrt(square_a / (rows > 1 ? count - 1.0 : 1.0)) + 1e-8);
    for (u32 i = threadIdx.x; i < rows; i += blockDim.x) advantage[i] = (float)((advantage[i] - mean_a) * factor);
}
