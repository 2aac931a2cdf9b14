"""Bodies from files of matrices: Matrix Market, SciPy's .npz, PETSc's binary, Abaqus' text, Ansys' .full."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy import sparse

from meshing.whole_file import require_regular

from ..checks import instance, path, shown
from .calculix import read_deck, without_doubles
from .finite_element_model import FiniteElementModel

OWNER = "read_matrices"
# First numbers of PETSc's files of sparse matrices; what Abaqus has on the diagonal of what is held.
PETSC, HELD = 1211216, 1e30


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
    files = [path(OWNER, name, given) for name, given in (("mass", mass), ("stiffness", stiffness))]
    matrices = [_read(file, k) for k, file in enumerate(files)]
    deck: dict[str, Any] = {"nodes": nodes, "sets": {}, "fixed": ()}
    if not isinstance(nodes, Mapping):
        instance(OWNER, "nodes", nodes, (str, os.PathLike), "a dict of labels to places, or a deck")
        deck = read_deck(OWNER, path(OWNER, "nodes", nodes))
    if {isinstance(matrix, np.ndarray) for matrix in matrices} != {unknowns is None}:
        raise ValueError(
            f"{OWNER}: unknowns = {shown(unknowns)}; give it unless both files are of Abaqus or Ansys"
        )
    if unknowns is None:
        matrices, unknowns, supports = _numbered(files, matrices)
        deck["fixed"] = [*deck["fixed"], *supports]
    elif isinstance(unknowns, (str, os.PathLike)):
        unknowns = _read(path(OWNER, "unknowns", unknowns), 2)
    deck |= {"sets": deck["sets"] | dict(sets or {}), "fixed": [*fixed, *deck["fixed"]]}
    m, k = matrices
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
        if head.startswith(b"%%MatrixMarket"):
            from scipy.io import mmread

            return sparse.coo_matrix(mmread(file))
        if head.startswith(b"PK"):
            return sparse.load_npz(file)
        if head[:4] == PETSC.to_bytes(4, "big"):
            return _petsc(file)
        with open(file, encoding="utf-8", errors="replace") as opened:
            lines = [line.replace(",", " ") for line in opened if not line.startswith("*")]
        table = np.loadtxt(lines or [""], ndmin=2)
        what = "node, direction" if place == 2 else "node, direction, node, direction, value"
        if table.shape[1:] != (len(what.split()),) or (table[:, :4] % 1.0).any():
            raise ValueError(f"lines of {what} were expected")
    except Exception as error:  # of any kind, by libraries
        why = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise ValueError(
            f"{OWNER}: {file} is missing or cut, or neither Matrix Market, .npz of scipy.sparse, PETSc's "
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
    made = sparse.csr_matrix((values, places, np.append(0, np.cumsum(lengths))), (rows, columns))
    made.check_format()
    return made


def _numbered(files: list[str], tables: list[np.ndarray]) -> tuple[list[sparse.csr_matrix], np.ndarray, Any]:
    """Matrices over one numbering, nodes and directions of their rows, and which of them are held."""
    pairs = np.concatenate([table[:, :4].astype(int).reshape(-1, 2) for table in tables])
    unknowns, place = np.unique(pairs, axis=0, return_inverse=True)
    if unknowns[0, 0] < 0:
        raise ValueError(
            f"{OWNER}: node {unknowns[0, 0]} is an internal one (Lagrange multiplier); leave contact, ties "
            "and connectors out of the step that writes the matrices"
        )
    matrices, held = [], np.zeros(len(unknowns), dtype=bool)
    for file, table, ends in zip(files, tables, np.split(place.reshape(-1, 2), [len(tables[0])])):
        (rows, columns), values = ends.T, table[:, 4]
        much = (rows == columns) & (values >= HELD)
        held[rows[much]] = True
        values = np.where(much, 1.0, values)
        matrices.append(without_doubles(OWNER, file, values, ends.T, len(unknowns)))
    unknowns = unknowns - [0, 1]
    return matrices, unknowns, unknowns[held].tolist()
