"""PETSc reads no options file, neither of the working directory nor of the user's home; numba and Matplotlib
read none of the working directory.
"""

import os
import subprocess
import sys

import pytest

from sbfem_petsc.petsc import PETSc
from tests.parallel import ROOT

PROGRAMS = {
    "command with options": ["-m", "sbfem_petsc", "doctor", "--", "-static_ksp_rtol", "1e-9"],
    "program": [
        "-c",
        "from sbfem_petsc.command_line import Parser; Parser('').parse([]); import sbfem_petsc.petsc",
    ],
}


def of_a_stranger(tmp_path, text):
    """A home, a working directory and a spare one, with options files in the first two."""
    home, here, spare = (tmp_path / name for name in ("home", "here", "spare"))
    for place in (home, here, spare):
        place.mkdir()
    for place in (home / ".petscrc", here / ".petscrc", here / "petscrc"):
        place.write_text(text(spare, place))
    return home, here, spare


def outputs(words, folder, **environment):
    """What Python prints, with such variables of its environment and none of matplotlib's or MPI's."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI", "PMI", "MATPLOTLIB"))}
    alone = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_ALLOW_RUN_AS_ROOT": "1"}
    alone |= {"OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=kept | alone | environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    return done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("program", ["program", pytest.param("command with options", marks=pytest.mark.long)])
def test_no_options_file_is_read(program, tmp_path):
    """-log_view writes a file: those of the two directories do not; PETSC_OPTIONS, the user's own, holds."""
    home, here, spare = of_a_stranger(
        tmp_path,
        lambda spare, place: f"-log_view :{spare}/{place.parent.name}{place.name}\n-no_such_option 1\n",
    )
    (here / "matplotlibrc").write_text("font.sans-serif: 17\n nonsense")
    said = outputs(PROGRAMS[program], here, HOME=str(home), PETSC_OPTIONS="-own_option 1 -options_left")
    assert os.listdir(spare) == [] and "no_such_option" not in said, said
    assert "own_option" in said and "Traceback" not in said and "Bad value" not in said, said
    assert "font" in said or "doctor" not in PROGRAMS[program]


MESHES = {
    "gmsh alone": "import gmsh; gmsh.initialize([], readConfigFiles=False); gmsh.finalize()",
    "beam": "from meshing import Beam; Beam(1.0, 0.1).mesh(order=2)",
    "file": "from meshing import Beam, read_gmsh; Beam(1.0, 0.1).write('b.geo_unrolled');"
    "read_gmsh('b.geo_unrolled', order=2)",
}


@pytest.mark.slow
@pytest.mark.parametrize("program", MESHES)
def test_no_options_file_is_read_by_the_petsc_inside_gmsh(program, tmp_path):
    """-info writes a file: when gmsh is started by itself it does."""
    home, here, spare = of_a_stranger(tmp_path, lambda spare, place: f"-info {spare}/told\n")
    environment = {**os.environ, "HOME": str(home), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", MESHES[program]],
        cwd=here,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert bool(os.listdir(spare)) == (program == "gmsh alone")


LIBRARIES = {
    "numba": (
        ".numba_config.yaml",
        "cache_dir: {here}/cache\nopt: 0\n",
        "import sbfem_petsc.continuation.multipliers, sbfem_petsc.contact.marching as m\n"
        "from numba.core import config; import numpy as np\n"
        "from sbfem_petsc.contact.compiled import compiled\n"
        "compiled(lambda x: x + 1.0)(2.0); print(config.OPT, config.CACHE_DIR)",
    ),
    "matplotlib": (
        "matplotlibrc",
        "savefig.dpi: 17\nbackend: module://evil\n",
        "from sbfem_petsc.plot import save_picture\n"
        "import matplotlib as m; print(m.rcParams['savefig.dpi'], m.matplotlib_fname())",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["matplotlib", pytest.param("numba", marks=pytest.mark.long)])
def test_no_settings_of_libraries_are_read(name, tmp_path):
    """Those of a stranger's folder would have code run by Matplotlib and the kept code of numba read there;
    the working directory is the same afterwards.
    """
    file, text, program = LIBRARIES[name]
    (tmp_path / file).write_text(text.format(here=tmp_path))
    (tmp_path / "evil.py").write_text("print('evil')")
    program = f"{program}\nimport os; print(os.getcwd())"
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI", "PMI", "MATPLOTLIB"))}
    environment |= {"PYTHONPATH": str(ROOT), "OMPI_MCA_ess_singleton_isolated": "1"}
    environment |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    said = done.stdout + done.stderr
    assert "Traceback" not in said and "evil" not in said and "Bad value" not in said, said
    assert {"numba": "(3)", "matplotlib": "figure "}[name] in said, said
    assert said.splitlines()[-1] == str(tmp_path)
    assert sorted(os.listdir(tmp_path)) == sorted([file, "evil.py"])


@pytest.mark.slow
def test_options_of_the_environment_are_told(tmp_path):
    """As those of a command line: misspelt ones had been taken without a word."""
    words = ["-c", "import sbfem_petsc.petsc"]
    said = outputs(words, tmp_path, PETSC_OPTIONS="-statik_ksp_type cg -static_kps_type cg")
    assert "-statik_ksp_type belongs to no solve; is 'static_' meant" in said
    assert "name:-static_kps_type value: cg" in said.split("Option left", 1)[1]
    said = outputs(words, tmp_path, PETSC_OPTIONS="-ksp_type cg -on_error_abort -start_in_debugger_x 0")
    assert "belongs to no solve" not in said, said  # PETSc's own
    if PETSc.Sys.getVersion() < (3, 19):  # 3.22 tells of them unasked
        assert "left" not in said, said
