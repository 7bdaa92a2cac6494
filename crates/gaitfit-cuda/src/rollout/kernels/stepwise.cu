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

// New episodes for the environments that are `chosen`, as if each had ended in the present step.
KERNEL restart(
    const u32* chosen, const u32* control, float* state, float* report, float* memory, u32* steps, u32* fresh, float* command, float* last_action,
    float* feet, float* returns, float* ways FOLLOWING(float* turned)
) {
    __shared__ u32 begins[THREADS];
    __shared__ Placing placing;
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    bool inside = e < ENVIRONMENTS;
    bool begun = inside && chosen[e];
    begins[threadIdx.x] = begun ? 1 : 0;
    if (begun) {
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
    start_episodes(
        control, control[FIRST_STEP] + 1, begins, placing, state, report, memory, command, ways FOLLOWING(turned));
}

// What those that are `chosen` observe at the next step; the rows of others stay.
KERNEL observe_chosen(
    const u32* chosen, const u32* control, const float* state, const float* params, const float* memory, const u32* steps,
    const u32* fresh, const float* imu, const float* command, const float* last_action, float* past, float* critic_past,
    float* observation, float* critic_observation FOLLOWING(const float* turned)
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS || !chosen[e]) return;
    observe_environment(
        0, control, state, params, memory, steps, fresh, imu, command, last_action, past, critic_past, observation,
        critic_observation, e FOLLOWING(turned));
}

// The present step of those that are `chosen` belongs to no episode: it pays nothing and ends nothing.
KERNEL clear_step(const u32* chosen, float* reward, unsigned char* ends) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS || !chosen[e]) return;
    reward[e] = 0.0f;
    ends[e] = ends[ENDS_APART + e] = ends[2 * ENDS_APART + e] = 0;
}

// How all robots move: one array after another, a row an environment. Position of the base, m, its orientation, wxyz, its
// velocity in the world, m/s, its rates in the body's frame, rad/s, then positions (rad), velocities (rad/s) and torques (N m)
// of the joints that the policy moves. A thread a number.
KERNEL write_motion(const float* state, const float* params, const float* report, float* motion) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= ENVIRONMENTS * (13 + 3 * ACTIONS)) return;
    const u32 base_ends[4] = {3, 7, 10, 13};
    u32 first = 0;
    for (int part = 0; part < 7; part++) {
        u32 last = part < 4 ? base_ends[part] : 13 + (u32)(part - 3) * ACTIONS, width = last - first;
        if (i >= ENVIRONMENTS * last) {
            first = last;
            continue;
        }
        u32 place = i - ENVIRONMENTS * first, e = place / width;
        int k = (int)(place % width);
        Base base = base_of(state, e);
        motion[i] = part == 0   ? base.position[k]
                    : part == 1 ? base.quaternion[k]
                    : part == 2 ? base.linear[k]
                    : part == 3 ? base.angular[k]
                    : part == 4 ? joint_position(state, params, e, JOINT_OF[k])
                    : part == 5 ? joint_velocity(state, e, JOINT_OF[k])
                                : TORQUE(JOINT_OF[k]);
        return;
    }
}
