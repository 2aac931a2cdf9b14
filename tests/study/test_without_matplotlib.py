"""Where Matplotlib is missing all else runs, and what draws says so."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.study.small_case import CASE

# None in its place lets an import of it fail as that of a package that is not installed.
PROGRAM = "import sys; sys.modules['matplotlib'] = None; from sbfem_petsc.cli import main; main()"
MISSING = "pictures need matplotlib"


@pytest.mark.slow
def test_the_command(tmp_path):
    """Cases run, with a line that tells of the pictures, and have their report; pictures alone are refused
    with the package that is missing.
    """
    case = CASE[: CASE.index("[analyses.steady]")] + "[output]\npictures = true\nvtu = true\n"
    (tmp_path / "case.toml").write_text(case)

    def told(*arguments: str, code: int = 0) -> str:
        command = [sys.executable, "-c", PROGRAM, *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr

    assert MISSING in told("run", "case.toml", "--output", "out") and not [*tmp_path.rglob("*.png")]
    assert (tmp_path / "out/pictures/push.vtu").exists() and (tmp_path / "out/results.h5").exists()
    told("report", "out")
    for arguments in (("plot", "out"), ("mesh", "case.toml")):
        said = told(*arguments, code=1)
        assert MISSING in said and "pip install" in said and "Traceback" not in said


def test_names_of_pictures_say_what_is_missing():
    program = "import sys; sys.modules['matplotlib'] = None; from sbfem_petsc.plot import plot_modes"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1 and f"ImportError: {MISSING}" in done.stderr
