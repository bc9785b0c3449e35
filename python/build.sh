#!/usr/bin/env bash
# Builds the wheel for Linux with glibc 2.17 or newer, and the source distribution, into target/wheels. Needs a Rust toolchain, Python 3.9 or
# newer and its registry of packages: maturin, and zig, which links for an old glibc, come from there. Half an hour on two busy cores.
set -euo pipefail
cd "$(dirname "$0")/.."

tools=target/python-tools
[ -x $tools/bin/maturin ] || { "${PYTHON:-python3}" -m venv $tools && $tools/bin/pip install --quiet 'maturin>=1.7,<2' ziglang; }
export PATH="$PWD/$tools/bin:$PATH"
maturin sdist --out target/wheels
maturin build --release --zig --compatibility manylinux_2_17 --out target/wheels
ls -l target/wheels
