"""Files from strangers: nothing in them is executed, nothing is written, and the process goes on.

Three walls are tried one by one: the scan of scripts, the check of the content against the ending, and the
child process that may neither execute programs nor write files.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from meshing import read_gmsh
from meshing.gmsh.isolation import clean_environment, run_child
from meshing.gmsh.script_scan import scan_script

SQUARE = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Physical Surface("steel") = {1};
Mesh.MeshSizeMax = 0.5;
"""

# Statements that would leave a file MARK behind, end the process, or read what is not the model's.
HOSTILE = {
    "system call": 'SystemCall "touch MARK";',
    "computed": 'SystemCall StrCat("touch ", "MARK");',
    "system": 'System "touch MARK";',
    "in the background": 'NonBlockingSystemCall "touch MARK";',
    "between comments": '/* a */ SystemCall /* b */ "touch MARK"; // c',
    "after a comment that seems longer": '/* // */ SystemCall "touch MARK";',
    "after a string that seems longer": "x = \"'\"; SystemCall 'touch MARK';",
    "over lines": 'SystemCall\n\n"touch MARK"\n;',
    "in a loop": 'For i In {1:2}\n  SystemCall "touch MARK";\nEndFor',
    "in a macro": 'Macro m\n  SystemCall "touch MARK";\nReturn\nCall m;',
    "in a macro of text": 'Macro("m", "SystemCall \'touch MARK\';");\nCall m;',
    "in a macro of built text": 'Macro("m", StrCat("System", "Call \'touch MARK\';"));\nCall m;',
    "by a built name": 'StringToName["SystemCall"] "touch MARK";',
    "by a built name, in short": 'S2N[StrCat["System", "Call"]] "touch MARK";',
    "by a numbered name": 'a~{1} "touch MARK";',
    "hidden in a skipped branch": 'If(0)\nIf("EndIf EndIf SystemCall " == "touch MARK")\nEndIf\nEndIf',
    "hidden behind a letter": 'If(0)\nE"EndIf SystemCall ";touch MARK;"";',
    "hidden in a name": 'If(0)\nx1EndIf1; SystemCall "touch MARK";',
    "after a line end of old": '// comment\rSystemCall "touch MARK";',
    "after a zero byte": '// a\0\nSystemCall "touch MARK";',
    "after an open string": 'x = "a;\nSystemCall "touch MARK";',
    "far out on a line": "x = 1;" * 3000 + 'SystemCall "touch MARK";',
    "through ONELAB": 'OnelabRun("x", "touch MARK");',
    "as a field": 'Field[1] = ExternalProcess; Field[1].CommandLine = "touch MARK"; Background Field = 1;',
    "as a solver": 'Solver.Executable0 = "/usr/bin/touch MARK";',
    "as a plugin": "Plugin(Crack).Run;",
    "exit": "Exit;",
    "exit with a code": "Exit 3;",
    "abort": "Abort;",
    "print to a file": 'Printf("hello") > "MARK";',
    "append to a file": 'Printf("a %g", 1) >> "MARK";',
    "a picture": 'Print "MARK.png";',
    "a mesh": 'Mesh 2; Save "MARK.msh";',
    "a view": 'Save View[0] "MARK.pos";',
    "a folder": 'CreateDir "MARK";',
    "an option that is a file": 'General.ErrorFileName = "MARK";',
    "a script elsewhere": 'Include "/etc/passwd";',
    "a script above": 'Include "../outside.geo";',
    "a script through a folder": 'Include "sub/../../outside.geo";',
    "a script by a link": 'Include "link.geo";',
    "a script by a built name": 'Include StrCat("a", ".geo");',
    "a script in a script": 'Include "evil.geo";',
    "a script in a script that is merged": 'Merge "evil.geo";',
    "a script that seems a mesh": 'Merge "evil.msh";',
    "a script without an ending": 'Include "evil";',
    "itself": 'Include "model.geo";',
    "itself by a detour": 'Include "detour.geo";',
    "a shape from elsewhere": 'a() = ShapeFromFile("../outside.brep");',
    "numbers from a file": 'a() = ListFromFile["/etc/passwd"];',
    "the environment": 'x = GetEnv("HOME");',
}


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "models"
    place.mkdir()
    (tmp_path / "outside.geo").write_text(SQUARE)
    (place / "link.geo").symlink_to(tmp_path / "outside.geo")
    for name in ("evil.geo", "evil.msh", "evil"):
        (place / name).write_text(f'SystemCall "touch {place}/MARK";\n')
    (place / "detour.geo").write_text('Include "model.geo";\n')
    return place


def marks(folder):
    return [found for found in folder.parent.rglob("*") if "MARK" in found.name]


@pytest.mark.parametrize("name", HOSTILE)
def test_scripts(folder, name, monkeypatch):
    """Refused by name and line, before a process is started."""
    path = folder / "model.geo"
    path.write_text(SQUARE + HOSTILE[name].replace("MARK", f"{folder}/MARK") + "\n", newline="")
    monkeypatch.setattr(subprocess, "Popen", None)
    with pytest.raises(ValueError) as caught:
        read_gmsh(path, order=1)
    assert "line " in str(caught.value) or "evil.msh: its content is not" in str(caught.value)
    assert str(folder) in str(caught.value) and "\n" not in str(caught.value)
    assert marks(folder) == []


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


def test_gmsh_is_given_what_was_checked():
    """No comments, strings set apart, lines of at most some thousand characters, the same line numbers."""
    text = 'a = 1; // "x\n/* "\n */ b = "y"; c = {' + ",".join(["1"] * 5000) + "};"
    script = scan_script(text.encode(), "model.geo")
    assert "//" not in script.text and "/*" not in script.text and script.text.count('"') == 2
    assert " " * 8 + '"y"' in script.text and max(map(len, script.text.splitlines())) < 3000
    assert script.text.splitlines()[2].lstrip().startswith("b =")
    assert script.text.count("1,") == 4999 and script.text.endswith("\n")


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
    assert marks(folder) == []


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
    assert marks(folder) == []


def test_what_lies_beside_the_file_has_no_say(folder):
    """gmsh reads options from files beside the model's, if it sees them."""
    path = folder / "model.geo"
    path.write_text(SQUARE)
    for name in ("model.geo.opt", "model.opt", ".gmshrc", ".gmsh-options", "gmsh.opt", "numpy.py", "gmsh.py"):
        (folder / name).write_text(f'SystemCall "touch {folder}/MARK";\n')
    here = Path.cwd()
    os.chdir(folder)
    try:
        assert read_gmsh("model.geo", order=1).area == pytest.approx(1.0, abs=1e-12)
    finally:
        os.chdir(here)
    assert marks(folder) == []


def child(script, time_limit=30.0, memory=None):
    """gmsh's answer to a script that nobody has checked."""
    request = {"module": "meshing.gmsh.extraction", "order": 1, "size": None, "most_unknowns": 10**6}
    return run_child("model.geo", {"model.geo": script.encode()}, request, time_limit, memory)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux lets a process give up rights")
@pytest.mark.parametrize(
    "statement",
    [
        'SystemCall "touch MARK";',
        'NonBlockingSystemCall "touch MARK";',
        'Printf("x") > "MARK";',
        'Save "MARK.msh";',
        'CreateDir "MARK";',
    ],
)
def test_the_child_cannot_even_if_asked(tmp_path, statement):
    """Past the scan: without the right to execute and to write."""
    try:
        child(SQUARE + statement.replace("MARK", f"{tmp_path}/MARK") + "\n")
    except ValueError:
        pass
    time.sleep(0.2)  # a call in the background would need some time
    if "CreateDir" in statement or "SystemCall" in statement:
        from ctypes import CDLL, c_size_t, c_uint32

        if CDLL(None).syscall(444, None, c_size_t(0), c_uint32(1)) < 1:
            pytest.skip("this kernel has no Landlock")
    assert all(os.path.getsize(found) == 0 for found in tmp_path.iterdir()) and marks(tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("Exit;\n", "ended before it had read the file"),
        ("Exit 3;\n", "ended with code 3"),
        ("For i In {1:2}\ni = 1;\nEndFor\n", "did not finish within 2 s"),
        (SQUARE + "Transfinite Curve{1} = 100000000;\n", "memory"),
    ],
)
def test_the_child_may_end_hang_or_run_out_of_memory(script, says):
    with pytest.raises(ValueError, match=says):
        child(script, 2.0 if "finish" in says else 60.0, int(6e8))


@pytest.mark.slow
def test_a_crash_is_a_sentence():
    request = {"module": "meshing.gmsh.extraction", "order": 1, "size": None, "most_unknowns": 10**6}
    deep = "Macro a\nCall a;\nReturn\nCall a;\n"
    with pytest.raises(ValueError, match="model.geo: gmsh (crashed|did not finish|cannot read)"):
        run_child("model.geo", {"model.geo": deep.encode()}, request, 3.0, None)


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
    path = tmp_path / "model.geo"
    path.write_bytes(b"// one\n// two \x96\n" + SQUARE.encode())
    with pytest.raises(ValueError, match="line 2 holds the byte 0x96"):
        read_gmsh(path)


def test_nothing_of_mpi_goes_to_the_child(monkeypatch):
    for name in ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID", "HYDRA_CONTROL_FD"):
        monkeypatch.setenv(name, "1")
    assert not any(name.startswith(("OMPI", "PMI", "SLURM", "HYDRA")) for name in clean_environment())
    assert "PATH" in clean_environment()


INTERRUPTED = """
import signal, sys, threading, os
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
from meshing import read_gmsh
from meshing.gmsh import isolation
started = isolation.subprocess.Popen
class Popen(started):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        print(self.pid, flush=True)
isolation.subprocess.Popen = Popen
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
        said, _ = parent.communicate(timeout=20)
    assert "interrupted" in said or by == signal.SIGKILL
    for _ in range(50):
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


@pytest.mark.parametrize("path", [None, 1, 3.5, b"model.geo", [], "", "a\0b"])
def test_paths_that_are_none(path):
    with pytest.raises((TypeError, ValueError), match="read_gmsh: path is"):
        read_gmsh(path)


def test_places_that_cannot_be_read(tmp_path):
    (tmp_path / "empty.geo").write_text(" \n")
    os.mkfifo(tmp_path / "pipe.geo")
    for name, says in (
        ("none.msh", "there is no such file"),
        (".", "it is a folder"),
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
