// Candidates on recordings: environment `e` is candidate `e / recordings` on recording `e % recordings`. The physics has
// `places` for environments, `count` of which are asked for; those beyond are copies of the first.

DEVICE u32 source_of(u32 place, u32 count) { return place % count; }

// Puts each candidate's parameters where the physics reads them: a thread a place, a block row a parameter.
// `numbers`: candidates x PARAMS. `factors`: candidates x 3 JOINTS, on position and velocity gains, then encoder biases;
// `gains`: recordings x 3 JOINTS, position and velocity gains, then the first positions. Only replays look at them.
KERNEL spread(
    u32 count, u32 places, u32 recordings, const float* numbers, const double* factors, const double* gains, float* params
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x, k = blockIdx.y;
    if (e >= places) return;
    u32 own = source_of(e, count), candidate = own / recordings;
    float number = numbers[(u64)candidate * PARAMS + k];
#if REPLAYS
    int gain = GAIN_OF[k];
    u32 recording = own % recordings;
    if (gain >= 0)
        number = (float)(factors[(u64)candidate * 3 * JOINTS + gain] * gains[(u64)recording * 3 * JOINTS + gain]);
#endif
    at(params, PARAMS_SIZE, PARAM_SPOTS[k], e) = number;
}
