"""What a child process that opens a user's file may do: read, compute and answer; nothing else.

Limits on memory and on files hold everywhere. On Linux the kernel's Landlock, where it is there (5.13 and
newer), takes away the right to execute programs and to make or change files; the file's scan (see
`meshing.gmsh.script_scan`) comes before this and does not depend on it.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import struct
import sys

_PR_SET_PDEATHSIG = 1
_PR_SET_NO_NEW_PRIVS = 38
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # the same on all architectures
_GET_VERSION = 1
_PATH_BENEATH = 1
_READ_FILE, _READ_DIR = 1 << 2, 1 << 3
# Rights on files that each version of Landlock knows: all of them are taken away, and reading is given back.
_RIGHTS = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1}


def end_with_parent(parent: int) -> None:
    """End this process when its parent ends, and leave Ctrl-C to the parent, which ends this one, too.

    Parameters
    ----------
    parent : int
        Process number.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it has ended already
        os._exit(1)


def confine(memory: int) -> None:
    """Take from this process what it does not need; for good.

    Parameters
    ----------
    memory : int
        Most memory the process may map, bytes.
    """
    for limit, value in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(limit)[1]
        if hard != resource.RLIM_INFINITY:
            value = min(value, hard)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(limit, (value, value))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # writing fails instead
    if sys.platform.startswith("linux"):
        _read_only(ctypes.CDLL(None, use_errno=True))


def _read_only(libc: ctypes.CDLL) -> None:
    """Landlock: no program is executed, no file made or changed from here on, by any thread or child."""
    version = libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(_GET_VERSION))
    if version < 1:
        return
    handled = ctypes.create_string_buffer(struct.pack("=Q", _RIGHTS[min(version, 3)]), 8)
    rules = libc.syscall(_CREATE_RULESET, handled, ctypes.c_size_t(8), ctypes.c_uint32(0))
    if rules < 0:
        return
    root = os.open("/", os.O_PATH | os.O_CLOEXEC)
    try:
        # packed: the rights, then the folder beneath which they hold
        beneath = ctypes.create_string_buffer(struct.pack("=Qi", _READ_FILE | _READ_DIR, root), 12)
        added = libc.syscall(_ADD_RULE, rules, ctypes.c_int(_PATH_BENEATH), beneath, ctypes.c_uint32(0))
        if added == 0 and libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0:
            libc.syscall(_RESTRICT_SELF, rules, ctypes.c_uint32(0))
    finally:
        os.close(root)
        os.close(rules)
