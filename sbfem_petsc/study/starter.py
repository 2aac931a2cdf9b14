"""Commented starter cases."""

from __future__ import annotations

import os
from importlib import resources

from meshing.whole_file import replaced

KINDS = ("beam", "plate", "gmsh", "body", "modulation", "nonlinear", "sweep")
# Files that a starter needs beside it.
_COMPANIONS = {"gmsh": ("part.geo",), "body": ("bar.inp", "bar.sti", "bar.mas", "bar.dof")}


def write_starter(kind: str, path: str | os.PathLike[str], *, replace: bool = False) -> list[str]:
    """Write a commented starter case, and the files it needs, without replacing what is there.

    Parameters
    ----------
    kind : {"beam", "plate", "gmsh", "body", "modulation", "nonlinear", "sweep"}
    path : path-like
        The case file.
    replace : bool
        Overwrite what is there.

    Returns
    -------
    list of str
        Files written.

    Raises
    ------
    ValueError
        For an unknown kind, files that exist or cannot be written.
    """
    from ..options import one_of

    if kind not in KINDS:
        raise ValueError(f"kind = {kind!r} of starter case is unknown; {one_of(KINDS, kind)}")
    path = os.fspath(path)
    folder = os.path.dirname(path)
    texts = {path: starter_text(f"{kind}.toml")}
    texts |= {os.path.join(folder, name): starter_text(name) for name in _COMPANIONS.get(kind, ())}
    for name in texts:
        if os.path.lexists(name) and not replace:
            raise ValueError(f"{name!r} exists; name another file, or give --replace to overwrite it")
    for name, text in texts.items():
        with replaced(name, "starter case") as temporary, open(temporary, "w", encoding="utf-8") as file:
            file.write(text)
    return list(texts)


def starter_text(name: str) -> str:
    """Text of a starter's file."""
    return (resources.files(__package__) / "starters" / name).read_text(encoding="utf-8")
