// The words of a generated control period for an ordinary processor: one number for each lane of one environment.
#include <cmath>
#include <cstring>
typedef float R __attribute__((vector_size(4 * LANES)));
typedef int I __attribute__((vector_size(4 * LANES)));
// The environment's number in its tile.
static int environment;
static inline R all(float x) {
  R r;
  for (int i = 0; i < LANES; ++i) r[i] = x;
  return r;
}
#define K(x) all(x)
static inline R FMA(R a, R b, R c) { return a * b + c; }
static inline R SELECT(R a, R b, R x, R y) { return a < b ? x : y; }
static inline R MIN(R a, R b) { return a < b ? a : b; }
static inline R MAX(R a, R b) { return a > b ? a : b; }
static inline R ROUND(R a) { for (int i = 0; i < LANES; ++i) a[i] = std::nearbyint(a[i]); return a; }
struct Four { R n0, n1, n2, n3; };
#define FUNCTION(name) static Four name(R i0, R i1, R i2)
#define GATHER(table, at) gather(table, sizeof(table) / 4, at)
static inline R gather(const float* table, unsigned length, R at) {
  for (int i = 0; i < LANES; ++i) at[i] = (unsigned)(int)at[i] < length ? table[(int)at[i]] : 0.f;
  return at;
}
static inline R ABS(R a) { return a < 0 ? -a : a; }
static inline R RECIP(R a) { return 1.f / a; }
static inline R DIV(R a, R b) { return a / b; }
#define EACH(name, call) static inline R name(R x) { for (int i = 0; i < LANES; ++i) x[i] = call(x[i]); return x; }
EACH(SQRT, std::sqrt)
EACH(TANH, std::tanh)
static inline void SINCOS(R x, R& s, R& c) {
  for (int i = 0; i < LANES; ++i) { s[i] = std::sin(x[i]); c[i] = std::cos(x[i]); }
}
#define OVER(name, join)                                                          \
  static inline R name(R x) {                                                     \
    float total = x[0];                                                           \
    for (int i = 1; i < LANES; ++i) { float other = x[i]; total = join; }         \
    return all(total);                                                            \
  }
OVER(LANE_SUM, total + other)
OVER(LANE_MAX, std::fmax(total, other))
OVER(LANE_MIN, std::fmin(total, other))
static inline bool UNLESS(R a, R b) {
#ifdef EVERY_REGION
  return true;
#endif
  I whether = a >= b;
  for (int i = 0; i < LANES; ++i) if (!whether[i]) return true;
  return false;
}
#define FRESH(pointer)
#define FRESH_TABLE
#define SCRATCH(count) R scratch_room[count]; for (R& room : scratch_room) room = all(NAN);
#define GET(k) scratch_room[k]
#define PUT(k, x) scratch_room[k] = x;
#define ONCE
#define __device__
#define KERNEL(name)                                                                             \
  extern "C" void name(float* state, const float* params, float* targets, float* memory,         \
                       const float* weights, float* report, const float* disturbance, \
                       int per_candidate)
#define BEGIN
#define PLACE(type, class, base, own, size)      \
  type* class##_own = base + environment * LANES; \
  type* class##_all = base + (own) * 32 + environment;
#define NEXT(class, size) class##_own += (size); class##_all += (size);
// All environments of the tile are of one candidate.
#define PLACE_WEIGHTS(own, size) const float* w_own = weights; const float* w_all = weights + (own) * LANES;
#define PLACE_TABLE(rows)
static inline R row(const float* at) { R r; std::memcpy(&r, at, 4 * LANES); return r; }
#define HELD_OWN(class, k) row(class##_own + (k) * 32)
#define GIVEN_OWN(class, k) row(class##_own + (k) * 32)
#define HELD_ALL(class, k) all(class##_all[(k) * (32 / LANES)])
#define GIVEN_ALL(class, k) all(class##_all[(k) * (32 / LANES)])
#define WEIGHT_OWN(k) row(w_own + (k) * LANES)
#define WEIGHT_ALL(k) all(w_all[k])
#define ROW(k) row(table_values + (k) * LANES)
#define KEEP_OWN(class, k, x) { R value = x; std::memcpy(class##_own + (k) * 32, &value, 4 * LANES); }
#define KEEP_ALL(class, k, x) { R value = x; class##_all[(k) * (32 / LANES)] = value[0]; }
