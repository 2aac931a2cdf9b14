"""States of an unreduced model that goes on with another number of ranks, or with other BLAS kernels.

Displacement unknowns are told apart by nodes. Auxiliary unknowns q stand in a basis that each rank finds for
its own S-elements; what is the same in every basis is what they give the nodes, C J^k q with k below the
number of terms of the continued fraction, and of that a state is found again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...system.solve.pencil import Pencil

Labels = Mapping[str, np.ndarray]
# Relative difference of two bases that are the same but for rounding.
_SAME = 1e-12


def alike(former: Sequence[Labels], own: Sequence[Labels]) -> bool:
    """Whether the states of a former run stand as those of this one do: of as many ranks, with the same
    S-elements in the same basis. Other BLAS kernels, as of another processor, find it with other signs.
    """

    def equal(one: np.ndarray, other: np.ndarray) -> bool:
        size = float(np.abs(one).max(initial=0.0))
        return one.shape == other.shape and bool(np.allclose(one, other, rtol=0.0, atol=_SAME * size))

    return len(former) == len(own) and all(
        a.keys() == b.keys() and all(equal(a[name], b[name]) for name in a) for a, b in zip(former, own)
    )


def layout_of(pencil: Pencil) -> dict[str, np.ndarray]:
    """What tells this rank's unknowns apart, by name: of a pencil that keeps every auxiliary one."""
    part, owned = pencil.layout.part, pencil.layout.owned
    own = (part.unknowns >= owned.start) & (part.unknowns < owned.stop)
    labels = np.empty(pencil.owned, dtype=np.int64)
    labels[part.unknowns[own] - owned.start] = (2 * part.nodes[:, None] + [0, 1])[own]
    found = {"labels": labels}
    shapes: dict[int, int] = {}
    for k, (group, scale, numbers) in enumerate(pencil.placed()):
        shape = shapes.setdefault(id(group.solution), k)
        if shape == k:
            solution = group.solution
            found |= {f"{k}/coupling": solution.coupling, f"{k}/inertia": solution.inertia}
        found |= {
            f"{k}/like": np.array([shape, scale]),
            f"{k}/elements": part.elements[group.elements],
            f"{k}/nodes": part.nodes[group.nodes],
            f"{k}/rotations": group.rotations,
            f"{k}/numbers": numbers,
        }
    return found


def moved(pencil: Pencil, layouts: Sequence[Labels], states: Sequence[np.ndarray]) -> np.ndarray:
    """(local unknowns, m): this rank's share of states (local unknowns, m) of other ranks."""
    mine, terms = layout_of(pencil), pencil.elements.terms
    result = np.zeros((pencil.owned + len(pencil.auxiliary_inertia()), states[0].shape[1]))
    labels = np.concatenate([layout["labels"] for layout in layouts])
    values = np.concatenate([state[: len(layout["labels"])] for layout, state in zip(layouts, states)])
    order = np.argsort(labels)
    result[: pencil.owned] = values[order[np.searchsorted(labels, mine["labels"], sorter=order)]]
    former = {
        int(element): (piece, k, state[len(layout["labels"]) :])
        for layout, state in zip(layouts, states)
        for piece in _pieces(layout)
        for k, element in enumerate(piece["elements"])
    }
    for piece in _pieces(mine):
        unit = piece["inertia"].max(initial=np.finfo(float).tiny)
        back = np.linalg.pinv(np.concatenate(list(_powers(piece, unit, terms))))
        for k, element in enumerate(piece["elements"]):
            other, row, auxiliary = former[int(element)]
            given = auxiliary[other["numbers"][row]]
            # the nodes there in the order of those here, and the frame there to that here
            order = np.argsort(other["nodes"][row])[np.argsort(np.argsort(piece["nodes"][k]))]
            turn = piece["rotations"][k] @ other["rotations"][row].T
            there = [
                turn @ (block @ given).reshape(len(order), 2, -1)[order]
                for block in _powers(other, unit, terms)
            ]
            on_nodes = np.concatenate(there).reshape(-1, given.shape[1])
            result[pencil.owned + piece["numbers"][k]] = back @ on_nodes
    return result


def moved_whole(pencil: Pencil, layouts: Sequence[Labels], states: np.ndarray) -> np.ndarray:
    """(n, N): states of n motions in the order of all ranks, one behind the other, of those of other ranks.
    Collective.
    """
    auxiliary = [sum(piece["numbers"].size for piece in _pieces(layout)) for layout in layouts]
    sizes = [2 * (len(layout["labels"]) + more) for layout, more in zip(layouts, auxiliary)]
    parts = np.split(states, np.cumsum(sizes)[:-1], axis=1)
    own = moved(pencil, layouts, [part.reshape(2 * len(states), -1).T for part in parts])
    return np.concatenate(pencil.layout.comm.allgather(own.T.reshape(len(states), -1)), axis=1)


def _pieces(layout: Labels) -> Iterator[dict[str, np.ndarray]]:
    """S-elements of one shape and size in a layout, with their coupling C and inertia J."""
    k = 0
    while f"{k}/like" in layout:
        shape, scale = layout[f"{k}/like"]
        blocks = {name: scale * layout[f"{int(shape)}/{name}"] for name in ("coupling", "inertia")}
        yield blocks | {name: layout[f"{k}/{name}"] for name in ("elements", "nodes", "rotations", "numbers")}
        k += 1


def _powers(piece: Labels, unit: float, terms: int) -> Iterator[np.ndarray]:
    """C J^k for the terms of the continued fraction, J in multiples of `unit`."""
    return (piece["coupling"] * (piece["inertia"] / unit) ** k for k in range(terms))
