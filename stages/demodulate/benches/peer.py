"""What benches/speed.rs times, in NumPy: 2048 x 2048 frames of 32-bit floats, three phases. CPU seconds of the thread, best of 5."""
import time

import numpy as np

SIDE = 2048
row, column = np.mgrid[0:SIDE, 0:SIDE]
a, b, c = (
    (0.5 + 0.2 * np.cos(0.1 * (row + column) + 2 * np.pi * k / 3)).astype(np.float32) for k in range(3)
)


def amplitudes():
    m_dc = (a + b + c) / np.float32(3)
    m_ac = np.float32(2**0.5 / 3) * np.sqrt((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2)
    return m_dc, m_ac


def with_phase():
    return *amplitudes(), np.arctan2(np.float32(3**0.5) * (c - b), 2 * a - b - c)


for name, work in [("AC, DC", amplitudes), ("AC, DC, phase", with_phase)]:
    best = float("inf")
    for _ in range(5):
        start = time.thread_time()
        work()
        best = min(best, time.thread_time() - start)
    one = SIDE * SIDE / best * 1e-6
    print(f"NumPy {np.__version__}, {name:14} {one:6.0f} {3 * one:6.0f} ({1e3 * best:.1f} ms)")
