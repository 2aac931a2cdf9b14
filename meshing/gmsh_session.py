"""gmsh through its API: a session that cleans up after itself."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_OF_MESHES = "MeshSizeMax", "MeshOnlyVisible", "RecombinationAlgorithm", "ElementOrder"
_OPTIONS = ["General.Terminal", "General.Verbosity", *(f"Mesh.{name}" for name in _OF_MESHES)]
_ALONE = threading.RLock()  # gmsh has one state for all threads


def initialize(gmsh: Any) -> None:
    """Start gmsh.

    Without interruptible=False it takes SIGINT for good; with configuration files the result would depend on
    the user's home; the PETSc inside its library would read options, and with them load code, from files in
    the working directory and the home. That option gmsh does not know, and would say so.
    """
    gmsh.initialize(["gmsh", "-v", "0", "-skip_petscrc"], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 5)  # as it is by itself


@contextmanager
def gmsh_session(name: str) -> Iterator[Any]:
    """A gmsh model of our own, removed afterwards; gmsh itself is ended only if it was started here.
    Threads take turns.

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
    with _ALONE:
        started = not gmsh.isInitialized()
        if started:
            with _own_signals():
                initialize(gmsh)
        previous = None if started else gmsh.model.getCurrent()
        options = {option: gmsh.option.getNumber(option) for option in _OPTIONS}
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.Verbosity", 0)  # what it says of each curve takes half of the time
        gmsh.model.add(name)
        try:
            yield gmsh
        finally:
            if started:
                with _own_signals():
                    gmsh.finalize()
            else:
                gmsh.model.remove()
                for option, value in options.items():  # options belong to gmsh, not to a model
                    gmsh.option.setNumber(option, value)
                if previous:
                    gmsh.model.setCurrent(previous)


@contextmanager
def _own_signals() -> Iterator[None]:
    """Python's handlers of signals stand again afterwards: the PETSc inside gmsh takes those of most away."""
    handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():  # Python lets no other one
            for number, handler in handlers.items():
                if callable(handler):
                    signal.signal(number, handler)
