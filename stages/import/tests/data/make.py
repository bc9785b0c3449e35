"""Makes the pictures of this folder: python3 make.py (NumPy, SciPy, tifffile, Pillow; ImageMagick's `convert` for the last).

Each holds numbers that a test knows: pixel (r, c) of page p is 1000 p + 10 r + c, less where the type has no room.
"""

import subprocess

import numpy as np
import tifffile
from scipy.io import savemat
from PIL import Image

rows, columns = 5, 7
ramp = 10 * np.arange(rows)[:, None] + np.arange(columns)[None, :]
pages = np.stack([ramp + 1000 * p for p in range(3)])
np.save("u8.npy", ramp.astype(np.uint8))
np.save("i16_big.npy", (ramp - 20).astype(">i2"))
np.save("f32.npy", (ramp / 64).astype(np.float32))
np.save("pages_u16.npy", pages.astype(np.uint16))
pages.astype("<u2").tofile("pages.raw")
np.save("fortran.npy", np.asfortranarray(ramp.astype(np.uint16)))
np.save("fortran_pages.npy", np.asfortranarray(pages.astype(np.uint16)))
np.savez("one.npz", ramp.astype(np.uint16))
np.savez_compressed("two.npz", mu_a=(ramp / 64).astype(np.float32), pages=pages.astype(np.uint16))
np.savetxt("spaces.txt", ramp / 64)
np.savetxt("commas.csv", ramp / 64, delimiter=",", fmt="%.18g")
others = {"name": "a text", "complex": ramp * 1j, "one": 7.0}
savemat("plain.mat", {**others, "u16": ramp.astype(np.uint16)})
savemat("packed.mat", {**others, "f64": ramp / 64, "i16": (ramp - 20).astype(np.int16)}, do_compression=True)
savemat("pages.mat", {"pages": np.moveaxis(pages, 0, -1).astype(np.uint16)}, do_compression=True)
tifffile.imwrite("pages.tif", pages.astype(np.uint16), photometric="minisblack")
tifffile.imwrite("pages_big.tif", pages.astype(np.uint16), photometric="minisblack", bigtiff=True)
tifffile.imwrite("i16.tif", (ramp - 20).astype(np.int16), photometric="minisblack")
tifffile.imwrite("deflate.tif", ramp.astype(np.uint16), photometric="minisblack", compression="zlib", predictor=True)
tifffile.imwrite("upside_down.tif", ramp[::-1].astype(np.uint16), photometric="minisblack", extratags=[(274, 3, 1, 4, True)])
colours = np.stack([ramp, ramp + 100, ramp + 200], -1).astype(np.uint8)
tifffile.imwrite("planar.tif", np.moveaxis(colours, -1, 0), photometric="rgb", planarconfig="separate")
tifffile.imwrite("palette.tif", ramp.astype(np.uint8), photometric="palette", colormap=np.zeros((3, 256), np.uint16))
Image.fromarray(ramp.astype(np.uint8)).save("grey.bmp")
tifffile.imwrite("source.tif", ramp.astype(np.uint8), photometric="minisblack")
tifffile.imwrite("source_rgb.tif", colours, photometric="rgb")
for source, *how, target in [
    ("source.tif", "grey.pgm"),
    ("source_rgb.tif", "-compress", "none", "colours.bmp"),
]:
    subprocess.run(["convert", source, *how, target], check=True)
subprocess.run(["convert", "source.tif", "-depth", "16", "grey16.pgm"], check=True)
subprocess.run(["rm", "source.tif", "source_rgb.tif"], check=True)
