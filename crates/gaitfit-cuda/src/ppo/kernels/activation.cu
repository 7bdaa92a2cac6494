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

DEVICE float tangent(float x) { return tanhf(x); }

// Within two units in the last place, without the branches of a division, for which registers would be missing.
DEVICE float quotient(float a, float b) {
#ifdef GAITFIT_HOST
    return a / b;
#else
    return __fdividef(a, b);
#endif
}

// Functions that the text is made for: of hidden layers, 0 is the actor's, 1 the critic's if that is another one.
#define ACTOR_OUTPUT 2
#define CRITIC_OUTPUT 3
// In the place of F: no function, whose derivative is 1.
#define NO_FUNCTION (-1)
// The kind and the parameters of function F, and `none` without a function.
#define OF_FUNCTION(name, none) (F == 0 ? name##_0 : F == 1 ? name##_1 : F == 2 ? name##_2 : F == 3 ? name##_3 : none)

template <int F> DEVICE float activate(float x) {
    constexpr int KIND = OF_FUNCTION(FUNCTION, LINEAR);
    constexpr float ALPHA = OF_FUNCTION(ALPHA, 0.0f), LAMBDA = OF_FUNCTION(LAMBDA, 0.0f);
    return function_of(KIND, ALPHA, LAMBDA, x);
}
// With the derivative.
template <int F> DEVICE float activate(float x, float& slope) {
    constexpr int KIND = OF_FUNCTION(FUNCTION, LINEAR);
    constexpr float ALPHA = OF_FUNCTION(ALPHA, 0.0f), LAMBDA = OF_FUNCTION(LAMBDA, 0.0f);
    return function_and_slope(KIND, ALPHA, LAMBDA, x, slope);
}
// d times the derivative, if there is a function at all.
template <int F> DEVICE float times_slope(float d, float slope) {
    constexpr int KIND = OF_FUNCTION(FUNCTION, LINEAR);
    return KIND == LINEAR ? d : d * slope;
}
// The derivative by the result, of a function whose derivative is not kept.
template <int F> DEVICE float slope(float h) {
    constexpr int KIND = OF_FUNCTION(FUNCTION, LINEAR);
    constexpr float ALPHA = OF_FUNCTION(ALPHA, 0.0f), LAMBDA = OF_FUNCTION(LAMBDA, 0.0f);
    return slope_by_result(KIND, ALPHA, LAMBDA, h);
}
// Whether a hidden layer keeps the derivative for the way back, because it does not follow from the result.
template <int F> __device__ constexpr bool keeps() {
    constexpr int KIND = OF_FUNCTION(FUNCTION, LINEAR);
    return KIND == SILU || KIND == GELU || KIND == GELU_TANH;
}

// Derivatives that hidden layers keep lie in the GPU's memory, because shared memory would hold fewer samples beside
// them. A thread of the way back takes the tiles that it had on the way forth, so it reads what it wrote itself and
// waits for nobody. They lie by tile and number, of EACH pairs that a thread has in a tile, then by thread: a warp's
// lie side by side.
template <int EACH> DEVICE int kept_pair(int tile, int number) {
    return (tile * EACH + number) * 32 + ((int)threadIdx.x & 31);
}
