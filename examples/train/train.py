"""A small U-Net learns mu_a and mu_s' of one SSOP frame; its errors beside those of SFDI on the same scenes.

    python3 train.py FOLDER [--scenes N] [--steps N] [--seed S] [--csv FILE]

FOLDER is what `turbid dataset build examples/train/ssop64.yaml --to FOLDER` wrote. Needs `datasets` and `torch`; runs on
the CPU. Architecture, number of steps and learning rate stand here and were fixed before the test splits were looked at.
The network sees frames as they are rendered and as the camera gives them, by turns; it is tried on both.
"""

import argparse
import csv
import math
import time

import numpy as np
import torch
from datasets import load_dataset
from torch import nn

WIDTHS = (16, 32, 64)
BATCH = 16
RATE = 3e-3
F_X = 0.1  # mm^-1
FIELD = 64.0  # mm
# What each method reads the maps of, by the name that its features begin with.
FRAMES = {"ideal frames": "", "the camera's frames": "seen_"}


class Block(nn.Sequential):
    def __init__(self, inputs, outputs):
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, padding=1), nn.GroupNorm(4, outputs), nn.SiLU(),
            nn.Conv2d(outputs, outputs, 3, padding=1), nn.GroupNorm(4, outputs), nn.SiLU(),
        )


class UNet(nn.Module):
    """Three levels; the input gets the pixel's place along the fringes beside the frame."""

    def __init__(self):
        super().__init__()
        inputs = 4
        self.down = nn.ModuleList()
        for width in WIDTHS:
            self.down.append(Block(inputs, width))
            inputs = width
        self.up = nn.ModuleList(Block(deep + flat, flat) for flat, deep in zip(WIDTHS[-2::-1], WIDTHS[:0:-1]))
        self.out = nn.Conv2d(WIDTHS[0], 2, 1)

    def forward(self, x):
        kept = []
        for i, block in enumerate(self.down):
            x = block(x if i == 0 else nn.functional.max_pool2d(x, 2))
            kept.append(x)
        for block, flat in zip(self.up, kept[-2::-1]):
            x = nn.functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
            x = block(torch.cat([x, flat], 1))
        return self.out(x)


def read(sets, split):
    """Every tensor of a split, (samples, channels, rows, columns)."""
    data = sets[split].with_format("numpy")
    columns = {name: np.stack(data[name][:]) for name in data.column_names if data[0][name].ndim == 3}
    assert columns, f"split {split} has no tensors"
    return columns


def inputs(frames, scale):
    """The frame over its scale, and where a pixel stands along x and within a period of the fringes."""
    n, _, rows, columns = frames.shape
    x = ((torch.arange(columns) + 0.5) / columns - 0.5) * FIELD
    fringe = [torch.cos(2 * math.pi * F_X * x), torch.sin(2 * math.pi * F_X * x), 2 * x / FIELD]
    place = torch.stack(fringe)[None, :, None, :].expand(n, 3, rows, columns)
    return torch.cat([torch.as_tensor(frames) / scale, place], 1)


def target(data):
    return torch.as_tensor(np.concatenate([np.log(data["mu_a_true"]), np.log(data["mu_s_prime_true"])], 1))


def errors(mu_a, mu_s_prime, data, where):
    """Mean absolute error of both in percent over the pixels that `where` names."""
    relative = [np.abs(mu_a / data["mu_a_true"] - 1), np.abs(mu_s_prime / data["mu_s_prime_true"] - 1)]
    return [100 * float(error[where].mean()) for error in relative]


def near_edges(data, within=3):
    """Pixels (mm) within so many of a change of the truth."""
    mu_a = torch.as_tensor(data["mu_a_true"])
    size = 2 * within + 1
    spread = nn.functional.max_pool2d(mu_a, size, 1, within) + nn.functional.max_pool2d(-mu_a, size, 1, within)
    return (spread > 1e-9).numpy()


def optimise(network, steps, batch):
    """Least mean absolute error; `batch(step)` gives inputs and what the network should say of them."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=steps)
    for step in range(steps):
        xs, ys = batch(step)
        loss = nn.functional.l1_loss(network(xs), ys)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    network.eval()
    return network


def train(data, steps, seed):
    """The network, the scale of frames, and mean and spread of what it says."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    scale = float(data["frame"].mean())
    frames, y = [inputs(data[prefix + "frame"], scale) for prefix in FRAMES.values()], target(data)
    middle, spread = y.mean((0, 2, 3), keepdim=True), y.std((0, 2, 3), keepdim=True)

    def batch(step):
        chosen = torch.as_tensor(rng.integers(0, len(y), BATCH))
        xs, ys = frames[step % 2][chosen], y[chosen]
        if step // 2 % 2:  # The fringes run along y: a mirror image in y is as likely.
            xs, ys = xs.flip(2), ys.flip(2)
        return xs, (ys - middle) / spread

    return optimise(UNet(), steps, batch), scale, middle, spread


def judge(sets, network, scale, middle, spread):
    """Rows: split, frames, method, mean |error| of mu_a and mu_s' over all pixels, near edges, and pixels counted (%)."""
    # A split without samples is not there.
    for split in (name for name in ("validation", "test", "test_far") if name in sets):
        data = read(sets, split)
        for frames, prefix in FRAMES.items():
            with torch.no_grad():
                found = torch.exp(network(inputs(data[prefix + "frame"], scale)) * spread + middle).numpy()
            methods = {
                "network": (found[:, :1], found[:, 1:]),
                "one frame (SSOP)": (data[prefix + "single_mu_a"], data[prefix + "single_mu_s_prime"]),
                "three phases": (data[prefix + "three_mu_a"], data[prefix + "three_mu_s_prime"]),
            }
            # The same pixels for all: those that no method masks.
            good = (data[prefix + "single_mask"] == 0) & (data[prefix + "three_mask"] == 0)
            edge = good & near_edges(data)
            for name, (mu_a, mu_s_prime) in methods.items():
                everywhere, at_edges = errors(mu_a, mu_s_prime, data, good), errors(mu_a, mu_s_prime, data, edge)
                yield [split, frames, name, *everywhere, *at_edges, 100 * good.mean()]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--scenes", type=int, default=None, help="of the train split; all of them by default")
    parser.add_argument("--steps", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--csv", default=None, help="append the rows to this file")
    arguments = parser.parse_args()

    sets = load_dataset(arguments.folder)
    data = {name: values[: arguments.scenes] for name, values in read(sets, "train").items()}
    scenes = len(data["frame"])
    began = time.process_time()
    found = train(data, arguments.steps, arguments.seed)
    seconds = time.process_time() - began
    weights = sum(p.numel() for p in found[0].parameters())
    print(f"{scenes} scenes, {weights} weights, {arguments.steps} steps, {seconds:.0f} CPU s of training")

    rows = list(judge(sets, *found))
    print("mean |error| in percent                                      mu_a  mu_s'   at edges: mu_a  mu_s'   pixels, %")
    for split, frames, method, *numbers in rows:
        a, s, edge_a, edge_s, share = numbers
        print(f"{split:<11} {frames:<20} {method:<20} {a:12.1f} {s:6.1f} {edge_a:16.1f} {edge_s:6.1f} {share:12.0f}")
    if arguments.csv:
        with open(arguments.csv, "a", newline="") as file:
            writer = csv.writer(file)
            writer.writerows([scenes, arguments.seed, f"{seconds:.0f}", *row] for row in rows)


if __name__ == "__main__":
    main()
