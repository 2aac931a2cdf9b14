"""Loads and contact that act on nothing, because supports hold their directions."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np

from meshing.warnings import LoadWarning

from ..errors import listed, warn
from ..loads import Load
from .model import Model

# Share of a load's nodal forces on free directions that rounding of normals leaves.
ROUND_OFF = 1e-12
# Components of a unit normal below this are those of rounding.
ROUNDED = 1e-9


def warn_of_idle_loads(owner: str, model: Model, units: Iterable[Load]) -> None:
    """Warn of unit loads whose whole force is on directions that are held fixed, and of cracks that end in a
    support. Collective.

    Warns
    -----
    LoadWarning
        With the load and the supports at its place, or the crack.
    """
    if not any(any(support.fixed) for support in model.supports):
        return
    _warn_of_held_faces(owner, model)
    for unit in units:
        idle, supports = model.keep(("idle", unit), functools.partial(_idle, model, unit))
        if idle:
            warn(
                f"{owner}: {unit!r} has no effect, for its direction is held fixed there by "
                f"{listed(supports)}; load another place or direction, or free this one",
                LoadWarning,
            )


def _warn_of_held_faces(owner: str, model: Model) -> None:
    """Warn of pairs of nodes of which supports hold both along their normal."""
    moved = np.repeat(np.abs(model.pairs.normal[:, None]) > ROUNDED, 2, axis=1)
    held = ~(moved & (model.layout.pair_unknowns.reshape(-1, 2, 2) >= 0)).any(axis=(1, 2))
    if held.any():
        names = sorted({model.cracks[crack].name for crack in model.pairs.crack[held]})
        warn(
            f"{owner}: supports hold both faces of {listed(names)} at {held.sum():,d} of {len(held):,d} "
            "pairs: the crack cannot open there, and what its faces press with there is no contact force and "
            "missing in their resultant; hold the edge beside the crack alone, unless that is meant",
            LoadWarning,
        )


def _idle(model: Model, unit: Load) -> tuple[bool, list[str]]:
    """Whether a unit load has no effect, and the supports that touch its nodes."""
    columns = model.load_columns([unit])
    loaded = np.abs(columns.nodal[..., 0]).max(axis=1, initial=0.0) > 0.0
    local = [np.abs(columns.forces).max(initial=0.0), np.abs(columns.nodal).max(initial=0.0)]
    free, given = np.max(model.comm.allgather(local), axis=0)
    if free > ROUND_OFF * given or columns.gaps.any() or columns.tips.any():
        return False, []
    here = [
        support.where for support in model.supports if loaded[model.layout.own_nodes_of(support.where)].any()
    ]
    found = sorted({name for names in model.comm.allgather(here) for name in names})
    return True, found
