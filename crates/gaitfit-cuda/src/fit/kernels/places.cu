// Candidates on recordings: environment `n` is candidate `n / recordings` on recording `n % recordings`. `count` are asked
// for. A tile of the physics has PER_TILE places. DENSITY of them are slots of environments of their own, the others copies
// of these: a warp with fewer robots leaves out more. Slots beyond the last environment are copies of the first.

DEVICE u32 environment_of(u32 slot, u32 count) { return slot % count; }
DEVICE u32 slot_of(u32 place) { return place / PER_TILE * DENSITY + place % PER_TILE % DENSITY; }
DEVICE u32 place_of(u32 slot) { return slot / DENSITY * PER_TILE + slot % DENSITY; }
// Every place `e` of a slot: the numbers of copies are written too.
#define EACH_COPY(slot) for (u32 e = place_of(slot), end = e - e % PER_TILE + PER_TILE; e < end; e += DENSITY)

// Puts each candidate's parameters where the physics reads them: a thread a place, a block row a parameter.
// `numbers`: candidates x PARAMS. `factors`: candidates x 3 JOINTS, on position and velocity gains, then encoder biases;
// `gains`: recordings x 3 JOINTS, position and velocity gains, then the first positions. Only replays look at them.
KERNEL spread(
    u32 count, u32 places, u32 recordings, const float* numbers, const double* factors, const double* gains, float* params
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x, k = blockIdx.y;
    if (e >= places) return;
    u32 own = environment_of(slot_of(e), count), candidate = own / recordings;
    float number = numbers[(u64)candidate * PARAMS + k];
#if REPLAYS
    int gain = GAIN_OF[k];
    u32 recording = own % recordings;
    if (gain >= 0)
        number = (float)(factors[(u64)candidate * 3 * JOINTS + gain] * gains[(u64)recording * 3 * JOINTS + gain]);
#endif
    at(params, PARAMS_SIZE, PARAM_SPOTS[k], e) = number;
}
