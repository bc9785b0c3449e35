#!/usr/bin/env bash
# Tests the Python module, types and tutorial included, in an environment of its own: target/python-tests, made where it is not there.
#
#     python/test.sh [pytest's arguments]
#
# The program is that of TURBID, else target/debug/turbid as `cargo test` leaves it (with the feature `tables`); nothing is built. PyTorch is
# used where a Python of the machine has one (Debian: python3-torch), Octave where there is one; else their tests are skipped.
# Ends with 3 where the environment cannot be made.
set -euo pipefail
cd "$(dirname "$0")/.."

export TURBID=${TURBID:-$PWD/target/debug/turbid} PYTHONPATH=$PWD/python PYTHONDONTWRITEBYTECODE=1
[ -x "$TURBID" ] || { echo "there is no program at $TURBID: cargo build --features tables"; exit 2; }

environment=${TURBID_PYTHON_TESTS:-target/python-tests}
if [ ! -x "$environment/bin/pytest" ]; then
    python=${PYTHON:-python3}
    [ -n "${PYTHON:-}" ] || ! /usr/bin/python3 -c 'import torch, ensurepip' 2>/dev/null || python=/usr/bin/python3
    "$python" -c 'import sys, venv, ensurepip; assert sys.version_info >= (3, 9)' 2>/dev/null || { echo "there is no Python 3.9 or newer with venv"; exit 3; }
    "$python" -m venv --system-site-packages "$environment"
    "$environment/bin/python" -m pip install --quiet "numpy<2" xarray polars "pyarrow; python_version < '3.10'" matplotlib pytest mypy OpenEXR || { rm -r "$environment"; echo "its packages cannot be had"; exit 3; }
fi
"$environment/bin/python" -m mypy --config-file pyproject.toml --cache-dir=/dev/null
"$environment/bin/python" -m pytest "$@"
