"""Each published problem within what is held, and as VALIDATION.md states it."""

import pytest

from tests.validation import cases  # noqa: F401  (registers them)
from tests.validation.page import CASES, agrees, section


@pytest.mark.slow
@pytest.mark.parametrize(
    "key", [pytest.param(key, marks=[pytest.mark.long] if case.long else []) for key, case in CASES.items()]
)
def test_published(key):
    case = CASES[key]
    rows = list(case.compute())
    for row in rows:
        assert row.held is None or row.difference <= row.held, row
    printed = section(case.title)
    assert len(printed) == len(rows), "VALIDATION.md is out of date: python -m tests.validation"
    for line, row in zip(printed, rows):
        assert agrees(line, row), (
            f"VALIDATION.md says {line}, found {row.cells()}: python -m tests.validation"
        )
