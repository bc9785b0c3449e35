"""Data sets as arrays and for PyTorch, of both formats."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Dict

import numpy
import pytest

import turbid

SPOTS = (Path(__file__).parents[2] / "docs" / "data-sets.md").read_text(encoding="utf-8").split("```yaml spots.yaml\n")[1].split("```")[0]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Dict[str, Path]:
    space = tmp_path_factory.mktemp("sets")
    (space / "spots.yaml").write_text(SPOTS, encoding="utf-8")
    for form in ("parquet", "webdataset"):
        command = [turbid.executable(), "dataset", "build", "spots.yaml", "--to", form, "--format", form]
        done = subprocess.run(command, cwd=space, capture_output=True, text=True)
        if "--features tables" in done.stderr:
            pytest.skip("the program was built without the feature `tables`")
        assert done.returncode == 0, done.stderr
    return {form: space / form for form in ("parquet", "webdataset")}


def test_both_formats_hold_what_show_says(folders: Dict[str, Path]) -> None:
    parquet, tar = (turbid.dataset(folders[form], "train") for form in ("parquet", "webdataset"))
    assert len(parquet) == len(tar) > 4 and parquet.features["frames"]["shape"] == [3, 8, 8]
    assert parquet.arrays()["frames"].shape == (len(parquet), 3, 8, 8) and parquet.arrays()["frames"].dtype == numpy.float32
    order = {draw: i for i, draw in enumerate(tar.arrays()["draw"].tolist())}
    space = folders["parquet"].parent
    for sample in list(parquet)[:2]:
        other = tar[order[int(sample["draw"])]]
        assert numpy.array_equal(sample["frames"], other["frames"]) and sample["mu_a"] == other["mu_a"]
        stored = turbid.open(space / "spots.yaml", f"frames[draw={int(sample['draw'])}].frames", outputs=space / "outputs").stack
        layers = [l.pixels for l in stored.layers if l.info["kind"] == "value" and l.info.get("f_x_per_mm") == 0.1]
        assert numpy.array_equal(numpy.stack(layers), sample["frames"])
    assert "samples of train" in repr(parquet) and "data:image/png" in parquet._repr_html_()


def test_torch(folders: Dict[str, Path]) -> None:
    torch = pytest.importorskip("torch")
    samples = turbid.dataset(folders["parquet"], "train")
    tensors = samples.torch("frames", "mu_a_true")
    assert len(tensors) == len(samples) and tensors[0][0].shape == (3, 8, 8) and tensors[0][1].dtype == torch.float32
    assert numpy.array_equal(tensors[1][0].numpy(), samples[1]["frames"])
    with pytest.raises(KeyError, match="no column 'frame'"):
        samples.torch("frame")


def test_what_is_not_there(folders: Dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="turbid dataset build"):
        turbid.dataset(tmp_path)
    with pytest.raises(ValueError, match="no split 'tset'; it has test"):
        turbid.dataset(folders["parquet"], "tset")
