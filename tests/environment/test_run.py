"""The script ``run``: which environment it takes, and what it says where there is none. Nothing is installed
here.

Each test works on a copy of the script in a directory of its own (with a blank in its name). The commands
that could change the machine are replaced by stubs that write their name into a file and fail, so a test also
sees what was started.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BASH = shutil.which("bash")
MODULES = "petsc4py slepc4py mpi4py numpy scipy numba gmsh meshio shapely h5py rich pydantic".split()
STUBBED = "python python3 pip pip3 apt-get apt-cache dpkg dpkg-query sudo".split()

pytestmark = pytest.mark.skipif(BASH is None or os.name != "posix", reason="run is a bash script")


def write_script(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)


class Project:
    """A copy of ``run`` and ``pyproject.toml`` beside stubs of everything that could change the machine."""

    def __init__(self, directory):
        self.directory = directory / "a project"
        self.directory.mkdir()
        self.venv = self.directory / ".venv"
        self.started = directory / "started"
        self.started.touch()
        self.stubs = directory / "stubs"
        for name in STUBBED:
            write_script(self.stubs / name, f'echo {name} >>"{self.started}"\nexit 99\n')
        for name in ("run", "pyproject.toml"):
            shutil.copy(ROOT / name, self.directory)
        self.environment = {"PATH": f"{self.stubs}:/usr/local/bin:/usr/bin:/bin", "HOME": str(directory)}

    def _bash(self, arguments, variables=None, **options):
        options = {"cwd": self.directory, "input": "", **options}
        return subprocess.run(
            [BASH, *map(str, arguments)],
            env={**self.environment, **(variables or {})},
            capture_output=True,
            text=True,
            timeout=300,
            **options,
        )

    def run(self, *command, **options):
        return self._bash([self.directory / "run", *command], **options)

    def function(self, text, **options):
        """Executes ``text`` with the functions of ``run``."""
        return self._bash(["-c", f"source ./run\n{text}"], **options)

    def stamp(self):
        """Makes a .venv that counts as complete and holds one command, ``tool``."""
        write_script(self.venv / "bin" / "tool", "echo the tool of .venv\n")
        assert self.function('stamp_text >"$stamp"').returncode == 0

    def commands_started(self):
        return self.started.read_text().split()


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path)


@pytest.fixture
def ready(project):
    project.stamp()
    return project


def fake_environment(directory, modules):
    """An environment whose Python finds ``modules`` and the standard library only."""
    for name in modules:
        (directory / "modules" / name).mkdir(parents=True)
        (directory / "modules" / name / "__init__.py").touch()
    write_script(
        directory / "bin" / "python", f'PYTHONPATH="{directory}/modules" exec "{sys.executable}" -S "$@"\n'
    )
    return {"VIRTUAL_ENV": str(directory)}


def test_without_a_command_it_prints_its_usage(project):
    result = project.run()
    assert result.returncode == 2
    assert result.stderr.startswith("usage: ./run COMMAND") and result.stdout == ""
    assert not project.venv.exists()


class TestReadyEnvironment:
    def test_the_command_gets_its_arguments_input_output_and_exit_code(self, ready):
        result = ready.run(
            "sh", "-c", 'cat; echo "$1|$2"; exit 3', "sh", "two words", "*", input="from stdin\n"
        )
        assert (result.returncode, result.stdout, result.stderr) == (3, "from stdin\ntwo words|*\n", "")

    def test_it_starts_no_python_and_no_installer(self, ready):
        assert ready.run("tool").stdout == "the tool of .venv\n"
        assert ready.commands_started() == []

    def test_it_takes_under_0_3_seconds_of_a_processor(self, ready):
        def seconds():
            start = os.times()
            ready.run("true")
            return sum(os.times()[2:4]) - sum(start[2:4])  # of children, whatever else the machine does

        assert min(seconds() for _ in range(5)) < 0.3  # 0.02 s

    def test_it_works_from_another_directory_and_through_a_link(self, ready, tmp_path):
        (tmp_path / "link").symlink_to(ready.directory)
        for script in (ready.directory / "run", tmp_path / "link" / "run", Path("link/run")):
            result = ready._bash([script, "pwd"], cwd=tmp_path)
            assert (result.returncode, result.stdout.strip()) == (0, str(tmp_path.resolve()))

    def test_variables_pass_through(self, ready):
        given = {
            "OMP_NUM_THREADS": "7",
            "OPENBLAS_NUM_THREADS": "",
            "PETSC_OPTIONS": "-log_view",
            "PYTHONPATH": "/x y:/z",
        }
        names = [*given, "VIRTUAL_ENV"]
        result = ready.run("sh", "-c", "".join(f'echo "${name}";' for name in names), variables=given)
        root = ready.directory.resolve()
        assert result.stdout.splitlines() == ["7", "", "-log_view", f"{root}:/x y:/z", f"{root}/.venv"]

    def test_defaults(self, ready):
        names = (
            "OMP_NUM_THREADS OPENBLAS_NUM_THREADS OMPI_MCA_rmaps_base_oversubscribe "
            "PRTE_MCA_rmaps_default_mapping_policy PYTHONPATH"
        )
        result = ready.run("sh", "-c", "".join(f'echo "${name}";' for name in names.split()))
        assert result.stdout.splitlines() == ["1", "1", "1", ":oversubscribe", str(ready.directory.resolve())]

    def test_inside_itself_it_changes_nothing_more(self, ready):
        script = str(ready.directory / "run")
        once, twice = (
            ready.run(*outer, "sh", "-c", 'echo "$PYTHONPATH $VIRTUAL_ENV"').stdout
            for outer in ([], [script])
        )
        assert once == twice and once.strip()

    def test_an_unknown_command_is_named(self, ready):
        result = ready.run("no-such-command")
        assert (
            result.returncode == 127
            and "no-such-command: no such command in the environment" in result.stderr
        )


class TestStamp:
    """An environment counts as ready only with a stamp that fits."""

    @staticmethod
    def is_ready(project):
        result = project.function("take_ready_venv && echo ready; true")
        assert result.returncode == 0, result.stderr
        return result.stdout == "ready\n"

    def test_complete(self, ready):
        assert self.is_ready(ready)

    def test_interrupted(self, ready):
        (ready.venv / "made-by-run").unlink()
        assert not self.is_ready(ready)

    def test_other_requirements(self, ready):
        """Those of the environment, not what other tools keep in the same file."""
        requirements = ready.directory / "pyproject.toml"
        requirements.write_text(requirements.read_text().replace("line-length = 110", "line-length = 80"))
        assert self.is_ready(ready)
        requirements.write_text(requirements.read_text().replace('"h5py>=', '"h5py>=9'))
        assert not self.is_ready(ready)

    @pytest.mark.parametrize(
        "command",
        [
            "pytest -q",
            "ruff check .",
            "python -m mypy",
            "python benchmarks/modal.py",
            "python -m tests.validation",
        ],
    )
    def test_developers_packages_come_with_their_first_command(self, ready, command):
        """Until then a user's environment does without; from then on every command finds it ready."""
        result = ready.function(f"""
            report() {{ take_ready_venv && echo ready || echo "${{extras[*]}}"; }}
            (choose_extras sbfem run case.toml; report)
            (choose_extras {command}; report; take_venv "$root/.venv"; stamp_text >"$stamp")
            choose_extras python examples/beam_notch.py; report""")
        assert result.stdout.splitlines() == ["ready", "plot test dev docs", "ready"], result.stderr

    def test_moved(self, ready, tmp_path):
        ready.directory = ready.directory.rename(tmp_path / "moved")
        assert not self.is_ready(ready)


# What would install something is replaced: a folder with one file, slowly or killed on the way.
MAKING = """
step() {
    [[ ${SLOW-} != "$1" ]] || sleep 1
    [[ ${KILLED-} != "$1" ]] || kill -KILL $BASHPID
}
install_system_packages() { step system; }
quietly() { step venv; touch "$venv/python"; }
fill_venv() { echo half >"$venv/content"; step fill; echo whole >"$venv/content"; }
compile_kernels() { :; }
compile_other_kernels() { :; }
link_system_petsc() { step link; }
check_venv() { step check; }
mv() { step stamp; command mv "$@"; }
rm() { [[ $1 != -f ]] || step last; command rm "$@"; }
"""
STEPS = "system venv fill link check stamp last".split()


@pytest.mark.skipif(shutil.which("flock") is None, reason="no flock on this system")
class TestMaking:
    """Environments are made beside what is there, which is neither changed nor removed; what an interrupted
    ./run has begun counts for nothing.
    """

    @staticmethod
    def make(project, *command, **variables):
        text = f"{MAKING}\nchoose_extras {' '.join(command)}\nmake_venv_alone; echo $venv"
        return project.function(f"set -e\n{text}", variables=variables)

    @staticmethod
    def contents(folder):
        return {path: path.stat().st_mtime_ns for path in (folder, *folder.rglob("*"))}

    def changed_requirements(self, project):
        path = project.directory / "pyproject.toml"
        path.write_text(path.read_text().replace('"h5py>=', '"h5py>=9'))

    def test_a_change_is_made_beside(self, project):
        first = self.make(project, "python")
        assert first.stdout == f"{project.venv}\n", first.stderr
        before = self.contents(project.venv)
        self.changed_requirements(project)
        second = self.make(project, "python")
        assert second.stdout == f"{project.venv}-2\n", second.stderr
        assert f"{project.venv} stays as it is, for programs that use it: remove it" in second.stderr
        assert self.contents(project.venv) == before
        # another ./run finds it, makes nothing and says nothing
        again = self.make(project, "python")
        assert (again.stdout, again.stderr) == (f"{project.venv}-2\n", "")

    @pytest.mark.parametrize("step", STEPS)
    def test_killed_at_any_step(self, project, step):
        assert self.make(project, "python").returncode == 0
        before = self.contents(project.venv)
        self.changed_requirements(project)
        killed = self.make(project, "pytest", KILLED=step)
        assert killed.returncode != 0 and killed.stdout == ""
        assert self.contents(project.venv) == before
        found = self.make(project, "pytest")
        assert found.stdout == f"{project.venv}-2\n", found.stderr
        assert Path(f"{project.venv}-2/content").read_text() == "whole\n"
        assert self.contents(project.venv) == before
        assert sorted(path.name for path in project.directory.glob(".venv*")) == [
            ".venv",
            ".venv-2",
            ".venv.lock",
        ]

    @pytest.mark.parametrize("step", STEPS[:-1])
    def test_a_first_start_that_was_killed(self, project, step):
        assert self.make(project, "python", KILLED=step).returncode != 0
        assert not project.function("take_ready_venv && echo ready; true").stdout
        found = self.make(project, "python")
        assert found.stdout == f"{project.venv}\n" and (project.venv / "content").read_text() == "whole\n"

    @pytest.mark.parametrize("what", ["a file", "a folder", "a link"])
    def test_what_it_did_not_make_stays(self, project, tmp_path, what):
        """An environment of a user's own, or one that another version of this script has left half made."""
        (tmp_path / "theirs" / "lib").mkdir(parents=True)
        if what == "a file":
            project.venv.touch()
        elif what == "a folder":
            shutil.copytree(tmp_path / "theirs", project.venv)
        else:
            (tmp_path / "theirs" / "unfinished").touch()
            project.venv.symlink_to(tmp_path / "theirs")
        before = self.contents(project.venv) | self.contents(tmp_path / "theirs")
        assert self.make(project, "python").stdout == f"{project.venv}-2\n"
        assert self.contents(project.venv) | self.contents(tmp_path / "theirs") == before

    def test_extras_only_grow(self, project):
        """Also where the requirements have changed meanwhile and a command of a user's makes the next one."""
        assert self.make(project, "pytest").stdout == f"{project.venv}\n"
        assert self.make(project, "python").stdout == f"{project.venv}\n"
        self.changed_requirements(project)
        assert self.make(project, "python").stdout == f"{project.venv}-2\n"
        assert self.make(project, "pytest").stdout == f"{project.venv}-2\n"

    @pytest.mark.parametrize("first, made", [("pytest", [".venv"]), ("python", [".venv", ".venv-2"])])
    def test_two_at_once(self, project, first, made):
        """One makes it, the other waits and takes it if it is enough: neither takes what the other has."""
        second = "python" if first == "pytest" else "pytest"
        result = project.function(f"""{MAKING}
            SLOW=fill
            (choose_extras {first}; make_venv_alone; echo "$venv") &
            until [[ -e $root/.venv/content ]]; do sleep 0.05; done
            (choose_extras {second}; make_venv_alone; echo "$venv") & wait""")
        found = [Path(line).name for line in result.stdout.splitlines()]
        assert found == [".venv", made[-1]], result.stderr
        assert result.stderr.count("waiting for another ./run") == 1
        assert [path.parent.name for path in sorted(project.directory.glob(".venv*/made-by-run"))] == made

    def test_of_several_at_once_one_makes_it_and_the_others_wait(self, project):
        result = project.function(f"""{MAKING}
            fill_venv() {{ echo made; sleep 0.5; }}
            make_venv_alone & make_venv_alone & make_venv_alone & wait; take_ready_venv && echo ready""")
        assert result.stdout.split() == ["made", "ready"], result.stderr
        assert result.stderr.count("waiting for another ./run") == 2


class TestActiveEnvironment:
    """An environment of the user's with petsc4py and slepc4py is used as it is, whatever .venv there may
    be.
    """

    def test_complete(self, ready, tmp_path):
        variables = fake_environment(tmp_path / "my env", MODULES)
        result = ready.run("sh", "-c", 'echo "$VIRTUAL_ENV"; command -v python', variables=variables)
        assert result.stdout.splitlines() == [f"{tmp_path}/my env", f"{tmp_path}/my env/bin/python"], (
            result.stderr
        )
        assert ready.commands_started() == []

    @pytest.mark.parametrize("missing", [["gmsh"], ["gmsh", "h5py"]])
    def test_without_other_modules_it_says_how_to_add_them(self, ready, tmp_path, missing):
        variables = fake_environment(tmp_path / "env", [name for name in MODULES if name not in missing])
        result = ready.run("true", variables=variables)
        assert result.returncode == 1
        assert f'"{tmp_path}/env/bin/python" -m pip install {" ".join(missing)}\n' in result.stderr
        assert "but not " + " ".join(missing).replace(" ", ", ") + ":" in result.stderr
        assert result.stderr.count("\n") == 1 and ready.commands_started() == []

    @pytest.mark.parametrize("missing", ["petsc4py", "slepc4py"])
    def test_without_petsc_it_is_left_aside(self, ready, tmp_path, missing):
        variables = fake_environment(tmp_path / "env", [name for name in MODULES if name != missing])
        assert ready.run("tool", variables=variables).stdout == "the tool of .venv\n"

    def test_conda(self, ready, tmp_path):
        prefix = fake_environment(tmp_path / "env", MODULES)["VIRTUAL_ENV"]
        assert (
            ready.run("sh", "-c", "command -v python", variables={"CONDA_PREFIX": prefix}).stdout
            == f"{prefix}/bin/python\n"
        )

    def test_modules_on_pythonpath(self, ready, tmp_path):
        fake_environment(tmp_path / "env", MODULES)
        write_script(tmp_path / "bin" / "python3", f'exec "{sys.executable}" -S "$@"\n')
        variables = {
            "PATH": f"{tmp_path}/bin:{ready.environment['PATH']}",
            "PYTHONPATH": str(tmp_path / "env" / "modules"),
        }
        result = ready.run("sh", "-c", 'echo "$VIRTUAL_ENV|"; command -v python3', variables=variables)
        assert result.stdout.splitlines() == ["|", f"{tmp_path}/bin/python3"], result.stderr


class TestNoEnvironment:
    def test_elsewhere_it_says_what_to_install(self, project, tmp_path):
        tools = tmp_path / "tools"  # a system without apt-get
        tools.mkdir()
        for name in ("bash", "cat", "cksum", "dirname", "env", "head", "readlink", "sed"):
            (tools / name).symlink_to(shutil.which(name))
        result = project.run("true", variables={"PATH": str(tools)})
        assert result.returncode == 1 and result.stderr.count("\n") == 1
        assert "conda env create -f environment.yml" in result.stderr
        assert "pip install petsc petsc4py slepc slepc4py" in result.stderr

    def test_who_is_not_root_is_told_what_root_must_do(self):
        os_release = Path("/etc/os-release")
        if (
            not os_release.exists()
            or "debian" not in os_release.read_text()
            or shutil.which("apt-get") is None
        ):
            pytest.skip("for Debian and Ubuntu")
        options = {"user": 65534, "group": 65534, "extra_groups": []} if os.geteuid() == 0 else {}
        with tempfile.TemporaryDirectory() as directory:
            project = Project(Path(directory))
            for path in (Path(directory), *Path(directory).rglob("*")):
                path.chmod(0o777)
            result = project.run("true", **options)
            assert result.returncode == 1
            assert (
                "apt-get update && apt-get install --no-install-recommends python3-petsc4py python3-slepc4py"
                in result.stderr
            )
            assert not {"apt-get", "dpkg", "pip"} & set(project.commands_started())

    @pytest.mark.parametrize("version, pinned", [("1.24.2", True), ("2.2.4", False), ("10.0.0", False)])
    def test_numpy_stays_below_2_where_the_system_petsc4py_needs_it(self, project, version, pinned):
        if sys.version_info < (3, 11):
            pytest.importorskip("pip._vendor.tomli")
        write_script(project.venv / "bin" / "python", f'exec "{sys.executable}" "$@"\n')
        write_script(project.directory / "python3", f"echo {version}\n")
        result = project.function("choose_extras pytest; system_python=$PWD/python3; requirements")
        assert result.returncode == 0, result.stderr
        requirements = result.stdout.splitlines()
        assert ("numpy<2" in requirements) == pinned
        names = {re.match(r"[\w.-]+", requirement)[0] for requirement in requirements}
        # what the program needs, pictures, tests, and the tools that .ci/run calls
        assert {"setuptools", "gmsh", "matplotlib", "pytest", "pytest-xdist", "ruff", "mypy"} <= names
        assert not {"petsc4py", "slepc4py", "mpi4py"} & names
