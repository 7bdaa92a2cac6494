// Actions drawn around the policy's means, the targets they ask for, and pushes.

KERNEL act(
    u32 step, const u32* control, const float* parameters, const float* mean, const u32* steps, u32* fresh, float* state,
    const float* params, float* targets, float* memory, float* action, float* log_probability
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS) return;
    u64 row = (u64)step * ENVIRONMENTS + e;
    u32 number = control[FIRST_STEP] + step;
    Draws exploration = draws_of(control, EXPLORATION_DRAWS, e, number);
    const float* log_std = parameters + LOG_STD_AT;
    float squares = 0.0f, logs = 0.0f;
    double pair[2];
    bool first = fresh[e] != 0;
    fresh[e] = 0;
    for (int k = 0; k < ACTIONS; k++) {
        if (k % 2 == 0) normal_pair(exploration, k / 2, pair);
        float z = (float)pair[k % 2], wanted = fmaf(expf(log_std[k]), z, mean[row * ACTIONS + k]);
        squares += z * z;
        logs += log_std[k];
        action[row * ACTIONS + k] = wanted;
        send_target(targets, e, JOINT_OF[k], target_of(k, wanted), first);
    }
    for (int k = 0; k < OTHER_JOINTS; k++) send_target(targets, e, OTHER_JOINT[k], DEFAULT_POSE[OTHER_JOINT[k]], true);
    for (int k = 0; k < MEMORY && first; k++) REMEMBERED(k) = settled(state, params, e, k);
    log_probability[row] = -0.5f * squares - (logs + 0.5f * (float)ACTIONS * LOG_TAU);
    // Robots are pushed at different times.
    if (PUSH_PERIOD > 0 && (number + (control[FIRST_ENVIRONMENT] + e) * 7u) % PUSH_PERIOD == 0 && steps[e] > 0) {
        Draws push = draws_of(control, PUSH_DRAWS, e, number);
        for (int k = 0; k < 2; k++) STATE(LINEAR + k) += (float)within(push, k, -PUSH_VELOCITY, PUSH_VELOCITY);
    }
}

// Random torques of all physics steps of a control period, a block column each. `deviation`: of each environment, N m;
// `tiles`: those of the physics.
KERNEL disturb(u32 step, u32 tiles, const u32* control, const double* deviation, float* disturbance) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS) return;
    u32 substep = blockIdx.y;
    Draws draws = draws_of(control, TORQUE_DRAWS, e, (control[FIRST_STEP] + step) * SUBSTEPS + substep);
    float* own = disturbance + (u64)substep * tiles * DISTURBANCE_SIZE;
    double pair[2];
    for (int j = 0; j < DISTURBED; j++) {
        if (j % 2 == 0) normal_pair(draws, j / 2, pair);
        at(own, DISTURBANCE_SIZE, DISTURBANCE_SPOTS[j], e) = (float)(deviation[e] * pair[j % 2]);
    }
}
