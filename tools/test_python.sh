#!/bin/sh
# Builds the Python package in debug, as a link in its own folder, and runs its tests in .venv (tools/setup_venv.sh).
# Usage: tools/test_python.sh [TEST...]      (for example tests.test_costs; default: all)
# Tests of packages that .venv lacks (PyTorch, rsl_rl, Stable-Baselines3, Ray) are skipped, and their names are printed.
set -eu
cd "$(dirname "$0")/.."
# Of the whole workspace: the features of its packages, and so what is compiled, are those of its tests.
cargo build --locked --workspace
ln -sf ../../target/debug/lib_gaitfit.so python/gaitfit/_gaitfit.abi3.so
cd python
if [ $# -gt 0 ]; then
    exec ../.venv/bin/python -m unittest -v "$@"
fi
exec ../.venv/bin/python -m unittest discover --top-level-directory . --start-directory tests -v
