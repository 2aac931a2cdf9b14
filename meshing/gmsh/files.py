"""A user's file before gmsh sees it: its content is what its ending says."""

from __future__ import annotations

import re
from pathlib import Path

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
_HDF5 = b"\x89HDF\r\n\x1a\n"


def checked_content(path: Path) -> bytes:
    """Content of a file whose ending is known, and which is, from beginning to end, what the ending says.

    gmsh itself goes by the content: a script in a file called .msh is run.

    Raises
    ------
    ValueError
        There is no such file, the ending is not known, or the content is something else or cut.
    """
    suffix, content = path.suffix.lower(), read_whole(path)
    if content.startswith(_HDF5) and suffix != ".med":
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
    _CHECKS[suffix](path, content)
    return content


def _check_script(path: Path, content: bytes) -> None:
    if content.startswith((b"$", b"ISO-10303-21")):
        raise ValueError(
            f"{path}: its content is a mesh or a CAD file, not a gmsh script; give it the ending of its "
            "format."
        )


def _check_step(path: Path, content: bytes) -> None:
    begins = content.lstrip().startswith(b"ISO-10303-21")
    _expect(path, begins, "a STEP file (it begins with ISO-10303-21)")
    _complete(path, content.rstrip().endswith(b"END-ISO-10303-21;"), "END-ISO-10303-21;")


def _check_brep(path: Path, content: bytes) -> None:
    begins = re.search(rb"CASCADE Topology V[0-9]", content[:400]) is not None and b"\0" not in content
    _expect(path, begins, "an OpenCASCADE BREP file (it begins with CASCADE Topology)")
    sections = (b"\nLocations ", b"\nCurve2ds ", b"\nCurves ", b"\nSurfaces ", b"\nTShapes ")
    ends = re.search(rb"\n[+-]?[0-9]+ [0-9]+ *\s*$", content)
    _complete(path, all(word in content for word in sections) and ends is not None, "the shape's number")


def _check_iges(path: Path, content: bytes) -> None:
    lines = [line for line in content.splitlines() if line.strip()]
    _expect(path, lines[0][72:73] in (b"S", b"F"), "an IGES file (column 73 of its first line is S)")
    _complete(path, lines[-1][72:73] == b"T", "a line with T in column 73")


def _check_inp(path: Path, content: bytes) -> None:
    _expect(path, content.lstrip().startswith(b"*") and b"\0" not in content, "an Abaqus input file")


def _check_vtu(path: Path, content: bytes) -> None:
    head = content[:2000].lstrip()
    _expect(path, head.startswith(b"<") and b"<VTKFile" in head, "a VTK XML file")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise ValueError(f"{path}: it declares entities, which VTK files do not; save it again.")
    _complete(path, content.rstrip().endswith(b"</VTKFile>"), "</VTKFile>")


def _check_vtk(path: Path, content: bytes) -> None:
    begins = content.startswith(b"# vtk DataFile")
    _expect(path, begins, "a legacy VTK file (it begins with # vtk DataFile)")


def _check_unv(path: Path, content: bytes) -> None:
    begins = re.match(rb"\s* {4}-1\s*\r?\n *[0-9]+", content) is not None and b"\0" not in content
    _expect(path, begins, "a universal file (it begins with a line -1 and a data set's number)")
    _complete(path, re.search(rb"(?m)^ {4}-1\s*\Z", content) is not None, "a line -1")


def _check_bdf(path: Path, content: bytes) -> None:
    has = re.search(rb"(?m)^GRID[ *,]", content) is not None and b"\0" not in content
    _expect(path, has, "a Nastran bulk data file (it has cards GRID)")


def _check_med(path: Path, content: bytes) -> None:
    _expect(path, content.startswith(_HDF5), "a MED file (it is in HDF5)")


def _expect(path: Path, holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"{path}: its content is not {what}, as its ending says.")


def _complete(path: Path, holds: bool, end: str) -> None:
    if not holds:
        raise ValueError(f"{path}: it is truncated or damaged, it does not end with {end}; export it again.")


def _check_msh(path: Path, content: bytes) -> None:
    header = re.match(rb"\$MeshFormat\r?\n([0-9.]+) ([01]) ([0-9]+)\s", content)
    if content.startswith(b"$NOD") or (header and float(header[1]) < 2):
        raise ValueError(f"{path}: it has version 1 of gmsh's format; save it as version 2.2 or 4.1.")
    _expect(path, header is not None, "a gmsh mesh (it begins with $MeshFormat and a version)")
    assert header is not None
    if header[1] not in (b"2", b"2.0", b"2.1", b"2.2", b"4", b"4.0", b"4.1"):
        raise ValueError(
            f"{path}: version {header[1].decode()} of gmsh's format is not known; save it as 2.2 or 4.1."
        )
    last = content.rstrip().splitlines()[-1]
    _complete(path, last.startswith(b"$End"), "$EndElements or another $End...")
    if header[2] == b"0":
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


_CHECKS = {
    ".msh": _check_msh,
    **dict.fromkeys(SCRIPTS, _check_script),
    **dict.fromkeys(STEP, _check_step),
    ".brep": _check_brep,
    **dict.fromkeys(IGES, _check_iges),
    ".inp": _check_inp,
    ".vtu": _check_vtu,
    ".vtk": _check_vtk,
    ".unv": _check_unv,
    ".med": _check_med,
    **dict.fromkeys(NASTRAN, _check_bdf),
}
KNOWN = tuple(_CHECKS)
