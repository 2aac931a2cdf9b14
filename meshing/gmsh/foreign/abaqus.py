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
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign import described, ends_first

# CAX4P and R3D3 are what meshio calls quadrilaterals and triangles
_PLANE = re.compile(r"(?:CPS|CPE|CPEG|M3D|S|STRI|R3D)([34689])(?!\d{2})[A-Z0-9]*|CAX(4)P")
# a truss has its number of nodes in its name, a beam its order; meshio calls lines of three nodes B33
_LINES = re.compile(r"(?:(?:T2|T3|R2)D([23])|B[23]([123]))[A-Z]*")
_OF_BEAM = {"1": (2,), "2": (3,), "3": (2, 3)}
_SHELLS = re.compile(r"(?:M3D|S|STRI|R3D)\d.*")
# Of shells Abaqus numbers the edges, CalculiX counts the two faces first.
_SIDE, _SIDE_OF_SHELL = re.compile(r"S([1-4])"), re.compile(r"E([1-4])|S([3-6])")
_SECTIONS = ("SOLID SECTION", "SHELL SECTION", "MEMBRANE SECTION")
_MADE = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
_OF_GMSH = re.compile(r"(?:Line|Surface)[0-9]+")


@dataclass
class _Card:
    """A keyword with its parameters, in capital letters, and its lines of data; `outer` if it stands in the
    assembly, whose sets are others than those of its part.
    """

    line: int
    keyword: str
    given: dict[str, str]
    outer: bool = False
    rows: list[tuple[int, list[str]]] = field(default_factory=list)

    def refuse(self, what: str, line: int | None = None) -> NoReturn:
        raise Refusal(f"*{self.keyword} in line {line or self.line} {what}.")


@dataclass
class _Set:
    """Labels in order; `hidden` sets are those that Abaqus/CAE makes for itself."""

    name: str
    hidden: bool
    outer: bool
    labels: dict[int, None] = field(default_factory=dict)

    def add(self, labels: Iterable[int]) -> None:
        self.labels.update(dict.fromkeys(labels))


def load() -> None:
    """Nothing: no library is needed."""


def extract(*, file: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a mesh; `options` are those of `meshing.gmsh.foreign.described`.

    Raises
    ------
    Refusal
        It is no plane mesh, is not understood, or has cells without a material or with two.
    """
    with open(file, encoding="utf-8", errors="replace") as stream:
        deck = _Deck(list(_of_one_part(_cards(stream.read()))))
    groups = deck.materials() | deck.curves()
    used = {name.upper() for _, name in groups}
    sets = deck.sets["NSET"] | deck.node_surfaces()
    seen = (found for key, found in sets.items() if key not in used and not found.hidden)
    node_sets = {found.name: list(found.labels) for found in seen}
    return described(deck.nodes, groups, node_sets, **options)


def _cards(text: str) -> list[_Card]:
    cards: list[_Card] = []
    going_on = False
    for line, content in enumerate(text.splitlines(), 1):
        content = content.strip()
        if not content or content.startswith("**"):
            continue
        if content.startswith("*") and not going_on:
            keyword, _, content = content[1:].partition(",")
            cards.append(_Card(line, " ".join(keyword.upper().split()), {}))
            going_on = True
        if going_on:
            going_on = content.endswith(",")
            for part in filter(None, (part.strip() for part in content.split(","))):
                name, _, value = part.partition("=")
                cards[-1].given[name.strip().upper()] = value.strip().strip("\"'")
        elif cards:
            cards[-1].rows.append((line, [part.strip() for part in content.split(",")]))
    return cards


def _of_one_part(cards: list[_Card]) -> Iterator[_Card]:
    """The cards of the part, and those of the assembly that speak of it."""
    seen: dict[str, int] = {}
    assembly = instance = False
    for card in cards:
        keyword = card.keyword
        if keyword in _MADE:
            card.refuse("makes nodes or elements, or places them; write all of them out")
        if "INPUT" in card.given or keyword == "INCLUDE":
            card.refuse(
                f"reads the file {card.given.get('INPUT', '')!r}, which is not done here; put all in one file"
            )
        if keyword in ("PART", "INSTANCE"):
            seen[keyword] = seen.get(keyword, 0) + 1
            moves = "".join(part for _, row in card.rows for part in row).strip("+-0.eEdD")
            if seen[keyword] > 1 or (keyword == "INSTANCE" and moves):
                card.refuse(
                    "is a second one, or moves its part; write the mesh as one part that is not moved"
                )
        assembly = (assembly or keyword == "ASSEMBLY") and keyword != "END ASSEMBLY"
        instance = (instance or keyword == "INSTANCE") and keyword != "END INSTANCE"
        card.outer = assembly and not instance
        # others are reference points and their sets
        if not card.outer or "INSTANCE" in card.given or keyword == "SURFACE":
            yield card


class _Deck:
    """What the cards say.

    Attributes
    ----------
    nodes : dict of int to list of float
    elements : dict of int to (int, list of int)
        Dimension, and node labels with the ends or corners first.
    sets : dict of str to dict of str to _Set
        Sets of elements ("ELSET") and nodes ("NSET") by their names in capital letters, in the order in which
        they are first met.
    shells : set of int
        Elements whose sides are edges, not faces.
    """

    def __init__(self, cards: list[_Card]) -> None:
        self.nodes: dict[int, list[float]] = {}
        self.elements: dict[int, tuple[int, list[int]]] = {}
        self.sets: dict[str, dict[str, _Set]] = {"ELSET": {}, "NSET": {}}
        self.shells: set[int] = set()
        self._cards = cards
        for card in self._of("NODE"):
            self._add_nodes(card)
        for card in self._of("ELEMENT"):
            self._add_elements(card)
        for card in self._of("ELSET", "NSET"):
            self._add_set(card)

    def materials(self) -> dict[tuple[int, str], list[list[int]]]:
        """Cells by their materials."""
        cells = {label: nodes for label, (dimension, nodes) in self.elements.items() if dimension == 2}
        spelled = {name.upper(): name for card in self._of("MATERIAL") if (name := card.given.get("NAME"))}
        owner: dict[int, str] = {}
        for card in self._of(*_SECTIONS):
            labels = self._known(card, "ELSET", card.given.get("ELSET", ""))
            name = card.given.get("MATERIAL", "")
            name = spelled.get(name.upper(), name)
            for label in labels if name else ():
                if owner.setdefault(label, name) != name:
                    card.refuse(f"gives element {label} the material {name!r}, and another {owner[label]!r}")
        by_sections = bool(owner)
        for label, names in () if by_sections else self._names(cells).items():
            if len(names) > 1:
                raise Refusal(
                    f"element {label} is in the sets {names[0]!r} and {names[1]!r}; it can be of one "
                    "material only, which *SOLID SECTION, ELSET=..., MATERIAL=... says."
                )
            owner[label] = names[0]
        if not owner:
            owner = dict.fromkeys(cells, "material")
        groups: dict[tuple[int, str], list[list[int]]] = {}
        for label, nodes in cells.items():
            if label not in owner:
                wants = "*SOLID SECTION" if by_sections else "set, whose name is the material's"
                raise Refusal(f"element {label} is in no {wants}; give it one.")
            groups.setdefault((2, owner[label]), []).append(nodes)
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

    def node_surfaces(self) -> dict[str, _Set]:
        """Surfaces of nodes by their names in capital letters; reference points of the assembly are none."""
        surfaces: dict[str, _Set] = {}
        for card, name in self._surfaces("NODE"):
            found = surfaces.setdefault(name.upper(), _Set(name, card.outer, card.outer))
            for line, row in card.rows:
                own = row[0].strip("\"'")
                if card.outer and "." not in own and own.upper() not in self.sets["NSET"]:
                    continue
                found.hidden = False
                found.add(self._labels(card, line, own, "NSET"))
        return surfaces

    def _surfaces(self, kind: str) -> Iterator[tuple[_Card, str]]:
        """Surfaces of a kind and their names, without those that Abaqus/CAE makes for itself."""
        for card in self._of("SURFACE"):
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

    def _sides(self, card: _Card) -> Iterator[list[int]]:
        """Node labels, ends first, of each side of a surface."""
        for line, row in card.rows:
            own, side = row[0].strip("\"'"), "".join(row[1:2]).upper()
            for label in self._labels(card, line, own, "ELSET"):
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
                    card.refuse(f"has {what} of element {label}, which is no line in the plane", line)

    @functools.cached_property
    def _uses(self) -> Counter[frozenset[int]]:
        """Elements at each side, by its ends."""
        cells = (nodes for dimension, nodes in self.elements.values() if dimension == 2)
        return Counter(frozenset(side[:2]) for nodes in cells for side in _around(nodes))

    def _labels(self, card: _Card, line: int, own: str, kind: str) -> Iterable[int]:
        """Labels of a set, or of the single element or node, that a card names; it may be PART.NAME."""
        last = own.rpartition(".")[2]
        if not last.isdecimal():
            return self._known(card, kind, own)
        (label,) = self._integers(card, line, [last])
        if label not in (self.elements if kind == "ELSET" else self.nodes):
            card.refuse(f"has {'element' if kind == 'ELSET' else 'node'} {label}, which does not exist", line)
        return (label,)

    def _of(self, *keywords: str) -> list[_Card]:
        return [card for card in self._cards if card.keyword in keywords]

    def _names(self, elements: dict[int, list[int]]) -> dict[int, list[str]]:
        """Sets of each element that is in one; without gmsh's own where there is another."""
        names: dict[int, list[str]] = {}
        for found in self.sets["ELSET"].values():
            for label in () if found.hidden else found.labels:
                if label in elements:
                    names.setdefault(label, []).append(found.name)
        return {label: [n for n in own if not _OF_GMSH.fullmatch(n)] or own for label, own in names.items()}

    def _add_nodes(self, card: _Card) -> None:
        labels = []
        for line, row in card.rows:
            try:
                label, where = _number(row[0]), [float(re.sub("[dD]", "e", x) or 0.0) for x in row[1:4]]
            except ValueError:
                card.refuse(f"does not hold a number and coordinates: {', '.join(row)}", line)
            if label in self.nodes:
                card.refuse(f"holds node {label}, which there is already", line)
            self.nodes[label] = where + [0.0] * (3 - len(where))
            labels.append(label)
        if "NSET" in card.given:
            self._set(card, "NSET").add(labels)

    def _add_elements(self, card: _Card) -> None:
        dimension, counts = _kind(card)
        labels, row = [], []
        for line, part in card.rows:
            row += part
            if row[-1] == "":  # goes on in the next line
                row.pop()
                if len(row) - 1 < min(counts):
                    continue
            label, *nodes = self._integers(card, line, row)
            row = []
            if len(nodes) not in counts:
                card.refuse(f"has {len(nodes)} nodes of element {label}, not {counts[0]}", line)
            if label in self.elements:
                card.refuse(f"holds element {label}, which there is already", line)
            missing = [node for node in nodes if node not in self.nodes]
            if missing:
                card.refuse(f"has node {missing[0]} in element {label}, which does not exist", line)
            self.elements[label] = (dimension, ends_first(nodes, self.nodes) if dimension == 1 else nodes)
            labels.append(label)
        if _SHELLS.fullmatch(card.given["TYPE"].upper()):
            self.shells.update(labels)
        if row:
            card.refuse(f"ends within element {row[0]}")
        if "ELSET" in card.given:
            self._set(card, "ELSET").add(labels)

    def _add_set(self, card: _Card) -> None:
        kind = card.keyword
        if kind == "NSET" and "ELSET" in card.given:
            labels = self._known(card, "ELSET", card.given["ELSET"])
            self._set(card, kind).add(node for label in labels for node in self.elements[label][1])
            return
        found = self._set(card, kind)
        for line, row in card.rows:
            parts = [part for part in row if part]
            if "GENERATE" not in card.given:
                for part in parts:
                    found.add(self._labels(card, line, part.strip("\"'"), kind))
                continue
            numbers = self._integers(card, line, parts)
            if len(numbers) not in (2, 3) or numbers[2:] == [0]:
                card.refuse(f"does not hold a first and a last number and a step: {', '.join(parts)}", line)
            known = self.elements if kind == "ELSET" else self.nodes
            labels_made = range(numbers[0], numbers[1] + 1, *numbers[2:])
            found.add(label for label in labels_made if label in known)

    def _set(self, card: _Card, kind: str) -> _Set:
        name = card.given.get(kind, "")
        if not name:
            card.refuse(f"has no name; give it one, {kind}=...")
        found = self.sets[kind].setdefault(name.upper(), _Set(name, "INTERNAL" in card.given, card.outer))
        if found.outer != card.outer:
            card.refuse(f"makes the set {name!r}, which the part has too; give one of them another name")
        return found

    def _known(self, card: _Card, kind: str, name: str) -> dict[int, None]:
        """Labels of a set that a card names, or of the part's set that the assembly calls PART.NAME."""
        sets = self.sets[kind]
        found = sets.get(name.upper()) or sets.get(name.upper().rpartition(".")[2])
        if found is None:
            card.refuse(f"names the set {name!r}, which does not exist before it")
        return found.labels

    @staticmethod
    def _integers(card: _Card, line: int, row: list[str]) -> list[int]:
        try:
            return [_number(part) for part in row]
        except ValueError:
            card.refuse(f"does not hold whole numbers: {', '.join(row)}", line)


def _around(nodes: list[int]) -> list[list[int]]:
    """Sides of a plane element, ends first."""
    corners = 3 if len(nodes) in (3, 6) else 4
    middles = nodes[corners : 2 * corners]
    return [[nodes[i], nodes[(i + 1) % corners], *middles[i : i + 1]] for i in range(corners)]


def _place(number: re.Match[str]) -> int:
    """Place of a side by its name."""
    return int(number[1]) - 1 if number[1] else int(number[2]) - 3


def _number(text: str) -> int:
    """A label; ValueError if it is none, or longer than any."""
    if len(text) > 18:
        raise ValueError
    return int(text)


def _kind(card: _Card) -> tuple[int, tuple[int, ...]]:
    """Dimension and numbers of nodes of a type of element."""
    kind = card.given.get("TYPE", "").upper()
    plane, line = _PLANE.fullmatch(kind), _LINES.fullmatch(kind)
    if plane:
        return 2, (int(plane[1] or plane[2]),)
    if line:
        return 1, (int(line[1]),) if line[1] else _OF_BEAM[line[2]]
    card.refuse(
        f"has elements of type {kind or 'none'}; a plane mesh of triangles and quadrilaterals (CPS3, CPE4, "
        "CPS8R ...) with lines (T2D2, B21 ...) was expected"
    )
