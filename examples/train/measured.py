"""The network of train.py on computed fringes of any phase, tried on a laboratory's single shots.

    python3 measured.py FOLDER SHOTS [--steps N] [--seed S]

FOLDER is what `turbid dataset build examples/train/ssop_measured.yaml --to FOLDER` wrote; SHOTS holds the pictures of
phantoms of Chen et al. (IEEE TMI 39, 1988 (2020), MIT licence): 512 x 256, on the left the shot (red: over the reference's
M_DC, in one common scale), on the right the laboratory's maps by three phases (red: mu_a, 255 = 0.25 mm^-1; green: mu_s',
255 = 2.5 mm^-1). Needs `datasets`, `torch` and `pillow`.

All was fixed before the shots were opened, but for two numbers that say nothing of mu_a and mu_s': the common scale (259
of a shot are R_d = 1) and the noise of a pixel, which the network learns with.
"""

import argparse
import math
import pathlib
import time

import numpy as np
import torch
from datasets import load_dataset
from PIL import Image
from train import BATCH, Block, UNet, optimise, read, target

SCALE = 259.0
# Of a pixel of a shot: so many times the root of its number.
NOISE = 0.25
# Rows and columns of a shot that the network sees.
MIDDLE = (slice(96, 160), slice(96, 160))


class AnyPhase(UNet):
    """The frame alone: where its fringes lie is not told."""

    def __init__(self):
        super().__init__()
        self.down[0] = Block(1, 16)


def fringes(data):
    """Complex amplitude and mean of R for each pixel: I(phase) = mean + Re(amplitude e^(i phase)), from three phases."""
    # R_d of the reference over its M_DC: the same in all samples, known where a pixel is not masked.
    known = data["m_dc"] > 0
    factor = np.nanmedian(np.divide(data["r_d"], data["m_dc"], out=np.full_like(data["r_d"], np.nan), where=known), 0)
    frames = data["frames"] * factor
    phases = np.exp(-2j * math.pi * np.arange(3) / 3)[None, :, None, None]
    amplitude = (frames * phases).sum(1, keepdims=True) * 2 / 3
    return amplitude.astype(np.complex64), frames.mean(1, keepdims=True).astype(np.float32)


def shots(amplitude, mean, rng):
    """One frame of each at a phase of its own, with the noise of a measured one."""
    turn = np.exp(2j * math.pi * rng.random((len(mean), 1, 1, 1)))
    frame = mean + (amplitude * turn).real
    noise = NOISE * np.sqrt(np.maximum(frame, 0) / SCALE)
    return torch.as_tensor((frame + noise * rng.standard_normal(frame.shape)).astype(np.float32))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("shots")
    parser.add_argument("--steps", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    rng = np.random.default_rng(arguments.seed)

    sets = load_dataset(arguments.folder)
    data = read(sets, "train")
    (amplitude, mean), y = fringes(data), target(data)
    middle, spread = y.mean((0, 2, 3), keepdim=True), y.std((0, 2, 3), keepdim=True)

    def batch(_):
        chosen = rng.integers(0, len(y), BATCH)
        xs, ys = shots(amplitude[chosen], mean[chosen], rng), y[torch.as_tensor(chosen)]
        for axis in (2, 3):  # Mirror images are as likely.
            if rng.random() < 0.5:
                xs, ys = xs.flip(axis), ys.flip(axis)
        return xs, (ys - middle) / spread

    began = time.process_time()
    network = optimise(AnyPhase(), arguments.steps, batch)
    print(f"{len(y)} scenes, {arguments.steps} steps, {time.process_time() - began:.0f} CPU s of training")

    def maps(frames):
        with torch.no_grad():
            return torch.exp(network(frames) * spread + middle).numpy()

    held = read(sets, "validation")
    found = maps(shots(*fringes(held), rng))
    for i, name in enumerate(("mu_a", "mu_s_prime")):
        error = np.abs(found[:, i : i + 1] / held[f"{name}_true"] - 1)
        print(f"validation, computed: mean |error| of {name} {100 * error.mean():.1f} %")

    print("phantom   laboratory: mu_a mu_s'   network: mu_a mu_s'   difference, %")
    differences = []
    for path in sorted(pathlib.Path(arguments.shots).glob("*.png")):
        picture = np.asarray(Image.open(path)).astype(np.float32)
        half = picture.shape[1] // 2
        shot, answer = picture[:, :half][MIDDLE], picture[:, half:][MIDDLE]
        laboratory = np.median(answer[..., 0]) * 0.25 / 255, np.median(answer[..., 1]) * 2.5 / 255
        found = maps(torch.as_tensor(shot[None, None, :, :, 0] / SCALE))[0]
        network_s = np.median(found[0]), np.median(found[1])
        differences.append([100 * (n / l - 1) for n, l in zip(network_s, laboratory)])
        a, s = differences[-1]
        print(f"{path.stem:<12} {laboratory[0]:9.4f} {laboratory[1]:6.3f} {network_s[0]:14.4f} {network_s[1]:6.3f} {a:+12.1f} {s:+6.1f}")
    mean_error = np.abs(differences).mean(0)
    bias, scatter = np.mean(differences, 0), np.std(differences, 0)
    print(f"mean |difference| {mean_error[0]:.1f}, {mean_error[1]:.1f} %; mean {bias[0]:+.1f}, {bias[1]:+.1f} %; standard deviation {scatter[0]:.1f}, {scatter[1]:.1f} %")


if __name__ == "__main__":
    main()
