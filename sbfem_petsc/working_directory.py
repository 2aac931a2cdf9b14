"""Settings that libraries look for in the working directory, which may be a stranger's, are not read."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def unread(name: str, package: str) -> Iterator[None]:
    """A package that is imported within, and was not before, does not find a file of this name here."""
    if package in sys.modules or not os.path.lexists(name):
        yield
        return
    here = os.open(os.curdir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.chdir(os.sep)
        yield
    finally:
        os.fchdir(here)
        os.close(here)
