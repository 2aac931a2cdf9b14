"""Universal files (.unv) of I-deas, Salome and others: nodes, elements and groups; runs in the child process
only.

Groups of plane elements are materials, of line elements curves; groups of nodes are points or, of several
nodes, the curve of the outline's edges between them. Loads and results are left aside.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign import described, ends_first, sorted_groups

_NODES, _ELEMENTS, _GROUPS = (781, 2411), (780, 2412), (2435, 2452, 2467, 2477)
# Older groups, whose entities have two numbers.
_GROUPS_OF_TWO = (2429, 2430, 2432)
_LINES, _BEAMS = (11, 21, 22, 23, 24), (21, 22, 23, 24)
# Plane stress and strain, plates, membranes, axisymmetric, thin shells: number of nodes by the last digit.
_PLANE = {
    first + last: count
    for first in (40, 50, 60, 70, 80, 90)
    for last, count in ((1, 3), (2, 6), (4, 4), (5, 8))
}
_POINT = 161  # a lumped mass
_IGNORED = range(136, 161)  # springs, dampers
_NODE, _ELEMENT = 7, 8


def load() -> None:
    """Nothing: no library is needed."""


def extract(*, file: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a mesh; `options` are those of `meshing.gmsh.foreign.described`.

    Raises
    ------
    Refusal
        It is no plane mesh, or is not understood.
    """
    nodes: dict[int, list[float]] = {}
    elements: dict[int, tuple[int, list[int]]] = {}
    element_groups: dict[str, list[int]] = {}
    node_groups: dict[str, list[int]] = {}
    with open(file, encoding="utf-8", errors="replace") as stream:
        text = stream.read()
    for number, lines in _datasets(text):
        try:
            if number in _NODES:
                nodes |= _nodes(lines)
            elif number in _ELEMENTS:
                elements |= _elements(lines)
            elif number in (*_GROUPS, *_GROUPS_OF_TWO):
                _groups(lines, 4 if number in _GROUPS else 2, element_groups, node_groups)
        except (ValueError, IndexError, StopIteration) as error:
            raise Refusal(f"its data set {number} is not understood ({error}); export it again.") from error
    for label, (_, corners) in elements.items():
        if missing := [node for node in corners if node not in nodes]:
            raise Refusal(f"element {label} has node {missing[0]}, which does not exist; export it again.")
    groups = sorted_groups(ends_first(elements, nodes), element_groups, node_groups)
    return described(nodes, *groups, **options)


def _datasets(text: str) -> Iterator[tuple[int, list[str]]]:
    """Number and lines of each data set, which lines of -1 enclose."""
    for part in re.split(r"(?m)^ {4}-1\s*$", text)[1::2]:
        number, *lines = part.strip("\n").split("\n")
        if number.strip().isdecimal():
            yield int(number), lines


def _nodes(lines: list[str]) -> dict[int, list[float]]:
    """Places by label: a line of numbers, a line of coordinates."""
    return {
        int(head.split()[0]): [float(re.sub("[dD]", "e", x)) for x in place.split()[:3]]
        for head, place in zip(lines[::2], lines[1::2], strict=True)
    }


def _elements(lines: list[str]) -> dict[int, tuple[int, list[int]]]:
    """Dimension and nodes, corners first, by label."""
    found, rest = {}, iter(lines)
    for head in rest:
        label, kind, *_, count = map(int, head.split())
        if kind in _BEAMS:
            next(rest)
        own: list[int] = []
        while len(own) < count:
            own += map(int, next(rest).split())
        if kind in _LINES and count in (2, 3):
            found[label] = (1, own)
        elif _PLANE.get(kind) == count:
            # nodes follow one another around the element, middles between corners
            found[label] = (2, [*own[::2], *own[1::2]] if count > 4 else own)
        elif kind == _POINT:
            found[label] = (0, own)
        elif kind not in _IGNORED:
            raise Refusal(
                f"element {label} is of the kind {kind} with {count} nodes; a plane mesh of triangles and "
                "quadrilaterals (41 to 95) of 3, 4, 6 or 8 nodes with lines (11 to 24) was expected; "
                "export it with these, or by gmsh as .msh."
            )
    return found


def _groups(
    lines: list[str], width: int, elements: dict[str, list[int]], nodes: dict[str, list[int]]
) -> None:
    """Add the labels of each group: of its elements and of its nodes."""
    rest = iter(lines)
    for head in rest:
        count, name = int(head.split()[-1]), next(rest).strip()
        numbers: list[int] = []
        while len(numbers) < width * count:
            numbers += map(int, next(rest).split())
        entities = np.array(numbers, np.int64).reshape(-1, width)[:, :2]
        for kind, found in ((_ELEMENT, elements), (_NODE, nodes)):
            found.setdefault(name, []).extend(entities[entities[:, 0] == kind, 1].tolist())
