"""Results: images, tables, records, many instances; the same numbers as by other ways."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy
import pytest

import turbid

from conftest import Space


def exported(space: Space, selector: str, tmp_path: Path) -> Any:
    space.program("export", str(space.file), selector, "--to", str(tmp_path / "x.npz"))
    return numpy.load(tmp_path / "x.npz")


@pytest.mark.parametrize("which", ["small", "large"])
def test_layers_are_those_of_export_and_of_openexr(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """Packed blobs and files alike, value layers and masks, bit by bit."""
    space: Space = request.getfixturevalue(which)
    for selector in ("modulation.modulation", "frames.truth"):
        stack = space.open(selector).stack
        other = exported(space, selector, tmp_path)
        assert [layer.info for layer in stack.layers] == [json.loads(str(text)) for text in other["layers"]]
        assert stack.attributes == json.loads(str(other["attributes"]))
        assert numpy.array_equal(numpy.stack([layer.pixels for layer in stack.layers]), other["images"])
        exr = pytest.importorskip("OpenEXR")
        copy = next((space.outputs / "latest" / which / selector.split(".")[0]).glob(f"{selector.split('.')[1]}.exr"))
        with exr.File(str(copy)) as file:
            for layer, part in zip(stack.layers, file.parts):
                (channel,) = part.channels.values()
                assert channel.pixels.dtype == numpy.float32 and numpy.array_equal(channel.pixels, layer.pixels)
        assert not any(layer.pixels.flags.writeable for layer in stack.layers)
        values = [layer.pixels for layer in stack.layers if layer.info["kind"] != "mask"]
        assert {image.strides[0] - 4 * image.shape[1] for image in values} == {12}, "they are views"


def test_quantities_have_errors_mask_units_and_places(small: Space) -> None:
    maps = small.open("maps")
    assert (maps.payload, maps.kind, list(maps), maps.axes) == ("maps", "images", ["mu_a", "mu_s_prime"], {})
    mu_a = maps["mu_a"]
    assert mu_a.dims == ("y", "x") and mu_a.shape == (12, 24) and mu_a.attrs["units"] == "mm^-1" == maps.units["mu_a"]
    # 24 x 12 mm in 24 x 12 pixels.
    assert numpy.allclose(mu_a.x, numpy.arange(-11.5, 12)) and numpy.allclose(mu_a.y, numpy.arange(5.5, -6, -1))
    assert mu_a.x.attrs["units"] == "mm" and mu_a.attrs["long_name"] == "mu_a"
    assert mu_a.good.dtype == bool and mu_a.mask.dtype == numpy.uint8 and mu_a.standard_error.attrs["units"] == "mm^-1"
    assert numpy.array_equal(mu_a.good, mu_a.mask == 0) and (mu_a.standard_error.values[mu_a.good] > 0).all()
    assert (mu_a.values[~mu_a.good.values] == 0).all()
    reasons = maps.reasons()
    assert sum(reasons.values()) == 288 and reasons["good"] == int(mu_a.good.sum()) and set(reasons) <= set(turbid.REASONS)
    assert maps.dataset.attrs["convention"] == "camera" == maps.attributes["convention"]
    assert "data:image/png" in maps._repr_html_() and maps.picture is not None
    with pytest.raises(KeyError, match="no layer 'mua'; it has mu_a"):
        maps["mua"]


def test_layers_of_one_name_have_a_dimension(small: Space, large: Space) -> None:
    for space, n in ((small, 12), (large, 96)):
        modulation = space.open("modulation").dataset
        assert modulation.m_ac.dims == ("f_x", "y", "x") and list(modulation.f_x) == [0, 0.1]
        assert modulation.m_ac.shape == (2, n, 2 * n) and modulation.f_x.attrs["units"] == "mm^-1"
        named = [layer for layer in space.open("modulation").stack.layers if layer.info["name"] == "m_ac"]
        for layer in named:
            one = modulation.m_ac.sel(f_x=layer.info["f_x_per_mm"])
            assert numpy.array_equal(one, layer.pixels)
        assert modulation["cov_pair"].size == modulation["cov"].shape[0] > 0
    frames = small.open("frames.frames").dataset
    assert frames.radiance.shape == (4, 12, 24) and frames.radiance_f_x.values.tolist() == [0, 0.1, 0.1, 0.1]
    assert numpy.allclose(frames.radiance_phase, [0, 0, 2 * numpy.pi / 3, 4 * numpy.pi / 3])


def test_tables_and_records(small: Space) -> None:
    errors = small.open("errors")
    assert errors.kind == "table" and errors.units["mean"] == "mm^-1" and errors.units["bias_percent"] == "%"
    assert set(errors.table["quantity"]) == {"mu_a", "mu_s_prime"}
    tissue = small.open("tissue")
    assert tissue.record["media"]["m"]["g"] == 0.8 and "camera" in tissue._repr_html_()
    for wrong in (lambda: errors.dataset, lambda: errors.record, lambda: small.open("maps").table):
        with pytest.raises(TypeError):
            wrong()


def test_selectors_that_fit_none_or_several(small: Space, sweep: Space) -> None:
    for space, selector, says in [
        (small, "mapps", "mapps"),
        (small, "maps.mu", "has no output `mu`"),
        (small, "maps[mu_a=1]", "no instance of `maps` has these axes"),
        (sweep, "maps[mu_b=0.05]", "no instance of `maps` has these axes"),
        (sweep, "maps[mu_a=0.04]", "there are maps"),
        (sweep, "maps", "names 6 instances"),
        (sweep, "maps[mu_a=0.05]", "names 2 instances"),
        (sweep, "maps[mu_a", "must look like"),
    ]:
        with pytest.raises(turbid.InputError, match=says.replace("[", r"\[")):
            space.open(selector)
    one = sweep.open("maps[mu_a=0.05,site=µ]")
    assert one.axes == {"mu_a": 0.05, "site": "µ"} and repr(one) == "maps[mu_a=0.05,site=µ].maps"
    assert sweep.open("errors[mu_a=0.05,site=µ]").units["bias_percent"] == "%"
    with pytest.raises(turbid.NotRunError, match="has not run yet with these parameters; try `turbid run"):
        sweep.open("maps[mu_a=0.05,site=µ]", set={"vars.samples": 17})


def test_scan_has_all_rows_with_axes(sweep: Space) -> None:
    polars = pytest.importorskip("polars")
    rows = turbid.scan(sweep.file, "errors", outputs=sweep.outputs).collect()
    assert rows["site"].n_unique() == 2 and rows.schema["mu_a"] == polars.Float64
    units = turbid.units(sweep.file, "errors", outputs=sweep.outputs)
    assert list(units) == rows.columns and units["bias_percent"] == "%" and units["site"] == ""
    parts = []
    for one in turbid.open_all(sweep.file, "errors", outputs=sweep.outputs):
        axes = [polars.lit(one.axes[name]).alias(name) for name in ("mu_a", "site")]
        parts.append(one.table.select(*axes, polars.all()))
    common = [name for name in rows.columns if not name.startswith("attributes.")]
    assert polars.concat(parts, how="vertical_relaxed").select(common).equals(rows.select(common))
    records = turbid.scan(sweep.file, "tissue", outputs=sweep.outputs).collect()
    media = [json.loads(text)["m"]["mu_a"] for text in records["media"]]
    assert len(records) == 6 and [m[0] if isinstance(m, list) else m for m in media] == records["mu_a"].to_list()


def test_export_stacks_images(sweep: Space, tmp_path: Path) -> None:
    (written,) = turbid.export(sweep.file, "maps", tmp_path / "all maps.npz", outputs=sweep.outputs)
    file = numpy.load(written)
    results = turbid.open_all(sweep.file, "maps", outputs=sweep.outputs)
    stacks = [one.stack for one in results]
    assert numpy.array_equal(file["images"], numpy.stack([[layer.pixels for layer in stack.layers] for stack in stacks]))
    assert file["mu_a"].tolist() == [one.axes["mu_a"] for one in results]
    assert file["site"].tolist() == [one.axes["site"] for one in results]
    assert [json.loads(str(text))["name"] for text in file["layers"]] == [layer.info["name"] for layer in stacks[0].layers]
    assert file["mean_se"].shape == (6, len(stacks[0].layers)) and file["pixel_pitch_mm"].tolist() == [2, 2]
    folder = tmp_path / "as they are"
    turbid.export(sweep.file, "maps", f"{folder}/", outputs=sweep.outputs)
    polars = pytest.importorskip("polars")
    listed = polars.read_parquet(folder / "instances.parquet")
    assert listed["mu_a"].to_list() == file["mu_a"].tolist() and len(list(folder.iterdir())) == 7
    for row, stack in zip(listed.iter_rows(named=True), stacks):
        again = turbid.read_exr(folder / row["file"])
        assert all(numpy.array_equal(a.pixels, b.pixels) for a, b in zip(again.layers, stack.layers))
    with pytest.raises(turbid.InputError, match=".npz or .mat"):
        turbid.export(sweep.file, "maps", tmp_path / "x.tiff", outputs=sweep.outputs)


def test_files_that_are_no_stacks(small: Space, tmp_path: Path) -> None:
    whole = next(small.outputs.glob("latest/small/maps/maps.exr")).read_bytes()
    path = tmp_path / "x.exr"
    for wrong in (b"", b"not an image", whole[:4], whole[:100], whole[: len(whole) // 2], b"\0" * len(whole)):
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match="x.exr"):
            turbid.read_exr(path)
    path.write_bytes(b"before" + whole + b"behind")
    stack = turbid.read_exr(path, 6, len(whole))
    assert len(stack.layers) == len(small.open("maps").stack.layers)
    with pytest.raises(OSError):
        turbid.read_exr(tmp_path / "none.exr")
