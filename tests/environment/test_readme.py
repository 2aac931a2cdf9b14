"""What the README and the pages beside it say can be checked by a program: links, names, the program."""

import ast
import importlib
import re
from pathlib import Path

import pytest

import sbfem_petsc

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "VALIDATION.md", "SECURITY.md")]
PAGES += sorted((ROOT / "docs").glob("*.md")) + sorted((ROOT / "docs/verification").glob("*.md"))


def program() -> str:
    """The README's."""
    return re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[1]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text())
    assert not [link for link in links if "://" not in link and not (page.parent / link).exists()]


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120


def test_names_in_the_readmes_program_exist():
    tree = ast.parse(program())
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module)
            assert all(hasattr(module, alias.name) for alias in node.names)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "sb":
            assert node.attr in sbfem_petsc.__all__


def assert_printed(shown: str, printed: str) -> None:
    """What a page shows stands in what is printed, piece by piece between its dots, numbers to 1e-5."""
    number = r"(-?\d+(?:\.\d+)?(?:e[+-]\d+)?)"
    for piece in filter(None, (piece.strip(" ;)") for piece in re.split(r"\.\.\.|\n", shown))):
        words = re.split(number, piece)[::2]
        found = re.search(number.join(map(re.escape, words)), printed)
        assert found, piece
        values = [list(map(float, numbers)) for numbers in (found.groups(), re.findall(number, piece))]
        assert values[0] == pytest.approx(values[1], rel=1e-5)
        printed = printed[found.end() :]


@pytest.mark.long
def test_the_readmes_program_prints_what_stands_there(tmp_path, monkeypatch, capsys):
    """Piece by piece between its dots, numbers to the digits of all machines, and draws its picture."""
    monkeypatch.chdir(tmp_path)
    exec(compile(program(), "README.md", "exec"), {})
    shown = re.search(r"It prints\n\n```\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[1]
    assert_printed(shown, capsys.readouterr().out)
    assert (tmp_path / "response.png").stat().st_size > 10_000
