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

DEVICE float activated(float x) {
#if ACTIVATION == 0
    return x > 0.0f ? x : exponential(x) - 1.0f;
#elif ACTIVATION == 1
    return x < 0.0f ? 0.0f : x;
#else
    x = x > 10.0f ? 10.0f : x;
    return 1.0f - 2.0f / (exponential(2.0f * x) + 1.0f);
#endif
}

// Each number is summed in the order of the inputs, whatever ROWS and GROUP are. Weights of four inputs of an output lie together;
// behind the last input are zeros. Gives the buffer with the outputs.
DEVICE float* forward(const float* network, float* from, float* to) {
    for (int l = 0; l < LAYERS; l++) {
        Layer layer = LAYER[l];
        const float4* matrix = (const float4*)(network + layer.weight);
        const float* bias = network + layer.bias;
        bool last = l + 1 == LAYERS;
        if (layer.outputs * ROWS <= (int)blockDim.x) {
            // A thread an output of one robot.
            for (int i = threadIdx.x; i < layer.outputs * ROWS; i += blockDim.x) {
                int j = i % layer.outputs, r = i / layer.outputs;
                float sum = 0.0f;
#pragma unroll 8
                for (int k = 0; k < layer.quads; k++) {
                    float4 w = matrix[k * layer.outputs + j];
                    const float* x = from + 4 * k * ROWS + r;
                    sum = fmaf(x[0], w.x, sum);
                    sum = fmaf(x[ROWS], w.y, sum);
                    sum = fmaf(x[2 * ROWS], w.z, sum);
                    sum = fmaf(x[3 * ROWS], w.w, sum);
                }
                float y = sum + bias[j];
                to[j * ROWS + r] = last ? y : activated(y);
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
                    to[j * ROWS + first + r] = last ? y : activated(y);
                }
            }
        }
        // The next layer's inputs are a multiple of four.
        for (int i = layer.outputs * ROWS + threadIdx.x; i < (layer.outputs + 3) / 4 * 4 * ROWS; i += blockDim.x)
            to[i] = 0.0f;
        __syncthreads();
        float* other = from;
        from = to, to = other;
    }
    return from;
}
