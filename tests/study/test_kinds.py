"""Kinds of analysis: each is one file, which is found."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.study.case.analyses import KINDS
from sbfem_petsc.study.kinds.kind import Kind

PACKAGE = Path(sb.__file__).parent
# Files of the package that know an analysis: its own, its kind, the public names, and two that rest on it.
MOST = 5


def test_each_file_is_a_kind():
    """It bears the kind's name and answers all that a run asks; nothing lists it."""
    files = {path.stem for path in (PACKAGE / "study/kinds").glob("*.py")} - {"__init__", "kind"}
    assert set(KINDS) == files and len(files) >= 14
    for name, kind in KINDS.items():
        assert kind.__module__.endswith(f".{name}") and kind.__doc__
        assert kind.cost is not Kind.cost and set(kind.loads_in) <= set(kind.model_fields)
        assert kind.solve is not Kind.solve or hasattr(getattr(sb, kind.function or name), "options")
    # each bears the name of a public function, but for one that is a motion under two tones
    assert set(KINDS) - set(sb.__all__) == {"modulation"}


@pytest.mark.parametrize("probe, periods", [(3200.0, 1), (3200.0, 3), (3000.0, 2), (3000.0, 4)])
def test_sidebands_of_a_motion_of_several_periods(probe, periods):
    """1 + 0.2 cos(2 pi 400 t) times a carrier, and a line of the motion's own where it has more periods than
    its loads: the index is 0.2 whatever they are.
    """
    tones = {"pump": "low", "pump_frequency": 400.0, "probe": "high", "probe_frequency": probe}
    kind = KINDS["modulation"](kind="modulation", point="A", **tones)
    t = np.arange(512 * periods) / (512 * 400.0)
    own = 0.1 * np.cos(2.0 * np.pi * 400.0 / periods * t) if periods > 2 else 0.0
    u = (1.0 + 0.2 * np.cos(2.0 * np.pi * 400.0 * t)) * np.cos(2.0 * np.pi * probe * t) + own
    motion = SimpleNamespace(periods=periods, displacement=lambda point: u)
    assert kind._sidebands(motion).modulation_index == pytest.approx(0.2, rel=1e-9)


def named(tree: ast.Module) -> Iterator[str]:
    """Names that a module defines, imports, imports from or takes from the public face, and texts that it
    tells things apart by: keys of tables, what is compared, members of lists, choices.
    """
    yield from (node.name for node in tree.body if isinstance(node, ast.FunctionDef))
    for node in ast.walk(tree):
        texts: list[ast.expr | None] = []
        if isinstance(node, ast.ImportFrom):
            yield from (*(node.module or "").split("."), *(alias.name for alias in node.names))
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "sb":
            yield node.attr
        elif isinstance(node, ast.Dict):
            texts = node.keys
        elif isinstance(node, ast.Compare):
            texts = [node.left, *node.comparators]
        elif isinstance(node, ast.Tuple | ast.List | ast.Set):
            texts = node.elts
        elif isinstance(node, ast.Subscript):
            texts = [node.slice]
        elif isinstance(node, ast.MatchValue):
            texts = [node.value]
        yield from (t.value for t in texts if isinstance(t, ast.Constant) and isinstance(t.value, str))


def test_an_analysis_is_known_to_few_files():
    """Of the package's files at most five name a public analysis in their code."""
    analyses = [name for name in sb.__all__ if hasattr(getattr(sb, name), "options")]
    assert len(analyses) >= 18 and {"static", "backbone", "basins", "swept_response"} <= set(analyses)
    found: dict[str, list[str]] = {name: [] for name in analyses}
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text()
        if words := found.keys() & set(re.findall(r"\w+", text)):  # before it is parsed
            for name in words & set(named(ast.parse(text))):
                found[name].append(str(path.relative_to(PACKAGE)))
    assert all(len(files) >= 2 for files in found.values())
    assert {name: files for name, files in found.items() if len(files) > MOST} == {}
