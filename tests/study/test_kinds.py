"""Kinds of analysis: each is one file, which is found."""

from __future__ import annotations

from pathlib import Path

import sbfem_petsc as sb
from sbfem_petsc.study.case.analyses import KINDS
from sbfem_petsc.study.kinds.kind import Kind

PACKAGE = Path(sb.__file__).parent


def test_each_file_is_a_kind():
    """It bears the kind's name and answers all that a run asks; nothing lists it."""
    files = {path.stem for path in (PACKAGE / "study/kinds").glob("*.py")} - {"__init__", "kind"}
    assert set(KINDS) == files and len(files) >= 14
    for name, kind in KINDS.items():
        assert kind.__module__.endswith(f".{name}") and kind.__doc__
        assert all(
            getattr(kind, part) is not getattr(Kind, part) for part in ("solve", "tree", "row", "cost")
        )
        assert set(kind.loads_in) <= set(kind.model_fields)
    # each bears the name of a public function, but for one that is a motion under two tones
    assert set(KINDS) - set(sb.__all__) == {"modulation"}
