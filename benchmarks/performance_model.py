"""Times and memory on many ranks, predicted from tables that `plate.py --file` wrote.

    python benchmarks/performance_model.py small.json large.json one_rank.json two_ranks.json

The first two tables, of one rank, give each stage's constant and exponent of growth with the unknowns, the
other two, of one size, what a doubling of the ranks gains. Assumed is that a stage goes on growing with its
exponent, and that every further doubling of the ranks gains as much as the first; that the mesh is made on
one rank; and that memory a rank is what the program takes by itself and, of the rest, the same share with
each doubling. Messages over a network, which two ranks of one machine do not have, cost a latency for each
level of a tree over the ranks in each product of vectors (`LATENCY`, `PRODUCTS`).
"""

from __future__ import annotations

import argparse
import json
import math

# s a message, and sums over all ranks in a stage: of a solve or an iteration few, of 20 modes 2,500.
LATENCY = 5e-6
PRODUCTS = {"modes": 2500, "static": 400}
UNKNOWNS, RANKS = (10**7, 10**8), (64, 512, 4096)


def read(name: str) -> dict:
    """A table with its stages by name."""
    with open(name, encoding="utf-8") as file:
        table = json.load(file)
    return {**table, "stages": {row["stage"]: row for row in table["stages"]}}


class Stage:
    """One stage's time over unknowns and ranks."""

    def __init__(self, name: str, small: dict, large: dict, *, one: dict, two: dict):
        self.name = name
        self.size = large["boundary_unknowns"]
        first, second, whole, shared = (table["stages"][name]["cpu_s"] for table in (small, large, one, two))
        growth = math.log(self.size / small["boundary_unknowns"])
        self.seconds = second
        self.exponent = max(1.0, math.log(second / first) / growth)
        self.gain = 1.0 if name == "mesh" else min(2.0, max(1.0, whole / shared))

    def __call__(self, unknowns: float, ranks: int) -> float:
        """s."""
        doublings = math.log2(ranks)
        alone = self.seconds * (unknowns / self.size) ** self.exponent
        return alone / self.gain**doublings + PRODUCTS.get(self.name, 20) * LATENCY * doublings


def memory(small: dict, large: dict, one: dict, two: dict) -> tuple[float, float, float]:
    """MB that a program takes by itself, MB an unknown, and what a doubling of the ranks leaves of them."""
    peaks = [
        max(row["peak_MB_a_rank"] for name, row in table["stages"].items() if name != "mesh")
        for table in (small, large, one, two)
    ]
    sizes = [table["boundary_unknowns"] for table in (small, large)]
    each = (peaks[1] - peaks[0]) / (sizes[1] - sizes[0])
    base = max(0.0, peaks[0] - each * sizes[0])
    return base, each, max(0.5, (peaks[3] - base) / (peaks[2] - base))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("tables", nargs=4, metavar="FILE")
    small, large, one, two = map(read, parser.parse_args().tables)
    common = set.intersection(*(set(table["stages"]) for table in (small, large, one, two)))
    stages = [Stage(name, small, large, one=one, two=two) for name in large["stages"] if name in common]
    print(f"| stage | s at {large['boundary_unknowns']:,d} | exponent | gain of two ranks |")
    print("|---|---|---|---|")
    for stage in stages:
        print(f"| {stage.name} | {stage.seconds:.1f} | {stage.exponent:.2f} | {stage.gain:.2f} |")
    base, each, share = memory(small, large, one, two)
    print(f"\nMemory: {base:.0f} MB and {1e3 * each:.2f} kB an unknown; of that {share:.2f} on two ranks\n")
    print("| unknowns | ranks | " + " | ".join(f"{stage.name}, s" for stage in stages) + " | GB a rank |")
    print("|---" * (len(stages) + 3) + "|")
    for unknowns in UNKNOWNS:
        for ranks in RANKS:
            times = " | ".join(f"{stage(unknowns, ranks):.2g}" for stage in stages)
            held = (base + each * unknowns * share ** math.log2(ranks)) / 1e3
            print(f"| {unknowns:.0e} | {ranks:,d} | {times} | {held:.2g} |")


if __name__ == "__main__":
    main()
