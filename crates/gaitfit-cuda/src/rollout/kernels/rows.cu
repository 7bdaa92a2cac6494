// The rows of a rollout's samples.

// A row as it was last observed: `past` of the actor, `critic_past` of the critic; without past frames nobody keeps them.
#define PAST_ROW(rows, row) (row.frames > 1 ? rows + (u64)e * row.width : nullptr)

// What the critic of environment `e` sees after a step, before a new episode begins.
DEVICE void write_critic_row(
    const float* state, const float* params, u32 steps, const float* command, const float* last_action, const float* critic_past, u32 e,
    float* out FOLLOWING(float turned)
) {
    for (int t = CRITIC_ROW.first; t < CRITIC_ROW.first + CRITIC_ROW.terms; t++)
        write_term(
            t, 0, TERMS[t].width, SCALES + CRITIC_ROW.scale, nullptr, PAST_ROW(critic_past, CRITIC_ROW), state, params, nullptr, steps,
            nullptr, command + e, last_action + e, ENVIRONMENTS, e, out FOLLOWING(place_of(steps, turned)));
}

#if STEPWISE
// What the actor of environment `e` observes at step `number`, at an episode's end; zeros if its simulation came apart.
DEVICE void write_last_row(
    const u32* control, const float* state, const float* params, const float* memory, u32 steps, const float* imu, const float* command,
    const float* last_action, const float* past, bool broken, u32 e, u32 number, float* rows
    FOLLOWING(float turned)
) {
    float* out = rows + (u64)e * ACTOR_ROW.width;
    Draws noise = draws_of(control, NOISE_DRAWS, e, number);
    for (int t = ACTOR_ROW.first; t < ACTOR_ROW.first + ACTOR_ROW.terms; t++)
        write_term(
            t, 0, TERMS[t].width, SCALES + ACTOR_ROW.scale, &noise, PAST_ROW(past, ACTOR_ROW), state, params, memory, steps, imu + e,
            command + e, last_action + e, ENVIRONMENTS, e, out FOLLOWING(place_of(steps, turned)));
    for (int k = 0; k < ACTOR_ROW.width && broken; k++) out[k] = 0.0f;
}
#endif

// Term `number` of the row of environment `e` of step `step`; its frames are kept for the next row. `fresh`: whether
// each episode begins.
DEVICE void observe_term(
    int number, u32 step, const u32* control, const float* state, const float* params, const float* memory,
    const u32* steps, const u32* fresh, const float* imu, const float* command, const float* last_action, float* past,
    float* critic_past, float* observation, float* critic_observation, u32 e FOLLOWING(const float* turned)
) {
    u64 sample = (u64)step * ENVIRONMENTS + e;
    bool actor = number < ACTOR_ROW.terms;
    Row row = actor ? ACTOR_ROW : CRITIC_ROW;
    Draws noise = draws_of(control, NOISE_DRAWS, e, control[FIRST_STEP] + step);
    float* out = (actor ? observation : critic_observation) + sample * row.width;
    float* kept = PAST_ROW((actor ? past : critic_past), row);
    write_term(
        number, 0, TERMS[number].width, SCALES + row.scale, actor ? &noise : nullptr, fresh[e] ? nullptr : kept, state,
        params, actor ? memory : nullptr, steps[e], actor ? imu + e : nullptr, command + e, last_action + e,
        ENVIRONMENTS, e, out FOLLOWING(place_of(steps[e], turned[e])));
    if (!kept) return;
    Term term = TERMS[number];
    for (int frame = 0; frame < term.frames; frame++)
        for (int k = 0; k < term.width; k++) {
            int place = term.oldest + frame * term.apart + k;
            kept[place] = out[place];
        }
}

// The row of environment `e` of step `step`: a block column for each term of the actor, then of the critic.
DEVICE void observe_environment(
    u32 step, const u32* control, const float* state, const float* params, const float* memory, const u32* steps,
    const u32* fresh, const float* imu, const float* command, const float* last_action, float* past, float* critic_past,
    float* observation, float* critic_observation, u32 e FOLLOWING(const float* turned)
) {
    int number = (int)blockIdx.y;
#if HAS_EARLIER
    // Earlier actions are read from where the last action is kept: the thread of the last action writes them before it.
    if (TERMS[number].quantity == EARLIER_ACTION) return;
    if (TERMS[number].quantity == LAST_ACTION) {
        Row row = number < ACTOR_ROW.terms ? ACTOR_ROW : CRITIC_ROW;
        for (int other = row.first; other < row.first + row.terms; other++)
            if (TERMS[other].quantity == EARLIER_ACTION)
                observe_term(
                    other, step, control, state, params, memory, steps, fresh, imu, command, last_action, past,
                    critic_past, observation, critic_observation, e FOLLOWING(turned));
    }
#endif
    observe_term(
        number, step, control, state, params, memory, steps, fresh, imu, command, last_action, past, critic_past,
        observation, critic_observation, e FOLLOWING(turned));
}

// The rows of step `step` of the samples.
KERNEL observe(
    u32 step, const u32* control, const float* state, const float* params, const float* memory, const u32* steps, const u32* fresh,
    const float* imu, const float* command, const float* last_action, float* past, float* critic_past, float* observation,
    float* critic_observation FOLLOWING(const float* turned)
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS) return;
    observe_environment(
        step, control, state, params, memory, steps, fresh, imu, command, last_action, past, critic_past, observation,
        critic_observation, e FOLLOWING(turned));
}

// What the critic sees after the last step: a block column for each term.
KERNEL observe_end(
    const float* state, const float* params, const u32* steps, const u32* fresh, const float* command, const float* last_action,
    const float* critic_past, float* tail FOLLOWING(const float* turned)
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= ENVIRONMENTS) return;
    int number = CRITIC_ROW.first + (int)blockIdx.y;
    write_term(
        number, 0, TERMS[number].width, SCALES + CRITIC_ROW.scale, nullptr,
        fresh[e] ? nullptr : PAST_ROW(critic_past, CRITIC_ROW), state, params, nullptr, steps[e], nullptr, command + e,
        last_action + e, ENVIRONMENTS, e,
        tail + (u64)e * CRITIC_ROW.width FOLLOWING(place_of(steps[e], turned[e])));
}
