"""gmsh through its API: a session that cleans up after itself."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_OPTIONS = (
    "General.Terminal",
    "Mesh.MeshSizeMax",
    "Mesh.Algorithm",
    "Mesh.RecombinationAlgorithm",
    "Mesh.ElementOrder",
)
_TEXT_OPTIONS = ("Geometry.OCCTargetUnit",)
_MOST_STATEMENTS = 10_000


@contextmanager
def gmsh_session(name: str) -> Iterator[object]:
    """A gmsh model of our own, removed afterwards; gmsh itself is ended only if it was started here.

    Raises
    ------
    RuntimeError
        gmsh cannot be loaded.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:  # OSError: the wheel's library lacks a system library
        raise RuntimeError(
            f"gmsh could not be loaded ({error}); install it with 'pip install gmsh' and the libraries "
            "libGLU, libXcursor, libXft, libXinerama."
        ) from error
    started = not gmsh.isInitialized()
    if started:
        # Without interruptible=False gmsh takes SIGINT for good; with configuration files the result would
        # depend on the user's home.
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    previous = None if started else gmsh.model.getCurrent()
    options = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
    texts = {name: gmsh.option.getString(name) for name in _TEXT_OPTIONS}
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add(name)
    try:
        yield gmsh
    finally:
        if started:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            for option, value in options.items():  # options belong to gmsh, not to a model
                gmsh.option.setNumber(option, value)
            for option, text in texts.items():
                gmsh.option.setString(option, text)
            if previous:
                gmsh.model.setCurrent(previous)


def drain_parser(gmsh) -> None:
    """Make gmsh forget the rest of a .geo file in which it found an error.

    It keeps the text after the error, also beyond its own end, and would put it before the next file of this
    process; every further attempt takes one statement off.
    """
    with tempfile.TemporaryDirectory() as folder:
        blank = Path(folder) / "blank.geo"
        blank.write_text("// nothing\n")
        for _ in range(_MOST_STATEMENTS):
            with contextlib.suppress(Exception):
                gmsh.merge(str(blank))
                return
