"""All parts, in the order of the report."""

from __future__ import annotations

from . import bursts, crack, foundations, hole, physics, readings, response, spectra, steady, tables
from .findings import Part

PARTS: list[Part] = [
    *readings.PARTS,
    *foundations.PARTS,
    *crack.PARTS,
    steady.TABLE1,
    *tables.PARTS,
    *bursts.PARTS,
    *spectra.PARTS[:1],
    *steady.FIGURES,
    *spectra.PARTS[1:],
    *response.PARTS,
    *hole.PARTS,
    steady.FIG13,
    *physics.PARTS,
    steady.CHECK,
]


def chosen(names: list[str] | None) -> list[Part]:
    """The named parts, or all.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    known = {part.name: part for part in PARTS}
    unknown = [name for name in names or () if name not in known]
    if unknown:
        error = ValueError(
            f"--only: there is no part {', '.join(map(repr, unknown))}; the parts are {', '.join(known)}"
        )
        error.on_all_ranks = True
        raise error
    return [part for part in PARTS if names is None or part.name in names]
