// Reads observations from standard input, kObservation numbers each, and writes a line of actions for each; with
// --targets position targets in rad.
//
//   g++ -std=c++17 -O2 -march=native example.cpp -o example

#include "policy.hpp"

#include <cstdio>
#include <cstring>

int main(int argc, char** argv) {
  const bool as_targets = argc == 2 && std::strcmp(argv[1], "--targets") == 0;
  if (argc > 2 || (argc == 2 && !as_targets)) {
    std::fprintf(stderr, "usage: %s [--targets] < observations\n", argv[0]);
    return 2;
  }
  static gaitfit_policy::Policy policy;
  static gaitfit_policy::Observation observation;
  for (long row = 1;; ++row) {
    for (std::size_t i = 0; i < gaitfit_policy::kObservation; ++i) {
      const int found = std::scanf("%f", &observation[i]);
      if (found == EOF && i == 0) return 0;
      if (found != 1) {
        std::fprintf(stderr, "observation %ld: number %zu of %zu is missing or no number\n", row, i + 1,
                     gaitfit_policy::kObservation);
        return 1;
      }
    }
    gaitfit_policy::Action action = policy.step(observation);
    if (as_targets) action = gaitfit_policy::targets(action);
    for (std::size_t i = 0; i < gaitfit_policy::kJoints; ++i) {
      std::printf(i == 0 ? "%.9g" : " %.9g", static_cast<double>(action[i]));
    }
    std::printf("\n");
  }
}
