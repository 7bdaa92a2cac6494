// Which samples make up which minibatch: the deal of gaitfit-learn, which shuffles a pack of cards one after the other
// (Durstenfeld 1964), here for all cards at once.
//
// Step i of the shuffle swaps places i and H(i) <= i, for i = n-1 .. 1, and place i is not touched again. So what lies
// at place p just before step i came there with the latest earlier step j > i that has H(j) = p, from place j; else it
// lay there from the beginning. Following these steps back ends at the card's first place; the way is a few steps long.

// Epochs are the grid's second dimension. `swaps`: H of each step; `head`, `next`: lists of the steps with one H, in any
// order, numbered from 1, 0 ends a list.
KERNEL shuffle_link(const u32* control, u32 samples, u32* swaps, u32* head, u32* next) {
    u32 epoch = blockIdx.y, base = epoch * samples;
    u32 block = blockIdx.x * blockDim.x + threadIdx.x;
    u32 words[4] = {block, epoch, control[ITERATION], 11u};
    philox(words, control[SEED_LOW], control[SEED_HIGH]);
    for (u32 k = 0; k < 4; k++) {
        u64 draw = (u64)block * 4 + k;
        if (draw + 1 >= samples) return;
        u32 last = samples - 1 - (u32)draw;
        u32 other = (u32)(((u64)words[k] * ((u64)last + 1)) >> 32);
        swaps[base + last] = other;
        next[base + last] = atomicExch(&head[base + other], last + 1);
    }
}

// The first step after `after` with this H, or 0: step 0 swaps nothing.
DEVICE u32 first_after(const u32* head, const u32* next, u32 place, u32 after) {
    u32 best = 0;
    for (u32 entry = head[place]; entry != 0; entry = next[entry - 1]) {
        u32 step = entry - 1;
        if (step > after && (best == 0 || step < best)) best = step;
    }
    return best;
}

// The minibatch of every sample.
KERNEL shuffle_follow(u32 samples, u32 minibatches, const u32* swaps, const u32* head, const u32* next, u32* cards) {
    u32 base = blockIdx.y * samples, i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= samples) return;
    head += base, next += base;
    u32 place = i == 0 ? 0 : swaps[base + i];
    u32 step = first_after(head, next, place, i);
    while (step != 0) {
        place = step;
        step = first_after(head, next, place, place);
    }
    cards[base + i] = (u32)((((u64)place + 1) * minibatches - 1) / samples);
}

#define CHUNK 256

// Samples of each minibatch in each chunk of CHUNK samples: `counts` is epochs x chunks x minibatches.
KERNEL shuffle_count(u32 samples, u32 minibatches, const u32* cards, u32* counts) {
    POOL(pool);
    u32* own = (u32*)pool;
    for (u32 m = threadIdx.x; m < minibatches; m += blockDim.x) own[m] = 0;
    __syncthreads();
    u32 i = blockIdx.x * CHUNK + threadIdx.x;
    if (i < samples) atomicAdd(&own[cards[blockIdx.y * samples + i]], 1u);
    __syncthreads();
    u32* out = counts + ((u64)blockIdx.y * gridDim.x + blockIdx.x) * minibatches;
    for (u32 m = threadIdx.x; m < minibatches; m += blockDim.x) out[m] = own[m];
}

// Turns counts into where each chunk's samples of each minibatch begin.
KERNEL shuffle_begin(u32 samples, u32 minibatches, u32 chunks, u32* counts) {
    u32 m = blockIdx.x * blockDim.x + threadIdx.x;
    if (m >= minibatches) return;
    u32* own = counts + (u64)blockIdx.y * chunks * minibatches + m;
    u32 begin = (u32)((u64)m * samples / minibatches);
    // Sixteen at a time, so that their loads do not wait for each other.
    for (u32 chunk = 0; chunk < chunks; chunk += 16) {
        u32 count[16];
#pragma unroll
        for (u32 k = 0; k < 16; k++) count[k] = chunk + k < chunks ? own[(u64)(chunk + k) * minibatches] : 0;
#pragma unroll
        for (u32 k = 0; k < 16; k++) {
            if (chunk + k < chunks) own[(u64)(chunk + k) * minibatches] = begin;
            begin += count[k];
        }
    }
}

// Rows of the minibatches one after the other, within a minibatch in the order of the samples. A sample's number goes
// through tiles of `tile` environments, then steps, then the tile's environments; a row through steps, then all
// environments.
KERNEL shuffle_place(
    u32 samples, u32 minibatches, u32 steps, u32 environments, u32 tile, const u32* cards, const u32* begins, u32* places
) {
    __shared__ u32 own[CHUNK];
    u32 i = blockIdx.x * CHUNK + threadIdx.x, base = blockIdx.y * samples;
    own[threadIdx.x] = i < samples ? cards[base + i] : 0xFFFFFFFFu;
    __syncthreads();
    if (i >= samples) return;
    u32 card = own[threadIdx.x], rank = 0;
    for (u32 k = 0; k < threadIdx.x; k++) rank += own[k] == card;
    u32 slot = begins[((u64)blockIdx.y * gridDim.x + blockIdx.x) * minibatches + card] + rank;
    u32 whole = tile * steps, number = i / whole, local = i % whole;
    u32 left = environments - number * tile, width = left < tile ? left : tile;
    places[base + slot] = local / width * environments + number * tile + local % width;
}
