"""What a command writes to the terminal: texts of files never move its cursor or change its state."""

from __future__ import annotations

import sys
from typing import TextIO


def tell(text: str, stream: TextIO | None = None, end: str = "\n") -> None:
    """Write lines, by default to the output; control characters but tabs and ends of lines are escaped."""
    shown = "".join(c if c.isprintable() or c in "\n\t" else repr(c)[1:-1] for c in text)
    print(shown, end=end, file=sys.stdout if stream is None else stream, flush=True)
