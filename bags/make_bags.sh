#!/usr/bin/env bash
# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Makes the bags of this folder again: short runs of the simulated stand, perfect sensors.
set -eu
cd "$(dirname "$0")/.."
identnl=${IDENTNL:-.venv/bin/identnl}
rm -rf bags/*.mcap
"$identnl" simulate --machine config/knee_column.yaml --excitation sine --noise none \
    --duration 0.15 --rate 10000 --seed 1 --out bags/knee_column_sine.mcap
"$identnl" simulate --machine config/three_body.yaml --excitation multisine --noise none \
    --duration 0.15 --rate 10000 --seed 2 --out bags/three_body_multisine.mcap
"$identnl" simulate --machine config/oscillator.yaml --excitation multisine --noise nominal \
    --duration 20 --amplitude 0.1 --seed 3 --out bags/oscillator_multisine.mcap
