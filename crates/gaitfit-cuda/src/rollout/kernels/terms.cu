
// What reward terms written as expressions are made of.

DEVICE float term_flag(bool on) { return on ? 1.0f : 0.0f; }
DEVICE float term_square(float x) { return x * x; }
// Unlike fminf and fmaxf, not a number if one of them is none.
DEVICE float term_least(float a, float b) { return a < b || a != a ? a : b; }
DEVICE float term_largest(float a, float b) { return a > b || a != a ? a : b; }
DEVICE float term_torque(const Moment& m, int j) {
    const float* report = m.report;
    u32 e = m.e;
    return TORQUE(j);
}
DEVICE float term_acceleration(const Moment& m, int j) {
    const float* state = m.state;
    u32 e = m.e;
    return STATE(QACC + j);
}
// The target that this period's action asks for.
DEVICE float term_target(const Moment& m, int j) {
    int k = ACTION_OF[j];
    if (k < 0) return DEFAULT_POSE[j];
    float wanted = m.action[k], clip = ACTION_CLIP[k], clipped = wanted < -clip ? -clip : wanted;
    clipped = clipped > clip ? clip : clipped;
    return DEFAULT_POSE[j] + ACTION_SCALE[j] * clipped;
}

