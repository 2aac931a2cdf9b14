"""Decks of Abaqus and CalculiX (.inp): cards of keywords, and the nodes, elements and sets that they say."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

from meshing.gmsh.confined import Refusal

_MADE = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
# What counts, and may stand in a file of its own.
_READ = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "BOUNDARY")


@dataclass
class Card:
    """A keyword with its parameters, in capital letters, and its lines of data, each with its place; `outer`
    if it stands in the assembly, whose sets are others than those of its part.
    """

    place: str
    keyword: str
    given: dict[str, str]
    outer: bool = False
    rows: list[tuple[str, list[str]]] = field(default_factory=list)

    def refuse(self, what: str, place: str = "") -> NoReturn:
        raise Refusal(f"*{self.keyword} in {place or self.place} {what}.")


@dataclass
class Labels:
    """Those of a set, in order; `hidden` sets are those that Abaqus/CAE makes for itself."""

    name: str
    hidden: bool
    outer: bool
    labels: dict[int, None] = field(default_factory=dict)

    def add(self, labels: Iterable[int]) -> None:
        self.labels.update(dict.fromkeys(labels))


def cards(lines: Iterable[tuple[str, str]]) -> list[Card]:
    """Those of lines, each with its place."""
    found: list[Card] = []
    going_on = False
    for place, content in lines:
        content = content.strip()
        if not content or content.startswith("**"):
            continue
        if content.startswith("*") and not going_on:
            keyword, _, content = content[1:].partition(",")
            found.append(Card(place, " ".join(keyword.upper().split()), {}))
            going_on = True
        if going_on:
            going_on = content.endswith(",")
            for part in filter(None, (part.strip() for part in content.split(","))):
                name, _, value = part.partition("=")
                found[-1].given[name.strip().upper()] = value.strip().strip("\"'")
        elif found:
            found[-1].rows.append((place, [part.strip() for part in content.split(",")]))
    return found


def _require_written_out(card: Card) -> None:
    """Refuse what is made by a rule, is placed in another system, or stands in another file."""
    system = card.given.get("SYSTEM", "R").upper() if card.keyword == "NODE" else "R"
    if card.keyword in _MADE or system not in ("R", ""):
        card.refuse("makes nodes or elements, or places them; write all of them out")
    if ("INPUT" in card.given and card.keyword in _READ) or card.keyword == "INCLUDE":
        card.refuse(
            f"reads the file {card.given.get('INPUT', '')!r}, which is not done here; put all in one file"
        )


def of_one_part(cards: Iterable[Card]) -> Iterator[Card]:
    """The cards of the part, and those of the assembly that speak of it."""
    seen: dict[str, int] = {}
    assembly = instance = False
    for card in cards:
        keyword = card.keyword
        _require_written_out(card)
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


class Deck:
    """What the cards say.

    Attributes
    ----------
    nodes : dict of int to list of float
    elements : dict of int to (kind, list of int)
        Kind as `kind` tells it, and node labels.
    sets : dict of str to dict of str to Labels
        Sets of elements ("ELSET") and nodes ("NSET") by their names in capital letters, in the order in which
        they are first met.
    splits : bool
        Whether the nodes of an element may go on in the next line without a comma at this one's end.
    some : bool
        Whether there are elements that have been left out: sets and labels that are not known are theirs.
    """

    splits = some = False

    def __init__(self, cards: list[Card]) -> None:
        self.nodes: dict[int, list[float]] = {}
        self.elements: dict[int, tuple[Any, list[int]]] = {}
        self.sets: dict[str, dict[str, Labels]] = {"ELSET": {}, "NSET": {}}
        self._cards = cards
        for card in self.of("NODE"):
            self._add_nodes(card)
        for card in self.of("ELEMENT"):
            self.add_elements(card)
        for card in self.of("ELSET", "NSET"):
            self._add_set(card)

    @abstractmethod
    def kind(self, card: Card) -> tuple[Any, tuple[int, ...]]:
        """What elements of a card are, and the numbers of nodes that they may have."""

    def labels(self, card: Card, place: str, own: str, kind: str) -> Iterable[int]:
        """Labels of a set, or of the single element or node, that a card names; it may be PART.NAME."""
        last = own.rpartition(".")[2]
        if not last.isdecimal():
            return self.known(card, kind, own)
        (label,) = self._integers(card, place, [last])
        if label not in (self.elements if kind == "ELSET" else self.nodes):
            if self.some and kind == "ELSET":
                return ()
            card.refuse(
                f"has {'element' if kind == 'ELSET' else 'node'} {label}, which does not exist", place
            )
        return (label,)

    def of(self, *keywords: str) -> list[Card]:
        """Cards of some keywords."""
        return [card for card in self._cards if card.keyword in keywords]

    def _add_nodes(self, card: Card) -> None:
        labels = []
        for place, row in card.rows:
            try:
                label, where = _number(row[0]), [float(re.sub("[dD]", "e", x) or 0.0) for x in row[1:4]]
            except ValueError:
                card.refuse(f"does not hold a number and coordinates: {', '.join(row)}", place)
            where += [0.0] * (3 - len(where))
            if self.nodes.setdefault(label, where) != where:
                card.refuse(f"holds node {label}, which stands elsewhere already", place)
            labels.append(label)
        if "NSET" in card.given:
            self._set(card, "NSET").add(labels)

    def add_elements(self, card: Card) -> list[int]:
        """Take in those of a card; their labels."""
        kind, counts = self.kind(card)
        labels, row = [], []
        for place, part in card.rows:
            row += part
            goes_on = self.splits
            if row[-1] == "":
                row.pop()
                goes_on = True
            if goes_on and len(row) - 1 < min(counts):
                continue
            label, *nodes = self._integers(card, place, row)
            row = []
            if len(nodes) not in counts:
                card.refuse(f"has {len(nodes)} nodes of element {label}, not {counts[0]}", place)
            if label in self.elements:
                card.refuse(f"holds element {label}, which there is already", place)
            missing = [node for node in nodes if node not in self.nodes]
            if missing:
                card.refuse(f"has node {missing[0]} in element {label}, which does not exist", place)
            self.elements[label] = (kind, nodes)
            labels.append(label)
        if row:
            card.refuse(f"ends within element {row[0]}")
        if "ELSET" in card.given:
            self._set(card, "ELSET").add(labels)
        return labels

    def _add_set(self, card: Card) -> None:
        kind = card.keyword
        if kind == "NSET" and "ELSET" in card.given:
            labels = self.known(card, "ELSET", card.given["ELSET"])
            self._set(card, kind).add(node for label in labels for node in self.elements[label][1])
            return
        found = self._set(card, kind)
        for place, row in card.rows:
            parts = [part for part in row if part]
            if "GENERATE" not in card.given:
                for part in parts:
                    found.add(self.labels(card, place, part.strip("\"'"), kind))
                continue
            numbers = self._integers(card, place, parts)
            if len(numbers) not in (2, 3) or numbers[2:] == [0]:
                card.refuse(f"does not hold a first and a last number and a step: {', '.join(parts)}", place)
            known = self.elements if kind == "ELSET" else self.nodes
            labels_made = range(numbers[0], numbers[1] + 1, *numbers[2:])
            found.add(label for label in labels_made if label in known)

    def _set(self, card: Card, kind: str) -> Labels:
        name = card.given.get(kind, "")
        if not name:
            card.refuse(f"has no name; give it one, {kind}=...")
        found = self.sets[kind].setdefault(name.upper(), Labels(name, "INTERNAL" in card.given, card.outer))
        if found.outer != card.outer:
            card.refuse(f"makes the set {name!r}, which the part has too; give one of them another name")
        return found

    def known(self, card: Card, kind: str, name: str) -> dict[int, None]:
        """Labels of a set that a card names, or of the part's set that the assembly calls PART.NAME."""
        sets = self.sets[kind]
        found = sets.get(name.upper()) or sets.get(name.upper().rpartition(".")[2])
        if found is None:
            if self.some and kind == "ELSET":
                return {}
            card.refuse(f"names the set {name!r}, which does not exist before it")
        return found.labels

    @staticmethod
    def _integers(card: Card, place: str, row: list[str]) -> list[int]:
        try:
            return [_number(part) for part in row]
        except ValueError:
            card.refuse(f"does not hold whole numbers: {', '.join(row)}", place)


def _number(text: str) -> int:
    """A label; ValueError if it is none, or longer than any."""
    if len(text) > 18:
        raise ValueError
    return int(text)
