#!/bin/sh
# Records the demo's logs anew: assets/go2-walk.safetensors on the robot of examples/go2-ground/robot.toml, in official
# MuJoCo. To be run after a change of the policy or the robot; needs tools/setup_venv.sh once.
# Usage: tools/make_ground_demo.sh [PYTHON]      (PYTHON: one with tools/requirements.txt, default .venv/bin/python)
# GAITFIT names a program that is built already.
set -eu
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python}
logs=examples/go2-ground/logs
gaitfit=${GAITFIT:-cargo run --release --quiet --}
made=$(mktemp -d)
trap 'rm -rf "$made"' EXIT
$gaitfit export assets/go2-walk.safetensors --onnx "$made/go2-walk.onnx" > /dev/null
"$python" tools/mujoco_robot.py collect --policy "$made/go2-walk.onnx" --robot examples/go2-ground/robot.toml \
    --out "$made/logs" --trajectories 64 --seconds 4 --log-shift 0.02 0.1 --seed 1 --digits 4 --base imu
rm -rf "$logs"
mv "$made/logs" "$logs"
du -sh "$logs"
