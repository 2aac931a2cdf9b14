"""What runs in the child process: a file is opened, and the answer goes to the parent as arrays."""

from __future__ import annotations

import importlib
import io
import json
import os
import sys
from typing import Any

import numpy as np

from meshing.gmsh.confinement import confine, end_with_parent


class Refusal(Exception):
    """A sentence for the user, without the file's name."""


def answer(request: dict[str, Any]) -> None:
    """Do what the request says and write the answer, an .npz archive, to standard output.

    Parameters
    ----------
    request : dict
        "parent" : number of the process that asks; "memory" : bytes; "module" : what knows how to read the
        file; the rest is passed to its `extract`.
    """
    end_with_parent(request.pop("parent"))
    # gmsh's libraries write to standard output as they like.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    arrays: dict[str, np.ndarray] = {}
    reader = importlib.import_module(request.pop("module"))
    try:
        reader.load()
    except (ImportError, OSError) as error:  # OSError: gmsh's wheel lacks a system library
        told = {
            "missing": f"gmsh or meshio could not be loaded ({error}); install them with 'pip install gmsh "
            "meshio' and, for gmsh, the libraries libGLU, libXcursor, libXft, libXinerama."
        }
    else:
        confine(request.pop("memory"))
        try:
            told, arrays = reader.extract(**request)
        except Refusal as refusal:
            told = {"refused": str(refusal)}
    buffer = io.BytesIO()
    np.savez(buffer, told=np.frombuffer(json.dumps(told).encode(), np.uint8), **arrays)
    out.write(buffer.getvalue())
    out.close()
    sys.stdout.flush()
    os._exit(0)  # without gmsh's own end, which may fail on what it could not read
