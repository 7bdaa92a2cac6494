// Forward pass, losses and backward pass of both networks over one minibatch, in one launch.
//
// Some blocks work on the actor, the others on the critic. A block takes ROWS samples at a time: all layers' outputs stay
// in shared memory, and the derivatives take their place on the way back. Weights are read from copies (`packed`) in the
// order in which the matrix units take them, which stay in the first-level cache. Each block adds its weight gradients to
// its own part of `partial`; `reduce` adds the parts up in a fixed order, so the result has the same bits every time.

// Numbers that each block sums besides gradients.
enum { SURROGATE, VALUE, DIVERGENCE, RATIO_K1, RATIO_K3, CLIPPED, LOSSES };

// Policy loss of one row, as gaitfit-learn has it: the derivative takes the place of the mean. Four threads share a row,
// this is number `part`; the row of `action` is number `i` of the samples if it is `inside`.
DEVICE void policy_loss(
    float* out, int s, int part, bool inside, const float* action, const float* old_mean, float old_log_probability,
    float advantage, const float* constants, float weight, float* losses, float* pull
) {
    float squares = 0.0f, shift = 0.0f;
    for (int c = part; c < ACTIONS && inside; c += 4) {
        float mean = out[c ^ s], z = (action[c] - mean) * constants[c], moved = (old_mean[c] - mean) * constants[c];
        squares += z * z;
        shift += moved * moved;
        pull[c] = z;
    }
    squares = sum_of_four(squares);
    shift = sum_of_four(shift);
    float log_ratio = -0.5f * squares - constants[ACTIONS] - old_log_probability, ratio = expf(log_ratio);
    float low = 1.0f - CLIP, high = 1.0f + CLIP;
    float clipped = ratio < low ? low : ratio;
    clipped = clipped > high ? high : clipped;
    float plain = -advantage * ratio, bounded = -advantage * clipped;
    // Written so that a NaN takes the plain branch and shows in the loss.
    bool held = bounded > plain;
    float pull_of_row = held ? 0.0f : plain * weight;
    for (int c = part; c < ACTIONS; c += 4) {
        float z = inside ? pull[c] : 0.0f;
        out[c ^ s] = inside ? rounded(pull_of_row * z * constants[c]) : 0.0f;
        pull[c] = inside ? pull_of_row * (z * z - 1.0f) : 0.0f;
    }
    if (part != 0 || !inside) return;
    losses[SURROGATE * ROWS] = held ? bounded : plain;
    losses[DIVERGENCE * ROWS] = 0.5f * shift + constants[ACTIONS + 1];
    losses[RATIO_K1 * ROWS] = -log_ratio;
    losses[RATIO_K3 * ROWS] = ratio - 1.0f - log_ratio;
    losses[CLIPPED * ROWS] = ratio < low || ratio > high ? 1.0f : 0.0f;
}

// Value loss of one row, likewise.
DEVICE void value_loss(float* out, float old, float target, bool clip, float weight, float* losses) {
    float value = *out, moved = value - old;
    float bounded = moved < -CLIP ? -CLIP : moved;
    bounded = bounded > CLIP ? CLIP : bounded;
    float plain_error = value - target, bounded_error = old + bounded - target;
    float plain = plain_error * plain_error, clipped = bounded_error * bounded_error;
    bool held = clip && clipped > plain;
    float pull = held ? (bounded == moved ? bounded_error : 0.0f) : plain_error;
    losses[VALUE * ROWS] = held ? clipped : plain;
    *out = rounded(2.0f * VALUE_COEFFICIENT * weight * pull);
}

// Observations of a tile's rows, normalised, into the first layer's place; zeros behind the last. Row `number` of the
// minibatch is `places[from + number]` of the samples, or `from + number` if there are no places.
DEVICE void load_inputs(
    const Net& net, float* pool, const float* input, const float* scale, const u32* places, u32 from, u32 tile, u32 rows
) {
    int inputs = net.width[0], apart = net.padded[0];
#pragma unroll 4
    for (int r = threadIdx.x >> 5; r < ROWS; r += WARPS) {
        u32 number = tile * ROWS + r;
        bool inside = number < rows;
        u64 place = !inside ? 0 : places ? places[from + number] : from + number;
        const float* row = input + place * inputs;
        for (int c = threadIdx.x & 31; c < apart; c += 32) {
            float x = inside && c < inputs ? row[c] * scale[c] + scale[inputs + c] : 0.0f;
            pool[net.place[0] + r * apart + (c ^ swizzle(r))] = rounded(x);
        }
    }
}

// Means and values of rows `from` .. `from` + `rows` of the samples. Blocks 0 .. actor_blocks are the actor's.
extern "C" __global__ void __launch_bounds__(THREADS, 1) foresee(
    u32 from, u32 rows, u32 actor_blocks, const float* observation, const float* critic_observation, const float* scale,
    const float* __restrict__ packed, float* mean, float* value
) {
    POOL(pool);
    bool actor = blockIdx.x < actor_blocks;
    const Net& net = NETS[actor ? 0 : 1];
    u32 block = actor ? blockIdx.x : blockIdx.x - actor_blocks, blocks = actor ? actor_blocks : gridDim.x - actor_blocks;
    const float* weights = packed + (actor ? 0 : ACTOR_PACKED);
    const float* input_scale = actor ? scale : scale + 2 * ACTOR_INPUTS;
    int outputs = net.width[net.layers], apart = net.padded[net.layers];
    float* out = actor ? mean : value;
    for (u32 tile = block; tile * ROWS < rows; tile += blocks) {
        // What memories give has no place in the samples.
        u32 first = MEMORY ? 0 : from;
        load_inputs(net, pool, actor ? observation : critic_observation, input_scale, nullptr, first, tile, rows);
        __syncthreads();
        for (int layer = 0; layer < net.layers; layer++) {
            forward_layer(net, layer, pool, weights);
            __syncthreads();
        }
        for (int i = threadIdx.x; i < ROWS * outputs; i += THREADS) {
            int r = i / outputs, c = i % outputs;
            u32 number = tile * ROWS + r;
            if (number < rows)
                out[(u64)(from + number) * outputs + c] = pool[net.place[net.layers] + r * apart + (c ^ swizzle(r))];
        }
        __syncthreads();
    }
}

// Blocks 0 .. actor_blocks are the actor's. `places`: rows of the samples, from `from` on `rows` of this minibatch.
// `scale`: of the actor's observations, then of the critic's. `sums`: blocks x (LOSSES + ACTIONS), the latter the
// derivative by ln sigma. Behind memories both observations are what these give, rows of the minibatch, and the derivatives
// by them are asked for.
extern "C" __global__ void __launch_bounds__(THREADS, 1) network(
    u32 from, u32 rows, u32 actor_blocks, const u32* control, const u32* places, const float* observation,
    const float* critic_observation, const float* action, const float* mean, const float* log_probability,
    const float* advantage, const float* value, const float* returns, const float* scale, const float* __restrict__ packed,
    const float* constants, float* partial, double* sums
#if MEMORY
    , float* of_actor_input, float* of_critic_input
#endif
) {
    POOL(pool);
    bool actor = blockIdx.x < actor_blocks;
    const Net& net = NETS[actor ? 0 : 1];
    u32 block = actor ? blockIdx.x : blockIdx.x - actor_blocks, blocks = actor ? actor_blocks : gridDim.x - actor_blocks;
    const float* weights = packed + (actor ? 0 : ACTOR_PACKED);
    float* gradient = partial + (u64)(actor ? 0 : actor_blocks) * ACTOR_GRADIENT + (u64)block * net.gradient;
    const float* input = actor ? observation : critic_observation;
    const float* input_scale = actor ? scale : scale + 2 * ACTOR_INPUTS;
    float* losses = pool + net.end;
    float* pulls = losses + LOSSES * ROWS;
    float weight = (float)(1.0 / (double)rows);
    bool clip_value = CLIPPED_VALUE_LOSS && !control[CRITIC_ALONE];
    int outputs_apart = net.padded[net.layers];
    // Which sum this thread keeps, if any.
    int quantity = THREADS - 1 - (int)threadIdx.x;
    double total = 0.0;
    bool first = true;
    for (u32 tile = block; tile * ROWS < rows; tile += blocks) {
        for (u32 i = threadIdx.x; i < LOSSES * ROWS + ROWS * ACTIONS; i += THREADS) losses[i] = 0.0f;
        load_inputs(net, pool, input, input_scale, MEMORY ? nullptr : places, MEMORY ? 0 : from, tile, rows);
        __syncthreads();
        for (int layer = 0; layer < net.layers; layer++) {
            forward_layer(net, layer, pool, weights);
            __syncthreads();
        }
        for (int r = threadIdx.x >> 2; r < ROWS; r += THREADS / 4) {
            int s = swizzle(r), part = threadIdx.x & 3;
            u32 number = tile * ROWS + r;
            bool inside = number < rows;
            u64 i = inside ? places[from + number] : 0;
            float* out = pool + net.place[net.layers] + r * outputs_apart;
            if (actor) {
                policy_loss(
                    out, s, part, inside, action + i * ACTIONS, mean + i * ACTIONS, log_probability[i], advantage[i],
                    constants, weight, losses + r, pulls + r * ACTIONS);
            } else if (part == 0) {
                if (inside) value_loss(out + s, value[i], returns[i], clip_value, weight, losses + r);
                else out[s] = 0.0f;
            }
        }
        __syncthreads();
        // The last warps add up losses while the others begin with the gradients.
        if (quantity < LOSSES + ACTIONS) {
            bool loss = quantity < LOSSES;
            const float* from_row = loss ? losses + quantity * ROWS : pulls + quantity - LOSSES;
            for (int r = 0; r < ROWS; r++) total += from_row[r * (loss ? 1 : ACTIONS)];
        }
        for (int layer = net.layers; layer-- > 0;) {
            gather_layer(net, layer, pool, gradient, first);
            __syncthreads();
            if (layer > 0) {
                backward_layer(net, layer, pool, weights);
                __syncthreads();
            }
        }
#if MEMORY
        input_layer(net, pool, weights);
        __syncthreads();
        float* of_input = actor ? of_actor_input : of_critic_input;
        int inputs = net.width[0], apart = net.padded[0];
        for (int i = threadIdx.x; i < ROWS * inputs; i += THREADS) {
            int r = i / inputs, c = i % inputs;
            u32 number = tile * ROWS + r;
            if (number < rows) of_input[(u64)number * inputs + c] = pool[net.place[0] + r * apart + (c ^ swizzle(r))];
        }
        __syncthreads();
#endif
        first = false;
    }
    if (quantity < LOSSES + ACTIONS) sums[blockIdx.x * (LOSSES + ACTIONS) + quantity] = total;
}
