"""A user's file is opened by a child process that may read the file's folder, and Python and NumPy,
compute and answer; nothing else.

The kernel sees to it, whatever a file says. Landlock (Linux 5.13 and newer): no program is executed, no file
made, changed or read elsewhere; seccomp: no process is started, no socket opened; limits on memory, time and
files hold everywhere. The child loads all that it needs, is confined for good, and then opens the file.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import io
import json
import math
import os
import resource
import selectors
import signal
import socket
import struct
import subprocess
import sys
import time
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

# Without site, whose hooks take longer than numpy: the path is the parent's.
_BOOT = (
    "import json, sys\n"
    "request = json.loads(sys.stdin.readline())\n"
    "sys.path[:] = request.pop('path')\n"
    "from meshing.gmsh.confined import answer\n"
    "answer(request)\n"
)
_KEPT = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")  # no secrets, nothing of MPI
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

_END_WITH_PARENT, _SECCOMP, _NO_NEW_PRIVILEGES = 1, 22, 38  # of prctl
_CREATE, _ADD, _RESTRICT = 444, 445, 446  # Landlock's calls, the same on all architectures
_READ_FILE, _READ_FOLDER = 1 << 2, 1 << 3
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}  # number of rights on files that a version of Landlock knows
# Of a machine: its number for the kernel, clone, and what is not called: socket, execve, execveat,
# io_uring_setup, and fork and vfork where they are.
_CALLS = {
    "x86_64": (0xC000003E, 56, (41, 59, 322, 425, 57, 58)),
    "aarch64": (0xC00000B7, 220, (198, 221, 281, 425)),
}
_CLONE3, _THREAD = 435, 0x10000
_EXIT = "a script must not end gmsh (Exit)"
_PART = 1 << 18  # bytes that are taken from a socket at once
_LONGEST = 1e6  # s, of waiting and of time limits that the system knows


class Refusal(Exception):
    """A sentence for the user, without the file's name."""


@dataclass(frozen=True)
class Rights:
    """What a child process may do.

    Attributes
    ----------
    time_limit : float
        s.
    memory : int
        Most that it may map, bytes.
    trusted : bool
        It may do what its parent may do, within these limits; `extract` is told so.
    """

    time_limit: float
    memory: int
    trusted: bool = False


def landlock_version() -> int:
    """Version of the kernel's Landlock; 0 where there is none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(ctypes.CDLL(None).syscall(_CREATE, None, ctypes.c_size_t(0), ctypes.c_uint32(1)), 0)


def ask(
    origin: str, file: Path, module: str, rights: Rights, options: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What `extract` of a module tells of a file.

    Parameters
    ----------
    origin : str
        For messages.
    file : path
        The file and what lies beneath its folder can be read.
    module : str
        It has `load`, which loads what is needed, and `extract`, called in the file's folder with the file's
        name and `options`.
    rights : Rights
    options : dict
        Of what JSON knows.

    Returns
    -------
    told : dict
    arrays : dict of str to array

    Raises
    ------
    ValueError
        The child refused the file, crashed, or was over the limits.
    RuntimeError
        The child could not be started or confined, or could not load its library.
    """
    path = [os.path.abspath(entry) for entry in sys.path if entry and os.path.exists(entry)]
    request = {
        "file": os.path.abspath(file),
        "module": module,
        "rights": asdict(rights),
        "landlock": landlock_version(),
        "options": options,
        "parent": os.getpid(),
        "path": [*path, str(Path(__file__).resolve().parents[2])],  # an editable package is not on the path
    }
    answer, status, said = _communicate(origin, request, rights.time_limit)
    if status != 0:
        raise ValueError(f"{origin}: {_why(status, said, rights.memory)}")
    try:
        with np.load(io.BytesIO(answer), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        told = json.loads(arrays.pop("told").tobytes())
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{origin}: gmsh ended before it had read the file; {_EXIT}.") from error
    if "refused" in told:
        raise ValueError(f"{origin}: {told['refused']}")
    if "missing" in told:
        raise RuntimeError(f"{origin}: {told['missing']}")
    return told, arrays


def _communicate(origin: str, request: dict[str, Any], time_limit: float) -> tuple[bytes, int, bytes]:
    """The child's answer, how it ended, and the beginning of what it said.

    By sockets: a script can open a pipe by its name in /proc, and write into the answer.
    """
    until, command = time.monotonic() + time_limit, [sys.executable, "-I", "-S", "-c", _BOOT]
    env = {name: os.environ[name] for name in _KEPT if name in os.environ} | _ONE_THREAD
    (answers, outlet), (sayings, mouth) = socket.socketpair(), socket.socketpair()
    with contextlib.ExitStack() as stack:
        for end in (answers, outlet, sayings, mouth):
            stack.enter_context(end)
        try:
            out, err = outlet.fileno(), mouth.fileno()
            child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=out, stderr=err, env=env)
        except OSError as error:
            raise RuntimeError(
                f"{origin}: the process in which gmsh reads files could not be started ({error})."
            ) from error
        stack.enter_context(child)
        stack.callback(child.kill)  # on KeyboardInterrupt as well
        outlet.close()
        mouth.close()
        assert child.stdin is not None
        with contextlib.suppress(BrokenPipeError), child.stdin:
            child.stdin.write(json.dumps(request).encode() + b"\n")
        try:
            answer, said = _received(answers, sayings, until)
            return answer, child.wait(max(until - time.monotonic(), 1.0)), said
        except (TimeoutError, subprocess.TimeoutExpired):
            raise ValueError(
                f"{origin}: gmsh did not finish within {time_limit:g} s; check the geometry for curves that "
                "cross, parts that are damaged and very small cells, or pass a larger time_limit."
            ) from None


def _received(answers: socket.socket, sayings: socket.socket, until: float) -> tuple[bytes, bytes]:
    """All that comes from one socket, and the beginning of what comes from another meanwhile."""
    answer, said = bytearray(), bytearray()
    with selectors.DefaultSelector() as waiting:
        waiting.register(answers, selectors.EVENT_READ, answer)
        waiting.register(sayings, selectors.EVENT_READ, said)
        while answers in waiting.get_map():
            left = until - time.monotonic()
            ready = waiting.select(min(left, _LONGEST)) if left > 0 else []
            if not ready:
                raise TimeoutError
            for key, _ in ready:
                part = os.read(key.fd, _PART)
                if not part:
                    waiting.unregister(key.fileobj)
                elif key.data is answer or len(said) < _PART:
                    key.data.extend(part)
    with contextlib.suppress(BlockingIOError):
        said += sayings.recv(_PART, socket.MSG_DONTWAIT)
    return bytes(answer), bytes(said)


def _why(status: int, said: bytes, memory: int) -> str:
    last = said.decode(errors="replace").strip().splitlines()
    if b"MemoryError" in said or b"bad_alloc" in said:
        return (
            f"gmsh needs more than {memory / 2**30:.3g} GiB of memory for it; give a larger size, or check "
            "the geometry."
        )
    if status < 0:
        name = signal.Signals(-status).name if -status in set(signal.Signals) else str(-status)
        return f"gmsh crashed on it ({name}); the file is damaged, export it again."
    what = f" ({last[-1]})" if last else ""
    return f"gmsh ended with code {status} before it had read the file{what}; {_EXIT}."


def answer(request: dict[str, Any]) -> None:
    """In the child: do what `ask` asks for and write the answer, an .npz archive, to standard output."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which ends this process
    libc = ctypes.CDLL(None, use_errno=True)
    if sys.platform.startswith("linux"):
        libc.prctl(_END_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != request["parent"]:  # it has ended already
        os._exit(1)
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # gmsh's libraries write to standard output as they like
    told, arrays = _found(libc, request)
    buffer = io.BytesIO()
    np.savez(buffer, told=np.frombuffer(json.dumps(told).encode(), np.uint8), **arrays)
    out.write(buffer.getvalue())
    out.close()
    os._exit(0)  # without gmsh's own end, which may fail on what it could not read


def _found(libc: ctypes.CDLL, request: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Load, be confined, read the file."""
    rights, file, options = Rights(**request["rights"]), request["file"], request["options"]
    try:
        reader = importlib.import_module(request["module"])
        reader.load()
        np.savez(io.BytesIO(), told=np.zeros(1))  # Python loads what this needs, while it still may
    except (ImportError, OSError) as error:  # OSError: gmsh's wheel lacks a system library
        return {
            "missing": f"gmsh or meshio could not be loaded ({error}); install them with 'pip install gmsh "
            "meshio' and, for gmsh, the libraries libGLU, libXcursor, libXft, libXinerama."
        }, {}
    try:
        _limit(rights)
        if rights.trusted:
            options["trusted"] = True
        else:
            _confine(libc, file, request["landlock"])
        os.chdir(os.path.dirname(file))
    except OSError as error:
        return {"missing": f"this system does not confine the process that opens it ({error})."}, {}
    try:
        return reader.extract(file=os.path.basename(file), **options)
    except Refusal as refusal:
        return {"refused": str(refusal)}, {}
    except UnicodeDecodeError as error:
        return {
            "refused": f"a name in it holds the byte 0x{error.object[error.start]:02x}, which is no text "
            "(UTF-8); save the file as UTF-8, or use plain letters."
        }, {}


def _limit(rights: Rights) -> None:
    """Limits of this process: memory and time; of what is not trusted, files of no bytes."""
    # the parent's limit comes first, unless it is gone
    seconds = math.ceil(min(rights.time_limit, _LONGEST)) + 1
    limits = {resource.RLIMIT_AS: rights.memory, resource.RLIMIT_CPU: seconds, resource.RLIMIT_CORE: 0}
    if not rights.trusted:
        limits[resource.RLIMIT_FSIZE] = 0
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # writing fails instead
    for limit, value in limits.items():
        hard = resource.getrlimit(limit)[1]
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with contextlib.suppress(ValueError):  # macOS has no limit of memory
            resource.setrlimit(limit, (value, value))


def _confine(libc: ctypes.CDLL, file: str, landlock: int) -> None:
    """Take from this process, for good, all that reading the file does not need.

    Raises
    ------
    OSError
        The kernel does not do what it says that it can.
    """

    def call(function: Any, *arguments: Any) -> int:
        result = function(*arguments)
        if result < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        return result

    if not sys.platform.startswith("linux"):
        return
    call(libc.prctl, _NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    if landlock:
        # packed: rights on files, TCP (from version 4), signals and sockets without a name (from 6)
        handled = (1 << _RIGHTS.get(landlock, 16)) - 1, 3 * (landlock >= 4), 3 * (landlock >= 6)
        size = 8 * (1 + (landlock >= 4) + (landlock >= 6))
        packed = struct.pack("=QQQ", *handled)[:size]
        rules = call(libc.syscall, _CREATE, packed, ctypes.c_size_t(size), ctypes.c_uint32(0))
        # Python and NumPy load parts of theirs when these are first used, the newer the more.
        folders = {os.path.dirname(place) for place in (file, os.__file__, np.__file__)}
        places = {folder: _READ_FILE | _READ_FOLDER for folder in folders if os.path.isdir(folder)}
        for place, rights in (places | {file: _READ_FILE}).items():
            beneath = struct.pack("=Qi", rights, os.open(place, os.O_PATH | os.O_CLOEXEC))
            call(libc.syscall, _ADD, rules, ctypes.c_int(1), beneath, ctypes.c_uint32(0))
        call(libc.syscall, _RESTRICT, rules, ctypes.c_uint32(0))
    steps = _without_processes_and_sockets()
    if steps:
        code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *step) for step in steps))
        program = ctypes.create_string_buffer(struct.pack("@HP", len(steps), ctypes.addressof(code)))
        call(libc.prctl, _SECCOMP, 2, program, 0, 0)


def _without_processes_and_sockets() -> list[tuple[int, int, int, int]]:
    """Seccomp's program, (code, steps to skip if true, if false, number); none for other machines."""
    machine = os.uname().machine
    if machine not in _CALLS or sys.maxsize < 2**32:
        return []
    number, clone, denied = _CALLS[machine]
    load, equal, at_least, any_bit, give = 0x20, 0x15, 0x35, 0x45, 0x06
    allow, deny, unknown = (give, 0, 0, 0x7FFF0000), (give, 0, 0, 0x50001), (give, 0, 0, 0x50026)
    return [
        (load, 0, 0, 4),  # the machine
        *((equal, 1, 0, number), deny),
        (load, 0, 0, 0),  # the call
        *((at_least, 0, 1, 1 << 30), deny),
        *(step for call in denied for step in ((equal, 0, 1, call), deny)),
        *((equal, 0, 1, _CLONE3), unknown),  # the C library then takes clone
        (equal, 0, 3, clone),
        (load, 0, 0, 16),  # its flags: threads are made
        *((any_bit, 1, 0, _THREAD), deny),
        allow,
    ]
