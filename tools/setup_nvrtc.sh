#!/bin/sh
# Makes .nvrtc at the repository root: a Python environment with NVIDIA's run-time compiler, for the tests whose names
# begin with nvrtc_. No GPU or driver is needed.
# Usage: tools/setup_nvrtc.sh [PYTHON]      (PYTHON: default python3)
# Then:  VIRTUAL_ENV=$PWD/.nvrtc cargo test -p gaitfit-cuda -- --ignored nvrtc_
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
[ -x "$root/.nvrtc/bin/python" ] || "${1:-python3}" -m venv "$root/.nvrtc"
"$root/.nvrtc/bin/python" -m pip install --quiet --disable-pip-version-check nvidia-cuda-nvrtc==13.0.88
find "$root/.nvrtc" -name 'libnvrtc.so*'
