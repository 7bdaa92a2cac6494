#!/bin/sh
# Checks and times the physics and trainings on a GPU and writes one JSON document. Builds nothing.
# Usage: tools/bench_cuda.sh [GAITFIT [OUT.json [DEVICE]]]
#   (GAITFIT: default target/release/gaitfit; OUT: default bench_cuda.json; DEVICE: default cuda)
# Each line on the terminal: million substeps a second, and the largest error of a velocity against f64 after one
# control period of 1,024 robots; of trainings, the time of an iteration and of its parts.
set -eu
gaitfit=${1:-target/release/gaitfit}
out=${2:-bench_cuda.json}
device=${3:-cuda}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
printf '{"doctor": ' >"$out"
"$gaitfit" doctor --json >>"$out"
printf ', "physics": [' >>"$out"
first=1
failed=0
measure() {
    if ! "$gaitfit" bench physics --device "$device" --json "$@" >"$work/one" 2>"$work/error"; then
        echo "FAILED $*: $(cat "$work/error")" >&2
        failed=1
        return
    fi
    [ $first = 1 ] || printf ',' >>"$out"
    first=0
    cat "$work/one" >>"$out"
    python3 - "$work/one" "$*" <<'END' || true
import json, sys
d = json.load(open(sys.argv[1]))
print(f"{d['substeps_per_second'] / 1e6:7.0f} M/s  {d['velocity_error_largest']:.1e}  same bits {d['same_bits']}  "
      f"lanes {d['lanes']}  registers {d['registers']}, local {d['local_bytes']} B  "
      f"ready in {d['compile_seconds']:.1f} s  height {d['base_height_m']:.3f}  {sys.argv[2]}", flush=True)
END
}
for preset in fast accurate; do
    for environments in 4096 16384 65536; do
        measure --preset $preset --environments $environments
    done
    measure --preset $preset --environments 65536 --substeps 20
done
for environments in 4096 65536; do
    measure --geoms all --environments $environments
done
# A caller may ask for more: one line of arguments each.
printf '%s\n' "${GAITFIT_BENCH_MORE:-}" | while read -r line; do
    # shellcheck disable=SC2086
    [ -z "$line" ] || measure $line
done
printf '], "train": [' >>"$out"
first=1
train() {
    if ! "$gaitfit" bench train --device "$device" --json "$@" >"$work/one" 2>"$work/error"; then
        echo "FAILED train $*: $(cat "$work/error")" >&2
        failed=1
        return
    fi
    [ $first = 1 ] || printf ',' >>"$out"
    first=0
    cat "$work/one" >>"$out"
    python3 - "$work/one" "$*" <<'END' || true
import json, sys
d = json.load(open(sys.argv[1]))
parts = "  ".join(f"{name} {1e3 * seconds:.2f}" for name, seconds in d["breakdown"].items())
print(f"{1e3 * d['iteration_seconds']:6.2f} ms an iteration  {1e-6 * d['samples_per_second']:.1f} M samples/s  "
      f"same bits {d['same_bits']}  {d['memory_bytes'] / 2**20:.0f} MiB  start {d['start_seconds']:.1f} s  ms: {parts}  "
      f"{sys.argv[2]}", flush=True)
END
}
# Robots that fall, and robots that walk.
train --iterations 10
train --iterations 300
train --iterations 300 --exact
train --iterations 30 --environments 16384
printf ']}\n' >>"$out"
exit $failed
