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

// Each number is summed in the order of the inputs, whatever ROWS is. Gives the buffer with the outputs.
DEVICE float* forward(const float* network, float* from, float* to) {
    for (int l = 0; l < LAYERS; l++) {
        Layer layer = LAYER[l];
        for (int j = threadIdx.x; j < layer.outputs; j += blockDim.x) {
            const float* weights = network + layer.weight + j;
            float sums[ROWS];
#pragma unroll
            for (int r = 0; r < ROWS; r++) sums[r] = 0.0f;
#pragma unroll 8
            for (int k = 0; k < layer.inputs; k++) {
                float weight = weights[k * layer.outputs];
                const float4* x = (const float4*)(from + k * ROWS);
#pragma unroll
                for (int q = 0; q < ROWS / 4; q++) {
                    float4 four = x[q];
                    sums[4 * q] = fmaf(four.x, weight, sums[4 * q]);
                    sums[4 * q + 1] = fmaf(four.y, weight, sums[4 * q + 1]);
                    sums[4 * q + 2] = fmaf(four.z, weight, sums[4 * q + 2]);
                    sums[4 * q + 3] = fmaf(four.w, weight, sums[4 * q + 3]);
                }
            }
            float bias = network[layer.bias + j];
#pragma unroll
            for (int r = 0; r < ROWS; r++) {
                float y = sums[r] + bias;
                to[j * ROWS + r] = l + 1 < LAYERS ? activated(y) : y;
            }
        }
        __syncthreads();
        float* other = from;
        from = to, to = other;
    }
    return from;
}
