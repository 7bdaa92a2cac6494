// A control step of robots that walk under a policy, but for the physics: what is recorded, falls, resets, the
// observation, the action and its targets. The same as `gaitfit_policy::follow`.

// Dimensions of the signals: joint positions, velocities, actions, the base's position, its velocity. Logs also have the base's
// orientation and rates, as its inertial unit reads them.
#define IMU_AT (3 * ACTIONS + 6)
#define DIMENSIONS (IMU_AT + (MAKES_LOGS ? 7 : 0))
// Numbers of a logged state: those of the state up to the joint velocities.
#define LOGGED (13 + 2 * JOINTS)

// The number `k` of environment `e`'s state: the log's, without errors of its inertial unit; what a robot at rest in midst of
// nothing has of the rest.
DEVICE void place_number(float* state, const float* imu, const float* from, u32 e, int k) {
    STATE(k) = k < LOGGED ? true_number(imu, 1, from, k) : 0.0f;
}

DEVICE bool ends_here(const float* state, const float* report, u32 e) {
    float q[4], up[3], uprightness;
    for (int k = 0; k < 4; k++) q[k] = STATE(QUATERNION + k);
    up_of(q, up);
    uprightness_of(up, POSTURE, &uprightness);
    float place[3];
    for (int k = 0; k < 3; k++) place[k] = STATE(POSITION + k);
    bool ends = has_fallen(report, e, uprightness, place[2] - ground_under(place));
    // A diverged robot's numbers fail every comparison.
    for (int k = 0; k < 3; k++) ends |= !is_finite(place[k]);
    return ends;
}

#if FOLLOWS
// The place in the motion at a sample of a recording, or `earlier` samples before it. `numbers` of the sample: its
// time (s), and the angle (rad) by which the motion is turned for robots that are reset and for others.
DEVICE MotionPlace place_at(const double* numbers, u32 earlier, bool resets) {
    return {numbers[0] - (double)earlier * CONTROL_DT, numbers[resets ? 1 : 2]};
}
#endif

// Step `sample` of ROWS environments a block. `lengths`: samples of each recording, `samples` at most. `commands`, `states`,
// `actions`: the log's, recordings x samples x their width. `starts`: `each` states for every recording. `begins`: for each
// candidate, the number of its start among those `each`. `every`: for each candidate, the samples between resets, or 0.
// `imus`: for each candidate, errors of its inertial unit. `ends`: for each environment, the sample of its fall or the end.
// `recurrent`: what the policy remembers of each environment.
// For robots that make logs, `starts` has one state and `begins` one number for each environment. The number counts the samples
// that the robot walks under the first command before the recording begins.
// `motion_places`: recordings x samples x 3, as for `place_at`.
KERNEL walk(
    u32 sample, u32 count, u32 places, u32 recordings, u32 samples, u32 each, const u32* lengths, const float* commands,
    const float* starts, const u32* begins, const float* states, const float* actions, const u32* every, const float* imus,
    const float* network, const float* params, const float* report, float* state, float* targets, float* memory,
    float* last_action, float* past, float* recurrent, float* signals, u32* ends
    FOLLOWING(const double* motion_places)
) {
    POOL(pool);
    float *first = pool, *second = first + WIDEST * ROWS, *kept = second + WIDEST * ROWS;
    __shared__ u32 recording[ROWS], before[ROWS], length[ROWS];
    __shared__ bool placed[ROWS];
    __shared__ const float *logged[ROWS], *imu[ROWS];
    u32 from = blockIdx.x * ROWS;
    int rows = places - from < ROWS ? (int)(places - from) : ROWS;
    int thread = (int)threadIdx.x, threads = (int)blockDim.x;
    if (thread < rows) {
        u32 own = source_of(from + thread, count), of = own % recordings, period = every[own / recordings];
        imu[thread] = imus + (u64)(own / recordings) * IMU_NUMBERS;
        recording[thread] = of;
        before[thread] = MAKES_LOGS ? begins[own] : 0;
        length[thread] = before[thread] + lengths[of];
        bool reset = period > 0 && sample > 0 && sample % period == 0 && sample < lengths[of];
        placed[thread] = sample == 0 || reset;
        u64 start = MAKES_LOGS ? own : (u64)of * each + begins[own / recordings];
        logged[thread] = period > 0 ? states + ((u64)of * samples + sample) * LOGGED : starts + start * LOGGED;
    }
    __syncthreads();
    if (sample == 0) {
        for (int i = thread; i < rows * STATE_COUNT; i += threads)
            place_number(state, imu[i / STATE_COUNT], logged[i / STATE_COUNT], from + i / STATE_COUNT, i % STATE_COUNT);
        for (int r = 0; r < rows; r++) begin_sensors(memory, from + r, thread, threads);
        for (int i = thread; i < rows * ACTIONS; i += threads) last_action[(u64)from * ACTIONS + i] = 0.0f;
        for (int i = thread; i < rows * POLICY_MEMORY; i += threads) recurrent[(u64)from * POLICY_MEMORY + i] = 0.0f;
        if (thread < rows && from + thread < count) ends[from + thread] = length[thread] - before[thread];
        __syncthreads();
    }
    // What is recorded of the state that was reached.
    for (int i = thread; i < ROWS * (2 * ACTIONS + 2); i += threads) {
        int r = i % ROWS, k = i / ROWS;
        u32 e = from + r;
        if (r >= rows || e >= count || sample >= length[r]) continue;
        if (k > 2 * ACTIONS) {
            bool walks = sample > 0 && ends[e] == length[r] - before[r];
            if (walks && ends_here(state, report, e)) ends[e] = sample > before[r] ? sample - before[r] : 0;
            continue;
        }
        if (sample < before[r]) continue;
        float* row = signals + ((u64)e * samples + sample - before[r]) * DIMENSIONS;
        if (k < ACTIONS)
            row[k] = joint_position(state, params, e, JOINT_OF[k]);
        else if (k < 2 * ACTIONS)
            row[k] = read_velocity(state, memory, e, JOINT_OF[k - ACTIONS]);
        else {
            Base base = base_of(state, e);
            for (int axis = 0; axis < 3; axis++) {
                row[3 * ACTIONS + axis] = base.position[axis];
                row[3 * ACTIONS + 3 + axis] = base.linear[axis];
            }
#if MAKES_LOGS
            base = read_base(state, memory, e);
            for (int i = 0; i < 4; i++) row[IMU_AT + i] = attitude_number(imu[r], 1, base.quaternion, i);
            read_rates(imu[r], 1, base.angular);
            for (int i = 0; i < 3; i++) row[IMU_AT + 4 + i] = base.angular[i];
#endif
        }
    }
    __syncthreads();
    if (sample > 0) {
        for (int i = thread; i < rows * STATE_COUNT; i += threads)
            if (placed[i / STATE_COUNT])
                place_number(state, imu[i / STATE_COUNT], logged[i / STATE_COUNT], from + i / STATE_COUNT, i % STATE_COUNT);
        for (int r = 0; r < rows; r++)
            if (placed[r]) begin_sensors(memory, from + r, thread, threads);
        for (int i = thread; i < rows * ACTIONS; i += threads) {
            int r = i / ACTIONS;
            u64 last = (u64)recording[r] * samples + sample - 1;
            if (placed[r]) last_action[(u64)from * ACTIONS + i] = actions[last * ACTIONS + i % ACTIONS];
        }
        __syncthreads();
    }
    // Observations, four numbers of a term a thread, then in the order of the network. Neighbouring threads have the same term.
    for (int i = thread; i < ROWS * PARTS; i += threads) {
        int r = i % ROWS;
        if (r >= rows) continue;
        Part part = PART[i / ROWS];
        u32 e = from + r, last = length[r] - 1, here = sample < last ? sample : last;
        u32 now = here > before[r] ? here - before[r] : 0;
        const float* command = commands + ((u64)recording[r] * samples + now) * 3;
        write_term(
            part.term, part.from, part.from + 4, SCALES, nullptr, HAS_PAST && sample > 0 ? past + (u64)e * OBSERVATION : nullptr, state, params, memory, sample, imu[r], command,
            last_action + (u64)e * ACTIONS, 1, e, second + r * OBSERVATION
            FOLLOWING(place_at(
                motion_places + 3 * ((u64)recording[r] * samples + now), here < before[r] ? before[r] - here : 0,
                every[source_of(e, count) / recordings] > 0)));
    }
    __syncthreads();
    // For the frames of the next row.
    for (int i = thread; HAS_PAST && i < rows * OBSERVATION; i += threads) past[(u64)from * OBSERVATION + i] = second[i];
    for (int i = thread; i < ROWS * ((OBSERVATION + 3) / 4 * 4); i += threads) {
        int k = i / ROWS, r = i % ROWS;
        first[i] = r < rows && k < OBSERVATION ? normalised(network, k, second[r * OBSERVATION + k]) : 0.0f;
    }
    __syncthreads();
    const float* chosen = choose(network, recurrent + (u64)from * POLICY_MEMORY, rows, first, second, kept);
    for (int i = thread; i < ROWS * ACTIONS; i += threads) {
        int r = i % ROWS, k = i / ROWS;
        if (r >= rows) continue;
        u32 e = from + r;
        float wanted = chosen[k * ROWS + r];
        if (e < count && sample >= before[r] && sample < length[r])
            signals[((u64)e * samples + sample - before[r]) * DIMENSIONS + 2 * ACTIONS + k] = wanted;
        last_action[(u64)e * ACTIONS + k] = wanted;
        send_target(targets, e, JOINT_OF[k], target_of(k, wanted), placed[r]);
    }
    for (int i = thread; i < rows * OTHER_JOINTS; i += threads) {
        int r = i / (OTHER_JOINTS > 0 ? OTHER_JOINTS : 1), j = OTHER_JOINT[i % (OTHER_JOINTS > 0 ? OTHER_JOINTS : 1)];
        send_target(targets, from + r, j, DEFAULT_POSE[j], true);
    }
    // What networks remember of a robot that has been as it is for long.
    for (int i = thread; i < rows * MEMORY; i += threads) {
        int r = i / MEMORY, k = i % MEMORY;
        u32 e = from + r;
        if (placed[r]) REMEMBERED(k) = settled(state, params, e, k);
    }
}
