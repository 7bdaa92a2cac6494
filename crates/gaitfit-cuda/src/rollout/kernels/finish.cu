// After a control period: feet, rewards, ends of episodes, new commands and new episodes.

// Sum `k` of environment `e`: the reward, then each reward term, then those of `Sum`.
#define TALLY(k) tally[(k) * ENVIRONMENTS + e]
#define FOOT(k, number) feet[(FOOT_SIZE * (k) + (number)) * ENVIRONMENTS + e]

enum { GOES_ON, FALL, TIME_OUT };

// The numbers of foot `k` at the end of a control period, and whether it landed.
DEVICE void advance_foot(const float* report, const float* feet, u32 e, u32 steps, int k, float foot[FOOT_SIZE + 1]) {
    float force = 0.0f, place[3], before[FOOT_SIZE];
    for (int i = FOOT_FIRST[k]; i < FOOT_FIRST[k + 1]; i++) force += FORCE(FOOT_GEOM[i]);
    for (int axis = 0; axis < 3; axis++) place[axis] = CENTRE(k, axis);
    for (int number = 0; number < FOOT_SIZE; number++) before[number] = FOOT(k, number);
    bool begins = steps <= 1;
#if COURSE
    // Episodes may begin in their midst, and far from the origin.
    bool fresh = true;
    for (int number = 0; number < FOOT_SIZE; number++) fresh &= before[number] == 0.0f;
    begins |= fresh;
#endif
    advanced_foot(before, force, place, (float)CONTROL_DT, flag(begins), foot);
}

// What is gone with an episode, besides its age.
DEVICE void forget_episode(u32* fresh, float* last_action, float* feet, u32 e) {
    fresh[e] = 1;
    for (int k = 0; k < ACTIONS; k++) last_action[k * ENVIRONMENTS + e] = 0.0f;
    for (int k = 0; k < FEET * FOOT_SIZE; k++) feet[k * ENVIRONMENTS + e] = 0.0f;
}

// New episodes from `step` on of those environments of the block that begin anew: all its threads share the work.
DEVICE void start_episodes(
    const u32* control, u32 step, const u32* begins, Placing& placing, float* state, float* report, float* memory,
    float* command, const float* ways FOLLOWING(float* turned)
) {
    __syncthreads();
    u32 any = 0;
#pragma unroll
    for (u32 k = 0; k < THREADS; k++) any |= begins[k];
    if (!any) return;
    for (u32 k = 0; k < THREADS; k++) {
        if (!begins[k]) continue;
        start_episode(
            control, blockIdx.x * THREADS + k, step, placing, state, report, memory, command, ways FOLLOWING(turned));
        __syncthreads();
    }
}

// Environment `e` at the end of a control period, `age` steps into its episode; whether its simulation is whole.
DEVICE bool write_moment(
    const float* state, const float* params, const float* report, const float* action, const float* command,
    const float* last_action, const float* feet, u32 age, u32 e, Moment& m
) {
    Base base = base_of(state, e);
    for (int k = 0; k < FEET; k++) advance_foot(report, feet, e, age, k, m.feet[k]);
    // Numbers that are none fail every comparison.
    float height = base.position[2] - ground_under(base.position);
    bool whole = is_finite(height);
    for (int k = 0; k < 3; k++) whole &= fabsf(base.linear[k]) <= FASTEST_BASE && fabsf(base.angular[k]) <= FASTEST_BASE;
    for (int k = 0; k < 4; k++) whole &= is_finite(base.quaternion[k]);
    for (int j = 0; j < JOINTS; j++) whole &= fabsf(joint_velocity(state, e, j)) <= FASTEST_JOINT;
    float numbers[9];
    for (int k = 0; k < 3; k++) m.command[k] = command[k * ENVIRONMENTS + e];
    base_moment(base.quaternion, base.linear, base.angular, m.command, POSTURE, numbers);
    for (int k = 0; k < 3; k++) m.velocity[k] = numbers[k], m.gravity[k] = numbers[3 + k], m.angular[k] = base.angular[k];
    m.yaw_rate = numbers[6], m.uprightness = numbers[7], m.walking = numbers[8] != 0.0f;
    m.height = height;
    m.clock = clock_of(age);
    m.fallen = has_fallen(report, e, m.uprightness, m.height);
    m.body_contacts = 0;
    for (int k = 0; k < BODY_GEOMS; k++) m.body_contacts += touches(report, e, BODY_GEOM[k]) ? 1 : 0;
    m.e = e, m.state = state, m.params = params, m.report = report;
    m.action = action, m.last_action = last_action;
    return whole;
}

// The sum of what the reward's terms pay environment `lane` of the block.
DEVICE float sum_of(const float terms[][THREADS], u32 lane) {
    float paid = 0.0f;
    for (int k = 0; k < REWARDS; k++) paid += terms[k][lane];
    return paid;
}

// Writes what `part` is responsible for: its sums of reward terms unless the step is broken; part 1 also the last action, part 2
// the feet.
DEVICE void keep_step(
    const Moment& m, const float terms[][THREADS], u32 part, u32 lane, bool broken, float* last_action, float* feet, double* tally
) {
    u32 e = m.e;
    // All sums are read first, so that the loads overlap.
    double sums[REWARDS / FINISH_PARTS + 1];
    for (int k = 0; k < REWARDS; k++)
        if (k % FINISH_PARTS == part) sums[k / FINISH_PARTS] = TALLY(1 + k);
    for (int k = 0; k < REWARDS; k++)
        if (k % FINISH_PARTS == part && !broken) TALLY(1 + k) = sums[k / FINISH_PARTS] + (double)terms[k][lane];
    if (part == 1 % FINISH_PARTS)
        for (int k = 0; k < ACTIONS; k++) last_action[k * ENVIRONMENTS + e] = m.action[k];
    if (part == 2 % FINISH_PARTS)
        for (int k = 0; k < FEET; k++)
            for (int number = 0; number < FOOT_SIZE; number++) FOOT(k, number) = m.feet[k][number];
}

// The rest of the step of an environment; whether a new episode begins. `held`: whether episodes that ended stay where they are.
DEVICE bool finish_step(
    u32 step, const u32* control, float* state, const float* params, float* report, float* reward, float* done, u32* steps,
    u32* fresh, float* command, float* last_action, float* feet, float* returns, u32* cut, float* tail, double* tally,
    float* errors, float* bases, unsigned char* ends, float* last_observation, const float* memory, const float* imu, float* ways,
    const float* past, const float* critic_past, const u32* held, const Moment& m, const float terms[][THREADS], u32 lane,
    u32 age, bool whole, bool broken FOLLOWING(const float* turned, float* motion_errors)
) {
    u32 e = m.e, number = control[FIRST_STEP] + step;
    u64 row = (u64)step * ENVIRONMENTS + e;
    float paid = sum_of(terms, lane);
    // What is added to is read before the first number is written, so that the loads overlap.
    float sum = returns[e], length = returns[ENVIRONMENTS + e] + 1.0f;
    double total_paid = TALLY(0), velocity_error = TALLY(VELOCITY_ERROR), yaw_error = TALLY(YAW_ERROR);
    bool over = age >= EPISODE_STEPS_MAX;
#if COURSE
    Base base = base_of(state, e);
    TALLY(LEVEL) += (double)WAY(WAY_LEVEL);
    if (whole) advance_way(ways, e, m.command, m.velocity);
    over |= is_outside(base.position);
#endif
    int ended = m.fallen || broken ? FALL : over ? TIME_OUT : GOES_ON;

    // Against the command of this step, not the one that is drawn for the next.
    float off[2];
    base_errors(m.velocity, m.yaw_rate, m.command, off);
    if (age % COMMAND_STEPS == 0) draw_command(control, e, number + 1, command);
    if (broken) {
        if (TALLY(DIVERGED) == 0.0) {
            TALLY(BROKEN_AT) = (double)(step + 1);
            for (int k = REWARDS - 1; k >= 0; k--)
                if (whole && !is_finite(terms[k][lane])) TALLY(BROKEN_TERM) = (double)(k + 1);
        }
        TALLY(DIVERGED) += 1.0;
        paid = 0.0f;
    } else {
        TALLY(0) = total_paid + (double)paid;
        TALLY(VELOCITY_ERROR) = velocity_error + (double)off[0];
        TALLY(YAW_ERROR) = yaw_error + (double)off[1];
    }
#if TRIALS
    errors[2 * row] = off[0], errors[2 * row + 1] = off[1];
    Base reached = base_of(state, e);
    for (int k = 0; k < 7; k++) bases[7 * row + k] = k < 3 ? reached.position[k] : reached.quaternion[k - 3];
#if FOLLOWS && ACTOR_FOLLOWS
    motion_errors[row] = distance_from_motion(state, params, place_of(age, 0.0f).time, e);
#endif
#endif
    // Trials are told of a robot that diverged by a reward that is no number; for the learner it fell.
    reward[row] = TRIALS && broken ? (float)double_of_bits(0x7FF8000000000000ull) : paid;
    done[row] = ended == GOES_ON ? 0.0f : 1.0f;

    sum = sum + paid;
#if STEPWISE
    ends[e] = ended == FALL;
    ends[ENDS_APART + e] = ended == TIME_OUT;
    ends[2 * ENDS_APART + e] = ended != GOES_ON;
    // Held robots stay as they are, but a state that is not finite cannot be stepped further.
    bool begins = ended != GOES_ON && (broken || !held[0]);
    if (ended != GOES_ON && !held[0])
        write_last_row(
            control, state, params, memory, age, imu, command, last_action, past, broken, e, number + 1,
            last_observation FOLLOWING(turned[e]));
#else
    bool begins = ended != GOES_ON;
    u32 slot = step / EPISODE_STEPS_MAX;
#if COURSE
    // Episodes that leave the ground are cut off too: take the first free place.
    for (slot = 0; slot + 1 < CUTS && cut[slot * ENVIRONMENTS + e] > 0;) slot++;
#endif
    if (ended == TIME_OUT) {
        // It would have gone on: the critic's value of the state reached stands for the rewards that follow.
        cut[slot * ENVIRONMENTS + e] = step + 1;
        write_critic_row(
            state, params, age, command, last_action, critic_past, e,
            tail + ((u64)(1 + slot) * ENVIRONMENTS + e) * CRITIC_ROW.width FOLLOWING(turned[e]));
    }
#endif
    if (ended != GOES_ON) {
        TALLY(EPISODES) += 1.0;
        TALLY(FALLS) += ended == FALL ? 1.0 : 0.0;
        if (ended == FALL && age < EPISODE_STEPS_MAX) TALLY(LOST_STEPS) += (double)(EPISODE_STEPS_MAX - age);
        TALLY(EPISODE_STEPS) += (double)length;
        TALLY(EPISODE_RETURN) += (double)sum;
    }
    if (begins) {
        sum = length = 0.0f;
        age = 0;
#if COURSE
        next_way(control, ways, e, number + 1, base.position, ended == FALL);
#endif
        forget_episode(fresh, last_action, feet, e);
    }
    returns[e] = sum;
    returns[ENVIRONMENTS + e] = length;
    steps[e] = age;
    return begins;
}

// Before the first barrier nothing global is written. Between the two, each part writes arrays of its own. Part 0 alone goes on
// after the second.
KERNEL finish(
    u32 step, const u32* control, float* state, const float* params, float* report, const float* action, float* reward,
    float* done, u32* steps, u32* fresh, float* command, float* last_action, float* feet, float* returns, u32* cut,
    float* tail, double* tally, float* errors, float* bases, unsigned char* ends, float* last_observation, float* memory, const float* imu,
    float* ways, const float* past, const float* critic_past, const u32* held
    FOLLOWING(float* turned, float* motion_errors)
) {
    // Which environments of the block begin anew.
    __shared__ u32 begins[THREADS];
    __shared__ Placing placing;
    // What each term of the reward pays.
    __shared__ float terms[REWARDS > 0 ? REWARDS : 1][THREADS];
    // Every environment has a thread in each part.
    u32 lane = threadIdx.x % THREADS, part = threadIdx.x / THREADS, e = blockIdx.x * THREADS + lane;
    bool inside = e < ENVIRONMENTS, whole = true;
    u32 age = inside ? steps[e] + 1 : 0;
    Moment m;
    if (inside) {
        const float* wanted = action + ((u64)step * ENVIRONMENTS + e) * ACTIONS;
        whole = write_moment(state, params, report, wanted, command, last_action, feet, age, e, m);
        REWARD_TERMS
    }
    if (part == 0) begins[lane] = 0;
    __syncthreads();
    bool broken = inside && (!whole || !is_finite(sum_of(terms, lane)));
    if (inside) keep_step(m, terms, part, lane, broken, last_action, feet, tally);
    __syncthreads();
    if (inside && part == 0)
        begins[lane] = finish_step(
            step, control, state, params, report, reward, done, steps, fresh, command, last_action, feet, returns, cut, tail,
            tally, errors, bases, ends, last_observation, memory, imu, ways, past, critic_past, held, m, terms, lane, age, whole,
            broken FOLLOWING(turned, motion_errors)) ? 1 : 0;
    start_episodes(
        control, control[FIRST_STEP] + step + 1, begins, placing, state, report, memory, command,
        ways FOLLOWING(turned));
}

// Before a rollout: sums of 0, no episode cut off.
KERNEL begin_rollout(double* tally, u32* cut) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS) return;
    for (int k = 0; k < TALLIES; k++) TALLY(k) = 0.0;
    for (int k = 0; k < CUTS; k++) cut[k * ENVIRONMENTS + e] = 0;
}

// After the critic has seen `tail`: its values of the last states, and in the rewards of episodes that were cut off.
KERNEL add_values(const u32* cut, const float* tail_value, float* reward, float* last_value) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS) return;
    last_value[e] = tail_value[e];
    for (int k = 0; k < CUTS; k++) {
        u32 step = cut[k * ENVIRONMENTS + e];
        if (step > 0) reward[(u64)(step - 1) * ENVIRONMENTS + e] += GAMMA * tail_value[(1 + k) * ENVIRONMENTS + e];
    }
}

// Adds up the sums of all environments, in a fixed order; a block a sum.
KERNEL total(const double* tally, double* totals) {
    double sum = 0.0;
    for (u32 e = threadIdx.x; e < ENVIRONMENTS; e += blockDim.x) sum += TALLY(blockIdx.x);
    sum = block_sum(sum);
    if (threadIdx.x == 0) totals[blockIdx.x] = sum;
}
