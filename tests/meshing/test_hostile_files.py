"""Files from strangers: nothing in them is executed, nothing is written, and the process goes on.

Two walls are tried one by one: the check of the content against the ending, and the child process that may
read the file's folder and compute, and nothing else.
"""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from meshing import GmshWarning, read_gmsh
from meshing.gmsh import confined, reader
from tests.parallel import on_ranks

needs_landlock = pytest.mark.skipif(not confined.landlock_version(), reason="this kernel has no Landlock")
KEPT = {
    "PATH",
    "LANG",
    "LC_ALL",
    "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
}

SQUARE = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Physical Surface("steel") = {1};
Mesh.MeshSizeMax = 0.5;
"""

PLAIN = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "steel"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
1
1 3 2 1 1 1 2 3 4
$EndElements
"""

# Statements that would leave a file MARK behind, start a process, end the process, or read what is not the
# model's, and a part of the sentence that refuses them.
PROGRAM, WRITES, OUTSIDE = (
    "it starts a program",
    "only read files in its folder",
    "outside the model's folder",
)
NOT_READ = "gmsh cannot read or mesh it"
HOSTILE = {
    "system call": ('SystemCall "touch MARK";', PROGRAM),
    "computed": ('SystemCall StrCat("touch ", "MARK");', PROGRAM),
    "system": ('System "touch MARK";', PROGRAM),
    "in the background": ('NonBlockingSystemCall "touch MARK";', PROGRAM),
    "fork bomb": ("SystemCall ':(){ :|:& };: ; touch MARK';", PROGRAM),
    "fork bombs in the background": (
        "For i In {1:99}\n  NonBlockingSystemCall 'sh -c \"sleep 99 & touch MARK\"';\nEndFor",
        PROGRAM,
    ),
    "between comments": ('/* a */ SystemCall /* b */ "touch MARK"; // c', PROGRAM),
    "after a comment that seems longer": ('/* // */ SystemCall "touch MARK";', PROGRAM),
    "after a string that seems longer": ("x = \"'\"; SystemCall 'touch MARK';", PROGRAM),
    "over lines": ('SystemCall\n\n"touch MARK"\n;', PROGRAM),
    "in a loop": ('For i In {1:2}\n  SystemCall "touch MARK";\nEndFor', PROGRAM),
    "in a macro": ('Macro m\n  SystemCall "touch MARK";\nReturn\nCall m;', PROGRAM),
    "in a macro of text": ('Macro("m", "SystemCall \'touch MARK\';");\nCall m;', NOT_READ),
    "in a macro of built text": (
        'Macro("m", StrCat("System", "Call \'touch MARK\';"));\nCall m;',
        NOT_READ,
    ),
    "by a built name": ('StringToName["SystemCall"] "touch MARK";', PROGRAM),
    "by a built name, in short": ('S2N[StrCat["System", "Call"]] "touch MARK";', PROGRAM),
    "by a numbered name": ('a~{1} "touch MARK";', NOT_READ),
    "hidden in a skipped branch": (
        'If(0)\nIf("EndIf EndIf SystemCall " == "touch MARK")\nEndIf\nEndIf',
        NOT_READ,
    ),
    "hidden behind a letter": ('If(0)\nE"EndIf SystemCall ";touch MARK;"";', NOT_READ),
    "hidden in a name": ('If(0)\nx1EndIf1; SystemCall "touch MARK";', NOT_READ),
    "after a zero byte": ('// a\0\nSystemCall "touch MARK";', PROGRAM),
    "after an open string": ('x = "a;\nSystemCall "touch MARK";', NOT_READ),
    "far out on a line": ("x = 1;" * 3000 + 'SystemCall "touch MARK";', PROGRAM),
    "through ONELAB": ('OnelabRun("x", "touch MARK");', PROGRAM),
    "as a field": (
        'Field[1] = ExternalProcess; Field[1].CommandLine = "touch MARK"; Background Field = 1;',
        PROGRAM,
    ),
    "as a plugin": ("Plugin(Crack).Run;", NOT_READ),
    "as a plugin, then a view": (
        'Plugin(NewView).Run;\nPlugin(ModifyComponents).View = 0;\nSave View[0] "MARK.pos";',
        NOT_READ,
    ),
    "exit": ("Exit;", r"must not end gmsh \(Exit\)"),
    "exit with a code": ("Exit 3;", r"with code 3 .* must not end gmsh \(Exit\)"),
    "print to a file": ('Printf("hello") > "MARK";', WRITES),
    "print to a file above": ('Printf("hello") > "../MARK";', WRITES),
    "print over the model": ('Printf("hello") > "model.geo";', WRITES),
    "append to a file": ('Printf("a %g", 1) >> "MARK";', WRITES),
    "the environment into a file": ('Printf(GetEnv("HOME")) > "MARK";', WRITES),
    "a picture": ('Print "MARK.png";', NOT_READ),
    "a mesh": ('Mesh 2; Save "MARK.msh";', WRITES),
    "the geometry": ('Save "MARK.geo_unrolled";', WRITES),
    "a device": ('Printf("hello") > "/dev/shm/MARK";', WRITES),
    "into the answer": (
        'For i In {0:20}\n  Printf("forged") > Sprintf("/proc/self/fd/%g", i);\nEndFor',
        "only read files in its folder",
    ),
    "into the answer by its number": (
        'Printf("forged") > "/proc/self/fd/3";',
        "only read files in its folder",
    ),
    "into the other end": ('Printf("forged") > "/proc/self/fd/1";', "only read files in its folder"),
    "on after errors": ("General.AbortOnError = 0;\nx = y;\nPrint = 3;", NOT_READ),
    "on after a file": ('General.AbortOnError = 0; Include "/etc/passwd";', OUTSIDE),
    "on after a program": ('General.AbortOnError = 0; SystemCall "touch MARK";', PROGRAM),
    "a view": ('Save View[0] "MARK.pos";', NOT_READ),
    "a script elsewhere": ('Include "/etc/passwd";', f"'/etc/passwd', which is {OUTSIDE}"),
    "a mesh elsewhere": ('Merge "/etc/passwd";', f"'/etc/passwd', which is {OUTSIDE}"),
    "this process's environment": (
        'Include "/proc/self/environ";',
        f"'/proc/self/environ', which is {OUTSIDE}",
    ),
    "a script above": ('Include "../outside.geo";', f"'../outside.geo', which is {OUTSIDE}"),
    "a script through a folder": ('Include "sub/../../outside.geo";', OUTSIDE),
    "a script by a link": ('Include "link.geo";', f"'link.geo', which is {OUTSIDE}"),
    "a script by a linked folder": ('Merge "linked/outside.geo";', OUTSIDE),
    "a script by a built name": ('Include StrCat("/etc/", "passwd");', OUTSIDE),
    "a script in a script": ('Include "evil.geo";', PROGRAM),
    "a script in a script that is merged": ('Merge "evil.geo";', PROGRAM),
    "a script that seems a mesh": ('Merge "evil.msh";', PROGRAM),
    "options beside what is merged": ('Merge "plain.msh";', PROGRAM),
    "a script without an ending": ('Include "evil";', PROGRAM),
    "itself": ('Include "model.geo";', NOT_READ),
    "itself by a detour": ('Include "detour.geo";', NOT_READ),
    "a shape from elsewhere": ('a() = ShapeFromFile("../outside.brep");', OUTSIDE),
    "numbers from a file": ('a() = ListFromFile["/etc/passwd"];', OUTSIDE),
    "a loop without end": ("For i In {1:2}\ni = 1;\nEndFor", "did not finish within 1 s"),
    "a macro without end": ("Macro a\nCall a;\nReturn\nCall a;", "gmsh (crashed|did not finish)"),
    "words without end": (
        'General.Terminal = 1;\nFor i In {1:1e9}\nPrintf("a flood of words");\nEndFor',
        "did not finish within 1 s",
    ),
    "sleep without end": ("Sleep 1000;", "did not finish within 1 s"),
    "memory without end": ("x() = {1:1e12};", "memory"),
}
# What is tried in vain, and read: the process has no environment, makes no folders and runs no solvers.
IN_VAIN = {
    "the environment": 'x = GetEnv("HOME"); If (StrLen(x) > 0) SystemCall "touch MARK"; EndIf',
    "a secret": 'x = GetEnv("SECRET"); If (StrLen(x) > 0) SystemCall "touch MARK"; EndIf',
    "a folder": 'CreateDir "MARK";',
    "an option that is a file": 'General.ErrorFileName = "MARK";',
    "a solver": 'Solver.Executable0 = "/usr/bin/touch MARK";',
    "abort": 'Abort; SystemCall "touch MARK";',
    "a line end of old": '// comment\rSystemCall "touch MARK";',
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET", "0")
    place = tmp_path / "models"
    place.mkdir()
    for name in ("outside.geo", "outside.brep"):
        (tmp_path / name).write_text(SQUARE)
    (place / "link.geo").symlink_to(tmp_path / "outside.geo")
    (place / "linked").symlink_to(tmp_path)
    for name in ("evil.geo", "evil.msh", "evil", "plain.msh.opt"):
        (place / name).write_text(f'SystemCall "touch {place}/MARK";\n')
    (place / "plain.msh").write_text(PLAIN)
    (place / "detour.geo").write_text('Include "model.geo";\n')
    return place


def written(folder, statement, ending=".geo"):
    path = folder / f"model{ending}"
    path.write_text(SQUARE + statement.replace("MARK", f"{folder}/MARK") + "\n", newline="")
    return path


def check_nothing_is_done(folder, before):
    """No file made or changed, no process left in the folder."""
    assert {path: path.lstat().st_mtime_ns for path in folder.parent.rglob("*")} == before
    assert not Path("/dev/shm/MARK").exists()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            place, state = os.readlink(process / "cwd"), (process / "stat").read_text().split()[2]
        except OSError:  # it has ended
            continue
        assert state == "Z" or not place.startswith(str(folder)), process


def states(folder):
    return {path: path.lstat().st_mtime_ns for path in folder.parent.rglob("*")}


def refused(path, says):
    limit = 1.0 if "did not finish" in says else 30.0
    memory = 1e9 if says == "memory" else 2e9
    with pytest.raises(ValueError, match=says) as caught:
        read_gmsh(path, order=1, time_limit=limit, memory_limit=memory)
    sentence = str(caught.value)
    assert str(path) in sentence and "\n" not in sentence and sentence.endswith(".")


@needs_landlock
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (k % 6 != 3)) for k, n in enumerate(HOSTILE)]
)
def test_scripts(folder, name):
    """Refused in one sentence by what they try, whatever words they use."""
    statement, says = HOSTILE[name]
    path = written(folder, statement)
    before = states(folder)
    refused(path, says)
    check_nothing_is_done(folder, before)


@needs_landlock
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (k % 2)) for k, n in enumerate(IN_VAIN)]
)
def test_scripts_that_try_in_vain(folder, name):
    path = written(folder, IN_VAIN[name])
    before = states(folder)
    assert read_gmsh(path, order=1).area == pytest.approx(1.0, abs=1e-12)
    check_nothing_is_done(folder, before)


@pytest.mark.parametrize("ending", [".msh", ".step", ".brep", ".inp"])
@pytest.mark.parametrize("version", [None, 0])
def test_scripts_in_files_called_otherwise(folder, ending, version, monkeypatch):
    """Refused before a process is started, with Landlock and without: gmsh would go by the content."""
    monkeypatch.setattr(subprocess, "Popen", None)
    if version is not None:
        monkeypatch.setattr(reader, "landlock_version", lambda: version)
    for statement in [*(statement for statement, _ in HOSTILE.values()), *IN_VAIN.values()]:
        refused(written(folder, statement, ending), "its content is not")


@pytest.mark.parametrize("name", [*HOSTILE, *IN_VAIN])
def test_scripts_without_landlock(folder, name, monkeypatch):
    """Refused, whatever they hold, before a process is started."""
    monkeypatch.setattr(reader, "landlock_version", lambda: 0)
    monkeypatch.setattr(subprocess, "Popen", None)
    statement = HOSTILE[name][0] if name in HOSTILE else IN_VAIN[name]
    refused(written(folder, statement), "pass trust=True to read_gmsh if you know what it does")


def test_there_are_many():
    assert len(HOSTILE) + len(IN_VAIN) >= 53


@pytest.mark.parametrize("version", [None, 0])
def test_a_script_that_is_trusted(folder, version, monkeypatch):
    """It may start programs, write, and read elsewhere, with Landlock and without."""
    if version is not None:
        monkeypatch.setattr(reader, "landlock_version", lambda: version)
    path = folder / "model.geo"
    path.write_text('Include "../outside.geo";\nSystemCall "touch MARK-1";\nPrintf("a") > "MARK-2";\n')
    assert read_gmsh(path, order=1, trust=True).area == pytest.approx(1.0, abs=1e-12)
    assert sorted(found.name for found in folder.glob("MARK*")) == ["MARK-1", "MARK-2"]
    with pytest.raises(TypeError, match="read_gmsh: trust = 'yes' must be True or False"):
        read_gmsh(path, trust="yes")


@pytest.mark.parametrize(
    "ending",
    [
        ".msh",
        ".step",
        ".vtu",
        *(pytest.param(e, marks=pytest.mark.long) for e in (".brep", ".iges", ".inp", ".vtk")),
    ],
)
def test_data_without_landlock(tmp_path, ending, monkeypatch):
    """Read in the clean process, as with it."""
    meshio, gmsh = pytest.importorskip("meshio"), pytest.importorskip("gmsh")
    (tmp_path / "model.geo").write_text(SQUARE)
    path = tmp_path / f"plain{ending}"
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(str(tmp_path / "model.geo"))
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path.with_suffix(".vtk") if ending == ".vtu" else path))
    finally:
        gmsh.finalize()
    if ending == ".vtu":
        cells = meshio.read(path.with_suffix(".vtk"))
        meshio.write(path, meshio.Mesh(cells.points, {"triangle": cells.cells_dict["triangle"]}))
    with_it = read_gmsh(path, order=1)
    monkeypatch.setattr(confined, "landlock_version", lambda: 0)
    monkeypatch.setattr(reader, "landlock_version", lambda: 0)
    assert np.array_equal(read_gmsh(path, order=1).nodes, with_it.nodes)
    in_mm = ending in (".step", ".iges")
    assert with_it.area == pytest.approx(1e-6 if in_mm else 1.0, rel=1e-12)


HARMLESS = """// SystemCall "touch MARK"; in a comment
/* Exit; Save "MARK.msh";
   Include "/etc/passwd"; */
SetFactory("OpenCASCADE");
General.Terminal = 0; Mesh.SaveAll = 1; Print.Background = 1; Geometry.Points = 1;
DefineConstant[ a = {1, Min 0.5, Max 2, Step 0.5, Name "Parameters/width"} ];
Function side
  count = count + 1;
Return
count = 0; Call side;
If (count == 1)
  Printf("width %g 'single' quotes
  over two lines", a);
Else
  Error("no \\"); // a backslash is a character like others
EndIf
For i In {1 : 2}
  p~{i} = i;
EndFor
name = StrCat("st", Str("eel"));
Include "part.geo";
Rectangle(1) = {0, 0, 0, a, 1};
Field[1] = MathEval; Field[1].F = "0.3 + 0.1*x"; Background Field = 1;
Physical Surface("Exit") = {1};
Physical Curve("Save the \xe4rea > 1") = {1};
"""


def test_what_users_write_is_read(tmp_path):
    """Comments, parameters, loops, macros, fields and names that sound like commands."""
    (tmp_path / "part.geo").write_text("Mesh.MeshSizeMax = 0.5;")
    path = tmp_path / "model.geo"
    path.write_text("\ufeff" + HARMLESS, encoding="utf-8", newline="\r\n")
    mesh = read_gmsh(path, order=1)
    assert mesh.area == pytest.approx(1.0, abs=1e-12)
    assert mesh.material_names == ("Exit",) and list(mesh.edge_sets) == ["Save the \xe4rea > 1"]
    assert sorted(os.listdir(tmp_path)) == ["model.geo", "part.geo"]


PRETENDING = [
    *(".msh", ".h5", ".txt", ".step", ".stp", ".brep", ".iges", ".inp", ".vtu", ".vtk", ".GEO", ".Geo"),
    *(".pos", ".py", ".gz", ".opt", ".stl", ".med", ".unv", ".mesh", ".exe", ""),
]


@pytest.mark.parametrize("ending", PRETENDING)
def test_scripts_that_pretend_to_be_others(folder, ending):
    path = folder / f"model{ending}"
    path.write_text(f'SystemCall "touch {folder}/MARK";\nExit;\n')
    with pytest.raises(ValueError) as caught:
        read_gmsh(path, order=1)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert not list(folder.parent.rglob("*MARK*"))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        (
            "model.msh",
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\nCALL\n$Nodes\n$EndNodes\n$Elements\n$EndElements\n",
        ),
        ("model.msh", "CALL\n$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"),
        ("model.step", "ISO-10303-21;\nCALL\nEND-ISO-10303-21;\n"),
        (
            "model.brep",
            "CASCADE Topology V1\nCALL\nLocations 0\nCurve2ds 0\nCurves 0\nSurfaces 0\nTShapes 0\n\n+1 0\n",
        ),
        ("model.vtk", "# vtk DataFile Version 3.0\nCALL\nASCII\nDATASET UNSTRUCTURED_GRID\n"),
        ("model.inp", "*HEADING\nCALL\n*NODE\n1,0,0\n"),
        ("model.vtu", '<?xml version="1.0"?><VTKFile type="UnstructuredGrid">CALL</VTKFile>'),
    ],
)
def test_right_beginnings_with_commands_behind(folder, name, content):
    path = folder / name
    path.write_text(content.replace("CALL", f'SystemCall "touch {folder}/MARK";'))
    with pytest.raises(ValueError):
        read_gmsh(path, order=1, time_limit=20.0)
    assert not list(folder.parent.rglob("*MARK*"))


def test_what_lies_beside_the_file(folder):
    """gmsh runs plate.msh.opt with plate.msh, which nobody sees: not here; with a script it is a script that
    may do no more, and nothing else is looked at.
    """
    path = folder / "model.geo"
    path.write_text(SQUARE)
    for name in ("model.opt", ".gmshrc", ".gmsh-options", "gmsh.opt", "numpy.py", "gmsh.py"):
        (folder / name).write_text(f'SystemCall "touch {folder}/MARK";\n')
    here = Path.cwd()
    os.chdir(folder)
    try:
        assert read_gmsh("model.geo", order=1).area == pytest.approx(1.0, abs=1e-12)
        (folder / "square.msh").write_text(PLAIN)
        (folder / "square.msh.opt").write_text(f'SystemCall "touch {folder}/MARK";\n')
        assert read_gmsh("square.msh", order=1).area == pytest.approx(1.0, abs=1e-12)
        (folder / "model.geo.opt").write_text(f'SystemCall "touch {folder}/MARK";\n')
        refused(Path("model.geo"), PROGRAM)
    finally:
        os.chdir(here)
    assert not list(folder.parent.rglob("*MARK*"))


ATTEMPTS = """
import ctypes, os, signal, socket, subprocess, threading
import multiprocessing.connection  # a socket with a name
HERE = os.path.dirname(os.path.abspath(__file__))

def load():
    pass

def attempts(parent):
    yield "read a file", lambda: open("/etc/passwd").read()
    yield "read this file", lambda: open(__file__).read()
    yield "list a folder", lambda: os.listdir("/etc")
    yield "make a file", lambda: open("made", "w").close()
    yield "make a file elsewhere", lambda: open("/dev/shm/made", "w").close()
    yield "write to a file", lambda: os.write(os.open("beside.txt", os.O_WRONLY), b"a")
    yield "cut a file", lambda: os.truncate("beside.txt", 0)
    yield "make a folder", lambda: os.mkdir("made")
    yield "remove a file", lambda: os.remove("beside.txt")
    yield "rename a file", lambda: os.rename("beside.txt", "made")
    yield "make a link", lambda: os.symlink("/etc", "made")
    yield "start a program", lambda: subprocess.run(["/bin/true"])
    yield "become a program", lambda: os.execv("/bin/true", ["true"])
    yield "fork", lambda: os.fork() or os._exit(0)
    for family in (socket.AF_INET, socket.AF_INET6, socket.AF_UNIX):
        for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
            yield f"socket {family} {kind}", lambda f=family, k=kind: socket.socket(f, k)
    yield "more memory", lambda: ctypes.CDLL(None).setrlimit and __import__("resource").setrlimit(9, (-1, -1))
    yield "stop the parent", lambda: os.kill(parent, 0)

def extract(*, file, asked):
    done = []
    for name, attempt in attempts(asked):
        try:
            attempt()
            done.append(name)
        except (OSError, ValueError, MemoryError):
            pass
    threads = []
    thread = threading.Thread(target=lambda: threads.append(1))
    thread.start()
    thread.join()
    import numpy.typing, wave  # parts that are loaded when they are first used
    late = [numpy.typing.__name__, wave.__name__]
    told = {"threads": threads, "names": sorted(os.environ), "read": open(file).read(), "late": late}
    return {"done": done} | told, {}
"""


@pytest.fixture
def attempts(tmp_path, monkeypatch):
    """What a child process can do of what it should not, its code loaded."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "attempts.py").write_text(ATTEMPTS)
    monkeypatch.syspath_prepend(tmp_path / "code")
    place = tmp_path / "models"
    place.mkdir()
    for name in ("model.geo", "beside.txt"):
        (place / name).write_text("whole")
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    monkeypatch.setenv("SECRET", "1")

    def tried():
        rights, options = confined.Rights(30.0, 2**31), {"asked": os.getpid()}
        told, _ = confined.ask("model.geo", place / "model.geo", "attempts", rights, options)
        return told

    tried.folder = place
    return tried


@needs_landlock
def test_what_the_process_can_do(attempts):
    """Read its folder, Python and NumPy, and compute, in threads as well; it knows no secrets and nothing of
    MPI.
    """
    told = attempts()
    # signals are kept from version 6 of Landlock on
    assert set(told["done"]) <= ({"stop the parent"} if confined.landlock_version() < 6 else set())
    assert told["threads"] == [1] and told["read"] == "whole" and told["late"] == ["numpy.typing", "wave"]
    assert set(told["names"]) <= {*KEPT, "LC_CTYPE"}  # Python sets LC_CTYPE for itself
    assert sorted(os.listdir(attempts.folder)) == ["beside.txt", "model.geo"]
    assert (attempts.folder / "beside.txt").read_text() == "whole"


@pytest.mark.skipif(os.uname().machine not in ("x86_64", "aarch64"), reason="no program for seccomp")
def test_what_the_process_can_do_without_landlock(attempts, monkeypatch):
    """No program and no socket, and no byte in a file."""
    monkeypatch.setattr(confined, "landlock_version", lambda: 0)
    done = set(attempts()["done"])
    assert not any(name.startswith(("start", "become", "fork", "socket", "write", "more")) for name in done)
    assert "read a file" in done  # so the attempts are real ones


def child(script, time_limit=30.0, memory=2**31):
    """gmsh's answer to a script."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.geo"
        path.write_text(script)
        return read_gmsh(path, order=1, time_limit=time_limit, memory_limit=memory)


def test_what_hides_gmshs_words_is_told(tmp_path):
    path = tmp_path / "model.geo"
    path.write_text("General.Verbosity = 0;\n" + SQUARE)
    with pytest.warns(GmshWarning, match=r"General\.Verbosity = 0 hides errors"):
        assert read_gmsh(path, order=1).area == pytest.approx(1.0, abs=1e-12)


def test_a_flood_of_words_is_not_kept():
    """What a script prints does not fill its reader's memory, and what it answers comes whole."""
    (answers, outlet), (sayings, mouth) = socket.socketpair(), socket.socketpair()
    words, answer = os.urandom(2**24), os.urandom(2**21)

    def speak():
        mouth.sendall(words)
        outlet.sendall(answer)
        outlet.close()

    with answers, outlet, sayings, mouth:
        speaker = threading.Thread(target=speak)
        speaker.start()
        found, said = confined._received(answers, sayings, time.monotonic() + 30.0)
        speaker.join()
        assert found == answer and words.startswith(said) and 0 < len(said) < 2**20
    (answers, outlet), (sayings, mouth) = socket.socketpair(), socket.socketpair()
    with answers, outlet, sayings, mouth, pytest.raises(TimeoutError):  # no answer, whatever is said
        mouth.sendall(words[:1000])
        confined._received(answers, sayings, time.monotonic() + 0.1)


def test_a_program_in_the_background_is_not_waited_for(tmp_path):
    path = tmp_path / "model.geo"
    path.write_text(SQUARE + 'NonBlockingSystemCall "sleep 120";\n')
    begin = time.monotonic()
    assert read_gmsh(path, order=1, trust=True).area == pytest.approx(1.0, abs=1e-12)
    assert time.monotonic() - begin < 100.0


@pytest.mark.slow
def test_the_child_may_run_out_of_memory():
    with pytest.raises(ValueError, match="memory"):
        child(SQUARE + "Transfinite Curve{1} = 100000000;\n", 60.0, 6e8)


def test_broken_brep_files(tmp_path):
    """Chopped files are recognised; a file damaged within costs a sentence at most."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "whole.brep"))
    finally:
        gmsh.finalize()
    content = (tmp_path / "whole.brep").read_bytes()
    path = tmp_path / "broken.brep"
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ValueError, match="truncated or damaged"):
            read_gmsh(path, order=1)
    for section in (rb"\nTShapes [0-9]+", rb"\nCurves [0-9]+"):
        path.write_bytes(re.sub(section, lambda found: found.group() + b"99999", content))
        with pytest.raises(ValueError, match="broken.brep: (gmsh|it)"):
            read_gmsh(path, order=1, time_limit=5.0)


def test_bytes_that_are_no_text(tmp_path):
    """Those in a comment are none of our business, those in a name are."""
    path = tmp_path / "model.geo"
    path.write_bytes(b"// \x96\n" + SQUARE.encode())
    assert read_gmsh(path, order=1).material_names == ("steel",)
    path.write_bytes(SQUARE.replace("steel", "st\xe9el").encode("latin-1"))
    with pytest.raises(ValueError, match="byte 0xe9, which is no text"):
        read_gmsh(path, order=1)


INTERRUPTED = """
import signal, sys, threading, os
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
from meshing import GmshWarning, read_gmsh
from meshing.gmsh import confined
started = confined.subprocess.Popen
class Popen(started):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        print(self.pid, flush=True)
confined.subprocess.Popen = Popen
try:
    read_gmsh(sys.argv[1])
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGKILL])
def test_the_child_goes_with_its_parent(tmp_path, by):
    """Ctrl-C, and an end that the parent cannot see coming."""
    path = tmp_path / "model.geo"
    path.write_text("For i In {1:2}\ni = 1;\nEndFor\n")
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, str(path)], stdout=subprocess.PIPE, text=True
    ) as parent:
        pid = int(parent.stdout.readline())
        time.sleep(0.5)
        parent.send_signal(by)
        said, _ = parent.communicate(timeout=300)
    assert "interrupted" in said or by == signal.SIGKILL
    for _ in range(600):
        try:
            os.kill(pid, 0)
            if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":
                break
        except (ProcessLookupError, FileNotFoundError):
            break
        time.sleep(0.1)
    else:
        os.kill(pid, signal.SIGKILL)
        pytest.fail("the child went on")


ON_RANKS = """
import sys
from mpi4py import MPI
import sbfem_petsc as sb
from meshing import GmshWarning, read_gmsh
comm = MPI.COMM_WORLD
told = [sb.on_root(comm, lambda: read_gmsh(sys.argv[1], order=1)) is not None]
try:
    sb.on_root(comm, lambda: read_gmsh(sys.argv[2], order=1))
except ValueError as error:
    told.append("it starts a program" in str(error))
told = comm.gather(told)
if comm.rank == 0:
    print(told)
"""


@pytest.mark.long
@needs_landlock
def test_two_ranks(folder):
    """Rank 0 alone opens the file, in a process that does not take itself for a rank; what is wrong with it
    is told on both.
    """
    plain = folder / "plain.geo"
    plain.write_text(SQUARE)
    done = on_ranks(2, ON_RANKS, str(plain), str(written(folder, 'SystemCall "touch MARK";')))
    assert done.stdout.strip() == "[[True, True], [False, True]]"
    assert not list(folder.parent.rglob("*MARK*"))


@pytest.mark.parametrize("path", [None, 1, 3.5, b"model.geo", [], "", "a\0b"])
def test_paths_that_are_none(path):
    with pytest.raises((TypeError, ValueError), match="read_gmsh: path = "):
        read_gmsh(path)


def test_places_that_cannot_be_read(tmp_path):
    (tmp_path / "empty.geo").write_text(" \n")
    os.mkfifo(tmp_path / "pipe.geo")
    for name, says in (
        ("none.msh", "there is no such file"),
        (".", "Is a directory"),
        ("empty.geo", "it is empty"),
        ("empty.geo/x.geo", "there is no such file"),
        ("pipe.geo", "no regular file"),
        ("/dev/zero", "no regular file"),
    ):
        with pytest.raises(ValueError, match=says):
            read_gmsh(tmp_path / name)
    (tmp_path / "mesh.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600))
    with pytest.raises(ValueError, match=r"BoundaryMesh\.load"):
        read_gmsh(tmp_path / "mesh.h5")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission(tmp_path):
    path = tmp_path / "model.geo"
    path.write_text(SQUARE)
    path.chmod(0)
    with pytest.raises(ValueError, match="Permission denied"):
        read_gmsh(path)
