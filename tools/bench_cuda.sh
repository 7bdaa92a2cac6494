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
# What to time (physics or train), then its arguments.
measure() {
    what=$1
    shift
    if ! "$gaitfit" bench "$what" --device "$device" --json "$@" >"$work/one" 2>"$work/error"; then
        echo "FAILED $what $*: $(cat "$work/error")" >&2
        failed=1
        return
    fi
    [ $first = 1 ] || printf ',' >>"$out"
    first=0
    cat "$work/one" >>"$out"
    python3 - "$work/one" "$*" "$what" <<'END' || true
import json, sys
d = json.load(open(sys.argv[1]))
if sys.argv[3] == "physics":
    text = (f"{d['substeps_per_second'] / 1e6:7.0f} M/s  {d['velocity_error_largest']:.1e}  same bits {d['same_bits']}  "
            f"lanes {d['lanes']}  registers {d['registers']}, local {d['local_bytes']} B  "
            f"ready in {d['compile_seconds']:.1f} s  height {d['base_height_m']:.3f}")
else:
    parts = "  ".join(f"{name} {1e3 * seconds:.2f}" for name, seconds in d["breakdown"].items())
    text = (f"{1e3 * d['iteration_seconds']:6.2f} ms an iteration  {1e-6 * d['samples_per_second']:.1f} M samples/s  "
            f"same bits {d['same_bits']}  {d['memory_bytes'] / 2**20:.0f} MiB  start {d['start_seconds']:.1f} s  ms: {parts}")
print(f"{text}  {sys.argv[2]}", flush=True)
END
}
for preset in fast accurate; do
    for environments in 4096 16384 65536; do
        measure physics --preset $preset --environments $environments
    done
    measure physics --preset $preset --environments 65536 --substeps 20
done
for environments in 4096 65536; do
    measure physics --geoms all --environments $environments
done
# A caller may ask for more: one line of arguments each.
printf '%s\n' "${GAITFIT_BENCH_MORE:-}" | while read -r line; do
    # shellcheck disable=SC2086
    [ -z "$line" ] || measure physics $line
done
printf '], "train": [' >>"$out"
first=1
# Robots that fall, and robots that walk.
measure train --iterations 10
measure train --iterations 300
measure train --iterations 300 --precision f32
measure train --iterations 30 --environments 16384
printf ']}\n' >>"$out"
exit $failed
