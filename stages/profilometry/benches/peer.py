"""The arrays of `cargo bench -p turbid-profilometry -- --write FOLDER` unwrapped by scikit-image: CPU seconds (best of 3), and pixels where the two differ
by whole turns (percent), up to one number of turns for all. Run as `python peer.py FOLDER`."""
import glob
import sys
import time

import numpy as np
import skimage
from skimage.restoration import unwrap_phase

for path in sorted(glob.glob(f"{sys.argv[1]}/wrapped_*.f32")):
    wrapped = np.fromfile(path, np.float32).reshape(2048, 2048)
    here = np.fromfile(path.replace("/wrapped_", "/unwrapped_"), np.float32).reshape(2048, 2048)
    best = float("inf")
    for _ in range(3):
        start = time.thread_time()
        peer = unwrap_phase(wrapped)
        best = min(best, time.thread_time() - start)
    turns = np.rint((peer - here) / (2 * np.pi)).astype(int)
    values, counts = np.unique(turns, return_counts=True)
    print(f"scikit-image {skimage.__version__}, {path[-7:-4]} rad: {best:.2f} s, {100 * (1 - counts.max() / turns.size):.4f} % differ")
