#!/usr/bin/env bash
# Puts small valid files of every kind into fuzz/corpus, where the fuzz targets begin.
set -euo pipefail
cd "$(dirname "$0")"
logs=../crates/gaitfit-import/tests/fixtures
policies=../crates/gaitfit-policy-files/tests/fixtures/policies
# put TARGET FILE…: names keep their folders apart.
put() {
    mkdir -p "corpus/$1"
    for file in "${@:2}"; do
        name="${file#../}"
        cp "$file" "corpus/$1/${name//\//_}"
    done
}
put pickle "$logs"/*.pkl
put sqlite "$logs"/bag/*.db3
put mcap "$logs"/*.mcap
put csv "$logs"/*.csv
put onnx "$policies"/*.onnx "$policies"/*/*.onnx
put safetensors "$policies"/*.safetensors
put mjcf ../assets/*.xml ../crates/gaitfit-model/tests/robots/*.xml
put urdf ../assets/*.urdf
# A triangle as a text in two formats.
mkdir -p corpus/mesh
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' > corpus/mesh/triangle.obj
printf 'solid t\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n' > corpus/mesh/triangle.stl
