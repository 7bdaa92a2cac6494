// The draws of gaitfit-random: pure functions of seed, purpose, environment, step and number, in f64 with the CPU's bits.

// Purposes.
enum { TORQUE_DRAWS = 3, COMMAND_DRAWS = 5, RESET_DRAWS = 6, NOISE_DRAWS = 8, EXPLORATION_DRAWS = 9, PUSH_DRAWS = 13, PLACE_DRAWS = 15 };

// Numbers in `control`, which the host writes before a rollout.
// COMMAND_RANGES: the ends of the commands' ranges as doubles, low words first. FIRST_ENVIRONMENT: the number that draws of
// environment 0 have.
enum { FIRST_STEP, SEED_LOW, SEED_HIGH, COMMAND_RANGES, FIRST_ENVIRONMENT = COMMAND_RANGES + 12, CONTROL_SIZE };

struct Draws {
    u32 seed_low, seed_high, purpose, environment, step;
};

DEVICE Draws draws_of(const u32* control, u32 purpose, u32 environment, u32 step) {
    return {control[SEED_LOW], control[SEED_HIGH], purpose, control[FIRST_ENVIRONMENT] + environment, step};
}

DEVICE void block_of(Draws d, u32 block, u32 words[4]) {
    words[0] = block, words[1] = d.step, words[2] = d.environment, words[3] = d.purpose;
    philox(words, d.seed_low, d.seed_high);
}

DEVICE double joined(u32 low, u32 high) {
    return (double)((((u64)high << 32) | low) >> 11) * (1.0 / 9007199254740992.0);
}

DEVICE double uniform(Draws d, u32 draw) {
    u32 words[4];
    block_of(d, draw / 2, words);
    return draw % 2 ? joined(words[2], words[3]) : joined(words[0], words[1]);
}

DEVICE double within(Draws d, u32 draw, double low, double high) { return low + (high - low) * uniform(d, draw); }

DEVICE u64 bits_of_double(double x) {
#ifdef GAITFIT_HOST
    u64 bits;
    memcpy(&bits, &x, 8);
    return bits;
#else
    return (u64)__double_as_longlong(x);
#endif
}
DEVICE double double_of_bits(u64 bits) {
#ifdef GAITFIT_HOST
    double x;
    memcpy(&x, &bits, 8);
    return x;
#else
    return __longlong_as_double((long long)bits);
#endif
}

// Natural logarithm of a positive, normal number: the series of artanh, as gaitfit-random has it.
DEVICE double log_of(double x) {
    u64 bits = bits_of_double(x);
    double mantissa = double_of_bits((bits & ((1ull << 52) - 1)) | (1023ull << 52));
    u64 upper = mantissa >= 1.4142135623730951 ? 1 : 0;
    mantissa = double_of_bits(bits_of_double(mantissa) - (upper << 52));
    long long exponent = (long long)((bits >> 52) + upper) - 1023;
    double s = (mantissa - 1.0) / (mantissa + 1.0), s2 = s * s, series = 0.0;
#pragma unroll
    for (int k = 11; k >= 0; k--) series = series * s2 + 1.0 / (double)(2 * k + 1);
    return (double)exponent * 0.6931471805599453 + 2.0 * s * series;
}

// cos and sin of t turns, t in [0, 1).
DEVICE void cos_sin_turns(double t, double& c, double& s) {
    u32 quarter = (u32)(4.0 * t + 0.5);
    double angle = 6.283185307179586 * (t - 0.25 * (double)quarter), square = angle * angle;
    double cosine = 1.0, sine = 1.0;
#pragma unroll
    for (int k = 7; k >= 0; k--) {
        double even = (double)(2 * k + 2);
        cosine = 1.0 - cosine * (square * (1.0 / (even * (even - 1.0))));
        sine = 1.0 - sine * (square * (1.0 / (even * (even + 1.0))));
    }
    sine *= angle;
    bool swap = quarter % 2 == 1;
    double x = swap ? sine : cosine, y = swap ? cosine : sine;
    c = double_of_bits(bits_of_double(x) ^ ((u64)((quarter + 1) & 2) << 62));
    s = double_of_bits(bits_of_double(y) ^ ((u64)(quarter & 2) << 62));
}

// Two standard normals, of draws 2 block and 2 block + 1.
DEVICE void normal_pair(Draws d, u32 block, double pair[2]) {
    u32 words[4];
    block_of(d, block, words);
    double u = joined(words[0], words[1]), v = joined(words[2], words[3]), cosine, sine;
    double radius = sqrt(-2.0 * log_of(1.0 - u));
    cos_sin_turns(v, cosine, sine);
    pair[0] = radius * cosine;
    pair[1] = radius * sine;
}
