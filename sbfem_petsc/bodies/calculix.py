"""Bodies from the files of CalculiX: matrices of *FREQUENCY, SOLVER=MATRIXSTORAGE and the deck."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from meshing.whole_file import read_whole

from ..checks import choice, path
from .cells import NODES
from .finite_element_model import AXES, FiniteElementModel
from .units import UNITS

OWNER = "read_calculix"
# What moves or removes unknowns, or closes contact before this program does.
REFUSED = {f"*{word}" for word in "COUPLING EQUATION GAP INSTANCE MPC TIE TRANSFORM".split()}
REFUSED |= {"*CONTACT PAIR", "*CYCLIC SYMMETRY MODEL", "*DISTRIBUTING COUPLING", "*RIGID BODY"}
# Solid elements by VTK's names, whose nodes stand in the same order.
SOLIDS = {"C3D4": "tetra", "C3D10": "tetra10", "C3D6": "wedge", "C3D15": "wedge15"}
SOLIDS |= {"C3D8": "hexahedron", "C3D20": "hexahedron20"}
# Decks that include decks that include decks; more than any label of a node.
DEEPEST, FAR = 20, 2**31


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
    choice(OWNER, "units", units, tuple(UNITS))
    stem = path(OWNER, "job", job).removesuffix(".inp")
    deck = Deck(OWNER, f"{stem}.inp")
    unknowns = _unknowns(f"{stem}.dof", deck.nodes)
    stiffness, mass = (_matrix(f"{stem}.{ending}", len(unknowns)) for ending in ("sti", "mas"))
    if stiffness.nnz != mass.nnz:
        raise ValueError(
            f"{OWNER}: {stem}.sti has {stiffness.nnz} entries, .mas not as many; one is cut or of another run"
        )
    free = set(map(tuple, unknowns.tolist()))
    solid = {a for cells in deck.elements.values() for a in cells.ravel().tolist()}
    if lost := min({(a, d) for a in solid for d in range(3)} - free - deck.held, default=None):
        raise ValueError(
            f"{OWNER}: node {lost[0]} has no unknown along {AXES[lost[1]]} in {stem}.dof, and no *BOUNDARY "
            f"of {stem}.inp holds it; are they of one run?"
        )
    _require_order(stem, mass, unknowns, deck)
    given: dict[str, Any] = {"sets": deck.sets, "fixed": deck.held - free, "elements": deck.elements}
    return FiniteElementModel(mass, stiffness, unknowns, deck.nodes, units=units, **given)


def job_files(job: str) -> list[str]:
    """Paths of the files of a job: its deck, those that it includes, unknowns and matrices."""
    stem = job.removesuffix(".inp")
    decks = dict.fromkeys(place.rpartition(", line ")[0] for place, _ in _lines(OWNER, f"{stem}.inp"))
    return [*decks, *(f"{stem}.{ending}" for ending in ("dof", "sti", "mas"))]


class Deck:
    """Nodes, sets of them, pairs of node and direction that are held, and solid elements by kind."""

    def __init__(self, owner: str, file: str):
        self.owner, self.nodes, self.held = owner, dict[int, tuple[float, ...]](), set[tuple[int, int]]()
        self.found, self.cells = dict[str, list[int]](), dict[str, list[int]]()
        keyword, options = "", dict[str, str]()
        for place, line in _lines(owner, file):
            cells = [cell.strip() for cell in line.split(",")]
            if line.startswith("*"):
                keyword = " ".join(cells[0].upper().split())
                given = (cell.upper().partition("=") for cell in cells[1:])
                options = {key.strip(): value.strip() for key, _, value in given}
                if keyword in REFUSED:
                    raise ValueError(
                        f"{owner}: {place} has {keyword}, which changes what the unknowns are or what "
                        "touches; leave it out of this deck, contact is said by body.contact"
                    )
                continue
            try:
                self._take(keyword, options, cells)
            except (ValueError, KeyError, IndexError) as error:
                raise ValueError(f"{owner}: {place}: {line!r} is no line of {keyword} ({error})") from None

    def _take(self, keyword: str, options: dict[str, str], cells: list[str]) -> None:
        """A line below a keyword."""
        if keyword == "*NODE":
            self.nodes[int(cells[0])] = tuple(float(cell or 0.0) for cell in [*cells[1:4], "", ""][:3])
            if "NSET" in options:
                self.found.setdefault(options["NSET"], []).append(int(cells[0]))
        elif keyword == "*ELEMENT":  # whose nodes may go on in further lines
            kind = SOLIDS.get(options["TYPE"].rstrip("RIMHT"))
            if kind is not None:
                self.cells.setdefault(kind, []).extend(int(cell) for cell in cells if cell)
        elif keyword == "*NSET":
            labels = _members(cells, self.found, "GENERATE" in options)
            self.found.setdefault(options["NSET"], []).extend(labels)
        elif keyword == "*BOUNDARY":
            first = int(cells[1])
            last = int(cells[2]) if cells[2:] and cells[2] else first
            nodes = _members(cells[:1], self.found, False)
            self.held |= {(n, d - 1) for n in nodes for d in range(first, min(last, 6) + 1)}

    @property
    def sets(self) -> dict[str, list[int]]:
        """Labels by name, each once."""
        return {name: list(dict.fromkeys(labels)) for name, labels in self.found.items()}

    @property
    def elements(self) -> dict[str, np.ndarray]:
        """Labels of nodes by kind."""
        try:
            rows = {kind: np.array(cells).reshape(-1, NODES[kind] + 1) for kind, cells in self.cells.items()}
        except ValueError:
            raise ValueError(f"{self.owner}: an element of the deck has too few or too many nodes") from None
        return {kind: cells[:, 1:] for kind, cells in rows.items()}


def _members(cells: list[str], sets: dict[str, list[int]], generated: bool) -> list[int]:
    """Labels of a line: numbers and names of sets, or first, last and step."""
    given = [cell for cell in cells if cell]
    if generated:
        first, last, step = (*map(int, given), 1)[:3]
        return list(range(first, last + 1, step))
    return [n for cell in given for n in ([int(cell)] if cell.isdigit() else sets[cell.upper()])]


def _lines(owner: str, file: str, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Place and text of each line that says something, those of *INCLUDE in its place."""
    for number, line in enumerate(_read(file, owner).splitlines(), 1):
        text = line.strip()
        if not text or text.startswith("**"):
            continue
        if text.upper().replace(" ", "").startswith("*INCLUDE,INPUT="):
            if depth == DEEPEST:
                raise ValueError(f"{owner}: {file}, line {number}: *INCLUDE is in itself")
            other = text.partition("=")[2].strip().strip("\"'")
            yield from _lines(owner, os.path.join(os.path.dirname(file), other), depth + 1)
            continue
        yield f"{file}, line {number}", text


def _unknowns(file: str, nodes: dict[int, tuple[float, ...]]) -> np.ndarray:
    """(n, 2): node and direction, from 0, of each row; written as node.direction, directions from 1."""
    found = []
    for number, line in enumerate(_read(file).split(), 1):
        node, _, direction = line.partition(".")
        if not (node.isdigit() and direction in ("1", "2", "3")):
            raise ValueError(f"{OWNER}: {file}, line {number}: {line!r} is no node.direction, such as 12.3")
        if int(node) not in nodes:
            raise ValueError(
                f"{OWNER}: {file}, line {number}: node {node} is not in the deck; elements that CalculiX "
                "expands (shells, beams, plane ones) have nodes of its own and are not read, solid ones are"
            )
        found.append((int(node), int(direction) - 1))
    return np.array(found, dtype=int).reshape(-1, 2)


def _matrix(file: str, count: int) -> sparse.coo_matrix:
    """The triangle that is stored, row, column and value a line, rows from 1."""
    lines = _read(file).splitlines()
    try:
        row, column, value = np.loadtxt(lines or ["0 0 0"], unpack=True, ndmin=2)
    except ValueError:
        raise ValueError(f"{OWNER}: {file} is cut, or no matrix of CalculiX, three numbers a line") from None
    place = np.array([row, column])
    if not (place.min() >= 1 and place.max() == count and (place == np.round(place)).all()):
        raise ValueError(
            f"{OWNER}: {file} has rows {place.min():g} to {place.max():g}, whole numbers from 1 to {count} "
            "were expected, the unknowns of .dof; it is cut, or of another run"
        )
    return sparse.coo_matrix((value, place.astype(np.int64) - 1), (count, count))


def _require_order(stem: str, mass: sparse.coo_matrix, unknowns: np.ndarray, deck: Deck) -> None:
    """ValueError unless a mass couples no directions, and only nodes that share an element, as .dof names
    them; a node may have a mass of its own.
    """
    one, other = (unknowns[rows] for rows in mass.nonzero())
    share = [(a[:, None] * FAR + a[..., None]).ravel() for a in deck.elements.values()]
    met = np.isin(one[:, 0] * FAR + other[:, 0], np.concatenate([[-1], *share]))
    met |= one[:, 0] == other[:, 0]
    if (wrong := ~met | (one[:, 1] != other[:, 1])).any():
        (a, d), (b, e) = one[wrong.argmax()] + [0, 1], other[wrong.argmax()] + [0, 1]
        raise ValueError(
            f"{OWNER}: as {stem}.dof has it, {stem}.mas couples {a}.{d} and {b}.{e}, which no element does; "
            "is it of another run, or in another order?"
        )


def _read(file: str, owner: str = OWNER) -> str:
    try:
        return read_whole(Path(file)).decode(errors="replace")
    except ValueError as error:
        raise ValueError(
            f"{owner}: {str(error).rstrip('.')}; a step with *FREQUENCY, SOLVER=MATRIXSTORAGE writes .sti, "
            ".mas and .dof beside the deck"
        ) from None
