// Forward pass, losses and backward pass of both networks over one minibatch, in one launch.
//
// Some blocks work on the actor, the others on the critic. A block takes ROWS samples at a time: all layers' outputs stay
// in shared memory, and the derivatives take their place on the way back. Weights are read from copies (`packed`) in the
// order in which the matrix units take them, which stay in the first-level cache. Each block adds its weight gradients to
// its own part of `partial`; `reduce` adds the parts up in a fixed order, so the result has the same bits every time.

// Where a block keeps the derivatives by which a hidden layer gave the inputs of layer `layer`: as these lie in shared
// memory, without the network's input.
DEVICE Number* kept_of(const Net& net, int layer, Number* slopes) {
    return slopes + ROWS * (net.place[layer] - net.place[1]);
}

// One layer of one network, by its widths, for R samples: SHAPES lists those of both networks once each. Derivatives
// that do not follow from results go to `slopes` if the way back follows (KEEP).
template <int R, bool KEEP>
DEVICE void forward_layer(const Net& net, int layer, Number* pool, const float* packed, Number* slopes) {
    const Number* h = pool + R * net.place[layer];
    Number* out = pool + R * net.place[layer + 1];
    float* floats = outputs_begin<R>(net, pool);
    const float *weight = packed + net.weight[layer], *bias = packed + net.bias[layer];
    bool last = layer + 1 == net.layers;
#define CASE(number, K_IN, IN, OUT, K_OUT, F) \
    if (net.shape[layer] == number) \
        forward<R, K_IN, IN, OUT, F, KEEP && keeps<F>()>( \
            h, out, floats, weight, bias, last, kept_of(net, layer + 1, slopes));
    SHAPES(CASE)
#undef CASE
}

DEVICE void backward_layer(const Net& net, int layer, Number* pool, const float* packed, Number* slopes) {
    Number* h = pool + ROWS * net.place[layer];
    const Number* d = pool + ROWS * net.place[layer + 1];
#define CASE(number, K_IN, IN, OUT, K_OUT, F) \
    if (net.shape[layer] == number) \
        backward<ROWS, K_OUT, IN, OUT, F>(h, d, packed + net.back[layer], kept_of(net, layer, slopes));
    SHAPES(CASE)
#undef CASE
}

#if MEMORY
// Derivatives by the input of the first layer take its place.
DEVICE void input_layer(const Net& net, Number* pool, const float* packed) {
    Number* h = pool + ROWS * net.place[0];
    const Number* d = pool + ROWS * net.place[1];
#define CASE(number, K_IN, IN, OUT, K_OUT, F) \
    if (net.shape[0] == number) backward<ROWS, K_OUT, IN, OUT, NO_FUNCTION>(h, d, packed + net.back[0], nullptr);
    SHAPES(CASE)
#undef CASE
}
#endif

DEVICE void gather_layer(const Net& net, int layer, const Number* pool, float* gradient, bool first) {
    const Number* h = pool + ROWS * net.place[layer];
    const Number* d = pool + ROWS * net.place[layer + 1];
#define CASE(number, K_IN, IN, OUT, K_OUT, F) \
    if (net.shape[layer] == number) \
        gather_gradient<ROWS, IN, OUT>(h, d, gradient + net.of_weight[layer], gradient + net.of_bias[layer], first);
    SHAPES(CASE)
#undef CASE
}

// Numbers that each block sums besides gradients.
enum { SURROGATE, VALUE, DIVERGENCE, RATIO_K1, RATIO_K3, CLIPPED, LOSSES };

// Of the samples that a thread sees in the losses: four threads share a row, this is number `part`.
template <int R> struct Sample {
    static constexpr int EACH = (ACTIONS + 3) / 4;
    bool inside;
    int row;
    // The actor's action and mean then, the logarithm of its probability, and the advantage; the critic's value then, and
    // the return.
    float action[EACH], mean[EACH], old, target;
};

// Policy loss of one row, as gaitfit-learn has it: the derivative by the last layer's sums takes their place.
template <int R>
DEVICE void policy_loss(
    const Outputs& out, int part, const Sample<R>& sample, const float* constants, float weight, float* losses, float* pull
) {
    constexpr int EACH = Sample<R>::EACH;
    float squares = 0.0f, shift = 0.0f, z[EACH] = {}, slopes[EACH];
#pragma unroll
    for (int k = 0; k < EACH; k++) {
        int c = part + 4 * k;
        slopes[k] = 1.0f;
        if (c >= ACTIONS || !sample.inside) continue;
        float mean = activate<ACTOR_OUTPUT>(out.get(c), slopes[k]), moved = (sample.mean[k] - mean) * constants[c];
        z[k] = (sample.action[k] - mean) * constants[c];
        squares += z[k] * z[k];
        shift += moved * moved;
    }
    squares = sum_of_four(squares);
    shift = sum_of_four(shift);
    float log_ratio = -0.5f * squares - constants[ACTIONS] - sample.old, ratio = expf(log_ratio);
    float low = 1.0f - CLIP, high = 1.0f + CLIP;
    float clipped = ratio < low ? low : ratio;
    clipped = clipped > high ? high : clipped;
    float plain = -sample.target * ratio, bounded = -sample.target * clipped;
    // Written so that a NaN takes the plain branch and shows in the loss.
    bool held = bounded > plain;
    float pull_of_row = held ? 0.0f : plain * weight;
#pragma unroll
    for (int k = 0; k < EACH; k++) {
        int c = part + 4 * k;
        if (c >= ACTIONS) continue;
        out.set(c, sample.inside ? times_slope<ACTOR_OUTPUT>(pull_of_row * z[k] * constants[c], slopes[k]) : 0.0f);
        pull[c] = sample.inside ? pull_of_row * (z[k] * z[k] - 1.0f) : 0.0f;
    }
    if (part != 0) return;
    bool inside = sample.inside;
    losses[SURROGATE * R] = !inside ? 0.0f : held ? bounded : plain;
    losses[DIVERGENCE * R] = inside ? 0.5f * shift + constants[ACTIONS + 1] : 0.0f;
    losses[RATIO_K1 * R] = inside ? -log_ratio : 0.0f;
    losses[RATIO_K3 * R] = inside ? ratio - 1.0f - log_ratio : 0.0f;
    losses[CLIPPED * R] = inside && (ratio < low || ratio > high) ? 1.0f : 0.0f;
}

// Value loss of one row, likewise.
template <int R>
DEVICE void value_loss(const Outputs& out, const Sample<R>& sample, bool clip, float weight, float* losses) {
    float slope, value = activate<CRITIC_OUTPUT>(out.get(0), slope), old = sample.old, moved = value - old;
    float bounded = moved < -CLIP ? -CLIP : moved;
    bounded = bounded > CLIP ? CLIP : bounded;
    float plain_error = value - sample.target, bounded_error = old + bounded - sample.target;
    float plain = plain_error * plain_error, clipped = bounded_error * bounded_error;
    bool held = clip && clipped > plain;
    float pull = held ? (bounded == moved ? bounded_error : 0.0f) : plain_error;
    losses[VALUE * R] = !sample.inside ? 0.0f : held ? clipped : plain;
    out.set(0, sample.inside ? times_slope<CRITIC_OUTPUT>(2.0f * VALUE_COEFFICIENT * weight * pull, slope) : 0.0f);
}

// Observations of a group's rows, normalised, into the first layer's place; zeros behind the last. Row `number` of the
// minibatch is `places[from + number]` of the samples, or `from + number` if there are no places.
template <int R>
DEVICE void load_inputs(
    const Net& net, Number* pool, const float* input, const float* scale, const u32* places, u32 from, u32 tile, u32 rows
) {
    using G = Group<R>;
    constexpr int EACH = G::ROWS_OF / G::WARPS_OF;
    int inputs = net.width[0], apart = net.apart[0], first = G::first_row() + (G::thread() >> 5);
    const float* row[EACH];
#pragma unroll
    for (int k = 0; k < EACH; k++) {
        u32 number = tile * R + first + k * G::WARPS_OF;
        row[k] = number < rows ? input + (u64)(places ? places[from + number] : from + number) * inputs : nullptr;
    }
    for (int c = 2 * (threadIdx.x & 31); c < net.padded[0]; c += 64) {
        bool left = c < inputs, right = c + 1 < inputs;
        float2 x[EACH], factor = {left ? scale[c] : 0.0f, right ? scale[c + 1] : 0.0f};
        float2 shift = {left ? scale[inputs + c] : 0.0f, right ? scale[inputs + c + 1] : 0.0f};
        // All loads before the first use.
#pragma unroll
        for (int k = 0; k < EACH; k++) {
            x[k].x = x[k].y = 0.0f;
            if (row[k] && inputs % 2 == 0 && left) x[k] = *(const float2*)(row[k] + c);
            if (row[k] && inputs % 2 != 0 && left) x[k].x = row[k][c];
            if (row[k] && inputs % 2 != 0 && right) x[k].y = row[k][c + 1];
        }
#pragma unroll
        for (int k = 0; k < EACH; k++) {
            int r = first + k * G::WARPS_OF;
            float low = row[k] ? x[k].x * factor.x + shift.x : 0.0f, high = row[k] ? x[k].y * factor.y + shift.y : 0.0f;
            set_pair(pool + r * apart, r, c, low, high);
        }
    }
}

// Means and values of rows `from` .. `from` + `rows` of the samples. Blocks 0 .. actor_blocks are the actor's.
extern "C" __global__ void __launch_bounds__(THREADS, 1) foresee(
    u32 from, u32 rows, u32 actor_blocks, const float* observation, const float* critic_observation, const float* scale,
    const float* __restrict__ packed, float* mean, float* value
) {
    POOL(room);
    Number* pool = (Number*)room;
    bool actor = blockIdx.x < actor_blocks;
    const Net& net = NETS[actor ? 0 : 1];
    u32 block = actor ? blockIdx.x : blockIdx.x - actor_blocks, blocks = actor ? actor_blocks : gridDim.x - actor_blocks;
    const float* weights = packed + (actor ? 0 : ACTOR_PACKED);
    const float* input_scale = actor ? scale : scale + 2 * ACTOR_INPUTS;
    int outputs = net.width[net.layers];
    float* out = actor ? mean : value;
    using G = Group<FORESEEN>;
    for (u32 tile = block; tile * FORESEEN < rows; tile += blocks) {
        // What memories give has no place in the samples.
        u32 first = MEMORY ? 0 : from;
        load_inputs<FORESEEN>(net, pool, actor ? observation : critic_observation, input_scale, nullptr, first, tile, rows);
        for (int layer = 0; layer < net.layers; layer++)
            forward_layer<FORESEEN, false>(net, layer, pool, weights, nullptr);
        G::sync();
        for (int i = G::thread(); i < G::ROWS_OF * outputs; i += G::THREADS_OF) {
            int r = G::first_row() + i / outputs, c = i % outputs;
            u32 number = tile * FORESEEN + r;
            if (number >= rows) continue;
            float x = outputs_of<FORESEEN>(net, pool, r).get(c);
            out[(u64)(from + number) * outputs + c] = actor ? activate<ACTOR_OUTPUT>(x) : activate<CRITIC_OUTPUT>(x);
        }
        G::sync();
    }
}

// Blocks 0 .. actor_blocks are the actor's. `places`: rows of the samples, from `from` on `rows` of this minibatch.
// `weight`: 1 by the minibatch's rows on all GPUs.
// `scale`: of the actor's observations, then of the critic's. `sums`: blocks x (LOSSES + ACTIONS), the latter the
// derivative by ln sigma. Behind memories both observations are what these give, rows of the minibatch, and the derivatives
// by them are asked for. `kept`: room for those derivatives of each block's hidden layers that do not follow from
// results.
extern "C" __global__ void __launch_bounds__(THREADS, 1) network(
    u32 from, u32 rows, float weight, u32 actor_blocks, const u32* control, const u32* places, const float* observation,
    const float* critic_observation, const float* action, const float* mean, const float* log_probability,
    const float* advantage, const float* value, const float* returns, const float* scale, const float* __restrict__ packed,
    const float* constants, float* partial, double* sums
#if MEMORY
    , float* of_actor_input, float* of_critic_input
#endif
#if ACTOR_KEPT + CRITIC_KEPT
    , Number* kept
#endif
) {
    POOL(room);
    Number* pool = (Number*)room;
    bool actor = blockIdx.x < actor_blocks;
    const Net& net = NETS[actor ? 0 : 1];
    u32 block = actor ? blockIdx.x : blockIdx.x - actor_blocks, blocks = actor ? actor_blocks : gridDim.x - actor_blocks;
    const float* weights = packed + (actor ? 0 : ACTOR_PACKED);
    float* gradient = partial + (u64)(actor ? 0 : actor_blocks) * ACTOR_GRADIENT + (u64)block * net.gradient;
    Number* slopes = nullptr;
#if ACTOR_KEPT + CRITIC_KEPT
    slopes = kept + (u64)(actor ? 0 : actor_blocks) * ROWS * ACTOR_KEPT;
    slopes += (u64)block * ROWS * (actor ? ACTOR_KEPT : CRITIC_KEPT);
#endif
    const float* input = actor ? observation : critic_observation;
    const float* input_scale = actor ? scale : scale + 2 * ACTOR_INPUTS;
    float* losses = behind<ROWS>(net, pool);
    float* pulls = losses + LOSSES * ROWS;
    bool clip_value = CLIPPED_VALUE_LOSS && !control[CRITIC_ALONE];
    // Sums of which this thread keeps a part, if any: number `quantity`, and those SUMS_AT_ONCE further on.
    constexpr int SUMS_AT_ONCE = THREADS / SHARERS, KEPT = (LOSSES + ACTIONS + SUMS_AT_ONCE - 1) / SUMS_AT_ONCE;
    int last = THREADS - 1 - (int)threadIdx.x, quantity = last / SHARERS, part_of_sum = last % SHARERS;
    double totals[KEPT] = {};
    using G = Group<ROWS>;
    constexpr int TURNS = (4 * G::ROWS_OF + G::THREADS_OF - 1) / G::THREADS_OF;
    int part = threadIdx.x & 3;
    for (u32 i = threadIdx.x; i < LOSSES * ROWS + ROWS * ACTIONS; i += THREADS) losses[i] = 0.0f;
    __syncthreads();
    bool first = true;
    for (u32 tile = block; tile * ROWS < rows; tile += blocks) {
        load_inputs<ROWS>(net, pool, input, input_scale, MEMORY ? nullptr : places, MEMORY ? 0 : from, tile, rows);
        for (int layer = 0; layer < net.layers; layer++) forward_layer<ROWS, true>(net, layer, pool, weights, slopes);
        // Loaded before the wait.
        Sample<ROWS> samples[TURNS];
#pragma unroll
        for (int turn = 0; turn < TURNS; turn++) {
            Sample<ROWS>& sample = samples[turn];
            int r = (G::thread() + turn * G::THREADS_OF) >> 2;
            u32 number = tile * ROWS + G::first_row() + r;
            sample.row = r < G::ROWS_OF ? G::first_row() + r : -1;
            sample.inside = sample.row >= 0 && number < rows;
            u64 i = sample.inside ? places[from + number] : 0;
            sample.old = actor ? log_probability[i] : value[i];
            sample.target = actor ? advantage[i] : returns[i];
#pragma unroll
            for (int k = 0; k < Sample<ROWS>::EACH; k++) {
                bool there = actor && sample.inside && part + 4 * k < ACTIONS;
                sample.action[k] = there ? action[i * ACTIONS + part + 4 * k] : 0.0f;
                sample.mean[k] = there ? mean[i * ACTIONS + part + 4 * k] : 0.0f;
            }
        }
        G::sync();
#pragma unroll
        for (int turn = 0; turn < TURNS; turn++) {
            const Sample<ROWS>& sample = samples[turn];
            // All threads of a warp or none.
            if (sample.row < 0) continue;
            Outputs out = outputs_of<ROWS>(net, pool, sample.row);
            if (actor)
                policy_loss(out, part, sample, constants, weight, losses + sample.row, pulls + sample.row * ACTIONS);
            else if (part == 0) value_loss(out, sample, clip_value, weight, losses + sample.row);
        }
        __syncthreads();
        // The last warps add up losses while the others begin with the gradients.
#pragma unroll
        for (int k = 0; k < KEPT; k++) {
            int q = quantity + k * SUMS_AT_ONCE;
            if (q >= LOSSES + ACTIONS) continue;
            bool loss = q < LOSSES;
            const float* from_row = loss ? losses + q * ROWS : pulls + q - LOSSES;
            for (int r = part_of_sum; r < ROWS; r += SHARERS) totals[k] += from_row[r * (loss ? 1 : ACTIONS)];
        }
        for (int layer = net.layers; layer-- > 0;) {
            gather_layer(net, layer, pool, gradient, first);
            if (layer > 0) backward_layer(net, layer, pool, weights, slopes);
#if MEMORY
            else input_layer(net, pool, weights);
#endif
            __syncthreads();
        }
#if MEMORY
        float* of_input = actor ? of_actor_input : of_critic_input;
        int inputs = net.width[0], apart = net.apart[0];
        for (int i = threadIdx.x; i < ROWS * inputs; i += THREADS) {
            int r = i / inputs, c = i % inputs;
            u32 number = tile * ROWS + r;
            if (number < rows) of_input[(u64)number * inputs + c] = get(pool + r * apart, r, c);
        }
        __syncthreads();
#endif
        first = false;
    }
    double* parts = (double*)room;
    for (int k = 0; k < KEPT; k++) {
        parts[last] = totals[k];
        __syncthreads();
        int q = quantity + k * SUMS_AT_ONCE;
        if (part_of_sum == 0 && q < LOSSES + ACTIONS) {
            double total = parts[last];
            for (int part = 1; part < SHARERS; part++) total += parts[last + part];
            sums[blockIdx.x * (LOSSES + ACTIONS) + q] = total;
        }
        __syncthreads();
    }
}
