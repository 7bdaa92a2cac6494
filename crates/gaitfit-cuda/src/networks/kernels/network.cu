// The policy's network, ROWS robots of a block together. Numbers of a layer lie robot after robot:
// number `k` of robot `r` at `k ROWS + r`.

// As gaitfit-policy has it: Cody and Waite's reduction, a series of degree 6.
DEVICE float exponential(float x) {
    x = x < -87.0f ? -87.0f : x;
    x = x > 88.0f ? 88.0f : x;
    float shifted = fmaf(x, 1.44269504f, 12582912.0f), n = shifted - 12582912.0f;
    float r = fmaf(n, 2.1219444e-4f, fmaf(n, -0.6933594f, x)), p = 1.0f / 720.0f;
    p = fmaf(p, r, 1.0f / 120.0f);
    p = fmaf(p, r, 1.0f / 24.0f);
    p = fmaf(p, r, 1.0f / 6.0f);
    p = fmaf(p, r, 0.5f);
    p = fmaf(p, r, 1.0f);
    p = fmaf(p, r, 1.0f);
#ifdef GAITFIT_HOST
    return p * float_of((bits_of(shifted) << 23) + (127u << 23));
#else
    return p * __uint_as_float((__float_as_uint(shifted) << 23) + (127u << 23));
#endif
}

DEVICE float tangent(float x) {
    x = x > 10.0f ? 10.0f : x;
    return 1.0f - 2.0f / (exponential(2.0f * x) + 1.0f);
}

DEVICE float sigmoid(float x) { return 1.0f / (1.0f + exponential(-x)); }

DEVICE float quotient(float a, float b) { return a / b; }

DEVICE float activated(Layer layer, float x) { return function_of(layer.function, layer.alpha, layer.lambda, x); }

// Waits for the layer's sums in `to`, normalises those of each robot and takes the layer's function (Ba, Kiros, Hinton 2016).
DEVICE void normalise(const float* network, Layer layer, float* to) {
    const float *weight = network + layer.norm + 4, *bias = weight + layer.outputs;
    __shared__ double means[ROWS], factors[ROWS];
    __syncthreads();
    if (threadIdx.x < ROWS) {
        double mean = 0.0, variance = 0.0;
        for (int j = 0; j < layer.outputs; j++) mean += (double)to[j * ROWS + threadIdx.x];
        mean = mean / (double)layer.outputs;
        for (int j = 0; j < layer.outputs; j++) {
            double apart = (double)to[j * ROWS + threadIdx.x] - mean;
            variance += apart * apart;
        }
        means[threadIdx.x] = mean;
        factors[threadIdx.x] = 1.0 / sqrt(variance / (double)layer.outputs + (double)network[layer.norm]);
    }
    __syncthreads();
    for (int i = threadIdx.x; i < layer.outputs * ROWS; i += blockDim.x) {
        int j = i / ROWS, r = i % ROWS;
        to[i] = activated(layer, (float)(((double)to[i] - means[r]) * factors[r]) * weight[j] + bias[j]);
    }
}

// Number `k` of an observation as the network takes it.
DEVICE float normalised(const float* network, int k, float x) {
#if NORMALISED
    x = x * network[NORMALISER + 2 * k] + network[NORMALISER + 2 * k + 1];
#endif
    return x;
}

// The sum of output `j` of `outputs` for robot `r`, over inputs by four.
DEVICE float product(const float4* matrix, int quads, int outputs, const float* from, int r, int j) {
    float sum = 0.0f;
#pragma unroll 8
    for (int k = 0; k < quads; k++) {
        float4 w = matrix[k * outputs + j];
        const float* x = from + 4 * k * ROWS + r;
        sum = fmaf(x[0], w.x, sum);
        sum = fmaf(x[ROWS], w.y, sum);
        sum = fmaf(x[2 * ROWS], w.z, sum);
        sum = fmaf(x[3 * ROWS], w.w, sum);
    }
    return sum;
}

// Fills `width` numbers of each robot up to a multiple of four with zeros: the next layer reads its inputs by four.
DEVICE void fill_up(float* to, int width) {
    for (int i = width * ROWS + threadIdx.x; i < (width + 3) / 4 * 4 * ROWS; i += blockDim.x) to[i] = 0.0f;
}

// Each number is summed in the order of the inputs, whatever ROWS and GROUP are. Weights of four inputs of an output lie together;
// behind the last input are zeros. Takes the dense layers from number `first_layer` to `end`; gives the buffer with the outputs.
DEVICE float* forward(const float* network, int first_layer, int end, float* from, float* to) {
    for (int l = first_layer; l < end; l++) {
        Layer layer = LAYER[l];
        const float4* matrix = (const float4*)(network + layer.weight);
        const float* bias = network + layer.bias;
        // A norm comes before the function.
        bool normed = layer.norm >= 0;
        if (layer.outputs * ROWS <= (int)blockDim.x) {
            // A thread an output of one robot.
            for (int i = threadIdx.x; i < layer.outputs * ROWS; i += blockDim.x) {
                int j = i % layer.outputs, r = i / layer.outputs;
                float y = product(matrix, layer.quads, layer.outputs, from, r, j) + bias[j];
                to[j * ROWS + r] = normed ? y : activated(layer, y);
            }
        } else {
            // A thread an output of GROUP robots.
            for (int i = threadIdx.x; i < layer.outputs * (ROWS / GROUP); i += blockDim.x) {
                int j = i % layer.outputs, first = i / layer.outputs * GROUP;
                float sums[GROUP];
#pragma unroll
                for (int r = 0; r < GROUP; r++) sums[r] = 0.0f;
#pragma unroll 8
                for (int k = 0; k < layer.quads; k++) {
                    float4 four = matrix[k * layer.outputs + j];
                    float w[4] = {four.x, four.y, four.z, four.w};
#pragma unroll
                    for (int input = 0; input < 4; input++) {
                        const float4* x = (const float4*)(from + (4 * k + input) * ROWS + first);
#pragma unroll
                        for (int q = 0; q < GROUP / 4; q++) {
                            float4 rows = x[q];
                            sums[4 * q] = fmaf(rows.x, w[input], sums[4 * q]);
                            sums[4 * q + 1] = fmaf(rows.y, w[input], sums[4 * q + 1]);
                            sums[4 * q + 2] = fmaf(rows.z, w[input], sums[4 * q + 2]);
                            sums[4 * q + 3] = fmaf(rows.w, w[input], sums[4 * q + 3]);
                        }
                    }
                }
#pragma unroll
                for (int r = 0; r < GROUP; r++) {
                    float y = sums[r] + bias[j];
                    to[j * ROWS + first + r] = normed ? y : activated(layer, y);
                }
            }
        }
        if (normed) normalise(network, layer, to);
        fill_up(to, layer.outputs);
        __syncthreads();
        float* other = from;
        from = to, to = other;
    }
    return from;
}

#if CELLS > 0
// A step of the recurrent layers of the first `rows` robots of a block. `remembered`: what the block's robots remember, robot after
// robot; `before` holds a layer's last outputs. Gives the buffer with the outputs. LSTM (Hochreiter, Schmidhuber 1997, with forget
// gates) and GRU (Cho et al. 2014), gates in PyTorch's order.
DEVICE float* remember(const float* network, float* remembered, int rows, float* from, float* to, float* before) {
    for (int l = 0; l < CELLS; l++) {
        Cell cell = CELL[l];
        for (int i = threadIdx.x; i < (cell.units + 3) / 4 * 4 * ROWS; i += blockDim.x) {
            int k = i / ROWS, r = i % ROWS;
            before[i] = r < rows && k < cell.units ? remembered[(u64)r * POLICY_MEMORY + cell.place + k] : 0.0f;
        }
        __syncthreads();
        const float4 *of_input = (const float4*)(network + cell.of_input), *of_output = (const float4*)(network + cell.of_output);
        // A thread a unit of one robot.
        for (int i = threadIdx.x; i < cell.units * ROWS; i += blockDim.x) {
            int u = i % cell.units, r = i / cell.units, outputs = GATES * cell.units;
            float out = 0.0f, x[4], h[4];
            if (r < rows) {
                float* own = remembered + (u64)r * POLICY_MEMORY + cell.place + u;
#pragma unroll
                for (int gate = 0; gate < GATES; gate++) {
                    int j = gate * cell.units + u;
                    x[gate] = product(of_input, cell.quads, outputs, from, r, j) + network[cell.input_bias + j];
                    h[gate] = product(of_output, (cell.units + 3) / 4, outputs, before, r, j) + network[cell.output_bias + j];
                }
#if GATES == 4
                float now = sigmoid(x[1] + h[1]) * own[cell.units] + sigmoid(x[0] + h[0]) * tangent(x[2] + h[2]);
                own[cell.units] = now;
                out = sigmoid(x[3] + h[3]) * tangent(now);
#else
                float reset = sigmoid(x[0] + h[0]), keep = sigmoid(x[1] + h[1]), candidate = tangent(x[2] + reset * h[2]);
                out = (1.0f - keep) * candidate + keep * before[u * ROWS + r];
#endif
                own[0] = out;
            }
            to[u * ROWS + r] = out;
        }
        fill_up(to, cell.units);
        __syncthreads();
        float* other = from;
        from = to, to = other;
    }
    return from;
}
#endif

#if ENCODED
// The input of a two-part policy's actor: numbers that it sees of the observation, and the latent. Gives the buffer with it.
DEVICE float* encode(const float* network, float* observation, float* other, float* passed) {
    for (int i = threadIdx.x; i < PASSED * ROWS; i += blockDim.x)
        passed[i] = observation[PASSED_FROM[i / ROWS] * ROWS + i % ROWS];
    __syncthreads();
    float* latent = forward(network, 0, ACTOR, observation, other);
    float* input = latent == observation ? other : observation;
    int width = ACTOR_INPUTS - PASSED;
    for (int i = threadIdx.x; i < ACTOR_INPUTS * ROWS; i += blockDim.x) {
        int from_latent = LATENT_FIRST ? i : i - PASSED * ROWS, from_passed = LATENT_FIRST ? i - width * ROWS : i;
        bool is_latent = from_latent >= 0 && from_latent < width * ROWS;
        input[i] = is_latent ? latent[from_latent] : passed[from_passed];
    }
    fill_up(input, ACTOR_INPUTS);
    __syncthreads();
    return input;
}
#endif

// The policy's actions for the observations in `first`; gives the buffer with them. `kept`: room for what a front keeps.
DEVICE float* choose(const float* network, float* remembered, int rows, float* first, float* second, float* kept) {
    float* input = first;
#if CELLS > 0
    input = remember(network, remembered, rows, first, second, kept);
#endif
#if ENCODED
    input = encode(network, first, second, kept);
#endif
    return forward(network, ACTOR, LAYERS, input, input == first ? second : first);
}
