"""What runs in the child process: a file is opened, and the answer goes to the parent as arrays."""

from __future__ import annotations

import importlib
import io
import json
import os
import sys
from typing import Any

import numpy as np


class Refusal(Exception):
    """A sentence for the user, without the file's name."""


def answer(request: dict[str, Any]) -> None:
    """Do what the request says and write the answer, an .npz archive, to standard output.

    Parameters
    ----------
    request : dict
        "memory" : bytes; "module" : what knows how to read the file; the rest is passed to its `extract`.
    """
    # gmsh's libraries write to standard output as they like.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    from meshing.gmsh.confinement import confine

    arrays: dict[str, np.ndarray] = {}
    try:
        reader = importlib.import_module(request.pop("module"))
        reader.load()
        confine(request.pop("memory"))
        told, arrays = reader.extract(**request)
    except Refusal as refusal:
        told = {"refused": str(refusal)}
    except (ImportError, OSError) as error:
        told = {"missing": str(error)}
    buffer = io.BytesIO()
    np.savez(buffer, told=np.frombuffer(json.dumps(told).encode(), np.uint8), **arrays)
    out.write(buffer.getvalue())
    out.close()
    sys.stdout.flush()
    os._exit(0)  # without gmsh's own end, which may fail on what it could not read
