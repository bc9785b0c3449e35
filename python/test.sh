#!/usr/bin/env bash
# Tests the Python module, types included, in an environment of its own: target/python-tests, made where it is not there. PyTorch is used
# where the Python that makes it has one (Debian: python3-torch); its tests are left out otherwise. Octave likewise.
#
#     python/test.sh [pytest's arguments]
#
# The program is that of TURBID, else target/debug/turbid, which must be built with the feature `tables` (`cargo build --features tables`).
set -euo pipefail
cd "$(dirname "$0")/.."

environment=${TURBID_PYTHON_TESTS:-target/python-tests}
if [ ! -x "$environment/bin/pytest" ]; then
    "${PYTHON:-python3}" -m venv --system-site-packages "$environment"
    "$environment/bin/pip" install --quiet "numpy<2" xarray polars matplotlib pytest mypy OpenEXR
fi
export TURBID=${TURBID:-$PWD/target/debug/turbid} PYTHONPATH=$PWD/python PYTHONDONTWRITEBYTECODE=1
[ -x "$TURBID" ] || { echo "there is no program at $TURBID: cargo build --features tables"; exit 2; }
"$environment/bin/mypy" --config-file pyproject.toml --cache-dir=/dev/null
"$environment/bin/pytest" "$@"
