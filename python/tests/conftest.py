"""Pipelines that are run once, for the tests that read what they made. TURBID names the program."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any, Callable, Dict

import pytest

import turbid

ROOT = Path(__file__).parents[2]


def scene(mu_a: Any, pixels: int) -> Dict[str, Any]:
    return {
        "media": {"m": {"mu_a": mu_a, "mu_s_prime": 1.0, "g": 0.8, "n": 1.0}},
        "objects": {"block": {"slab": {"thickness": 30, "top": 0, "size": [21, 40], "center": [0, 0]}, "medium": "m"}},
        "camera": {"position": [0, 0, 500], "look_at": [0, 0, 0], "field": [24, 12], "pixels": [2 * pixels, pixels]},
        "projector": {"position": [0, 35, 500], "look_at": [0, 0, 0], "field": [48, 48], "power": 5},
    }


def tree(name: str, pixels: int = 12, **tissue: Any) -> Dict[str, Any]:
    """A whole chain, from scenes to maps and their errors; a sweep where `tissue` has a `foreach`."""
    mu_a = "${mu_a}" if "mu_a" in tissue.get("foreach", {}) else 0.05
    render = {"f_x": [0, 0.1], "phases": 3, "samples": "${samples}"}
    return {
        "pipeline": name,
        "seed": 7,
        "vars": {"samples": 256},
        "stages": {
            "tissue": {"use": "scene", "with": scene(mu_a, pixels), **tissue},
            "phantom": {"use": "scene", "with": scene(0.03, pixels)},
            "frames": {"use": "render", "in": {"scene": "tissue"}, "with": render},
            "phantom_frames": {"use": "render", "in": {"scene": "phantom"}, "with": render},
            "modulation": {"use": "demodulate", "in": {"frames": "frames", "covariance": "frames.covariance"},
                           "with": {"low_signal": 0}},
            "phantom_modulation": {"use": "demodulate", "in": {"frames": "phantom_frames"}, "with": {"low_signal": 0}},
            "reflectance": {
                "use": "calibrate",
                "in": {"sample": "modulation", "reference": "phantom_modulation"},
                "with": {"reference": scene(0.03, 1)["media"]["m"], "model": "diffusion", "convention": "camera", "smooth": 3},
            },
            "table": {
                "use": "build_lut",
                "with": {"model": "diffusion", "f_x": [0, 0.1], "mu_a": {"logspace": [0.005, 0.3, 12]},
                         "mu_s_prime": {"logspace": [0.3, 3, 12]}, "g": 0.8, "n": 1.0, "convention": "camera"},
            },
            "maps": {"use": "invert", "in": {"reflectance": "reflectance", "lut": "table"}},
            "errors": {"use": "compare", "in": {"estimate": "maps", "truth": "frames.truth"}},
        },
    }


class Space:
    """A folder with a pipeline, and the results of one."""

    def __init__(self, folder: Path, pipeline: Dict[str, Any]) -> None:
        self.folder = folder
        self.outputs = folder / "outputs"
        self.file = turbid.Pipeline(pipeline, folder / "p.yaml").write()

    def run(self, *targets: str, **options: Any) -> turbid.Run:
        return turbid.run(self.file, *targets, outputs=self.outputs, **options)

    def open(self, selector: str, **options: Any) -> turbid.Result:
        return turbid.open(self.file, selector, outputs=self.outputs, **options)

    def program(self, *arguments: str) -> str:
        """What the program prints."""
        command = [turbid.executable(), *arguments, "--outputs", str(self.outputs)]
        return subprocess.run(command, check=True, capture_output=True, text=True, cwd=self.folder).stdout


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """One instance of each stage, in a folder with a blank and an umlaut."""
    space = Space(tmp_path_factory.mktemp("Größe und Maß"), tree("small"))
    space.run()
    return space


@pytest.fixture(scope="session")
def large(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """Images that are files of their own in the store."""
    pipeline = tree("large", 96)
    pipeline["vars"]["samples"] = 16
    space = Space(tmp_path_factory.mktemp("large"), pipeline)
    space.run("modulation", "frames.truth")
    return space


@pytest.fixture(scope="session")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """Six instances along a number and a text, which nothing uses."""
    foreach = {"mu_a": [0.03, 0.05, 0.1], "site": ["Mund, \"links\"", "µ"]}
    space = Space(tmp_path_factory.mktemp("sweep"), tree("sweep", 6, foreach=foreach))
    space.run()
    return space


@pytest.fixture
def fresh(tmp_path: Path) -> Callable[..., Space]:
    """Makes a folder with a pipeline that has not run."""
    return lambda pipeline=None: Space(tmp_path, pipeline or tree("fresh"))


@pytest.fixture(autouse=True)
def nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment says nothing of outputs."""
    for name in ("TURBID_OUTPUTS", "TURBID_STORE"):
        monkeypatch.delenv(name, raising=False)
    os.environ.setdefault("MPLBACKEND", "Agg")
