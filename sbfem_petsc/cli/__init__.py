"""The command `sbfem`."""

from __future__ import annotations

from typing import NoReturn


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    from .entry import main as run

    run(arguments)
