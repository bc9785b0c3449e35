"""A small U-Net learns mu_a and mu_s' of one SSOP frame; its errors beside those of SFDI on the same scenes.

    python3 train.py FOLDER [--scenes N] [--steps N] [--seed S]

FOLDER is what `turbid dataset build examples/train/ssop64.yaml --to FOLDER` wrote. Needs `datasets` and `torch`; runs on
the CPU. Architecture, number of steps and learning rate stand here and were fixed before the test splits were looked at.
"""

import argparse
import math
import time

import numpy as np
import torch
from datasets import load_dataset
from torch import nn

WIDTHS = (16, 32, 64)


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
            x = block(torch.cat([nn.functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False), flat], 1))
        return self.out(x)


def read(sets, split):
    data = sets[split].with_format("numpy")
    columns = {name: np.stack(data[name][:]) for name in data.column_names if name.endswith(("frame", "true", "mu_a", "mu_s_prime", "mask"))}
    return {name: values for name, values in columns.items() if values.ndim == 4}


def inputs(frames, scale):
    """The frame over its scale, and where a pixel stands along x and within a period of the fringes."""
    n, _, rows, columns = frames.shape
    x = (torch.arange(columns) + 0.5) / columns * 64 - 32
    fringe = [torch.cos(2 * math.pi * 0.1 * x), torch.sin(2 * math.pi * 0.1 * x), x / 32]
    place = torch.stack(fringe)[None, :, None, :].expand(n, 3, rows, columns)
    return torch.cat([torch.as_tensor(frames) / scale, place], 1)


def target(data):
    return torch.as_tensor(np.concatenate([np.log(data["mu_a_true"]), np.log(data["mu_s_prime_true"])], 1))


def errors(mu_a, mu_s_prime, data, good):
    """Mean absolute error in percent of both, over the pixels that `good` names."""
    relative = [np.abs(mu_a / data["mu_a_true"] - 1), np.abs(mu_s_prime / data["mu_s_prime_true"] - 1)]
    return [100 * float(error[good].mean()) for error in relative]


def near_edges(data, within=3):
    """Pixels within so many pixels of a change of the truth."""
    mu_a = torch.as_tensor(data["mu_a_true"])
    size = 2 * within + 1
    spread = nn.functional.max_pool2d(mu_a, size, 1, within) + nn.functional.max_pool2d(-mu_a, size, 1, within)
    return (spread > 1e-9).numpy()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--scenes", type=int, default=None)
    parser.add_argument("--steps", type=int, default=2500)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    rng = np.random.default_rng(arguments.seed)

    sets = load_dataset(arguments.folder)
    train = read(sets, "train")
    if arguments.scenes:
        train = {name: values[: arguments.scenes] for name, values in train.items()}
    scale = float(train["frame"].mean())
    x, y = inputs(train["frame"], scale), target(train)
    middle, spread = y.mean((0, 2, 3), keepdim=True), y.std((0, 2, 3), keepdim=True)
    network = UNet()
    weights = sum(p.numel() for p in network.parameters())
    optimiser = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, total_steps=arguments.steps)
    began = time.process_time()
    for step in range(arguments.steps):
        chosen = torch.as_tensor(rng.integers(0, len(x), 16))
        xs, ys = x[chosen], y[chosen]
        if step % 2:  # The fringes run along y: a mirror image in y is as likely.
            xs, ys = xs.flip(2), ys.flip(2)
        loss = nn.functional.l1_loss(network(xs), (ys - middle) / spread)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    print(f"{len(x)} scenes, {weights} weights, {arguments.steps} steps, {time.process_time() - began:.0f} CPU s of training")

    print("mean |error| of mu_a, mu_s' in percent      all pixels      within 3 mm of an edge")
    network.eval()
    # A split without samples is not there.
    for split in (name for name in ("validation", "test", "test_far") if name in sets):
        data = read(sets, split)
        with torch.no_grad():
            found = torch.exp(network(inputs(data["frame"], scale)) * spread + middle).numpy()
        methods = {
            "network": (found[:, :1], found[:, 1:]),
            "one frame (SSOP)": (data["single_mu_a"], data["single_mu_s_prime"]),
            "three phases": (data["three_mu_a"], data["three_mu_s_prime"]),
        }
        good = (data["single_mask"] == 0) & (data["three_mask"] == 0)
        edge = good & near_edges(data)
        for name, (mu_a, mu_s_prime) in methods.items():
            a, b = errors(mu_a, mu_s_prime, data, good), errors(mu_a, mu_s_prime, data, edge)
            print(f"{split:<12} {name:<28} {a[0]:8.1f} {a[1]:6.1f} {b[0]:16.1f} {b[1]:6.1f}")


if __name__ == "__main__":
    main()
