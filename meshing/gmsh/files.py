"""A user's file before gmsh sees it: its content is what its ending says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from meshing.whole_file import read_whole

SCRIPTS = (".geo", ".geo_unrolled")
STEP, IGES = (".step", ".stp"), (".iges", ".igs")
CAD = (*STEP, ".brep", *IGES)  # these formats carry no physical groups
NASTRAN = (".bdf", ".nas")  # groups are the numbers of properties
FOREIGN = {
    ".inp": "meshing.gmsh.foreign.abaqus",
    ".vtu": "meshing.gmsh.foreign.vtk",
    ".vtk": "meshing.gmsh.foreign.vtk",
    ".unv": "meshing.gmsh.foreign.universal",
    ".med": "meshing.gmsh.foreign.salome",
}


class _Format(NamedTuple):
    """What a format's content begins with, and how it ends; in words for messages."""

    begin: str
    what: str
    end: str = ""
    word: str = ""
    sections: tuple[str, ...] = ()


_MSH = _Format(
    r"\$(?:NOD|MeshFormat\r?\n([0-9.]+) ([01]) [0-9]+\s)",
    "a gmsh mesh (it begins with $MeshFormat and a version)",
    r"\n\$E(?:nd|ND)[^\n]*",
    "$EndElements or another $End...",
)
_STEP = _Format(
    r"\s*ISO-10303-21", "a STEP file (it begins with ISO-10303-21)", r"END-ISO-10303-21;", "END-ISO-10303-21;"
)
_BREP = _Format(
    r"(?!.*\0).{0,400}CASCADE Topology V[0-9]",
    "an OpenCASCADE BREP file (it begins with CASCADE Topology)",
    r"\n[+-]?[0-9]+ [0-9]+",
    "the shape's number",
    ("\nLocations ", "\nCurve2ds ", "\nCurves ", "\nSurfaces ", "\nTShapes "),
)
_IGES = _Format(
    r"(?:[^\S\n]*\n)*[^\n]{72}[SF]",
    "an IGES file (column 73 of its first line is S)",
    r"\n[^\n]{72}T[^\n]*",
    "a line with T in column 73",
)
_UNV = _Format(
    r"(?!.*\0)\s* {4}-1\s*\r?\n *[0-9]+",
    "a universal file (it begins with a line -1 and a data set's number)",
    r"\n {4}-1",
    "a line -1",
)
_BDF = _Format(r"(?!.*\0)(?:.*\n)?GRID[ *,]", "a Nastran bulk data file (it has cards GRID)")
_HDF5 = r"\x89HDF\r\n\x1a\n"
_VTU = _Format(r"\s*(?=<).{0,2000}<VTKFile", "a VTK XML file", "</VTKFile>", "</VTKFile>")
_FORMATS = {
    ".msh": _MSH,
    **dict.fromkeys(SCRIPTS, None),
    **dict.fromkeys(STEP, _STEP),
    ".brep": _BREP,
    **dict.fromkeys(IGES, _IGES),
    ".inp": _Format(r"(?!.*\0)(?:\xef\xbb\xbf)?\s*\*", "an Abaqus input file"),
    ".vtu": _VTU,
    ".vtk": _Format(r"# vtk DataFile", "a legacy VTK file (it begins with # vtk DataFile)"),
    ".unv": _UNV,
    ".med": _Format(_HDF5, "a MED file (it is in HDF5)"),
    **dict.fromkeys(NASTRAN, _BDF),
}
KNOWN = (*_FORMATS,)


def checked_content(path: Path) -> bytes:
    """Content of a file whose ending is known, and which is, from beginning to end, what the ending says.

    gmsh itself goes by the content: a script in a file called .msh is run.

    Raises
    ------
    ValueError
        There is no such file, the ending is not known, or the content is something else or cut.
    """
    suffix, content = path.suffix.lower(), read_whole(path)
    if suffix != ".med" and re.match(_HDF5.encode(), content):
        raise ValueError(
            f"{path}: it is an HDF5 file, not a gmsh model; meshes that were saved here are read by "
            "BoundaryMesh.load(path)."
        )
    if suffix not in KNOWN:
        raise ValueError(
            f"{path}: the ending {path.suffix or '(none)'} is not known; {', '.join(KNOWN)} are read, and "
            "the content must be what the ending says; meshio convert FILE FILE.vtu makes one of many others."
        )
    if not content.strip():
        raise ValueError(f"{path}: it is empty.")
    if suffix in SCRIPTS and content.startswith((b"$", b"ISO-10303-21")):
        raise ValueError(
            f"{path}: its content is a mesh or a CAD file, not a gmsh script; give it the ending of its "
            "format."
        )
    if form := _FORMATS[suffix]:
        head = re.match(form.begin.encode(), content, re.DOTALL)
        if not head:
            raise ValueError(f"{path}: its content is not {form.what}, as its ending says.")
        if form is _VTU and (b"<!DOCTYPE" in content or b"<!ENTITY" in content):
            raise ValueError(f"{path}: it declares entities, which VTK files do not; save it again.")
        ends = re.search(form.end.encode() + rb"\Z", content.rstrip())
        if not (ends and all(word.encode() in content for word in form.sections)):
            raise ValueError(
                f"{path}: it is truncated or damaged, it does not end with {form.word}; export it again."
            )
        if form is _MSH:
            _check_msh(path, content, *head.groups(b"1"))
    return content


def _check_msh(path: Path, content: bytes, version: bytes, binary: bytes) -> None:
    """Of a version that is known, with its sections."""
    if version not in (b"2", b"2.0", b"2.1", b"2.2", b"4", b"4.0", b"4.1"):
        raise ValueError(
            f"{path}: version {version.decode()} of gmsh's format is not read; save it as 2.2 or 4.1."
        )
    if binary == b"0":
        opened = re.findall(rb"(?m)^\$([A-Za-z]+)\s*$", content)
        for begin, end in zip(opened[::2], opened[1::2] + [b""]):
            if end != b"End" + begin:
                raise ValueError(f"{path}: its section ${begin.decode()} does not end; save it again.")
    for section in (b"$Nodes", b"$Elements"):
        if section not in content:
            raise ValueError(
                f"{path}: it has no section {section.decode()} and so no mesh; mesh the model before saving "
                "it."
            )
