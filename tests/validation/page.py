"""Cases of published problems and the page that states what is found beside what is published."""

from __future__ import annotations

import math
import pathlib
import re
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

PAGE = pathlib.Path(__file__).parents[2] / "VALIDATION.md"
# Differences below this are printed as such: they are round-off, which differs from machine to machine.
ROUND_OFF = 1e-8

HEAD = """# Published problems

Written by `python -m tests.validation`; the tests hold each line (`pytest tests/validation`). *published* is
what the source prints, or its closed form evaluated; *difference* is relative to it, or to the scale named
in the line where zero is published. *held* is what the test allows.
"""

# One entry a string: the page wraps them, so that a list stays a list.
NOT_COVERED = (
    "**Growth** (SSLP320, sslp315a, sslp322a): cracks do not grow.",
    "**Friction** has no lines here: what it was compared with, SDND100 and oblique cracks under compression "
    "among it, stands in docs/friction.md. Faces of plane bodies rub at rest, in histories, reduced and "
    "unreduced, and in steady states and response curves of reduced models; other analyses of motions refuse "
    "them.",
    "**NLvib's other examples**: they have cubic springs, large displacements or friction smoothed by tanh.",
    "**Cracked beam of Rizos et al. (1990)**: its figures are known second hand only; the lines above hold "
    "nothing.",
)
_WIDTH = 110


@dataclass(frozen=True)
class Row:
    """One quantity.

    Attributes
    ----------
    quantity : str
        With its unit.
    published, found : float
    held : float or None
        Largest difference that is allowed; None: nothing is held.
    scale : float or None
        What the difference is relative to; default: the published value.
    note : str
        What explains the difference.
    """

    quantity: str
    published: float
    found: float
    held: float | None
    scale: float | None = None
    note: str = ""

    @property
    def difference(self) -> float:
        """Relative."""
        return abs(self.found - self.published) / abs(self.published if self.scale is None else self.scale)

    def cells(self) -> tuple[str, ...]:
        """Of the page's table."""
        difference = f"{self.difference:.1e}" if self.difference >= ROUND_OFF else f"< {ROUND_OFF:.0e}"
        small = self.scale is not None and abs(self.found) < ROUND_OFF * abs(self.scale)
        found = "0" if small else f"{self.found:.5g}"
        held = "-" if self.held is None else f"{self.held:.1e}".replace(".0e", "e")
        return self.quantity, f"{self.published:.7g}", found, difference, held, self.note


@dataclass(frozen=True)
class Case:
    """A published problem.

    Attributes
    ----------
    key : str
    title, source : str
    compute : callable
        Gives its rows.
    long : bool
    """

    key: str
    title: str
    source: str
    compute: Callable[[], Iterator[Row]] = field(repr=False)
    long: bool

    def text(self, rows: list[Row]) -> str:
        """The section of the page."""
        lines = [f"## {self.title}", "", self.source, ""]
        lines += ["| quantity | published | found | difference | held | note |", "|---|---|---|---|---|---|"]
        lines += ["| " + " | ".join(row.cells()) + " |" for row in rows]
        return "\n".join(lines) + "\n"


CASES: dict[str, Case] = {}


def case(title: str, source: str, *, long: bool = False):
    """Register a generator of rows under its name."""

    def register(compute: Callable[[], Iterator[Row]]) -> Callable[[], Iterator[Row]]:
        CASES[compute.__name__] = Case(compute.__name__, title, source, compute, long)
        return compute

    return register


def page(sections: list[str]) -> str:
    """The whole page."""
    return "\n".join([HEAD, *sections, "## Not covered\n", not_covered()])


def not_covered() -> str:
    """The list of what is not computed, one wrapped entry each."""
    entries = (
        textwrap.fill(text, _WIDTH, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)
        for text in NOT_COVERED
    )
    return "\n".join(entries) + "\n"


def section(title: str) -> list[list[str]]:
    """Cells of the rows of a section of the page as it stands."""
    text = PAGE.read_text()
    start = text.find(f"## {title}\n")
    if start < 0:
        return []
    body = text[start:].split("\n## ")[0]
    rows = [line for line in body.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in re.split(r" \| ", line[2:-2] + " ")] for line in rows[1:]]


def agrees(printed: list[str], row: Row) -> bool:
    """Whether a line of the page says what is found: numbers to within what machines differ by."""
    quantity, published, found, difference, held, note = row.cells()
    if [printed[k].strip() for k in (0, 1, 4, 5)] != [quantity, published, held, note]:
        return False
    scale = abs(row.published if row.scale is None else row.scale)
    if not math.isclose(float(printed[2]), float(found), rel_tol=1e-4, abs_tol=1e-6 * scale):
        return False
    if "<" in difference or "<" in printed[3]:
        return row.difference < 10 * ROUND_OFF
    return math.isclose(float(printed[3]), row.difference, rel_tol=0.1, abs_tol=1e-6)
