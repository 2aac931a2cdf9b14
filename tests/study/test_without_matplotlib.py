"""Where Matplotlib is missing all else runs, and what draws says so."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.study.small_case import CASE

# None in its place lets an import of it fail as that of a package that is not installed.
PROGRAM = """
import sys
sys.modules["matplotlib"] = None
from sbfem_petsc.cli import main
for words in sys.argv[1:]:
    try:
        main(words.split())
        code = 0
    except SystemExit as ended:
        code = ended.code or 0
    print("ended with", code, flush=True)
"""
MISSING = "pictures need matplotlib"


@pytest.mark.long
def test_the_command(tmp_path):
    """Cases run, with a line that tells of the pictures, and have their report; pictures alone are refused
    with the package that is missing.
    """
    case = CASE[: CASE.index("[analyses.steady]")] + "[output]\npictures = true\nvtu = true\n"
    (tmp_path / "case.toml").write_text(case)
    words = ("run case.toml --output out", "report out", "plot out", "mesh case.toml")
    command = [sys.executable, "-c", PROGRAM, *words]
    done = subprocess.run(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout
    said = done.stdout.split("ended with ")
    assert [part[0] for part in said[1:]] == ["0", "0", "1", "1"], done.stdout
    assert MISSING in said[0] and not [*tmp_path.rglob("*.png")]
    assert (tmp_path / "out/pictures/push.vtu").exists() and (tmp_path / "out/results.h5").exists()
    for text in said[2:4]:
        assert MISSING in text and "pip install" in text and "Traceback" not in text


def test_names_of_pictures_say_what_is_missing():
    program = "import sys; sys.modules['matplotlib'] = None; from sbfem_petsc.plot import plot_modes"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1 and f"ImportError: {MISSING}" in done.stderr
