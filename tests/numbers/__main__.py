"""Compute the table of numbers and compare it with the stored one: `python -m tests.numbers`.

Prints what has moved, the furthest in its tolerance first, and then exits with 1. `--only GROUP` takes one
kind of analysis, `--all` prints the numbers that hold too, `--write` stores what was computed (numbers within
their tolerance keep their digits). Under mpiexec: the groups that ranks share.
"""

from __future__ import annotations

import argparse
import sys
import time

from mpi4py import MPI

from tests.numbers import GROUPS
from tests.numbers.table import Group, Number, compare


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.numbers", description=__doc__, allow_abbrev=False)
    parser.add_argument(
        "--only", action="append", choices=list(GROUPS), metavar="GROUP", help=", ".join(GROUPS)
    )
    parser.add_argument("--write", action="store_true", help="store what was computed")
    parser.add_argument("--all", action="store_true", help="print the numbers that hold too")
    options = parser.parse_args()
    comm = MPI.COMM_WORLD
    groups = [GROUPS[name] for name in options.only or GROUPS]
    found: list[tuple[float, str]] = []
    for group in groups:
        if comm.size > 1 and not group.ranks:
            continue
        found += run(group, write=options.write)
    if comm.rank > 0:
        return 0
    moved = sorted((item for item in found if item[0] > 1.0), key=lambda item: -item[0])
    for _, text in sorted(found, key=lambda item: -item[0]) if options.all else moved:
        print(text)
    print(f"{len(found)} numbers, {len(moved)} moved")
    return 1 if moved and not options.write else 0


def run(group: Group, *, write: bool) -> list[tuple[float, str]]:
    """Compute a group; compare it with what is stored, and store it if asked to."""
    start = time.process_time()
    numbers = list(group.compute())
    found = compare(group, numbers)
    if MPI.COMM_WORLD.rank == 0:
        print(f"{group.name}: {len(numbers)} numbers, {time.process_time() - start:.1f} s", file=sys.stderr)
        if write:
            group.write(number for number in numbers if isinstance(number, Number))
    return found


if __name__ == "__main__":
    sys.exit(main())
