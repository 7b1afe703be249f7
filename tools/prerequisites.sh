#!/bin/sh
# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Print the Python interpreter that makes the environment, or name what is missing together
# with the package of Debian or Ubuntu that brings it.
# Usage: tools/prerequisites.sh [python ...]     candidates, the first that suffices is taken

[ "$#" -gt 0 ] || set -- python3.12 python3.11 python3

missing=''
lacks() {
    missing="$missing
  $1 not found: install the package $2"
}

# What an interpreter lacks, one line each; fails if it is too old or does not run. Being
# found proves little: a version manager leaves commands behind that only print an error.
inspect() {
    "$1" - 2>/dev/null <<'PYTHON'
import importlib.util
import os
import sys
import sysconfig

if sys.version_info < (3, 11):
    sys.exit(1)
# In a virtual environment, the interpreter it was made from: the environment may go.
print(getattr(sys, '_base_executable', None) or sys.executable)
name = f'python{sys.version_info[0]}.{sys.version_info[1]}'
if not (importlib.util.find_spec('venv') and importlib.util.find_spec('ensurepip')):
    print(f'venv of {name}', f'{name}-venv', sep='|')
if not os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')):
    print(f'Python.h of {name}', f'{name}-dev', sep='|')
PYTHON
}

python=''
python_lacks=''
for candidate in "$@"; do
    found=$(inspect "$candidate") || continue
    lines=$(printf '%s\n' "$found" | sed 1d)
    if [ -z "$python" ] || [ -z "$lines" ]; then
        python=$(printf '%s\n' "$found" | sed -n 1p)
        python_lacks=$lines
    fi
    [ -n "$lines" ] || break
done

[ -n "$python" ] || lacks "Python 3.11 or newer (tried $*)" 'python3, or python3.12 or python3.11'
while IFS='|' read -r what package; do
    [ -z "$what" ] || lacks "$what" "$package"
done <<LINES
$python_lacks
LINES

compiler=''
for candidate in "$CXX" c++ g++ clang++; do
    command -v "$candidate" >/dev/null 2>&1 && compiler=$candidate && break
done
[ -n "$compiler" ] || lacks 'g++' 'g++'
command -v git >/dev/null 2>&1 || lacks 'git' 'git'

if [ "$(uname -sm)" != 'Linux x86_64' ]; then
    missing="$missing
  ROS 2 comes as Python wheels for Linux on x86_64 only, this is $(uname -sm): use a ROS 2
  installation and colcon"
fi

if [ -n "$missing" ]; then
    printf 'Cannot set up:%s\n' "$missing" >&2
    exit 1
fi
printf '%s\n' "$python"
