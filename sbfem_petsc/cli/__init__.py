"""The command `sbfem`."""

from __future__ import annotations

import sys
from typing import NoReturn


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    try:
        from .entry import main as run

        run(arguments)
    except KeyboardInterrupt:  # modules are being imported: nothing has begun
        print("interrupted", file=sys.stderr)
        sys.exit(130)
