"""Reading a case: lines, hashes, objects; documentation and schema in sync; starter cases."""

import importlib.util
import inspect
import json
import pathlib
import warnings

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from sbfem_petsc.study.case import geometry, objects, parts
from sbfem_petsc.study.case.case import case_from_text, read_case
from sbfem_petsc.study.case.locations import parse
from sbfem_petsc.study.starter import KINDS, starter_text
from sbfem_petsc.study.structure import Structure
from tests.parallel import ROOT
from tests.study.small_case import CASE, SWEEP, sbfem

_spec = importlib.util.spec_from_file_location("make_pages", pathlib.Path(ROOT) / "docs/make_pages.py")
documentation = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(documentation)

TOML = '''\
# a comment with [brackets] and "quotes"
top = 1
"quoted key" = """
three
lines""" # after
dotted.key = { inline = 1, other = [1,
  2, # comment
  { deep = 3 }] }

[table . "sub.table"]
text = 'a # b = [c]'
escaped = "a \\" ] # b"

[[list]]
a = 1
[[list]]
a = 2
[list.inner]
b = 3
[[list.rows]]
c = 4
'''


def test_lines():
    """Every key of a text with all of TOML's ways to write one stands where it is found."""
    data, lines = parse(TOML, "x.toml")
    texts = TOML.splitlines()
    expected = {
        ("top",): 2,
        ("quoted key",): 3,
        ("dotted", "key", "inline"): 6,
        ("dotted", "key", "other", 1): 7,
        ("dotted", "key", "other", 2, "deep"): 8,
        ("table", "sub.table"): 10,
        ("table", "sub.table", "escaped"): 12,
        ("list", 0, "a"): 15,
        ("list", 1): 16,
        ("list", 1, "a"): 17,
        ("list", 1, "inner", "b"): 19,
        ("list", 1, "rows", 0, "c"): 21,
    }
    assert {path: lines[path] for path in expected} == expected
    for path, line in lines.items():
        here = data
        for part in path:
            here = here[part]
        assert 1 <= line <= len(texts)


def test_hash():
    """Comments, titles and pictures leave the key as it is; results' causes do not."""
    case = case_from_text(CASE)
    same = case_from_text("# comment\n" + CASE.replace("small", "other").replace("pictures = false", ""))
    assert case.key == same.key
    for old, new in (
        ("depth = 0.004", "depth = 0.003"),
        ("fy = 200.0", "fy = 201.0"),
        ("count = 5", "count = 6"),
    ):
        assert case_from_text(CASE.replace(old, new)).key != case.key
    assert case_from_text(CASE.replace("fy = 200.0", "fy = 201.0")).structure_key == case.structure_key
    assert case_from_text(CASE.replace("order = 3", "order = 4")).structure_key != case.structure_key


def test_hash_of_named_files(tmp_path):
    """What a named file holds belongs to the case."""
    text = CASE.replace(
        'fy = { kind = "tone_burst", amplitude = 100.0, frequency = 2000.0, cycles = 4 }',
        'fy = { kind = "samples", file = "force.csv", time_scale = 1e-3 }',
    )
    keys = []
    for value in (1.0, 2.0):
        (tmp_path / "force.csv").write_text(f"0, 0\n1, {value}\n2, 0\n")
        case = case_from_text(text, str(tmp_path / "case.toml"))
        keys.append(case.key)
    assert keys[0] != keys[1]
    (force,) = objects.load(case, ["burst"], 3.0)
    assert force.fy(1e-3) == pytest.approx(6.0)


def test_objects():
    """Every kind of load, support and material becomes the object of the Python interface."""
    text = CASE.replace(
        'clamped = "left"', 'clamped = ["left"]\nsupports = [{ where = "A", x = false, y = 1e6 }]'
    )
    text = text.replace(
        "young = 70e9\npoisson = 0.33", 'kind = "orthotropic"\nyoung_1 = 7e10\nyoung_2 = 1e10'
    )
    text = text.replace("density = 2700", "poisson_12 = 0.3\nshear_12 = 5e9\ndensity = 1600\nangle = 30.0")
    text = text.replace(
        "damping = 0.01",
        "rayleigh = { low = 100.0, low_ratio = 0.01, high = 1000.0, high_ratio = 0.02 }\nthickness = 0.02",
    )
    text += """
[loads]
wind = { kind = "edge_load", edge_set = "top", pressure = { kind = "step", amplitude = 5.0, time = 1.0 } }
weight = { kind = "support_motion", ay = 9.81 }
pull = { kind = "edge_motion", where = "A", uy = 1e-5 }
[loads.sweep]
kind = "point_force"
point = "A"
fx = { kind = "chirp", amplitude = 1.0, start = 10.0, stop = 20.0, duration = 2.0 }
fy = { kind = "constant", value = 4.0 }
"""
    case = case_from_text(text)
    model = objects.model(case, MPI.COMM_SELF)
    material = sb.OrthotropicMaterial(
        young_1=7e10, young_2=1e10, poisson_12=0.3, shear_12=5e9, density=1600.0, angle=30.0
    )
    assert model.materials == [material]
    assert model.supports == (sb.Support("left"), sb.Support("A", x=False, y=1e6))
    assert model.rayleigh == sb.rayleigh_factors(100.0, 0.01, 1000.0, 0.02)
    assert model.thickness == 0.02
    wind, weight, chirp = objects.load(case, ["wind", "weight", "sweep"], 2.0)
    assert wind == sb.EdgeLoad("top", pressure=sb.Step(10.0, time=1.0))
    assert weight == sb.SupportMotion(ay=19.62)
    assert objects.load(case, ["pull"], 2.0) == [sb.EdgeMotion("A", uy=2e-5)]
    assert chirp == sb.PointForce("A", fx=sb.Chirp(2.0, 10.0, 20.0, 2.0), fy=sb.Constant(8.0))
    (tone,) = objects.load(case, ["push"], 0.5, frequency=50.0)
    assert tone == sb.PointForce("A", fy=sb.Harmonic(100.0, 50.0))
    model.destroy()


@pytest.mark.parametrize(
    ("written", "damping"),
    [
        ("[0.01, 0.03]", (0.01, 0.03)),
        ("{ points = [[50.0, 0.01], [400, 0.02]] }", sb.DampingTable([(50.0, 0.01), (400.0, 0.02)])),
    ],
)
def test_measured_damping(written, damping):
    """Ratios of each mode and by frequency."""
    case = case_from_text(CASE.replace("damping = 0.01", f"damping = {written}"))
    with objects.model(case, MPI.COMM_SELF) as model:
        assert model.damping == damping


def test_documentation_in_sync():
    """The pages are what the classes say; python docs/make_pages.py."""
    assert "results.md" in documentation.PAGES and "case_file.schema.json" in documentation.PAGES
    for path in (pathlib.Path(ROOT) / "docs" / name for name in documentation.PAGES):
        assert path.read_text() == documentation.page(path), path


def test_every_key_is_documented():
    """Each key of each table has a description, and each number with a dimension a unit."""
    text = documentation.markdown()
    schema = json.loads(documentation.schema())
    for name, table in schema["$defs"].items():
        for key, entry in table["properties"].items():
            assert f"`{key}`" in text, (name, key)
            assert entry.get("description"), (name, key)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_starter_cases(kind, tmp_path):
    """`new` writes a case that `check` finds valid, and does not overwrite one."""
    path = tmp_path / f"{kind}.toml"
    assert sbfem("new", kind, path).code == 0
    read_case(path)
    done = sbfem("check", path, "--json")
    assert done.code == 0, done.err
    assert done.answer["contact_pairs"] > 0
    if kind != "body":
        assert done.answer["unknowns"] > done.answer["boundary_unknowns"]
    again = sbfem("new", kind, path)
    assert again.code == 2 and "--replace" in again.err
    assert sbfem("new", kind, path, "--replace").code == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["plate", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("gmsh", "modulation"))]
)
def test_starter_cases_run(kind, tmp_path):
    """With a coarse mesh and few modes, to be quick."""
    path = tmp_path / f"{kind}.toml"
    sbfem("new", kind, path)
    text = starter_text(f"{kind}.toml")
    if kind != "gmsh":
        text = text.replace("[model]", "[mesh]\norder = 4\n[model]").replace(
            "pairs = 3", "pairs = 3\nmodes = 24"
        )
    path.write_text(text + "\n[output]\npictures = false\n")
    done = sbfem("run", path, "--output", tmp_path / "out", "--json", "--quiet")
    assert done.code == 0 and not done.err, done.err
    if kind == "gmsh":
        assert (np.diff(done.answer["frequencies"]["frequencies"]) > 0).all()
        assert done.answer["pressure"]["displacement"]["end"][1] < 0.0
    elif kind == "plate":
        k_1, k_2 = done.answer["pull"]["stress_intensity"]["crack"]
        assert k_1 > 0.0 and k_2 != 0.0  # an oblique crack in tension opens and slides
    else:
        found = done.answer["modulation"]
        assert found["common_period"] == pytest.approx(2 / 430)
        assert found["sidebands"]["modulation_index"] > 1e-3


@pytest.mark.long
def test_nonlinear_starter_case_runs(tmp_path):
    """With a coarse mesh, few modes, a short sweep: lines of bifurcations lead through those of the curve,
    the backbone begins at its mode's frequency.
    """
    path = tmp_path / "nonlinear.toml"
    text = starter_text("nonlinear.toml")
    for former, new in (
        ("[model]", "[mesh]\norder = 3\n[model]"),
        ("accuracy = 0.002", ""),
        ("modes = 160", ""),
        ("stop = 14600.0", "stop = 14600.0\nmodes = 24\nsteps = 128"),
        ("duration = 0.5", "duration = 0.01"),
        ("least = 0.8 ", "least = 0.97 "),
        ("most = 1.5", "most = 1.03"),
    ):
        assert former in text
        text = text.replace(former, new)
    path.write_text(text + "\n[output]\npictures = false\n")
    done = sbfem("run", path, "--output", tmp_path / "out", "--json", "--quiet")
    assert done.code == 0, done.err
    on_curve = [point["own_value"] for point in done.answer["curve"]["bifurcations"]]
    lines = done.answer["bifurcations"]["loci"]
    # where the factor is 1, in the steps of both; the curve's points in its own steps are known to 1e-6
    at_force = [line["frequency"][np.abs(np.array(line["value"]) - 1.0).argmin()] for line in lines]
    assert len(on_curve) == 2 and at_force == pytest.approx(on_curve, rel=1e-6)
    assert set(done.answer["sweep"]) == {"kind", "up", "down"}
    backbone, modes = done.answer["backbone"], done.answer["frequencies"]["frequencies"]
    assert backbone["frequency"][0] == pytest.approx(modes[16], rel=1e-6)
    assert backbone["frequency"][-1] > 1.004 * modes[16]  # a crack that closes makes the beam stiffer


def test_sweep_table():
    assert case_from_text(CASE + SWEEP).tables.sweep.parameters["loads.push.fy"].count == 3


def test_values_are_an_array_or_a_table():
    with pytest.raises(ValueError, match=r'"loads.push.fy" = 3.0 must be an array, \[...\] or a table\.$'):
        case_from_text(CASE + '[sweep.parameters]\n"loads.push.fy" = 3.0\n')


@pytest.mark.slow
def test_the_unit_of_a_drawing(tmp_path):
    """A case file says as read_gmsh does that a large model is meant: 1.0 is not the same as none."""
    drawing = 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 60, 30};\nMesh.MeshSizeMax = 20;\n'
    (tmp_path / "part.geo").write_text(drawing + 'Physical Surface("material") = {1};\n')
    for scale, width, said in (("", 60.0, True), ("scale = 1.0", 60.0, False), ("scale = 1e-3", 0.06, False)):
        text = f'[geometry]\nkind = "gmsh"\nfile = "part.geo"\n{scale}\n[material]\n'
        text += "young = 70e9\npoisson = 0.33\ndensity = 2700.0\n[model]\nclamped = []\n"
        text += '[analyses.modes]\nkind = "modal"\ncount = 1\n'
        case = case_from_text(text, folder=str(tmp_path))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = objects.mesh(case)
        assert np.ptp(found.nodes[:, 0]) == pytest.approx(width)
        assert any("it is 60 m wide" in str(one.message) for one in caught) == said


@pytest.mark.parametrize(
    "table",
    [table for table in (vars(geometry) | vars(parts)).values() if getattr(table, "made", None)],
    ids=lambda table: table.__name__,
)
def test_tables_are_what_they_stand_for(table):
    """Keys and defaults of a table are the arguments of its class."""
    arguments = dict(inspect.signature(table.made).parameters)
    if table is geometry.GmshGeometry:  # the others stand in [mesh], see test_keys_of_the_mesh
        arguments = {key: arguments[key] for key in ("path", "scale")}
    keys = {
        "path" if key == "file" else key: field for key, field in table.model_fields.items() if key != "kind"
    }
    assert list(keys) == list(arguments)
    for key, field in keys.items():
        default = arguments[key].default
        assert field.is_required() == (default is inspect.Parameter.empty)
        if not field.is_required():
            assert field.default == (list(default) if isinstance(default, tuple) else default), key


@pytest.mark.parametrize("kind", geometry.GEOMETRIES, ids=lambda kind: kind.__name__)
def test_keys_of_the_mesh(kind):
    """What a geometry's mesh is made with stands in [mesh], or elsewhere in a case, with the same default."""
    arguments = inspect.signature(getattr(kind.made, "mesh", kind.made)).parameters
    for key in kind.mesh_keys():
        default = geometry.Mesh.model_fields[key].default
        assert arguments[key].default == (tuple(default) if isinstance(default, list) else default)
    elsewhere = {"self", "points", "path", "scale", "max_unknowns", "time_limit", "memory_limit", "trust"}
    assert set(arguments) <= {*kind.mesh_keys(), *elsewhere}


LAWS = {
    "unilateral": ("compliance = 1e-9", sb.Unilateral(1e-9)),
    "tied": ("", sb.Tied()),
    "clearance": ("width = 1e-5", sb.Clearance(width=1e-5)),
    "coulomb": ("friction = 0.2\nstatic_friction = 0.3", sb.Coulomb(0.2, 0.3)),
}


def with_law(kind, keys, analysis="static"):
    start = CASE[: CASE.index("[analyses.frequencies]")]
    return (
        f'{start}[model.contact_laws.crack1]\nkind = "{kind}"\n{keys}\n'
        f'[analyses.push]\nkind = "{analysis}"\nload = "push"\n'
        + ("frequency = 1000.0\n" if analysis == "periodic" else "")
    )


@pytest.mark.parametrize("kind", LAWS)
def test_contact_laws(kind):
    keys, law = LAWS[kind]
    model = objects.model(case_from_text(with_law(kind, keys)), MPI.COMM_SELF)
    assert model.contact_laws == {"crack1": law}


def test_analyses_that_know_no_friction_say_so():
    of = "of the unreduced model knows no friction yet, and the faces of 'crack1' rub"
    rubs = with_law("coulomb", "friction = 0.2", "periodic")
    with pytest.raises(ValueError, match=f"'periodic' {of}"):
        case_from_text(f"{rubs}reduced = false\n")
    history = with_law("coulomb", "friction = 0.2", "transient") + "duration = 1e-3\n"
    assert case_from_text(f"{history}reduced = false\n")
    with pytest.raises(ValueError, match="'periodic' in segments knows no friction yet"):
        case_from_text(f"{rubs}segments = 2\n")
    assert case_from_text(rubs)
    with pytest.raises((KeyError, ValueError), match="crack9"):
        text = with_law("coulomb", "friction = 0.2").replace("crack1", "crack9")
        objects.model(case_from_text(text), MPI.COMM_SELF)


@pytest.mark.long
def test_a_moved_edge():
    """In a steady state: the results of Python, reactions among their quantities."""
    push = '[loads.push]\nkind = "point_force"\npoint = "A"\nfy = 200.0'
    moved = '[loads.push]\nkind = "edge_motion"\nwhere = "left"\nuy = 1e-6'
    assert push in CASE
    case = case_from_text(CASE.replace(push, moved))
    structure = Structure(case, MPI.COMM_SELF)
    found = structure.solve(case, "steady")
    exact = sb.periodic(structure.model, sb.EdgeMotion("left", uy=1e-6), 400.0, modes=12, steps=256)
    assert np.abs(exact.reactions).max() > 0.1
    assert np.array_equal(found.reactions, exact.reactions)
    kept = case.tables.analyses["steady"].found(found, structure.points(case))
    assert np.array_equal(kept["reactions"]["left"].value, exact.reaction("left"))
    structure.close()
