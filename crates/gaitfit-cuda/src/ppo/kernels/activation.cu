// What layers share, whatever numbers their products take.

#define WARPS (THREADS / 32)

// A block that works on R samples is made of groups of warps. Each has samples of its own, and waits for the others only
// where a sum is over all samples.
template <int R> struct Group {
    static constexpr int COUNT = GROUPS_OF(R), THREADS_OF = THREADS / COUNT, WARPS_OF = WARPS / COUNT, ROWS_OF = R / COUNT;
    METHOD static int number() { return (int)threadIdx.x / THREADS_OF; }
    METHOD static int thread() { return (int)threadIdx.x % THREADS_OF; }
    METHOD static int first_row() { return number() * ROWS_OF; }
    // Waits for the group's threads.
    METHOD static void sync() {
        if (COUNT == 1) __syncthreads();
        else group_barrier(number() + 1, THREADS_OF);
    }
};

// Sum over each four neighbouring threads.
DEVICE float sum_of_four(float x) {
    x += __shfl_xor_sync(0xFFFFFFFFu, x, 1);
    return x + __shfl_xor_sync(0xFFFFFFFFu, x, 2);
}

// exp as exactly as the products.
DEVICE float exponential(float x) {
#if SPLIT || defined(GAITFIT_HOST)
    return expf(x);
#elif BF16
    // Without the care that __expf takes of numbers near 0, of which 1 is subtracted.
    float y;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x * 1.44269504f));
    return y;
#else
    return __expf(x);
#endif
}

// Function F of hidden layers: 0 is the actor's, 1 the critic's if that is another one.
template <int F> DEVICE float activate(float x) {
    constexpr int KIND = F == 0 ? FUNCTION_0 : FUNCTION_1;
    constexpr float ALPHA = F == 0 ? ALPHA_0 : ALPHA_1, LAMBDA = F == 0 ? LAMBDA_0 : LAMBDA_1;
    if (KIND == EXPONENTIAL) return LAMBDA * (x > 0.0f ? x : ALPHA * (exponential(x) - 1.0f));
    if (KIND == RECTIFIED) return x < 0.0f ? 0.0f : x;
    if (KIND == LEAKY) return x > 0.0f ? x : ALPHA * x;
    return tanhf(x);
}

// In the place of F: no function, whose derivative is 1.
#define NO_FUNCTION (-1)
// Derivative of function F by its result.
template <int F> DEVICE float slope(float h) {
    constexpr int KIND = F == 0 ? FUNCTION_0 : FUNCTION_1;
    constexpr float ALPHA = F == 0 ? ALPHA_0 : ALPHA_1, LAMBDA = F == 0 ? LAMBDA_0 : LAMBDA_1;
    if (KIND == EXPONENTIAL) return h > 0.0f ? LAMBDA : h + LAMBDA * ALPHA;
    if (KIND == RECTIFIED) return h > 0.0f ? 1.0f : 0.0f;
    if (KIND == LEAKY) return h > 0.0f ? 1.0f : ALPHA;
    return 1.0f - h * h;
}
