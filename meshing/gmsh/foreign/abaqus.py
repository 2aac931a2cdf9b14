"""Abaqus input files (.inp): nodes, elements, sets, surfaces and sections; runs in the child process only.

Plane elements are cells. Their materials are those of the sections (`*SOLID SECTION`, `*SHELL SECTION`,
`*MEMBRANE SECTION`), or without sections the element sets, of which each cell is in one. Line elements make
curves: each set that holds some is one, and sets may overlap. A set of nodes is a point if it has one node,
else the curve of the outline's edges between its nodes; if it has the name of a set of elements that is used,
that one counts. A surface of sides of elements is a curve, one of nodes what a set of these is; it counts
before a set of nodes of its name. The names that gmsh gives to its entities ("Line3", "Surface1") count for
elements of no other set. Names are the same in small and capital letters. Loads, supports and constraints are
left aside.
"""

from __future__ import annotations

import functools
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign import described, ends_first
from meshing.gmsh.foreign.deck import Card, Deck, Labels, cards, of_one_part

# CAX4P and R3D3 are what meshio calls quadrilaterals and triangles
_PLANE = re.compile(r"(?:CPS|CPE|CPEG|M3D|S|STRI|R3D)([34689])(?!\d{2})[A-Z0-9]*|CAX(4)P")
# a truss has its number of nodes in its name, a beam its order; meshio calls lines of three nodes B33
_LINES = re.compile(r"(?:(?:T2|T3|R2)D([23])|B[23]([123]))[A-Z]*")
_OF_BEAM = {"1": (2,), "2": (3,), "3": (2, 3)}
_SHELLS = re.compile(r"(?:M3D|S|STRI|R3D)\d.*")
# Of shells Abaqus numbers the edges, CalculiX counts the two faces first.
_SIDE, _SIDE_OF_SHELL = re.compile(r"S([1-4])"), re.compile(r"E([1-4])|S([3-6])")
_SECTIONS = ("SOLID SECTION", "SHELL SECTION", "MEMBRANE SECTION")
_OF_GMSH = re.compile(r"(?:Line|Surface)[0-9]+")


def load() -> None:
    """Nothing: no library is needed."""


def extract(*, file: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a mesh; `options` are those of `meshing.gmsh.foreign.described`.

    Raises
    ------
    Refusal
        It is no plane mesh, is not understood, or has cells without a material or with two.
    """
    with open(file, encoding="utf-8-sig", errors="replace") as stream:
        lines = ((f"line {number}", line) for number, line in enumerate(stream, 1))
        deck = _Deck(list(of_one_part(cards(lines))))
    groups = deck.materials() | deck.curves()
    used = {name.upper() for _, name in groups}
    sets = deck.sets["NSET"] | deck.node_surfaces()
    seen = (found for key, found in sets.items() if key not in used and not found.hidden)
    node_sets = {found.name: list(found.labels) for found in seen}
    return described(deck.nodes, groups, node_sets, **options)


class _Deck(Deck):
    """What the cards say of a plane mesh; kinds of elements are their dimensions, and their nodes begin with
    the ends or corners.

    Attributes
    ----------
    shells : set of int
        Elements whose sides are edges, not faces.
    """

    def __init__(self, cards: list[Card]) -> None:
        self.shells: set[int] = set()
        super().__init__(cards)
        self.elements = ends_first(self.elements, self.nodes)

    def kind(self, card: Card) -> tuple[int, tuple[int, ...]]:
        """Dimension and numbers of nodes of a type of element."""
        kind = card.given.get("TYPE", "").upper()
        plane, line = _PLANE.fullmatch(kind), _LINES.fullmatch(kind)
        if plane:
            return 2, (int(plane[1] or plane[2]),)
        if line:
            return 1, (int(line[1]),) if line[1] else _OF_BEAM[line[2]]
        card.refuse(
            f"has elements of type {kind or 'none'}; a plane mesh of triangles and quadrilaterals (CPS3, "
            "CPE4, CPS8R ...) with lines (T2D2, B21 ...) was expected"
        )

    def add_elements(self, card: Card) -> list[int]:
        """Take in those of a card; their labels."""
        labels = super().add_elements(card)
        if _SHELLS.fullmatch(card.given["TYPE"].upper()):
            self.shells.update(labels)
        return labels

    def materials(self) -> dict[tuple[int, str], list[list[int]]]:
        """Cells by their materials."""
        cells = {label: nodes for label, (dimension, nodes) in self.elements.items() if dimension == 2}
        spelled = {name.upper(): name for card in self.of("MATERIAL") if (name := card.given.get("NAME"))}
        said: dict[int, list[str]] = {}
        for card in self.of(*_SECTIONS):
            labels = self.known(card, "ELSET", card.given.get("ELSET", ""))
            name = card.given.get("MATERIAL", "")
            name = spelled.get(name.upper(), name)
            for label in labels if name else ():
                if said.setdefault(label, [name]) != [name]:
                    other = said[label][0]
                    card.refuse(f"gives element {label} the material {name!r}, and another {other!r}")
        owner = said or self._names(cells) or dict.fromkeys(cells, ["material"])
        groups: dict[tuple[int, str], list[list[int]]] = {}
        for label, nodes in cells.items():
            if label not in owner:
                wants = "*SOLID SECTION" if said else "set, whose name is the material's"
                raise Refusal(f"element {label} is in no {wants}; give it one.")
            name, *others = owner[label]
            if others:
                raise Refusal(
                    f"element {label} is in the sets {name!r} and {others[0]!r}; it can be of one material "
                    "only, which *SOLID SECTION, ELSET=..., MATERIAL=... says."
                )
            groups.setdefault((2, name), []).append(nodes)
        return groups

    def curves(self) -> dict[tuple[int, str], list[list[int]]]:
        """Line elements of each set that has some, and sides of elements of each surface."""
        lines = {label: nodes for label, (dimension, nodes) in self.elements.items() if dimension == 1}
        groups: dict[tuple[int, str], list[list[int]]] = {}
        for label, names in self._names(lines).items():
            for name in names:
                groups.setdefault((1, name), []).append(lines[label])
        known = {name.upper(): sides for (_, name), sides in groups.items()}
        for card, name in self._surfaces("ELEMENT"):
            sides = {frozenset(side[:2]): side for side in self._sides(card)}
            if not sides:
                card.refuse("holds no side of the outline; name the sides of its elements, S1, S2 ...")
            if sides.keys() != {frozenset(side[:2]) for side in known.get(name.upper(), sides.values())}:
                card.refuse(f"makes the curve {name!r}, which there is already; give it another name")
            if name.upper() not in known:
                groups[1, name] = known[name.upper()] = list(sides.values())
        return groups

    def node_surfaces(self) -> dict[str, Labels]:
        """Surfaces of nodes by their names in capital letters; reference points of the assembly are none."""
        surfaces: dict[str, Labels] = {}
        for card, name in self._surfaces("NODE"):
            found = surfaces.setdefault(name.upper(), Labels(name, card.outer, card.outer))
            for place, row in card.rows:
                own = row[0].strip("\"'")
                if card.outer and "." not in own and own.upper() not in self.sets["NSET"]:
                    continue
                found.hidden = False
                found.add(self.labels(card, place, own, "NSET"))
        return surfaces

    def _surfaces(self, kind: str) -> Iterator[tuple[Card, str]]:
        """Surfaces of a kind and their names, without those that Abaqus/CAE makes for itself."""
        for card in self.of("SURFACE"):
            own, name = card.given.get("TYPE", "ELEMENT").upper(), card.given.get("NAME", "")
            made = next((key for key in ("COMBINE", "CROP") if key in card.given), own)
            if "INTERNAL" in card.given:
                continue
            if not name:
                card.refuse("has no name; give it one, NAME=...")
            if made not in ("ELEMENT", "NODE"):
                card.refuse(f"is made by {made}; give its elements and sides, or leave it out")
            if own == kind:
                yield card, name

    def _sides(self, card: Card) -> Iterator[list[int]]:
        """Node labels, ends first, of each side of a surface."""
        for place, row in card.rows:
            own, side = row[0].strip("\"'"), "".join(row[1:2]).upper()
            for label in self.labels(card, place, own, "ELSET"):
                dimension, nodes = self.elements[label]
                number = (_SIDE_OF_SHELL if label in self.shells else _SIDE).fullmatch(side)
                if dimension == 1 and side in ("", "SPOS", "SNEG"):
                    yield nodes
                elif dimension == 2 and side == "" and label not in self.shells:
                    yield from (own for own in _around(nodes) if self._uses[frozenset(own[:2])] == 1)
                elif dimension == 2 and number and len(found := _around(nodes)) > _place(number):
                    yield found[_place(number)]
                else:
                    what = f"side {side!r}" if side else "a face"
                    card.refuse(f"has {what} of element {label}, which is no line in the plane", place)

    @functools.cached_property
    def _uses(self) -> Counter[frozenset[int]]:
        """Elements at each side, by its ends."""
        cells = (nodes for dimension, nodes in self.elements.values() if dimension == 2)
        return Counter(frozenset(side[:2]) for nodes in cells for side in _around(nodes))

    def _names(self, elements: dict[int, list[int]]) -> dict[int, list[str]]:
        """Sets of each element that is in one; without gmsh's own where there is another."""
        names: dict[int, list[str]] = {}
        for found in self.sets["ELSET"].values():
            for label in () if found.hidden else found.labels:
                if label in elements:
                    names.setdefault(label, []).append(found.name)
        return {label: [n for n in own if not _OF_GMSH.fullmatch(n)] or own for label, own in names.items()}


def _around(nodes: list[int]) -> list[list[int]]:
    """Sides of a plane element, ends first."""
    corners = 3 if len(nodes) in (3, 6) else 4
    middles = nodes[corners : 2 * corners]
    return [[nodes[i], nodes[(i + 1) % corners], *middles[i : i + 1]] for i in range(corners)]


def _place(number: re.Match[str]) -> int:
    """Place of a side by its name."""
    return int(number[1]) - 1 if number[1] else int(number[2]) - 3
