"""Bodies from files: of a job of CalculiX (*FREQUENCY, SOLVER=MATRIXSTORAGE), decks, Matrix Market, SciPy's
.npz, PETSc's binary, Abaqus' text, Ansys' .full.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io, sparse

from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign.deck import Card, Deck, cards, of_one_part
from meshing.whole_file import read_whole, require_regular

from ..checks import instance, path, shown
from .cells import KINDS
from .finite_element_model import FiniteElementModel, require_known
from .plausibility import whole

JOB, FILES = "read_calculix", "read_matrices"
# What moves or removes unknowns, or closes contact before this program does.
REFUSED = {"COUPLING", "EQUATION", "GAP", "MPC", "TIE", "TRANSFORM", "CONTACT PAIR", "RIGID BODY"}
REFUSED |= {"CYCLIC SYMMETRY MODEL", "DISTRIBUTING COUPLING"}
# Solid elements by VTK's names, whose nodes stand in the same order, but for those of a wedge of six.
SOLIDS = {"C3D4": "tetra", "C3D10": "tetra10", "C3D6": "wedge", "C3D15": "wedge15"}
SOLIDS |= {"C3D8": "hexahedron", "C3D20": "hexahedron20"}
WEDGE = (0, 2, 1, 3, 5, 4)
# Decks that include decks that include decks; what Abaqus has on the diagonal of what is held.
DEEPEST, HELD = 20, 1e30


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
        If a file is missing, cut or of another job; if the deck has constraints, contact, supports that move
        or elements that CalculiX expands (shells, beams, plane ones).

    Warns
    -----
    UnitWarning
        If the units make no sense.
    """
    stem = path(JOB, "job", job).removesuffix(".inp")
    deck = read_deck(JOB, f"{stem}.inp")
    unknowns = _unknowns(f"{stem}.dof", deck["nodes"])
    k, m = (_matrix(f"{stem}.{ending}", len(unknowns)) for ending in ("sti", "mas"))
    if k.nnz != m.nnz:
        raise ValueError(f"{JOB}: {stem}.sti has {k.nnz} entries, .mas {m.nnz}; one is cut or of another run")
    deck["fixed"] -= set(map(tuple, unknowns.tolist()))
    body = FiniteElementModel(m, k, unknowns, **deck, units=units)
    _require_one_run(stem, body)
    return body


def files_of(*paths: str) -> list[str]:
    """Paths of the files of a job of CalculiX, or of matrices, nodes and unknowns, and of decks that a deck
    includes.
    """
    stem, *matrices = paths[0].removesuffix(".inp"), *paths[1:]
    lines = _lines("body", matrices[1] if matrices else f"{stem}.inp")
    decks = dict.fromkeys(place.rpartition(", line ")[0] for place, _ in lines)
    return [*paths, *decks] if matrices else [*decks, *(f"{stem}.{own}" for own in ("dof", "sti", "mas"))]


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
        held = range(first - 1, min(last, 6))
        if held and any(part.strip("+-0.eEdD") for part in row[3:]):
            card.refuse(
                f"moves what it holds ({', '.join(row)}), and bodies are held at 0; leave the value out, and "
                "move all that is held by SupportMotion in loads of reduce",
                place,
            )
        yield from product(nodes, held)


def read_deck(owner: str, file: str) -> dict[str, Any]:
    """Arguments of `FiniteElementModel` out of a deck of CalculiX or Abaqus without parts: `nodes`, `sets`,
    whose names are in capitals, `fixed` and `elements`.
    """
    try:
        deck = _Solids([card for card in of_one_part(cards(_lines(owner, file))) if _counts(card)])
        boundaries = [*deck.of("BOUNDARY")]
        for former, card in pairwise(boundaries):
            if [one.given.get("OP", "").upper() == "NEW" for one in (former, card)] == [False, True]:
                card.refuse("frees what those before it hold; leave these out of the deck")
        held = {pair for card in boundaries for pair in _held(deck, card)}
    except Refusal as error:
        raise ValueError(f"{owner}: {str(error).removesuffix('.')}") from None
    if not deck.nodes:
        raise ValueError(f"{owner}: {file} has no nodes (*NODE); give a deck of CalculiX or Abaqus, as text")
    sets = {name: list(found.labels) for name, found in deck.sets["NSET"].items() if found.labels}
    elements = dict[str, list[list[int]]]()
    for kind, nodes in deck.elements.values():
        elements.setdefault(kind, []).append([nodes[k] for k in WEDGE] if kind == "wedge" else nodes)
    return {"nodes": deck.nodes, "sets": sets, "fixed": held, "elements": elements}


def _lines(owner: str, file: str, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Place and text of each line, those of *INCLUDE in its place."""
    for number, line in enumerate(_text(file, owner).splitlines(), 1):
        if line.upper().replace(" ", "").startswith("*INCLUDE,INPUT="):
            if depth == DEEPEST:
                raise ValueError(f"{owner}: {file}, line {number}: *INCLUDE is in itself")
            other = line.partition("=")[2].strip().strip("\"'")
            yield from _lines(owner, os.path.join(os.path.dirname(file), other), depth + 1)
        else:
            yield f"{file}, line {number}", line


def _unknowns(file: str, nodes: dict[int, list[float]]) -> np.ndarray:
    """(n, 2): node and direction, from 0, of each row; written as node.direction, directions from 1."""
    known = {f"{node}.{direction + 1}": (node, direction) for node, direction in product(nodes, range(3))}
    lines = _text(file).split()
    for number, line in enumerate(lines, 1):
        if line not in known:
            raise ValueError(
                f"{JOB}: {file}, line {number}: {shown(line)} is no node.direction of the deck; elements "
                "that CalculiX expands (shells, beams, plane ones) have nodes of its own, solid ones are read"
            )
    return np.array([known[line] for line in lines], dtype=int).reshape(-1, 2)


def _matrix(file: str, count: int) -> sparse.csr_matrix:
    """The triangle that is stored, row, column and value a line, rows from 1."""
    lines = _text(file).splitlines()
    try:
        row, column, value = np.loadtxt(lines or ["0 0 0"], unpack=True, ndmin=2)
    except ValueError:
        raise ValueError(f"{JOB}: {file} is cut, or no matrix of CalculiX, three numbers a line") from None
    place = np.array([row, column])
    if place.min() < 1 or place.max() != count or (place % 1.0).any():
        raise ValueError(
            f"{JOB}: {file} has rows {place.min():g} to {place.max():g}, whole numbers from 1 to {count} "
            "were expected, the unknowns of .dof; it is cut, or of another run"
        )
    return of_entries(JOB, file, value, place.astype(np.int64) - 1, count)


def of_entries(owner: str, file: str, values: np.ndarray, places: np.ndarray, count: int) -> Any:
    """A matrix of values at (2, n) rows and columns, of which none may be given twice."""
    matrix = sparse.csr_matrix((values, places), (count, count))
    if matrix.nnz < len(values):
        raise ValueError(f"{owner}: {file} has {len(values) - matrix.nnz} entries twice; is it of two runs?")
    return matrix


def _require_one_run(stem: str, body: FiniteElementModel) -> None:
    """ValueError unless elements' nodes move or are held, and a mass couples no directions, and only nodes
    that share an element, as .dof names them; a node may have a mass of its own.
    """
    count = int(body.labels.max()) + 1
    near, missed = [(count + 1) * body.labels], f"in {stem}.dof, and no *BOUNDARY of {stem}.inp holds it"
    for cells in body.elements.values():
        named = body.labels[cells]
        near.append((count * named[:, :, None] + named[:, None]).ravel())
        require_known(body, cells.ravel(), (0, 1, 2), JOB, f"{missed}; are they of one run?")
    (one, d), (other, e) = body.unknowns[np.array(body.mass.nonzero())].transpose(0, 2, 1)
    if (wrong := (d != e) | ~np.isin(count * one + other, np.concatenate(near))).any():
        k = wrong.argmax()
        raise ValueError(
            f"{JOB}: as {stem}.dof has it, {stem}.mas couples {one[k]}.{d[k] + 1} and {other[k]}.{e[k] + 1}, "
            "which no element does; is it of another run, or in another order?"
        )


def _text(file: str, owner: str = JOB) -> str:
    try:
        return read_whole(Path(file)).decode(errors="replace")
    except ValueError as error:
        how = "" if file.endswith(".inp") else "; *FREQUENCY, SOLVER=MATRIXSTORAGE writes .sti, .mas and .dof"
        raise ValueError(f"{owner}: {str(error).rstrip('.')}{how}") from None


def read_matrices(
    stiffness: Any,
    mass: Any,
    nodes: Any,
    unknowns: Any = None,
    *,
    sets: Mapping[str, Iterable[int]] | None = None,
    fixed: Iterable[tuple[int, int]] = (),
    units: str = "SI",
) -> FiniteElementModel:
    """A body from files of its matrices.

    Parameters
    ----------
    stiffness, mass : str or path
        Matrix Market, `scipy.sparse.save_npz`, PETSc's binary of a sparse matrix, or what Abaqus writes of
        ``*MATRIX GENERATE`` by ``*MATRIX OUTPUT, FORMAT=MATRIX INPUT``, told apart by their content. Both of
        Ansys are in one .full, which `ansys-mapdl-reader` reads.
    nodes : dict of int to (x, y, z), or str or path
        Places by label, or a deck of CalculiX or Abaqus without parts, of which sets, `*BOUNDARY` and solid
        elements are taken too.
    unknowns : (n, 2) array of int, or str or path, optional
        Of each row, as for `FiniteElementModel`, or text of two columns. Files of Abaqus and Ansys have them.
    sets, fixed, units
        As for `FiniteElementModel`, beside those of a deck.

    Returns
    -------
    FiniteElementModel

    Raises
    ------
    ValueError, TypeError
        If a file is missing, cut or of another kind; for what `FiniteElementModel` refuses.
    """
    files = [path(FILES, name, given) for name, given in (("mass", mass), ("stiffness", stiffness))]
    m, k = (_read(file, place) for place, file in enumerate(files))
    instance(FILES, "sets", {} if sets is None else sets, Mapping, "a dict of names to labels")
    instance(FILES, "fixed", fixed, Iterable, "pairs (node, direction)")
    deck: dict[str, Any] = {"nodes": nodes, "sets": {}, "fixed": ()}
    if not isinstance(nodes, Mapping):
        instance(FILES, "nodes", nodes, (str, os.PathLike), "a dict of labels to places, or a deck")
        deck = read_deck(FILES, path(FILES, "nodes", nodes))
    if {isinstance(matrix, np.ndarray) for matrix in (m, k)} != {unknowns is None}:
        raise ValueError(
            f"{FILES}: unknowns = {shown(unknowns)}; give it unless both files are of Abaqus or Ansys"
        )
    if unknowns is None:
        (m, k), unknowns, supports = _numbered(files, [m, k])
        deck["fixed"] = [*deck["fixed"], *supports]
    elif isinstance(unknowns, (str, os.PathLike)):
        unknowns = _read(path(FILES, "unknowns", unknowns), 2)
    deck |= {"sets": deck["sets"] | dict(sets or {}), "fixed": [*fixed, *deck["fixed"]]}
    return FiniteElementModel(m, k, unknowns, **deck, units=units)


def _read(file: str, place: int) -> Any:
    """A matrix, mass (0) or stiffness (1); of Abaqus' text and Ansys' .full a table of node, direction, node,
    direction and value. Or unknowns (2), of a text nodes and directions.
    """
    try:
        require_regular(file)
        if file.endswith(".full"):
            return _ansys(file, place)
        with open(file, "rb") as opened:
            head = opened.read(14)
        if reader := next((one for start, one in FORMATS.items() if head.startswith(start)), None):
            found = reader(file)
            if hasattr(found, "check_format"):  # what indices there are is believed by all else
                found.check_format()
            return sparse.csr_matrix(found)
        with open(file, encoding="utf-8-sig", errors="replace") as opened:
            lines = [line.replace(",", " ") for line in opened if not line.startswith("*")]
        table = np.loadtxt(lines or ["0"], ndmin=2)
        what = "node, direction" if place == 2 else "node, direction, node, direction, value"
        if table.shape[1:] != (len(what.split()),) or not whole(table[:, :4]):
            raise ValueError(f"lines of {what} were expected")
    except Exception as error:  # of any kind, by libraries
        why = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise ValueError(
            f"{FILES}: {file} is missing or cut, or neither Matrix Market, .npz of scipy.sparse, PETSc's "
            f"binary, text of Abaqus nor .full of Ansys, by ansys-mapdl-reader ({why})"
        ) from None
    return table


def _ansys(file: str, place: int) -> np.ndarray:
    """Mass (0) or stiffness (1) of Ansys as those of Abaqus' text, what is held by its diagonal."""
    from ansys.mapdl.reader import read_binary

    full = read_binary(file)
    labels, stiffness, mass = full.load_km(as_sparse=True)
    upper = (mass, stiffness)[place]
    entries = sparse.coo_matrix(upper + sparse.triu(upper, 1).T)
    pairs = np.hstack([labels[entries.row], labels[entries.col]]) + [0, 1, 0, 1]
    held = np.tile(full.const, 2) + [0, 1, 0, 1]
    kept = ~np.isin(pairs[:, :2] @ [64, 1], held[:, :2] @ [64, 1])  # Ansys has fewer than 64 directions
    values = np.append(entries.data[kept], np.full(len(held), 2.0 * HELD))
    return np.column_stack([np.vstack([pairs[kept], held]), values])


def _petsc(file: str) -> sparse.csr_matrix:
    """A sparse matrix as PETSc writes it in binary: big-endian, sizes, lengths of rows, columns, values."""
    _, rows, columns, count = np.fromfile(file, ">i4", 4).tolist()
    if os.path.getsize(file) != 16 + 4 * rows + 12 * count or min(rows, columns, count) < 0:
        raise ValueError(f"it has no {rows} rows and {count} entries")
    lengths, places = np.split(np.fromfile(file, ">i4", rows + count, offset=16).astype(int), [rows])
    values = np.fromfile(file, ">f8", offset=16 + 4 * (rows + count)).astype(float)
    if lengths.sum() != count:
        raise ValueError("the lengths of its rows do not fit")
    return sparse.csr_matrix((values, places, np.append(0, np.cumsum(lengths))), (rows, columns))


def _market(file: str) -> Any:
    if io.mminfo(file)[4] == "pattern":
        raise ValueError("its field is pattern, places without values; write it with field real")
    return io.mmread(file)


# What reads a matrix, by how its file begins.
FORMATS = {b"%%MatrixMarket": _market, b"PK": sparse.load_npz, (1211216).to_bytes(4, "big"): _petsc}


def _numbered(files: list[str], tables: list[np.ndarray]) -> tuple[list[sparse.csr_matrix], np.ndarray, Any]:
    """Matrices over one numbering, nodes and directions of their rows, and which of them are held."""
    table, parts = np.concatenate(tables), [len(tables[0])]
    unknowns, place = np.unique(table[:, :4].astype(int).reshape(-1, 2), axis=0, return_inverse=True)
    if unknowns[0, 0] < 0:
        raise ValueError(
            f"{FILES}: node {unknowns[0, 0]} is an internal one (Lagrange multiplier); leave contact, ties "
            "and connectors out of the step that writes the matrices"
        )
    ends, values, unknowns = place.reshape(-1, 2).T, table[:, 4], unknowns - [0, 1]
    held = (ends[0] == ends[1]) & (values >= HELD)
    values[held] = 1.0
    each = zip(files, np.split(values, parts), np.split(ends, parts, axis=1))
    matrices = [of_entries(FILES, *given, len(unknowns)) for given in each]
    return matrices, unknowns, unknowns[ends[0][held]].tolist()
