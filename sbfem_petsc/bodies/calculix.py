"""Bodies from the files of CalculiX: matrices of *FREQUENCY, SOLVER=MATRIXSTORAGE and the deck."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign.deck import Card, Deck, cards, of_one_part
from meshing.whole_file import read_whole

from ..checks import path
from .cells import KINDS
from .finite_element_model import FiniteElementModel
from .rows import AXES, NONE

OWNER = "read_calculix"
# What moves or removes unknowns, or closes contact before this program does.
REFUSED = {"COUPLING", "EQUATION", "GAP", "MPC", "TIE", "TRANSFORM", "CONTACT PAIR", "RIGID BODY"}
REFUSED |= {"CYCLIC SYMMETRY MODEL", "DISTRIBUTING COUPLING"}
# Solid elements by VTK's names, whose nodes stand in the same order.
SOLIDS = {"C3D4": "tetra", "C3D10": "tetra10", "C3D6": "wedge", "C3D15": "wedge15"}
SOLIDS |= {"C3D8": "hexahedron", "C3D20": "hexahedron20"}
# Decks that include decks that include decks.
DEEPEST = 20


def read_calculix(job: Any, units: str = "mm-N-t") -> FiniteElementModel:
    """A body from what CalculiX stores of a step ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

    Parameters
    ----------
    job : str or path
        Name of the job: `job`.inp is read for nodes, node sets (whose names are in capitals, as CalculiX
        takes them) and boundary conditions, `job`.dof, `job`.sti and `job`.mas for the matrices.
    units : {"SI", "mm-N-t", "mm-kg-mN"}
        Those of the deck.

    Returns
    -------
    FiniteElementModel

    Raises
    ------
    ValueError, TypeError
        If a file is missing, cut or of another job; if the deck has constraints, contact or elements that
        CalculiX expands (shells, beams, plane ones).

    Warns
    -----
    UnitWarning
        If the units make no sense.
    """
    stem = path(OWNER, "job", job).removesuffix(".inp")
    deck = read_deck(OWNER, f"{stem}.inp")
    unknowns = _unknowns(f"{stem}.dof", deck["nodes"])
    stiffness, mass = (_matrix(f"{stem}.{ending}", len(unknowns)) for ending in ("sti", "mas"))
    if stiffness.nnz != mass.nnz:
        raise ValueError(
            f"{OWNER}: {stem}.sti has {stiffness.nnz} entries, .mas {mass.nnz}; one is cut or of another run"
        )
    deck["fixed"] -= set(map(tuple, unknowns.tolist()))
    body = FiniteElementModel(mass, stiffness, unknowns, **deck, units=units)
    _require_one_run(stem, body)
    return body


def job_files(job: str) -> list[str]:
    """Paths of the files of a job: its deck, those that it includes, unknowns and matrices."""
    stem = job.removesuffix(".inp")
    return [*decks(OWNER, f"{stem}.inp"), *(f"{stem}.{ending}" for ending in ("dof", "sti", "mas"))]


def decks(owner: str, file: str) -> dict[str, None]:
    """Paths of a deck and of those that it includes."""
    return dict.fromkeys(place.rpartition(", line ")[0] for place, _ in _lines(owner, file))


class _Solids(Deck):
    """Nodes, sets of them, and solid elements by kind."""

    splits = some = True

    def kind(self, card: Card) -> tuple[str, tuple[int, ...]]:
        """VTK's name, and the number of nodes."""
        kind = SOLIDS[_type(card)]
        return kind, (KINDS[kind][0],)


def _type(card: Card) -> str:
    return card.given.get("TYPE", "").upper().rstrip("RIMHT")


def _counts(card: Card) -> bool:
    """Whether it tells of nodes or solid elements; elements of other kinds do not."""
    if card.keyword in REFUSED:
        card.refuse("changes what moves or touches; leave it out, contact is said by body.contact")
    if card.keyword == "INSTANCE":
        card.refuse("numbers nodes anew, which the matrices' labels follow; write the deck without parts")
    return card.keyword != "ELEMENT" or _type(card) in SOLIDS


def _held(deck: Deck, card: Card) -> Iterator[tuple[int, int]]:
    """Nodes and directions, from 0."""
    for place, row in card.rows:
        nodes = deck.labels(card, place, row[0], "NSET")
        try:
            first, last = int(row[1]), int(row[2] if row[2:] and row[2] else row[1])
        except (ValueError, IndexError):
            card.refuse(f"does not hold nodes, a first and a last direction: {', '.join(row)}", place)
        yield from product(nodes, range(first - 1, min(last, 6)))


def read_deck(owner: str, file: str) -> dict[str, Any]:
    """Arguments of `FiniteElementModel` out of a deck of CalculiX or Abaqus without parts: `nodes`, `sets`,
    whose names are in capitals, `fixed` and `elements`.
    """
    try:
        deck = _Solids([card for card in of_one_part(cards(_lines(owner, file))) if _counts(card)])
        held = {pair for card in deck.of("BOUNDARY") for pair in _held(deck, card)}
    except Refusal as error:
        raise ValueError(f"{owner}: {str(error).removesuffix('.')}") from None
    if not deck.nodes:
        raise ValueError(f"{owner}: {file} has no nodes (*NODE); give a deck of CalculiX or Abaqus, as text")
    sets = {name: list(found.labels) for name, found in deck.sets["NSET"].items() if found.labels}
    elements = dict[str, list[list[int]]]()
    for kind, nodes in deck.elements.values():
        elements.setdefault(kind, []).append(nodes)
    return {"nodes": deck.nodes, "sets": sets, "fixed": held, "elements": elements}


def _lines(owner: str, file: str, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Place and text of each line, those of *INCLUDE in its place."""
    for number, line in enumerate(_read(file, owner).splitlines(), 1):
        if line.upper().replace(" ", "").startswith("*INCLUDE,INPUT="):
            if depth == DEEPEST:
                raise ValueError(f"{owner}: {file}, line {number}: *INCLUDE is in itself")
            other = line.partition("=")[2].strip().strip("\"'")
            yield from _lines(owner, os.path.join(os.path.dirname(file), other), depth + 1)
        else:
            yield f"{file}, line {number}", line


def _unknowns(file: str, nodes: dict[int, list[float]]) -> np.ndarray:
    """(n, 2): node and direction, from 0, of each row; written as node.direction, directions from 1."""
    found = []
    for number, line in enumerate(_read(file).split(), 1):
        node, _, direction = line.partition(".")
        if not (node.isdecimal() and int(node) in nodes and direction in ("1", "2", "3")):
            raise ValueError(
                f"{OWNER}: {file}, line {number}: {line!r} is no node.direction of the deck; elements that "
                "CalculiX expands (shells, beams, plane ones) have nodes of its own, solid ones are read"
            )
        found.append((int(node), int(direction) - 1))
    return np.array(found, dtype=int).reshape(-1, 2)


def _matrix(file: str, count: int) -> sparse.csr_matrix:
    """The triangle that is stored, row, column and value a line, rows from 1."""
    lines = _read(file).splitlines()
    try:
        row, column, value = np.loadtxt(lines or ["0 0 0"], unpack=True, ndmin=2)
    except ValueError:
        raise ValueError(f"{OWNER}: {file} is cut, or no matrix of CalculiX, three numbers a line") from None
    place = np.array([row, column])
    if place.min() < 1 or place.max() != count or (place % 1.0).any():
        raise ValueError(
            f"{OWNER}: {file} has rows {place.min():g} to {place.max():g}, whole numbers from 1 to {count} "
            "were expected, the unknowns of .dof; it is cut, or of another run"
        )
    return without_doubles(OWNER, file, value, place.astype(np.int64) - 1, count)


def without_doubles(
    owner: str, file: str, values: np.ndarray, places: np.ndarray, count: int
) -> sparse.csr_matrix:
    """A matrix of values at (2, n) rows and columns, of which none may be given twice."""
    matrix = sparse.csr_matrix((values, places), (count, count))
    if matrix.nnz < len(values):
        raise ValueError(f"{owner}: {file} has {len(values) - matrix.nnz} entries twice; is it of two runs?")
    return matrix


def _require_one_run(stem: str, body: FiniteElementModel) -> None:
    """ValueError unless elements' nodes move or are held, and a mass couples no directions, and only nodes
    that share an element, as .dof names them; a node may have a mass of its own.
    """
    count, near = len(body.labels), [(len(body.labels) + 1) * np.arange(len(body.labels))]
    for cells in body.elements.values():
        near.append((count * cells[:, :, None] + cells[:, None]).ravel())
        if (lost := body.columns[cells, :3] == NONE).any():
            element, place, d = np.argwhere(lost)[0]
            raise ValueError(
                f"{OWNER}: node {body.labels[cells[element, place]]} has no unknown along {AXES[d]} in "
                f"{stem}.dof, and no *BOUNDARY of {stem}.inp holds it; are they of one run?"
            )
    moves, rows = body.columns >= 0, np.array(body.mass.nonzero())
    (one, d), (other, e) = np.argwhere(moves)[np.argsort(body.columns[moves])][rows].transpose(0, 2, 1)
    if (wrong := (d != e) | ~np.isin(count * one + other, np.concatenate(near))).any():
        (a, d), (b, e) = body.unknowns[rows[:, wrong.argmax()]] + [0, 1]
        raise ValueError(
            f"{OWNER}: as {stem}.dof has it, {stem}.mas couples {a}.{d} and {b}.{e}, which no element does; "
            "is it of another run, or in another order?"
        )


def _read(file: str, owner: str = OWNER) -> str:
    try:
        return read_whole(Path(file)).decode(errors="replace")
    except ValueError as error:
        raise ValueError(
            f"{owner}: {str(error).rstrip('.')}; *FREQUENCY, SOLVER=MATRIXSTORAGE writes .sti, .mas and .dof"
        ) from None
