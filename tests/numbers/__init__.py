"""The table of numbers: what the program computes, case by case, held to stored values.

`python -m tests.numbers` compares. The stored numbers are no oracles (the other tests have those): they tell
what a change moves besides what it means to move.
"""

from __future__ import annotations

from tests.numbers import (
    basins,
    curves,
    fields,
    fracture,
    free,
    histories,
    loci,
    modes,
    orbits,
    statics,
    tori,
    unreduced,
)

GROUPS = {
    module.GROUP.name: module.GROUP
    for module in (
        modes,
        statics,
        fracture,
        fields,
        histories,
        orbits,
        curves,
        free,
        loci,
        tori,
        basins,
        unreduced,
    )
}
