"""matlab/turbid_read.m in Octave reads the numbers that Python reads."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy
import pytest

import turbid

from conftest import ROOT, Space

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
pytestmark = pytest.mark.skipif(OCTAVE is None, reason="there is no Octave")


def octave(space: Space, code: str) -> str:
    """What a script prints."""
    head = f"addpath('{ROOT / 'matlab'}'); options = {{'turbid', '{turbid.executable()}', 'outputs', '{space.outputs}'}};\n"
    assert OCTAVE is not None
    done = subprocess.run([OCTAVE, "--no-gui", "--norc", "--quiet", "--eval", head + code], capture_output=True, text=True, cwd=space.folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_maps(small: Space, tmp_path: Path) -> None:
    code = f"""
        m = turbid_read('{small.file}', 'maps', options{{:}});
        raw = m.mu_a; raw(isnan(raw)) = 0;
        save('-v7', '{tmp_path}/back.mat', 'raw');
        printf('%s\\n', jsonencode(struct('units', m.units, 'x', m.x_mm, 'y', m.y_mm, 'nan', nnz(isnan(m.mu_a)), 'masked', nnz(m.mask), ...
            'se', m.mu_a_se(5, 7), 'convention', m.attributes.convention, 'size', size(m.mu_a))));
    """
    told = json.loads(octave(small, code))
    maps = small.open("maps")
    mu_a = maps["mu_a"]
    assert told["units"]["mu_a"] == "mm^-1" and told["convention"] == "camera" and told["size"] == [12, 24]
    assert told["nan"] == told["masked"] == 288 - maps.reasons()["good"]
    assert numpy.allclose(told["x"], mu_a.x, atol=1e-12) and numpy.allclose(told["y"], mu_a.y, atol=1e-12)
    assert told["se"] is None or numpy.float32(told["se"]) == mu_a.standard_error[4, 6]
    scipy = pytest.importorskip("scipy.io")
    assert numpy.array_equal(scipy.loadmat(tmp_path / "back.mat")["raw"].astype(numpy.float32), mu_a.values)


def test_many_instances_and_tables(sweep: Space) -> None:
    code = f"""
        m = turbid_read('{sweep.file}', 'maps', 'all', true, options{{:}});
        t = turbid_read('{sweep.file}', 'errors', 'all', true, options{{:}});
        means = squeeze(sum(sum(m.images(:, :, 1, :), 1), 2));
        printf('%s\\n', jsonencode(struct('mu_a', m.axes.mu_a, 'site', find(strcmp(m.axes.site, 'Mund, "links"')), 'sums', double(means), 'bias', t.bias_percent, ...
            'unit', t.units.bias_percent, 'size', size(m.mu_a))));
    """
    told = json.loads(octave(sweep, code))
    results = turbid.open_all(sweep.file, "maps", outputs=sweep.outputs)
    assert told["mu_a"] == [one.axes["mu_a"] for one in results]
    # Octave reads no text beyond ASCII.
    assert told["site"] == [k + 1 for k, one in enumerate(results) if one.axes["site"].startswith("Mund")]
    first = [one.stack.layers[0].pixels for one in results]
    assert numpy.allclose(told["sums"], [image.sum(dtype=float) for image in first], rtol=1e-6)
    assert told["size"] == [6, 12, 6] and told["unit"] == "%"
    bias = [value for one in turbid.open_all(sweep.file, "errors", outputs=sweep.outputs) for value in one.table["bias_percent"].to_list()]
    assert numpy.allclose([numpy.nan if b is None else b for b in told["bias"]], numpy.array(bias, float), equal_nan=True)


def test_errors(sweep: Space) -> None:
    code = f"""
        calls = {{{{'{sweep.file}', 'mapps'}}, {{'{sweep.file}', 'maps'}}, {{'{sweep.file}', 'maps', 'odd', 1}}, {{'nowhere.yaml', 'maps'}}}};
        for k = 1:numel(calls)
            try
                turbid_read(calls{{k}}{{:}}, options{{:}});
                printf('nothing\\n');
            catch problem
                printf('%s: %s\\n', problem.identifier, strtok(problem.message, char(10)));
            end
        end
    """
    told = octave(sweep, code).splitlines()
    assert [line.split(": ")[0] for line in told] == ["turbid:program", "turbid:several", "turbid:option", "turbid:program"], told
    assert "mapps" in told[0] and "6 instances" in told[1]


def test_the_page_runs(tmp_path: Path) -> None:
    from test_docs import blocks

    subprocess.run([turbid.executable(), "new", "mine"], cwd=tmp_path, check=True)
    subprocess.run([turbid.executable(), "run", "mine.yaml"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    (tmp_path / "sweep.yaml").write_text(next(text for language, _, text in blocks("docs/matlab.md") if language == "yaml"))
    subprocess.run([turbid.executable(), "run", "sweep.yaml"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
    code = "\n".join(text for language, words, text in blocks("docs/matlab.md") if language == "matlab" and words != "plot")
    head = f"addpath('{ROOT / 'matlab'}'); setenv('PATH', ['{Path(turbid.executable()).parent}:' getenv('PATH')]);\n"
    assert OCTAVE is not None
    done = subprocess.run([OCTAVE, "--no-gui", "--norc", "--quiet", "--eval", head + code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
