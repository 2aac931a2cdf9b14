"""Assemblies: several bodies as one, between which contact is said."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..checks import instance
from .finite_element_model import FiniteElementModel


def join(*bodies: FiniteElementModel) -> FiniteElementModel:
    """Several bodies as one, each where it is, for contact between them; nothing else connects them.

    Parameters
    ----------
    *bodies : FiniteElementModel
        Labels of nodes of the first one stay; those of a further one that are in use are moved up by a power
        of ten. A set's name that is in use gets the body's number: "LEFT" is "LEFT.2" of the second, and
        "LEFT.2.2" where that is in use, too.

    Returns
    -------
    FiniteElementModel
        In SI. Rows and contacts of its parts are not its own: make them of it.

    Raises
    ------
    TypeError
        If there is none, or one is no body.
    """
    if not bodies:
        raise TypeError("join: no body is given; give two or more")
    nodes, sets, fixed = dict[int, np.ndarray](), dict[str, tuple[int, ...]](), list[tuple[int, int]]()
    unknowns, cells = [], dict[str, list[np.ndarray]]()
    for number, body in enumerate(bodies, 1):
        instance("join", f"body {number}", body, FiniteElementModel, "a FiniteElementModel")
        own = body.labels.tolist()
        up = 10 ** len(str(max(*nodes, *own) - min(0, *own))) if {*own} & {*nodes} else 0
        nodes |= {label + up: place for label, place in zip(own, body.places)}
        for name, labels in body.sets.items():
            while name in sets:
                name += f".{number}"
            sets[name] = tuple(label + up for label in labels)
        unknowns.append(body.unknowns + [up, 0])
        fixed += [(label + up, d) for label, d in body.fixed]
        for kind, rows in body.elements.items():
            cells.setdefault(kind, []).append(body.labels[rows] + up)
    mass = sparse.block_diag([body.mass for body in bodies])
    stiffness = sparse.block_diag([body.stiffness for body in bodies])
    elements = {kind: np.concatenate(parts) for kind, parts in cells.items()}
    whole = mass, stiffness, np.concatenate(unknowns), nodes
    found = FiniteElementModel(*whole, sets=sets, fixed=fixed, elements=elements)
    found.inertia = np.concatenate([body.inertia for body in bodies])  # of what is held, too
    return found
