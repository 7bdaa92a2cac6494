// Steps one by one, under actions from outside.

// Reads actions where they lie. `refused`: the place of the first that is not finite, if one is.
KERNEL take_actions(const float* given, float* action, u32* refused) {
    u32 k = blockIdx.x * blockDim.x + threadIdx.x;
    if (k >= ENVIRONMENTS * ACTIONS) return;
    float wanted = given[k];
    action[k] = wanted;
    if (!is_finite(wanted)) atomicMin(refused, k);
}

// The next step's number.
KERNEL next_step(u32* control) {
    if (threadIdx.x == 0) control[FIRST_STEP] += 1;
}

// New episodes for all environments, as if each had ended in the present step.
KERNEL restart(
    const u32* control, float* state, float* report, float* memory, u32* steps, u32* fresh, float* command, float* last_action,
    float* feet, float* returns, float* ways
) {
    __shared__ u32 begins[THREADS];
    __shared__ Placing placing;
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    bool inside = e < ENVIRONMENTS;
    begins[threadIdx.x] = inside ? 1 : 0;
    if (inside) {
        forget_episode(fresh, last_action, feet, e);
        steps[e] = 0;
        returns[e] = returns[ENVIRONMENTS + e] = 0.0f;
#if COURSE
        u32 next = control[FIRST_STEP] + 1;
        if (next == 0) {
            // The very first episodes.
            WAY(WAY_LEVEL) = (float)any_level(control, e, next, DRAWN_LEVELS);
            WAY(WAY_WALKED) = WAY(WAY_COMMANDED) = 0.0f;
        } else {
            next_way(control, ways, e, next, base_of(state, e).position, false);
        }
#endif
    }
    start_episodes(control, control[FIRST_STEP] + 1, begins, placing, state, report, memory, command, ways);
}
