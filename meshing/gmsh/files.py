"""A user's file before gmsh sees it: its content is what its ending says, what it reads is beside it.

`collect` returns the bytes that were checked. gmsh is given copies of these in a folder of their own, so that
nothing that lies beside the user's file, and nothing that changes it afterwards, has a say.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from meshing.gmsh.script_scan import scan_script
from meshing.whole_file import read_whole

SCRIPTS = (".geo", ".geo_unrolled")
STEP, IGES = (".step", ".stp"), (".iges", ".igs")
CAD = (*STEP, ".brep", *IGES)  # these formats carry no physical groups
_MERGED = (*SCRIPTS, *STEP, ".brep", ".msh")
MESHES = (".msh",)
FOREIGN = {".inp": "meshing.gmsh.abaqus", ".vtu": "meshing.gmsh.vtk", ".vtk": "meshing.gmsh.vtk"}
KNOWN = (*MESHES, *SCRIPTS, *CAD, *FOREIGN)
_MOST_FILES = 100
_HDF5 = b"\x89HDF\r\n\x1a\n"


def collect(path: Path) -> dict[str, bytes]:
    """The file and all it reads, checked.

    Parameters
    ----------
    path : path

    Returns
    -------
    dict of str to bytes
        What gmsh is given, by name; the first is the file itself, called "model" with its ending in small
        letters, the others have their paths relative to its folder.

    Raises
    ------
    ValueError
        The ending is not known, the content is something else, the file reads others outside its folder or
        itself, or a script holds a statement that is refused.
    """
    suffix = path.suffix.lower()
    content = read_whole(path)
    if content.startswith(_HDF5):
        raise ValueError(
            f"{path}: it is an HDF5 file, not a gmsh model; meshes that were saved here are read by "
            "BoundaryMesh.load(path)."
        )
    if suffix not in KNOWN:
        raise ValueError(
            f"{path}: the ending {path.suffix or '(none)'} is not known; {', '.join(KNOWN)} are read, and "
            "the content must be what the ending says."
        )
    files: dict[str, bytes] = {f"model{suffix}": b""}
    if suffix in SCRIPTS:
        files[f"model{suffix}"] = _script(path, content, path.parent, files, (_real(path),))
    else:
        check_content(path, suffix, content)
        files[f"model{suffix}"] = content
    return files


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _script(
    path: Path, content: bytes, folder: Path, files: dict[str, bytes], within: tuple[Path, ...]
) -> bytes:
    """The checked text of a script; what it reads is added to `files`."""
    if not content.strip():
        raise ValueError(f"{path}: it is empty.")
    if content.startswith((b"$", b"ISO-10303-21")):
        raise ValueError(
            f"{path}: its content is a mesh or a CAD file, not a gmsh script; give it the ending of its "
            "format."
        )
    script = scan_script(content, str(path))
    for statement, line, name in script.reads:
        where = f"{path}: {statement} in line {line} reads {name!r}"
        other = path.parent / name
        relative = os.path.normpath(os.path.relpath(other, folder))
        outside = Path(name).is_absolute() or relative.startswith("..") or "\\" in name or "~" in name
        if outside or not _real(other).is_relative_to(_real(folder)):
            raise ValueError(f"{where}, which is outside the model's folder; put the file beside the model.")
        if _real(other) in within:
            raise ValueError(f"{where}, which reads itself; remove the statement.")
        if not other.is_file():
            raise ValueError(f"{where}, and there is no such file.")
        if len(files) >= _MOST_FILES:
            raise ValueError(f"{where}; more than {_MOST_FILES} files are not read.")
        suffix = other.suffix
        if statement == "Include" or suffix in SCRIPTS:
            files[relative] = b""
            files[relative] = _script(other, read_whole(other), folder, files, (*within, _real(other)))
        elif suffix in _MERGED:
            stored = read_whole(other)
            check_content(other, suffix, stored)
            files[relative] = stored
        else:
            raise ValueError(
                f"{where}, whose ending is not known; {', '.join(_MERGED)} can be merged (in small letters)."
            )
    return script.text.encode()


def check_content(path: Path, suffix: str, content: bytes) -> None:
    """ValueError unless the content is, from beginning to end, what the ending says."""
    if not content.strip():
        raise ValueError(f"{path}: it is empty.")
    if suffix in MESHES:
        _check_msh(path, content)
    elif suffix in STEP:
        _expect(
            path, content.lstrip().startswith(b"ISO-10303-21"), "a STEP file (it begins with ISO-10303-21)"
        )
        _complete(path, content.rstrip().endswith(b"END-ISO-10303-21;"), "END-ISO-10303-21;")
    elif suffix == ".brep":
        _expect(
            path,
            re.search(rb"CASCADE Topology V[0-9]", content[:400]) is not None and b"\0" not in content,
            "an OpenCASCADE BREP file (it begins with CASCADE Topology)",
        )
        sections = (b"\nLocations ", b"\nCurve2ds ", b"\nCurves ", b"\nSurfaces ", b"\nTShapes ")
        ends = re.search(rb"\n[+-]?[0-9]+ [0-9]+ *\s*$", content)
        _complete(path, all(word in content for word in sections) and ends is not None, "the shape's number")
    elif suffix in IGES:
        lines = content.splitlines()
        _expect(path, lines[0][72:73] in (b"S", b"F"), "an IGES file (column 73 of its first line is S)")
        last = [line for line in lines if line.strip()][-1]
        _complete(path, last[72:73] == b"T", "a line with T in column 73")
    elif suffix == ".inp":
        first = next((s for s in (line.strip() for line in content.splitlines()) if s), b"")
        _expect(path, first.startswith(b"*") and b"\0" not in content, "an Abaqus input file")
        include = re.search(rb"(?im)^\s*\*\s*include\b", content)
        if include:
            line = content.count(b"\n", 0, include.start()) + 1
            raise ValueError(
                f"{path}: *INCLUDE in line {line} reads another file, which is not done here; put all in one "
                "file."
            )
    elif suffix == ".vtu":
        head = content[:2000].lstrip()
        _expect(path, head.startswith(b"<") and b"<VTKFile" in head, "a VTK XML file")
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise ValueError(f"{path}: it declares entities, which VTK files do not; save it again.")
        _complete(path, content.rstrip().endswith(b"</VTKFile>"), "</VTKFile>")
    elif suffix == ".vtk":
        _expect(
            path, content.startswith(b"# vtk DataFile"), "a legacy VTK file (it begins with # vtk DataFile)"
        )


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
