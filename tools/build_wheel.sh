#!/bin/sh
# Builds the release wheel of the Python package, with the program in it, for every Python from 3.10 on (abi3).
# Usage: tools/build_wheel.sh [FOLDER] [MATURIN-OPTION...]      (FOLDER: where it goes, default dist)
# It takes Rust and Python; maturin comes from the package index into a folder of its own. The wheel needs the C library that
# it was built with, or a later one: its name says which (manylinux_2_35: glibc 2.35). For older ones build on an older system.
# For `gaitfit run` on a robot over DDS:  tools/build_wheel.sh dist --features dds
# For imports of Parquet, Arrow and HDF5, as in a release:  --features all-formats
set -eu
cd "$(dirname "$0")/.."
out=${1:-dist}
[ $# -eq 0 ] || shift
most=$((30 * 1024 * 1024))
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
python3 -m venv "$tools/venv"
"$tools/venv/bin/python" -m pip install --quiet --disable-pip-version-check 'maturin>=1.7,<2'
"$tools/venv/bin/python" tools/make_notices.py
"$tools/venv/bin/maturin" build --profile dist --locked --manifest-path python/Cargo.toml --out "$tools/wheel" "$@"
# The licence texts are in it.
for text in LICENSE-MIT LICENSE-APACHE LICENSE-THIRD-PARTY.txt; do
    "$tools/venv/bin/python" -m zipfile --list "$tools"/wheel/*.whl | grep -q "licenses/$text" ||
        { echo "build_wheel.sh: the wheel lacks $text" >&2; exit 1; }
done
# What was built does what it should where nothing else is.
python3 -m venv "$tools/own"
"$tools/own/bin/python" -m pip install --quiet --disable-pip-version-check "$tools"/wheel/*.whl
(cd "$tools" && own/bin/gaitfit --version && own/bin/python -c 'import gaitfit; gaitfit.fit; gaitfit.config.Fit()')
mkdir -p "$out"
for wheel in "$tools"/wheel/*.whl; do
    size=$(wc -c <"$wheel")
    [ "$size" -le "$most" ] || { echo "build_wheel.sh: $wheel has $size bytes, more than $most" >&2; exit 1; }
    mv "$wheel" "$out/"
    echo "$out/$(basename "$wheel"): $((size / 1024)) KiB"
done
