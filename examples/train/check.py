"""Reads a data set of turbid with the programs of others, and compares what they read with `turbid export`.

    python3 examples/train/check.py FILE DIR [--name NAME] [--turbid PROGRAM] [--outputs DIR] [--speed]

FILE is the pipeline, DIR the folder that `turbid dataset build FILE --to DIR` made, of either format. Needs Python 3.10 or newer
and, the first time, the network: pyarrow, polars, Hugging Face datasets, mlcroissant and webdataset are put into a virtual
environment (about 700 MB in `outputs/python`, or `--environment`). PyTorch is tried where the Python that starts this has it.

Each reader must find all samples with shapes, types and, to the bit, the values of the first and the last sample of each split
as `turbid export` writes them. Ends with 1 where one does not. `--speed` prints samples per CPU second of each reader for the
largest split, all tensors as NumPy arrays, in order and shuffled; it compares nothing.
"""

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

# NumPy 1.26 is what Debian's PyTorch was built for, and these are the last of the others that work with it.
PACKAGES = ["numpy<2", "pyarrow<22", "datasets>=4,<5", "polars>=1", "mlcroissant>=1.1", "webdataset>=1"]
READERS = {
    "parquet": ["pyarrow", "polars", "datasets", "mlcroissant", "torch"],
    "webdataset": ["webdataset", "datasets_of_tar", "mlcroissant_of_tar", "torch_of_tar"],
}
SPEEDS = {"parquet": ["pyarrow", "polars", "datasets", "torch"], "webdataset": ["webdataset", "torch_of_tar"]}
CHOSEN = "TURBID_CHECK_ENVIRONMENT"


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--name", help="the data set, where the file has several")
    parser.add_argument("--turbid", default="turbid", help="the program (default: the one on the path)")
    parser.add_argument("--outputs", default="outputs", help="where turbid keeps results")
    parser.add_argument("--environment", type=Path, default=Path("outputs/python"), help="the virtual environment to make or use")
    parser.add_argument("--reader", choices=sum(READERS.values(), []), help="only this one")
    parser.add_argument("--speed", action="store_true", help="how fast the readers are")
    return parser.parse_args()


def in_environment(folder: Path) -> None:
    """Goes on in a virtual environment that has the readers; makes it if it is not there."""
    if os.environ.get(CHOSEN):
        return
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        print(f"making {folder} with {', '.join(PACKAGES)}", flush=True)
        venv.create(folder, with_pip=True, system_site_packages=True)
    have = subprocess.run([python, "-c", "import datasets, polars, pyarrow, mlcroissant, webdataset"], capture_output=True)
    if have.returncode != 0:
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    # Nothing of a data set goes over the network.
    environment = {**os.environ, CHOSEN: "1", "HF_HUB_OFFLINE": "1", "HF_HUB_DISABLE_TELEMETRY": "1", "HF_DATASETS_DISABLE_PROGRESS_BARS": "1"}
    sys.exit(subprocess.run([python, *sys.argv], env=environment).returncode)


class Exported:
    """What `turbid export` says of the samples."""

    def __init__(self, options, manifest):
        self.options, self.manifest = options, manifest
        self.folder = tempfile.TemporaryDirectory()
        self.ports, self.outputs = {}, {}
        self.sample = manifest["resolved"]["datasets"][manifest["dataset"]]["sample"]

    def port(self, stage, port, index):
        """The archive of an output."""
        import numpy

        key = (stage, port, index)
        if key not in self.ports:
            to = Path(self.folder.name) / f"{stage}.{port}.{index}.npz"
            command = [self.options.turbid, "export", str(self.options.file), f"{stage}[draw={index}].{port}"]
            command += ["--to", str(to), "--outputs", self.options.outputs]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode != 0:
                sys.exit(done.stderr)
            self.ports[key] = numpy.load(to, allow_pickle=False)
        return self.ports[key]

    def outputs_of(self, stage, index):
        """Names of the outputs of a stage."""
        command = [self.options.turbid, "show", str(self.options.file), f"{stage}[draw={index}]", "--json"]
        command += ["--outputs", self.options.outputs]
        if stage not in self.outputs:
            shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            self.outputs[stage] = list(json.loads(shown)["instances"][0]["ports"])
        return self.outputs[stage]

    @staticmethod
    def names(archive):
        """Layers of images, or columns of a table."""
        if "images" not in archive:
            return set(archive.files)
        return {json.loads(str(layer))["name"] for layer in archive["layers"]}

    def tensor(self, name, index):
        """(channels, rows, columns), float32, or a number."""
        import numpy

        asked = self.sample[name]
        asked = asked if isinstance(asked, dict) else {"from": asked}
        stage, *rest = asked["from"].split(".")
        ports = self.outputs_of(stage, index)
        # The second word is an output if there is one of that name, else a layer of the stage's first output.
        named = bool(rest) and rest[0] in ports
        port, part = (rest[0], rest[1] if len(rest) > 1 else None) if named else (None, rest[0] if rest else None)
        candidates = [port] if named else ports
        archives = [self.port(stage, port, index) for port in candidates]
        archives = [archive for archive in archives if part is None or part in self.names(archive)]
        if len(archives) != 1:
            sys.exit(f"feature `{name}`: name its output, STAGE.PORT or STAGE.PORT.LAYER, to compare it with `turbid export`")
        archive = archives[0]
        if "images" not in archive:
            return archive[part].reshape(())
        layers = [json.loads(str(layer)) for layer in archive["layers"]]
        keys = {"f_x": "f_x_per_mm", "phase": "phase_rad", "orientation_deg": "orientation_deg", "wavelength_nm": "wavelength_nm"}

        def meant(layer):
            if (layer["name"] != part) if part else (layer["kind"] != "value"):
                return False
            for key, number in keys.items():
                wanted = asked.get(key)
                wanted = wanted if isinstance(wanted, list) else [] if wanted is None else [wanted]
                have = layer.get(number)
                if wanted and (have is None or not any(abs(have - w) <= 1e-9 * max(abs(w), 1) for w in wanted)):
                    return False
            return True

        return numpy.stack([image for image, layer in zip(archive["images"], layers) if meant(layer)])


class Checks:
    """Counts what is compared, and remembers what is wrong."""

    def __init__(self, folder, manifest, exported):
        import numpy

        self.folder, self.manifest, self.exported, self.numpy = folder, manifest, exported, numpy
        self.tensors = [column for column in manifest["columns"] if "shape" in column]
        self.rows = {}
        for shard in manifest["shards"]:
            self.rows[shard["split"]] = self.rows.get(shard["split"], 0) + shard["rows"]
        self.rows = {split: n for split, n in self.rows.items() if n}
        self.files = {split: [str(folder / s["file"]) for s in manifest["shards"] if s["split"] == split and s["rows"]] for split in self.rows}
        self.wrong, self.compared = [], 0

    def that(self, held, what):
        self.compared += 1
        if not held:
            self.wrong.append(what)

    def reader(self, reader, split, draws, tensor):
        """`draws`: raw indices of the rows; `tensor(column)`: all values of a column as an array."""
        numpy = self.numpy
        self.that(len(draws) == self.rows[split], f"{reader}: {split} has {len(draws)} samples, not {self.rows[split]}")
        for column in self.tensors:
            name, values = column["name"], tensor(column["name"])
            shape = (len(draws), *column["shape"])
            self.that(values.shape == shape, f"{reader}: {split}/{name} has the shape {values.shape}, not {shape}")
            self.that(str(values.dtype) == column["dtype"], f"{reader}: {split}/{name} is {values.dtype}, not {column['dtype']}")
            for row in sorted({0, len(draws) - 1}):
                wanted = self.exported.tensor(name, int(draws[row])).astype(values.dtype)
                same = wanted.shape == values[row].shape and wanted.tobytes() == numpy.ascontiguousarray(values[row]).tobytes()
                self.that(same, f"{reader}: {split}/{name} of sample {draws[row]} differs from `turbid export`")

    def narrowed(self, name, values):
        """Hugging Face hands half precision out as float32, which holds it exactly."""
        half = next(column["dtype"] for column in self.tensors if column["name"] == name) == "float16"
        return values.astype("float16") if half and values.dtype == "float32" else values

    def pyarrow(self):
        import pyarrow.dataset

        for split in self.rows:
            table = pyarrow.dataset.dataset(self.files[split], format="parquet").to_table()
            units = {column["name"]: column.get("unit") for column in self.tensors}

            def tensor(name):
                self.that((table.schema.field(name).metadata or {}).get(b"unit", b"").decode() == units[name], f"pyarrow: unit of {name}")
                column = table.column(name).combine_chunks()
                column = getattr(column, "storage", column)
                shape = next(c["shape"] for c in self.tensors if c["name"] == name)
                for _ in shape:
                    column = column.flatten()
                return column.to_numpy().reshape(-1, *shape)

            self.reader("pyarrow", split, table.column("draw").to_numpy(), tensor)

    def polars(self):
        import polars

        for split in self.rows:
            frame = polars.scan_parquet(self.folder / "data" / f"{split}-*.parquet").collect()
            self.reader("polars", split, frame["draw"].to_numpy(), lambda name: frame[name].to_numpy())

    def datasets(self):
        import datasets

        with tempfile.TemporaryDirectory() as cache:
            loaded = datasets.load_dataset(str(self.folder), cache_dir=cache)
            self.that(set(loaded) == set(self.rows), f"datasets: the splits {sorted(loaded)}")
            for split, rows in loaded.items():
                for column in self.tensors:
                    feature = rows.features[column["name"]]
                    wanted = datasets.Array3D(tuple(column["shape"]), column["dtype"])
                    self.that(type(feature) is datasets.Array3D and feature.dtype == wanted.dtype and tuple(feature.shape) == wanted.shape, f"datasets: {column['name']} is {feature}")
                rows = rows.with_format("numpy")
                self.reader("datasets", split, rows["draw"][:], lambda name: self.narrowed(name, self.numpy.asarray(rows[name][:])))

    def mlcroissant(self):
        import mlcroissant

        loaded = mlcroissant.Dataset(jsonld=str(self.folder / "croissant.json"))
        for issue in sorted(loaded.metadata.ctx.issues.errors):
            self.that(False, f"mlcroissant: {issue}")
        for split in self.rows:
            records = list(loaded.records(record_set=split))
            by_name = lambda record, name: record[f"{split}/{name}"]
            draws = self.numpy.array([by_name(record, "draw") for record in records])
            dtypes = {column["name"]: column["dtype"] for column in self.tensors}

            def tensor(name):
                # Nested lists, or arrays of arrays.
                plain = lambda value: [plain(v) for v in value] if hasattr(value, "__len__") else value
                shape = next(c["shape"] for c in self.tensors if c["name"] == name)
                values = [self.numpy.array(plain(by_name(record, name)), dtype=dtypes[name]).reshape(shape) for record in records]
                return self.numpy.stack(values)

            self.reader("mlcroissant", split, draws, tensor)

    def torch(self):
        import datasets
        import torch

        with tempfile.TemporaryDirectory() as cache:
            loaded = datasets.load_dataset(str(self.folder), cache_dir=cache).with_format("torch")
            for split, rows in loaded.items():
                names = ["draw", *(column["name"] for column in self.tensors)]
                batches = list(torch.utils.data.DataLoader(rows.select_columns(names), batch_size=7))
                joined = {name: torch.cat([batch[name] for batch in batches]).numpy() for name in names}
                self.reader("torch", split, joined["draw"], lambda name: self.narrowed(name, joined[name]))

    def webdataset(self):
        from webdataset import WebDataset

        for split, files in self.files.items():
            samples = list(WebDataset(files, shardshuffle=False).decode())
            draws = self.numpy.array([sample["json"]["draw"] for sample in samples])
            self.that(all(sample["__key__"] == sample["json"]["id"] for sample in samples), "webdataset: keys are ids")
            self.reader("webdataset", split, draws, lambda name: self.numpy.stack([sample["npz"][name] for sample in samples]))

    def torch_of_tar(self):
        import torch
        from webdataset import WebDataset

        for split, files in self.files.items():
            loader = torch.utils.data.DataLoader(WebDataset(files, shardshuffle=False).decode().to_tuple("npz"), batch_size=7)
            batches = [batch for (batch,) in loader]
            draws = self.numpy.array([sample["json"]["draw"] for sample in WebDataset(files, shardshuffle=False).decode()])
            self.reader("torch_of_tar", split, draws, lambda name: torch.cat([batch[name] for batch in batches]).numpy())

    def datasets_of_tar(self):
        import datasets

        dtypes = {column["name"]: column["dtype"] for column in self.tensors}
        with tempfile.TemporaryDirectory() as cache:
            loaded = datasets.load_dataset(str(self.folder), cache_dir=cache)
            self.that(set(loaded) == set(self.rows), f"datasets_of_tar: the splits {sorted(loaded)}")
            for split, rows in loaded.items():
                known, arrays = rows["json"][:], rows["npz"][:]
                draws = self.numpy.array([sample["draw"] for sample in known])
                self.reader("datasets_of_tar", split, draws, lambda name: self.numpy.array([sample[name] for sample in arrays], dtype=dtypes[name]))

    def mlcroissant_of_tar(self):
        import mlcroissant

        loaded = mlcroissant.Dataset(jsonld=str(self.folder / "croissant.json"))
        for issue in sorted(loaded.metadata.ctx.issues.errors):
            self.that(False, f"mlcroissant_of_tar: {issue}")
        text = lambda value: value.decode() if isinstance(value, bytes) else value
        points = [{key.split("/")[1]: text(value) for key, value in record.items()} for record in loaded.records(record_set="points")]
        kept = {(point["shard"], point["row"]) for point in points if point["reject"] == ""}
        wanted = {(shard["file"], float(row)) for shard in self.manifest["shards"] for row in range(shard["rows"])}
        self.that(kept == wanted, "mlcroissant_of_tar: the points are not those of the shards")


class Speeds:
    """Each reader as a function that goes over the samples of the largest split once, in order or shuffled."""

    def __init__(self, folder, manifest):
        checks = Checks(folder, manifest, None)
        self.folder, self.split = folder, max(checks.rows, key=checks.rows.get)
        self.shapes = {column["name"]: tuple(column["shape"]) for column in checks.tensors}
        self.n, self.files, self.numpy = checks.rows[self.split], checks.files[self.split], checks.numpy

    def arrays(self, batch):
        """Tensor columns of a batch of Arrow as arrays."""
        for name, shape in self.shapes.items():
            column = getattr(batch.column(name), "storage", batch.column(name))
            for _ in shape:
                column = column.flatten()
            yield column.to_numpy(zero_copy_only=False).reshape(-1, *shape)

    def count(self, arrays):
        return sum(array.shape[0] for array in arrays) // len(self.shapes)

    def pyarrow(self, shuffled):
        import pyarrow.dataset

        columns = list(self.shapes)
        found = pyarrow.dataset.dataset(self.files, format="parquet")
        if shuffled:
            table = found.take(self.numpy.random.default_rng(0).permutation(self.n), columns=columns)
            return self.count(array for batch in table.combine_chunks().to_batches() for array in self.arrays(batch))
        return self.count(array for batch in found.to_batches(columns=columns, batch_size=64) for array in self.arrays(batch))

    def polars(self, shuffled):
        import polars

        frame = polars.scan_parquet(self.files).select(list(self.shapes)).collect()
        if shuffled:
            frame = frame.sample(fraction=1, shuffle=True, seed=0)
        return self.count(frame[name].to_numpy() for name in self.shapes)

    def datasets(self, shuffled):
        import datasets

        with tempfile.TemporaryDirectory() as cache:
            loaded = datasets.load_dataset(str(self.folder), split=self.split, cache_dir=cache).select_columns(list(self.shapes))
            loaded = loaded.shuffle(seed=0) if shuffled else loaded
            began = time.process_time()
            n = self.count(batch[name] for batch in loaded.with_format("numpy").iter(64) for name in self.shapes)
            return n, time.process_time() - began

    def torch(self, shuffled):
        import datasets
        import torch

        with tempfile.TemporaryDirectory() as cache:
            loaded = datasets.load_dataset(str(self.folder), split=self.split, cache_dir=cache).select_columns(list(self.shapes))
            began = time.process_time()
            loader = torch.utils.data.DataLoader(loaded.with_format("torch"), batch_size=64, shuffle=shuffled)
            n = self.count(batch[name] for batch in loader for name in self.shapes)
            return n, time.process_time() - began

    def stream(self, shuffled):
        from webdataset import WebDataset

        samples = WebDataset(self.files, shardshuffle=len(self.files) if shuffled else False, seed=0)
        return (samples.shuffle(512, seed=0) if shuffled else samples).decode()

    def webdataset(self, shuffled):
        return self.count(sample["npz"][name][None] for sample in self.stream(shuffled) for name in self.shapes)

    def torch_of_tar(self, shuffled):
        import torch

        loader = torch.utils.data.DataLoader(self.stream(shuffled).to_tuple("npz"), batch_size=64)
        return self.count(batch[name] for (batch,) in loader for name in self.shapes)

    def measure(self, reader):
        """Samples per CPU second of all threads, in order and shuffled: the better of two rounds, after one that imports."""

        def rate(shuffled):
            began = time.process_time()
            found = getattr(self, reader)(shuffled)
            n, seconds = found if isinstance(found, tuple) else (found, time.process_time() - began)
            if n != self.n:
                sys.exit(f"{reader}: {n} samples, not {self.n}")
            return n / seconds

        return [max([rate(shuffled) for _ in range(3)][1:]) for shuffled in (False, True)]


def main():
    options = arguments()
    in_environment(options.environment)
    manifest = json.loads((options.folder / "dataset.json").read_text())
    if options.name not in (None, manifest["dataset"]):
        sys.exit(f"{options.folder} holds the data set {manifest['dataset']}, not {options.name}")
    format = manifest.get("shard_format", "parquet")
    if options.reader is None:
        # Each in a process of its own: what one registers with pyarrow is not to help or hinder another.
        readers = (SPEEDS if options.speed else READERS)[format]
        if options.speed:
            print(f"{format}: samples per CPU s\n| reader | in order | shuffled |\n|---|---|---|", flush=True)
        codes = [subprocess.run([sys.executable, *sys.argv, "--reader", reader]).returncode for reader in readers]
        sys.exit(1 if any(codes) else 0)
    if options.reader.startswith("torch") and not importlib.util.find_spec("torch"):
        print(f"{options.reader}: PyTorch is not there, left out")
        return
    if options.speed:
        in_order, shuffled = Speeds(options.folder, manifest).measure(options.reader)
        print(f"| {options.reader} | {in_order:.0f} | {shuffled:.0f} |")
        return
    checks = Checks(options.folder, manifest, Exported(options, manifest))
    try:
        getattr(checks, options.reader)()
    except Exception as error:  # A reader that refuses the folder is a finding.
        checks.wrong.append(f"{options.reader}: {type(error).__name__}: {error}")
    print(f"{options.reader}: {checks.compared} comparisons, {len(checks.wrong)} differ", *checks.wrong, sep="\n  ")
    sys.exit(1 if checks.wrong else 0)


if __name__ == "__main__":
    main()
