#!/bin/sh
# Makes .venv at the repository root with the pinned packages of tools/requirements.txt.
# Usage: tools/setup_venv.sh [--torch] [--dds] [--ray] [PYTHON]      (PYTHON: an interpreter ≥ 3.11, default python3)
# --torch adds PyTorch (large), which tools/bench_ppo_torch.py, tools/export_lstm_torch.py, tools/make_export_fixtures.py and
# tools/make_graph_fixtures.py need; tools/make_trainer_fixtures.py needs more, which it names.
# --dds adds CycloneDDS, with which tools/make_robot_fixtures.py and the tests of gaitfit-robot use Unitree's SDK and ROS 2's messages.
# --ray adds Ray, which the tests of gaitfit.ray and tools/bench_ray.py need.
# Then:  .venv/bin/python tools/<script>.py --help
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
torch= dds= ray=
[ "${1:-}" != --torch ] || { torch=yes; shift; }
[ "${1:-}" != --dds ] || { dds=yes; shift; }
[ "${1:-}" != --ray ] || { ray=yes; shift; }
python=${1:-python3}
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "setup_venv.sh: $python is older than Python 3.11; give a newer one: tools/setup_venv.sh PYTHON" >&2
    exit 2
}
[ -x "$root/.venv/bin/python" ] || "$python" -m venv "$root/.venv"
"$root/.venv/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$root/tools/requirements.txt" \
    ${torch:+--requirement "$root/tools/requirements-torch.txt"} \
    ${dds:+--requirement "$root/tools/requirements-dds.txt"} \
    ${ray:+--requirement "$root/tools/requirements-ray.txt"}
"$root/.venv/bin/python" -c 'import mujoco, numpy, scipy; print(f"mujoco {mujoco.__version__}, numpy {numpy.__version__}, scipy {scipy.__version__}")'
