// Functions of layers and their derivatives, for kernels that train policies and for those that run them. Each text
// says how exactly it computes powers of e, tanh and quotients.
DEVICE float exponential(float x);
DEVICE float tangent(float x);
DEVICE float quotient(float a, float b);

// x sigmoid(x), and its derivative.
DEVICE float silu(float x, float& slope) {
    float below = 1.0f + exponential(-x), share = quotient(1.0f, below);
    slope = share * (1.0f + x * (1.0f - share));
    return quotient(x, below);
}

// x Phi(x), with erfc of Abramowitz and Stegun (1964), 7.1.26, and its derivative Phi(x) + x phi(x).
DEVICE float gelu(float x, float& slope) {
    float z = (x < 0.0f ? -x : x) * 0.70710678f, t = quotient(1.0f, 1.0f + 0.3275911f * z), p = 1.061405429f;
    p = p * t + -1.453152027f;
    p = p * t + 1.421413741f;
    p = p * t + -0.284496736f;
    p = p * t + 0.254829592f;
    float power = exponential(-z * z), beyond = 0.5f * p * t * power, half = 0.5f * x * p * t * power;
    slope = (x > 0.0f ? 1.0f - beyond : beyond) + 0.39894228f * x * power;
    return x > 0.0f ? x - half : half;
}

// The approximation of GELU by a hyperbolic tangent, and its derivative.
DEVICE float gelu_tanh(float x, float& slope) {
    float t = tangent(0.7978846f * (x + 0.044715f * x * x * x));
    float inner = 0.7978846f * (1.0f + 3.0f * 0.044715f * x * x);
    slope = 0.5f * (1.0f + t) + 0.5f * x * (1.0f - t * t) * inner;
    return 0.5f * x * (1.0f + t);
}

// A function of this kind, with its two parameters.
DEVICE float function_of(int kind, float alpha, float lambda, float x) {
    float unused;
    switch (kind) {
        case EXPONENTIAL: return lambda * (x > 0.0f ? x : alpha * (exponential(x) - 1.0f));
        case RECTIFIED: return x < 0.0f ? 0.0f : x;
        case LEAKY: return x > 0.0f ? x : alpha * x;
        case TANGENT: return tangent(x);
        case SILU: return silu(x, unused);
        case GELU: return gelu(x, unused);
        case GELU_TANH: return gelu_tanh(x, unused);
        default: return x;
    }
}

// The derivative of a function by its result h; not of SILU, GELU and GELU_TANH, where it does not follow from h.
DEVICE float slope_by_result(int kind, float alpha, float lambda, float h) {
    switch (kind) {
        case EXPONENTIAL: return h > 0.0f ? lambda : h + lambda * alpha;
        case RECTIFIED: return h > 0.0f ? 1.0f : 0.0f;
        case LEAKY: return h > 0.0f ? 1.0f : alpha;
        case TANGENT: return 1.0f - h * h;
        default: return 1.0f;
    }
}

// As `function_of`, with the derivative.
DEVICE float function_and_slope(int kind, float alpha, float lambda, float x, float& slope) {
    if (kind == SILU) return silu(x, slope);
    if (kind == GELU) return gelu(x, slope);
    if (kind == GELU_TANH) return gelu_tanh(x, slope);
    float h = function_of(kind, alpha, lambda, x);
    slope = slope_by_result(kind, alpha, lambda, h);
    return h;
}
