// Observations: rows as the policy's interface lays them out.

// Writes the numbers `from` to `until` of term `number` of TERMS into their places of a row, in all frames; `from` is a
// multiple of 4. `scales`: those of the row. `noise`: draws of this environment and step, or none. `past`: the row of the
// step before, whose frames move up, or none at an episode's start; it may be `out` unless an earlier action is
// observed. `memory` and `imu`: errors of this robot's sensors, or none; `command` and `last_action`: this robot's;
// all have their numbers `apart` from each other. `where`: its place in the motion that its policy follows.
DEVICE void write_term(
    int number, int from, int until, const float* scales, const Draws* noise, const float* past, const float* state, const float* params,
    const float* memory, u32 steps, const float* imu, const float* command, const float* last_action, u32 apart, u32 e, float* out
    FOLLOWING(MotionPlace where)
) {
    Term term = TERMS[number];
    Base base;
    float vector[3] = {0.0f, 0.0f, 0.0f};
    u32 words[4];
    // The base is looked at where a term is of the base.
    switch (term.quantity) {
        case BASE_ANGULAR_VELOCITY:
            base = read_base(state, memory, e);
            for (int k = 0; k < 3; k++) vector[k] = base.angular[k];
            read_rates(imu, apart, vector);
            break;
        case PROJECTED_GRAVITY:
            base = read_base(state, memory, e);
            up_of(base.quaternion, vector);
            for (int k = 0; k < 3; k++) vector[k] = -vector[k];
            read_direction(imu, apart, vector);
            break;
        case BASE_LINEAR_VELOCITY:
            base = base_of(state, e);
            to_body(base.quaternion, base.linear, vector);
            break;
        case BASE_HEIGHT:
            base = base_of(state, e);
            vector[0] = base.position[2] - ground_under(base.position);
            break;
        case COMMAND:
            for (int k = 0; k < 3; k++) vector[k] = command[k * apart];
            break;
        case GAIT_PHASE: {
            float angle = 6.2831855f * clock_of(steps);
            vector[0] = sinf(angle), vector[1] = cosf(angle);
            break;
        }
        case GAIT_SINE: vector[0] = sinf(6.2831855f * clock_of(steps)); break;
        case CONSTANT: vector[0] = 1.0f; break;
        default: break;
    }
#if FOLLOWS
    // How far ahead the motion is read, in control periods.
    double time = where.time + (double)EXTRA[number] * CONTROL_DT;
    Between samples = between(time);
#if REFERENCE_TURNS
    Quat to_motion = {1.0, 0.0, 0.0, 0.0};
    if (term.quantity == REFERENCE_ORIENTATION)
        to_motion = turn_to_motion(where.heading, time, state, params, memory, imu, apart, e);
#endif
#endif
    until = until < term.width ? until : term.width;
    for (; from < until; from += 4) {
        if (noise && term.half_range > 0.0f) block_of(*noise, term.draw + from, words);
#pragma unroll
        for (int i = 0; i < 4; i++) {
            int k = from + i;
            if (k >= until) break;
            float value = 0.0f;
            switch (term.quantity) {
                case JOINT_POSITION: value = joint_position(state, params, e, JOINT_OF[k]) - HOME[k]; break;
                case JOINT_VELOCITY: value = read_velocity(state, memory, e, JOINT_OF[k]); break;
                case LAST_ACTION: value = last_action[k * apart]; break;
#if HAS_EARLIER
                // The row before has it as its last action, scaled.
                case EARLIER_ACTION: value = past ? past[EXTRA[number] + k] / scales[EXTRA[number] + k] : 0.0f; break;
#endif
#if FOLLOWS
                case REFERENCE_JOINT_POSITION: value = reference_number(REFERENCE_POSITION, samples, k); break;
                case REFERENCE_JOINT_VELOCITY:
                    value = samples.moves ? reference_number(REFERENCE_VELOCITY, samples, k) : 0.0f;
                    break;
#if REFERENCE_TURNS
                case REFERENCE_ORIENTATION: value = column_number(to_motion, k); break;
#endif
                case REFERENCE_PHASE: value = reference_phase(time); break;
#endif
                default: value = i < 3 ? vector[i] : 0.0f;
            }
            if (noise && term.half_range > 0.0f)
                value += term.half_range * (2.0f * ((float)(words[i] >> 8) * (1.0f / 16777216.0f)) - 1.0f);
            out[term.place + k] = value * scales[term.place + k];
            for (int frame = 0; frame + 1 < term.frames; frame++) {
                int place = term.oldest + frame * term.apart + k;
                out[place] = past ? past[place + term.apart] : ZEROS_BEFORE ? 0.0f : out[term.place + k];
            }
        }
    }
}
