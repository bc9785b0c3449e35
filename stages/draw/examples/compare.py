"""Discrepancy and integration error of turbid's points beside those of SciPy: `compare.py points.csv`.

`points.csv` is what the example `points` prints. Needs numpy and scipy. Each figure is the root mean square over the seeds;
integrals are over ten dimensions, errors relative to the standard deviation of the integrand, so that independent points have
1 / sqrt(n).
"""

import csv
import math
import sys
from collections import defaultdict

import numpy
from scipy.stats import qmc

MEASURES = {"centred L2 discrepancy": "CD", "L2-star discrepancy": "L2-star"}


def integrands(dimensions):
    """Name, function of an (n, dimensions) array, exact mean, standard deviation (None: measured with 2^20 points)."""
    i = numpy.arange(1, dimensions + 1)
    c = 1 / i
    oscillatory = 4.5 / dimensions
    mean_of = lambda a: (numpy.exp(1j * a) - 1) / (1j * a)
    peak = math.sqrt(math.pi) / 2 * math.erf(1.0)  # of one dimension
    return {
        "sum of squares": (lambda x: (x**2).sum(1), dimensions / 3),
        "product, smooth": (lambda x: (1 + c * (x - 0.5)).prod(1), 1.0),
        "oscillatory": (lambda x: numpy.cos(oscillatory * x.sum(1)), float(numpy.real(mean_of(oscillatory) ** dimensions))),
        "Gaussian peak": (lambda x: numpy.exp(-4 * ((x - 0.5) ** 2).sum(1)), peak**dimensions),
        "with kinks": (lambda x: ((abs(4 * x - 2) + i) / (1 + i)).prod(1), 1.0),
        "with a jump": (lambda x: (x.sum(1) > dimensions / 2).astype(float), 0.5),
    }


def read(path):
    points = defaultdict(list)
    with open(path, newline="") as file:
        rows = csv.reader(file)
        next(rows)
        for method, n, seed, *x in rows:
            points[f"turbid {method}", int(n), int(seed)].append(x)
    return {key: numpy.array(x, dtype=float) for key, x in points.items()}


def main():
    points = read(sys.argv[1])
    numbers = sorted({n for _, n, _ in points})
    seeds = sorted({seed for _, _, seed in points})
    dimensions = next(iter(points.values())).shape[1]
    for n in numbers:
        for seed in seeds:
            points["scipy Sobol", n, seed] = qmc.Sobol(dimensions, seed=seed).random(n)
            points["scipy LHS", n, seed] = qmc.LatinHypercube(dimensions, seed=seed).random(n)
    methods = ["turbid sobol", "scipy Sobol", "turbid lhs", "scipy LHS", "turbid random"]
    assert all(numpy.all((x > 0) & (x < 1)) for (method, _, _), x in points.items() if method.startswith("turbid"))

    def table(name, of, digits):
        print(f"\n| {name}, n | " + " | ".join(methods) + " |\n|---|" + "---|" * len(methods))
        for n in numbers:
            rms = lambda method: math.sqrt(sum(of(points[method, n, seed]) ** 2 for seed in seeds) / len(seeds))
            print(f"| {n} | " + " | ".join(f"{rms(method):.{digits}g}" for method in methods) + " |", flush=True)

    print(f"{dimensions} dimensions, {len(seeds)} seeds")
    for name, method in MEASURES.items():
        # CD is given squared.
        root = math.sqrt if method == "CD" else float
        table(name, lambda x: root(qmc.discrepancy(x, method=method, workers=-1)), 3)
    many = numpy.random.default_rng(0).random((1 << 20, dimensions))
    for name, (f, mean) in integrands(dimensions).items():
        values = f(many)
        spread = values.std()
        away = abs(values.mean() - mean) / (spread / math.sqrt(len(many)))
        assert away < 5, f"{name}: the mean of many points is {away} standard errors from {mean}"
        table(f"error of {name}", lambda x: (f(x).mean() - mean) / spread, 2)


if __name__ == "__main__":
    main()
