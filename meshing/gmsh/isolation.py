"""gmsh's work on a user's file in a child process: what goes wrong there is a sentence here.

gmsh may hang or crash on broken geometry, and ends the process where a script says so. The child (see
`meshing.gmsh.child`) answers with plain arrays.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

# The package without what its __init__ imports, which takes longer than gmsh does.
_BOOTSTRAP = (
    "import json, sys, types\n"
    "request = json.loads(sys.stdin.readline())\n"
    "sys.path[:] = request.pop('path')\n"
    "sys.modules['meshing'] = types.ModuleType('meshing')\n"
    "sys.modules['meshing'].__path__ = [request.pop('package')]\n"
    "from meshing.gmsh.child import answer\n"
    "answer(request)\n"
)
# A child of an MPI rank must not take itself for that rank.
_OF_MPI = (
    "OMPI_",
    "PMIX_",
    "PMI_",
    "PRTE_",
    "ORTE_",
    "HYDRA_",
    "MPIR_",
    "MPI_",
    "MV2_",
    "I_MPI_",
    "SLURM_",
    "PALS_",
    "FLUX_",
)
_SHARE_OF_MEMORY = 0.75


def run_child(
    origin: str, files: dict[str, bytes], request: dict[str, Any], time_limit: float, memory_limit: int | None
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Let a child process do what `request` says with `files`.

    Parameters
    ----------
    origin : str
        For messages.
    files : dict of str to bytes
        Put into a folder of their own; the first is the one to open.
    request : dict
        Of what JSON knows; see `meshing.gmsh.child`.
    time_limit : float
        s.
    memory_limit : int, optional
        Bytes; three quarters of the machine's by default.

    Returns
    -------
    told : dict
    arrays : dict of str to array

    Raises
    ------
    ValueError
        The child refused the file, crashed, or was over the limits.
    RuntimeError
        The child could not be started or could not load gmsh.
    """
    with tempfile.TemporaryDirectory(prefix="sbfem-gmsh-") as folder:
        try:
            for name, content in files.items():
                place = Path(folder) / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
        except OSError as error:
            raise RuntimeError(
                f"{origin}: no copy of it can be put into {folder} ({error.strerror}); set TMPDIR to a "
                "folder with room."
            ) from error
        whole = {
            **request,
            "path": [os.path.abspath(entry) for entry in sys.path if entry and os.path.exists(entry)],
            "package": str(Path(__file__).resolve().parents[1]),
            "folder": folder,
            "file": next(iter(files)),
            "memory": memory_limit or _memory(),
            "parent": os.getpid(),
        }
        answer, status, said = _communicate(origin, whole, folder, time_limit)
    if status != 0:
        _explain(origin, status, said, whole["memory"])
    try:
        with np.load(io.BytesIO(answer), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        told = json.loads(arrays.pop("told").tobytes())
    except (ValueError, KeyError, OSError, EOFError) as error:
        raise ValueError(f"{origin}: gmsh ended before it had read the file.") from error
    if "refused" in told:
        raise ValueError(f"{origin}: {told['refused']}")
    if "missing" in told:
        raise RuntimeError(told["missing"])
    return told, arrays


def _communicate(origin: str, request: dict, folder: str, time_limit: float) -> tuple[bytes, int, bytes]:
    try:
        child = subprocess.Popen(
            [sys.executable, "-I", "-c", _BOOTSTRAP],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env=clean_environment(),
        )
    except OSError as error:
        raise RuntimeError(
            f"{origin}: the process in which gmsh reads files could not be started ({error})."
        ) from error
    with child:
        try:
            answer, said = child.communicate(json.dumps(request).encode() + b"\n", timeout=time_limit)
        except subprocess.TimeoutExpired:
            raise ValueError(
                f"{origin}: gmsh did not finish within {time_limit:g} s; check the geometry for curves that "
                "cross, parts that are damaged and very small cells, or pass a larger time_limit."
            ) from None
        finally:  # on KeyboardInterrupt as well
            if child.poll() is None:
                child.kill()
    return answer, child.returncode, said


def clean_environment() -> dict[str, str]:
    """This process's environment without what MPI launchers have put into it."""
    return {name: value for name, value in os.environ.items() if not name.startswith(_OF_MPI)}


def _memory() -> int:
    with contextlib.suppress(ValueError, OSError, AttributeError):
        return int(_SHARE_OF_MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return 8 * 2**30


def _explain(origin: str, status: int, said: bytes, memory: int) -> None:
    last = said.decode(errors="replace").strip().splitlines()
    if b"MemoryError" in said or b"bad_alloc" in said:
        raise ValueError(
            f"{origin}: gmsh needs more than {memory / 2**30:.3g} GiB of memory for it; give a larger size, "
            "or check the geometry."
        )
    if status < 0:
        name = signal.Signals(-status).name if -status in set(signal.Signals) else str(-status)
        raise ValueError(f"{origin}: gmsh crashed on it ({name}); the file is damaged, export it again.")
    raise ValueError(
        f"{origin}: gmsh ended with code {status} before it had read the file"
        f"{f' ({last[-1]})' if last else ''}."
    )
