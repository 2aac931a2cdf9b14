"""PETSc reads no options file: neither of the working directory nor of the user's home."""

import os
import subprocess
import sys

import pytest

from tests.parallel import ROOT

PROGRAMS = {
    "import": ["-c", "import sbfem_petsc.petsc"],
    "command": ["-m", "sbfem_petsc", "doctor"],
    "command with options": ["-m", "sbfem_petsc", "doctor", "--", "-static_ksp_rtol", "1e-9"],
    "program": [
        "-c",
        "from sbfem_petsc.command_line import Parser; Parser('').parse([]); import sbfem_petsc.petsc",
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_no_options_file_is_read(program, tmp_path):
    """-log_view writes a file: those of the two directories do not; PETSC_OPTIONS, the user's own, holds."""
    home, here, spare = (tmp_path / name for name in ("home", "here", "spare"))
    for place in (home, here, spare):
        place.mkdir()
    for place in (home / ".petscrc", here / ".petscrc", here / "petscrc"):
        place.write_text(f"-log_view :{spare}/{place.parent.name}{place.name}\n-no_such_option 1\n")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI", "PMI"))}
    environment |= {
        "HOME": str(home),
        "PYTHONPATH": str(ROOT),
        "PETSC_OPTIONS": "-own_option 1 -options_left",
        "OMPI_MCA_ess_singleton_isolated": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    done = subprocess.run(
        [sys.executable, *PROGRAMS[program]],
        cwd=here,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    said = done.stdout + done.stderr
    assert os.listdir(spare) == [] and "no_such_option" not in said, said
    assert "own_option" in said, said
