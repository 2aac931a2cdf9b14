"""What a script has read, and what it was kept from, by gmsh's log; in the child process only."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator

from meshing.gmsh.confined import Refusal
from meshing.gmsh.files import SCRIPTS, STEP

_READING = re.compile(r"Info: Reading '(.*)'\.\.\.")
_NAMED = re.compile(r"(?:Unable to open file|Could not open file|Could not read file|File) '(.*)'")
_SHAPES = re.compile(rb"""ShapeFromFile\s*\(\s*["']([^"']*)["']""")  # not in the log
_TRUST = (
    "or pass trust=True to read_gmsh if you know the script, which may then start programs and read and "
    "write files as you may"
)
# A last line that holds one statement at most.
_ONE_STATEMENT = re.compile(rb"\s*(?!(?:If|ElseIf|For|Macro|Function)\b)[^;]*;?\s*(?://.*)?", re.DOTALL)
_BEFORE_ANOTHER = re.compile(rb"\s*(?:Else|EndIf|EndFor|Return)\s+[^\s/]")
_TAIL = 65536  # bytes, in which a last line is looked for


def check_whole(log: list[str]) -> None:
    """Refuse what gmsh leaves out without a word.

    Raises
    ------
    Refusal
        Errors after which a script has gone on (General.AbortOnError); statements that follow others in a
        last line without its end; shapes from a file that gmsh cannot read.
    """
    for line in log:
        if line.startswith("Error: "):
            raise refused(line.removeprefix("Error: "), script=True)
    for name in _files_read(log):
        with open(name, "rb") as stream:
            stream.seek(max(stream.seek(0, os.SEEK_END) - _TAIL, 0))
            last = stream.read().rpartition(b"\n")[2]
        if not _ONE_STATEMENT.fullmatch(last) or _BEFORE_ANOTHER.match(last):
            raise Refusal(
                f"the last line of {name!r} holds several statements and no line break at its end, and gmsh "
                "reads the first of them only; add a line break at the end of the file."
            )
    for name in _shapes_read(log):
        try:
            open(name, "rb").close()
        except OSError:
            raise _not_opened(name) from None


def step_read(log: list[str]) -> str | None:
    """A STEP file that a script merges or takes shapes from; None without one."""
    return next(
        (name for name in (*_files_read(log), *_shapes_read(log)) if name.lower().endswith(STEP)), None
    )


def refused(said: str, script: bool) -> Refusal:
    """What gmsh says that it could not do, as a refusal.

    Parameters
    ----------
    said : str
        gmsh's error.
    script : bool
        A script is read, which may have been kept from something.
    """
    if script and ("system call" in said or "socket" in said):
        return Refusal(f"it starts a program, which a script may not; remove the statement, {_TRUST}.")
    named = _NAMED.search(said)
    if script and named:
        return _not_opened(named[1])
    return Refusal(f"gmsh cannot read or mesh it ({said}); mend the file there.")


def _not_opened(place: str) -> Refusal:
    folder = os.path.realpath(os.curdir)
    where = "" if os.path.exists(place) else ", which is not there"
    if os.path.commonpath([os.path.realpath(place), folder]) != folder:
        where = ", which is outside the model's folder"
    return Refusal(
        f"it opens {place!r}{where}, and a script may only read files in its folder and below; put the file "
        f"there, remove the statement (read_gmsh meshes by itself and writes nothing), {_TRUST}."
    )


def _files_read(log: list[str]) -> list[str]:
    """The files that gmsh has read or tried to read, the script first, as it names them."""
    return [found[1] for found in map(_READING.fullmatch, log) if found]


def _shapes_read(log: list[str]) -> Iterator[str]:
    """Files from which scripts take shapes, where their names are written out."""
    for name in _files_read(log):
        if name.lower().endswith(SCRIPTS):
            with open(name, "rb") as stream:
                for found in _SHAPES.finditer(stream.read()):
                    yield os.path.join(os.path.dirname(name), os.fsdecode(found[1]))
