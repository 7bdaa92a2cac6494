// The policy's mean actions for a step's observations, ROWS robots of a block together.

// `observation` and `mean`: rows of all steps, of which those from `from` on are `environments` robots' of this step. `recurrent`:
// what the policy remembers of each robot.
KERNEL decide(u32 from, u32 environments, const float* network, const float* observation, float* recurrent, float* mean) {
    POOL(pool);
    float *first = pool, *second = first + WIDEST * ROWS, *kept = second + WIDEST * ROWS;
    u32 robot = blockIdx.x * ROWS;
    int rows = environments - robot < ROWS ? (int)(environments - robot) : ROWS, wide = (OBSERVATION + 3) / 4 * 4;
    const float* seen = observation + (u64)(from + robot) * OBSERVATION;
    // Neighbouring threads read neighbouring numbers of a robot.
    for (int i = threadIdx.x; i < wide * ROWS; i += blockDim.x) {
        int k = i % wide, r = i / wide;
        first[k * ROWS + r] = r < rows && k < OBSERVATION ? normalised(network, k, seen[r * OBSERVATION + k]) : 0.0f;
    }
    __syncthreads();
    const float* chosen = choose(network, recurrent + (u64)robot * POLICY_MEMORY, rows, first, second, kept);
    for (int i = threadIdx.x; i < ACTIONS * rows; i += blockDim.x) {
        int k = i % ACTIONS, r = i / ACTIONS;
        mean[(u64)(from + robot + r) * ACTIONS + k] = chosen[k * ROWS + r];
    }
}
