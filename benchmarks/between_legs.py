"""What leaves the window between two legs at a stack's end, over both ratios of leg to window: the polynomial's making.

    python benchmarks/between_legs.py [mirror|plain] [--nodes 11] [--degree 8] [--checks 12]

Solves `EndSection`s at Chebyshev's nodes in the logarithms of both ratios (7 CPU minutes for each kind), prints the
coefficients as `msl_fem/magnetics/field/between_legs.py` has them, and how far the polynomial is from other solutions.
"""

import argparse

import numpy as np
from numpy.polynomial import chebyshev

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.field.between_legs import REACH
from msl_fem.magnetics.field.end_effects import EndSection


@one_blas_thread
def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", nargs="?", choices=("mirror", "plain"), default="mirror")
    parser.add_argument("--nodes", type=int, default=11)
    parser.add_argument("--degree", type=int, default=8)
    parser.add_argument("--checks", type=int, default=12)
    given = parser.parse_args()

    def excess(place: tuple[float, float]) -> float:
        first, second = np.exp(REACH * np.array(place))
        return EndSection(1.0, float(first), float(second), mirror=given.kind == "mirror").excess()

    nodes = np.cos(np.pi * (np.arange(given.nodes) + 0.5) / given.nodes)
    values = np.array([[excess((a, b)) for b in nodes] for a in nodes])
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, given.nodes - 1))
    found = (inverse @ values @ inverse.T)[: given.degree + 1, : given.degree + 1]
    for row in found:
        print("    (" + ", ".join(f"{c:.5f}" for c in row) + "),")
    places = np.random.default_rng(0).uniform(-1, 1, (given.checks, 2))
    off = [chebyshev.chebval2d(*place, found) / excess(tuple(place)) - 1 for place in places]
    print(f"largest relative difference from {given.checks} other solutions: {np.abs(off).max():.1e}")


if __name__ == "__main__":
    main()
