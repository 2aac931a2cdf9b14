"""Wrong cases: each is refused with file, line, item and remedy."""

import contextlib
import os
import re
import shutil
import struct
import zlib

import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from sbfem_petsc.ranks import capacity
from sbfem_petsc.study import rows
from sbfem_petsc.study.case import objects
from sbfem_petsc.study.case.case import case_from_text, read_case
from sbfem_petsc.study.case.problems import CaseError
from sbfem_petsc.study.estimates import requirements
from sbfem_petsc.study.run import run_case
from sbfem_petsc.study.structure import Structure
from tests.study.small_case import CASE, SWEEP

NEW = "<new>"  # mark of the line on which the fault stands

# (what is replaced, by what, item, remedy): the fault stands on the line of the mark, or of the replacement's
# first line; where a table lacks something, its line is the fifth entry.
WRONG = [
    # TOML itself
    ("length = 0.1", "length = = 0.1", "length = = 0.1", "write key = value"),
    ("length = 0.1", "length 0.1", "length 0.1", "write key = value"),
    ('kind = "beam"', "kind = beam", "kind = beam", "texts in quotation marks"),
    ("[mesh]", "[mesh", "[mesh", "tables as [name]"),
    ("height = 0.01", "height = 0.01\nheight = 0.02" + NEW, "height = 0.02", "not TOML"),
    # keys that do not exist
    ("depth = 0.004", "depht = 0.004", "geometry.notches[0].depht", "did you mean 'depth'?"),
    ("length = 0.1", "lenght = 0.1", "geometry.lenght", "did you mean 'length'?"),
    ("[mesh]", "[mehs]", "mehs", "did you mean 'mesh'?"),
    ("young = 70e9", "youngs = 70e9", "material.youngs", "did you mean 'young'?"),
    ("damping = 0.01", "dampnig = 0.01", "model.dampnig", "did you mean 'damping'?"),
    ("count = 5", "number = 5", "analyses.frequencies.number", "Valid are|valid are"),
    (
        "duration = 0.003",
        "duration = 0.003\ntimestep = 1e-6" + NEW,
        "analyses.burst.timestep",
        "did you mean 'step'?",
    ),
    ("cycles = 4", "cycels = 4", "loads.burst.fy.cycels", "did you mean 'cycles'?"),
    ("fy = 200.0", "fz = 200.0", "loads.push.fz", "did you mean 'fx'?|did you mean 'fy'?"),
    ("pictures = false", "picture = false", "output.picture", "did you mean 'pictures'?"),
    # keys that are missing; the line is that of the table
    (
        "[[geometry.notches]]\nx = 0.05\n",
        "[[geometry.notches]]\n",
        "geometry.notches[0].x",
        "is missing",
        "[[geometry.notches]]",
    ),
    ('[geometry]\nkind = "beam"\n', "[geometry]\n", "geometry", "has no kind; valid are 'beam'"),
    ('[analyses.burst]\nkind = "transient"\n', "[analyses.burst]\n", "analyses.burst", "has no kind"),
    ("duration = 0.003\n", "", "analyses.burst.duration", "is missing", "[analyses.burst]"),
    # an analysis that is called as a kind is
    (
        '[analyses.burst]\nkind = "transient"',
        '[analyses.transient]\nkind = "transiant"' + NEW,
        "analyses.transient.kind = 'transiant'",
        "did you mean 'transient'?",
    ),
    (
        '[analyses.push]\nkind = "static"\nload',
        '[analyses.sweep]\nkind = "static"\nlaod' + NEW,
        "analyses.sweep.laod",
        "did you mean 'load'?",
    ),
    ("density = 2700\n", "", "material.density", "density, in kg/m^3", "[material]"),
    (
        '[analyses.push]\nkind = "static"\nload = "push"',
        '[analyses.push]\nkind = "static"',
        "analyses.push.load",
        "add it",
    ),
    # wrong types
    ("length = 0.1", 'length = "0.1"', "geometry.length = '0.1'", "must be a number, in m"),
    ("length = 0.1", "length = true", "geometry.length = true", "must be a number"),
    ("order = 3", "order = 3.5", "mesh.order = 3.5", "must be a whole number"),
    ("order = 3", 'order = "three"', "mesh.order", "must be a whole number"),
    ('clamped = "left"', "clamped = 3", "model.clamped = 3", "must be an array"),
    ("pictures = false", "pictures = 0", "output.pictures = 0", "must be true or false"),
    ('load = "push"\nfrequency', "load = 3\nfrequency", "analyses.steady.load = 3", "must be an array"),
    ("count = 5", "band = 100.0", "analyses.frequencies.band", "must be an array"),
    ("[[geometry.notches]]", "[geometry.notches]", "geometry.notches", "must be an array"),
    ("damping = 0.01", 'rayleigh = "low"', "model.rayleigh", "an array, [...] or a table"),
    ("fy = 200.0", 'fy = "200 N"', "loads.push.fy = '200 N'", "must be a number or a table, in N"),
    ("fy = 200.0", "fy = [200.0]", "loads.push.fy", "must be a number or a table, in N"),
    ('title = "small"', "title = 3", "title = 3", "must be a text"),
    # a kind that is called as one of its keys is
    (
        "fy = 200.0",
        'fy = 200.0\n[loads.bad]\nkind = "force"\nforce = 1.0\npoint = 3' + NEW,
        "loads.bad.point",
        "a text",
    ),
    # numbers out of range
    ("length = 0.1", "length = -0.1", "geometry.length = -0.1", "must be above 0, in m"),
    ("length = 0.1", "length = inf", "geometry.length = inf", "must be a finite number"),
    ("length = 0.1", "length = nan", "geometry.length = nan", "must be a finite number"),
    ("order = 3", "order = 21", "mesh.order = 21", "must be at most 20"),
    ("order = 3", "order = 0", "mesh.order = 0", "must be at least 1"),
    ("poisson = 0.33", "poisson = 0.6", "material.poisson = 0.6", "must be at most 0.5"),
    ("damping = 0.01", "damping = 1.0", "model.damping = 1.0", "must be below 1"),
    ("frequency = 400.0", "frequency = 0.0", "analyses.steady.frequency", "must be at least 1e-12, in Hz"),
    ("steps = 256", "steps = 4", "analyses.steady.steps = 4", "must be at least 48"),
    ("opening = 0.005", "opening = -1.0", "geometry.notches[0].opening", "must be at least 0, in degree"),
    ("count = 5", "count = 0", "analyses.frequencies.count = 0", "must be at least 1"),
    ("count = 5", "band = [100.0]", "analyses.frequencies.band", "at least 2 expected"),
    # names and kinds
    ('kind = "beam"', 'kind = "baem"', "geometry.kind = 'baem'", "did you mean 'beam'?"),
    ('kind = "transient"', 'kind = "transiant"', "analyses.burst.kind", "did you mean 'transient'?"),
    ('kind = "tone_burst"', 'kind = "toneburst"', "loads.burst.fy.kind", "did you mean 'tone_burst'?"),
    ('load = "burst"', 'load = "bursts"', "analyses.burst.load = 'bursts'", "did you mean 'burst'?"),
    ("duration = 0.003", 'duration = 0.003\nscheme = "euler"' + NEW, "analyses.burst.scheme", "'newmark'"),
    ("[analyses.push]", "[analyses.run]", "analyses.run", "cannot be a name"),
    (
        "density = 2700",
        'density = 2700\nkind = "steel"' + NEW,
        "material.kind",
        "valid are 'isotropic', 'orthotropic'",
    ),
    ("density = 2700", 'density = 2700\nplane = "stres"' + NEW, "material.plane", "did you mean 'stress'?"),
    # contradictions
    (
        "count = 5",
        "count = 5\nband = [1.0, 2.0]",
        "analyses.frequencies",
        "and not both",
        "[analyses.frequencies]",
    ),
    ("count = 5", "", "analyses.frequencies", "needs count", "[analyses.frequencies]"),
    ("count = 5", "band = [200.0, 100.0]", "analyses.frequencies.band", "0 <= low < high"),
    ("order = 3", "tip_element = true", "mesh.tip_element", "is not for geometry.kind = 'beam'"),
    (
        "[material]",
        "[materials.steel]\nyoung = 1e9\npoisson = 0.3\ndensity = 1000\n[material]",
        "materials",
        "not both",
    ),
    ('load = "push"\nfrequency', 'load = "burst"\nfrequency', "analyses.steady.load", "use transient"),
    (
        'kind = "static"\nload = "push"',
        'kind = "static"\nload = "burst"',
        "analyses.push.load",
        "static takes numbers",
        'load = "burst"',
    ),
    ('clamped = "left"', "clamped = []", "analyses.push.kind", "clamp an edge set", 'kind = "static"'),
    ("fy = 200.0", "fy = 0.0", "loads.push", "give fx or fy", "[loads.push]"),
    (
        "duration = 0.003",
        "duration = 0.003\nstep = 0.01",
        "analyses.burst.step",
        "longer than duration",
        "step = 0.01",
    ),
    ("damping = 0.01", "damping = [0.01, 1.0]", "model.damping[1] = 1.0", "must be below 1"),
    ("damping = 0.01", "damping = []", "model.damping", "at least 1 expected"),
    ("damping = 0.01", 'damping = "low"', "model.damping", "a number or an array, [...] or a table"),
    ("damping = 0.01", "damping = { points = [] }", "model.damping.points", "at least 1 expected"),
    (
        "damping = 0.01",
        "damping = { points = [[9.0, 0.1], [2.0, 0.1]] }",
        "model.damping.points",
        "give ascending frequencies",
    ),
    (
        "damping = 0.01",
        "rayleigh = { low = 1.0, low_ratio = 0.01, high = 2.0, high_ratio = 0.03 }",
        "model.rayleigh.high_ratio",
        "must be from 0.005 to 0.02",
    ),
    ("damping = 0.01", "rayleigh = [-1.0, 0.0]", "model.rayleigh[0] = -1.0", "must be at least 0"),
    (
        "damping = 0.01",
        "rayleigh = { low = 9.0, low_ratio = 0.01, high = 2.0, high_ratio = 0.01 }",
        "model.rayleigh.low",
        "must be below high",
    ),
    (
        'fy = { kind = "tone_burst", amplitude = 100.0, frequency = 2000.0, cycles = 4 }',
        'fy = { kind = "samples", file = "nowhere.csv" }',
        "loads.burst.fy.file",
        "name a file relative to the case file",
    ),
    (
        'fy = { kind = "tone_burst", amplitude = 100.0, frequency = 2000.0, cycles = 4 }',
        'fy = { kind = "chirp", amplitude = 1.0, start = 1.0, stop = 9.0, duration = 1.0, taper = 0.9 }',
        "loads.burst.fy.taper",
        "at most half the duration",
    ),
    # two tones and slow loads, in the place of a kind of analysis
    (
        'kind = "static"\nload = "push"',
        'kind = "quasi_periodic"\nprobe = "push"\nprobe_frequency = 3000.0\npump = "push"\n'
        "pump_frequency = 3000.0" + NEW,
        "analyses.push.pump_frequency = 3000",
        "use periodic for one tone",
        "pump_frequency = 3000.0",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "quasi_periodic"\nprobe = "push"\nprobe_frequency = 3000.0\npump = "push"\n'
        "pump_frequency = 50.0\nsamples = 9\norder = 5" + NEW,
        "analyses.push.order = 5",
        "give samples = 11 or more",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "quasi_periodic_response"\nload = "push"\nstart = 50.0\nstop = 60.0\nend = 55.0\nsamples = 8'
        + NEW,
        "analyses.push.samples = 8",
        "must be odd; give 9",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "quasi_periodic"\nprobe = "burst"' + NEW + "\nprobe_frequency = 3000.0\npump = "
        '"push"\npump_frequency = 50.0',
        "analyses.push.probe = 'burst'",
        "quasi_periodic takes numbers and harmonic or constant",
    ),
    (
        "fy = 200.0",
        'fy = 200.0\nfx = { kind = "harmonic", amplitude = 1.0, frequency = 500.0 }',
        "analyses.steady.load",
        "fy = 200, a number beside signals, which may be meant as a constant or as an amplitude; give { kind",
        'load = "push"',
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "load_history"\nload = "burst"\ntimes = { start = 0.0, stop = 1.0 }' + NEW,
        "analyses.push.times",
        "is missing (number of values)",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "load_history"\nload = "burst"\ntimes = []' + NEW,
        "analyses.push.times",
        "at least 1 expected",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "load_history"\nload = "push"\ntimes = { start = 0, stop = 1, count = 1000000000 }' + NEW,
        "analyses.push.times.count = 1000000000",
        "must be at most 1e+06",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "static"\nload = "push"\nstress_at = { "." = "A" }' + NEW,
        "analyses.push.stress_at",
        "cannot be a name here; use letters",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "static"\nload = "push"\nstress_at = { top = [0.05] }' + NEW,
        "analyses.push.stress_at.top",
        "at least 2 expected",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "static"\nload = "push"\naccuracy = 0.0' + NEW,
        "analyses.push.accuracy = 0.0",
        "must be at least 1e-13",
    ),
    # nonlinear vibration
    (
        'kind = "static"\nload = "push"',
        'kind = "locus"\nload = "push"\nstart = 50.0\nstop = 60.0\nbifurcations = []' + NEW,
        "analyses.push.bifurcations",
        "at least 1 expected",
    ),
    (
        'damping = 0.01\n\n[loads.push]\nkind = "point_force"\npoint = "A"\nfy = 200.0',
        'damping = 0.0\n\n[loads.push]\nkind = "point_force"\npoint = "A"\nfy = 200.0\n\n[analyses.map]\n'
        'kind = "locus"\nload = "push"\nstart = 50.0\nstop = 60.0\nparameter = "damping"' + NEW,
        "analyses.map.parameter",
        "give model.damping, or another parameter",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "backbone"\nstart = 1.0\nstop = 2.0\nmodes = 8\nmode = 12' + NEW,
        "analyses.push.mode = 12",
        "must be one of the modes = 8",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "backbone"\nmode = 1\nstart = 2.0\nstop = 2.0' + NEW,
        "analyses.push.stop = 2",
        "give a range of energies",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "modulation"\npump = "push"\nprobe = "push"\npoint = "A"\npump_frequency = 300.0\n'
        "probe_frequency = 900.0\npairs = 3" + NEW,
        "analyses.push.pairs = 3 reaches down to 0 Hz",
        "give fewer",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "modulation"\npump = "push"\nprobe = "push"\npoint = "A"\npump_frequency = 10.0\n'
        "probe_frequency = 900.0\nsteps = 186" + NEW,
        "analyses.push.steps = 186 tells lines below 930 Hz, and the highest sideband is at 930 Hz",
        "leave steps out",
    ),
    *(
        (
            'kind = "static"\nload = "push"',
            f'kind = "{kind}"\n{more}pump = "push"\nprobe = "push"\nprobe_frequency = 900.0\n'
            f"pump_frequency = 1e-320{NEW}",
            "analyses.push.pump_frequency = 1e-320",
            "must be at least 1e-12, in Hz",
        )
        for kind, more in (("modulation", 'point = "A"\n'), ("quasi_periodic", ""))
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "frequency_response"\nstart = 50.0\nstop = 60.0\nload = "hold"\n[loads.hold]\n'
        'kind = "point_force"\npoint = "A"\nfy = { kind = "constant", value = 1.0 }' + NEW,
        "analyses.push.load = ['hold'] does not oscillate",
        "give a number",
        'load = "hold"',
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "periodic"\nload = "push"\nfrequency = 50.0\nreduced = false' + NEW,
        "analyses.push.reduced = false needs damping of all motions",
        "give model.rayleigh",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "frequency_response"\nload = "push"\nstart = 50.0\nstop = 60.0\nreduced = false\n'
        "contact = false" + NEW,
        "analyses.push.contact = false is for the reduced model",
        "leave out reduced = false or contact",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "basins"\nload = "push"\nfrequency = 50.0\nstarts = [{ values = [0.0] }]\nfactor = 0.0' + NEW,
        "analyses.push.factor = 0",
        "give another factor",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "swept_response"\nload = "push"\nstart = 50.0\nstop = 60.0\nduration = 1e-3' + NEW,
        "analyses.push.duration = 0.001 s holds 0.055 cycles",
        "give 2 or more",
    ),
    (
        "fy = 200.0",
        'fy = { kind = "harmonic", amplitude = 1.0, frequency = 55.0 }\n\n[analyses.curve]\n'
        'kind = "frequency_response"\nload = "push"' + NEW + "\nstart = 50.0\nstop = 60.0",
        "analyses.curve.load",
        "frequency_response takes numbers and constant",
    ),
    # the sweep
    ('"geometry.notches[0].depth"', '"geometry.notches[1].depth"', "notches[1].depth", "numbered from 0"),
    ('"geometry.notches[0].depth"', '"geometry.notches[0].depths"', "depths", "did you mean 'depth'?"),
    ('"loads.push.fy"', '"loads.pull.fy"', "loads.pull.fy", "did you mean 'push'?"),
    ('"loads.push.fy"', '"loads..fy"', "loads..fy", "write it as in geometry.notches[0].depth"),
    ("[0.002, 0.004]", "[0.002, -0.004]", "notches[0].depth", "must be above 0, in m"),
    ("[0.002, 0.004]", "[]", "notches[0].depth", "at least 1 expected"),
    (
        "[0.002, 0.004]",
        "{ start = 0.002, stop = 0.004, count = 1000000 }",
        "sweep.parameters",
        "make 3,000,000 rows, more than 1,000,000",
        "[sweep.parameters]",
    ),
    (
        ", count = 3 }",
        " }",
        "loads.push.fy",
        "is missing",
        '"loads.push.fy" = { start = 100.0, stop = 300.0 }',
    ),
    (
        "noise = { snr = 60.0, seed = 3 }",
        'method = "list"\nsamples = 3' + NEW,
        "sweep.samples",
        "leave it out",
    ),
    ("noise = { snr = 60.0, seed = 3 }", 'method = "random"', "sweep.method", "valid are 'grid'"),
    ("noise = { snr = 60.0, seed = 3 }", "noise = 60.0", "sweep.noise", "must be a table"),
    (
        'analyses = ["frequencies", "steady"]',
        'analyses = ["steddy"]',
        "sweep.analyses",
        "did you mean 'steady'?",
    ),
]


def changed(old: str, new: str) -> tuple[str, int | None]:
    """The text with a fault, and the line it stands on."""
    text = CASE if old in CASE else CASE + SWEEP  # whose rows mend what they vary
    assert text.count(old) >= 1, old
    text = text.replace(old, new, 1)
    marked = NEW in text
    at = text.index(NEW) if marked else text.index(new.split("\n")[0]) if new else None
    line = None if at is None else text[:at].count("\n") + 1
    return text.replace(NEW, ""), line


def refused(text: str) -> str:
    with pytest.raises(CaseError) as error:
        case_from_text(text, "case.toml")
    return str(error.value)


@pytest.mark.parametrize("fault", WRONG, ids=[f"{k}-{w[2]}" for k, w in enumerate(WRONG)])
def test_refused(fault):
    """One of the sentences names the file, the line of the fault, the item and the remedy."""
    old, new, item, remedy, *table = fault
    text, line = changed(old, new)
    sentences = refused(text).splitlines()
    fitting = [s for s in sentences if item in s and any(part in s for part in remedy.split("|"))]
    assert fitting, sentences
    found = re.match(r"case\.toml, line (\d+): ", fitting[0])
    assert found, fitting[0]
    if table:
        assert text.splitlines()[int(found[1]) - 1] == table[0]
    else:
        assert int(found[1]) == line


# Names of analyses that no file can bear, or that a terminal would obey.
BAD_NAMES = ['"pu\\u0000sh"', '"pu\\u001b[2Jsh"', '"pu\\nsh"', "p" * 300, f'"{70 * "é"}"']


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_no_file_can_bear(name):
    said = refused(CASE.replace("[analyses.push]", f"[analyses.{name}]"))
    assert "line 39" in said and "use letters, digits" in said and "\n" not in said
    assert len(said) < 400 and "\0" not in said and "\x1b" not in said


@pytest.mark.parametrize("digits", [400, 5000, 100_000])
@pytest.mark.parametrize("key", ["young = 70e9", "order = 3", "x = 0.05"])
def test_numbers_of_many_digits(key, digits):
    """Python refuses to read them, or to make a floating-point number of them."""
    name, line = key.split(" = ")[0], CASE.splitlines().index(key) + 1
    said = refused(CASE.replace(key, f"{name} = {'9' * digits}"))
    assert f"line {line}: " in said.splitlines()[0] and len(said) < 600
    assert f"{digits:,d} digits" in said or f"{name} = " in said


def test_several_at_once():
    """All faults of a file are told, in the order of their tables."""
    text = CASE.replace("length = 0.1", "length = -1.0").replace("young = 70e9", "yung = 70e9")
    sentences = refused(text).splitlines()
    assert [s.split(":")[0] for s in sentences] == [
        "case.toml, line 5",
        "case.toml, line 16",
        "case.toml, line 17",
    ]


# Faults that the mesh shows.
ON_THE_MESH = [
    ("depth = 0.004", "depth = 0.012", "geometry.notches[0].depth", "make the notch shallower"),
    ("x = 0.05", "x = 0.2", "geometry.notches[0]", "outside the beam"),
    ('point = "A"', 'point = "tip"', "loads.push.point = 'tip'", "valid are"),
    ('clamped = "left"', 'clamped = "lfet"', "model.clamped = 'lfet'", "did you mean 'left'?"),
    ("pictures = false", 'points = ["a"]', "output.points = 'a'", "valid are"),
    (
        'load = "push"\n\n[analyses.steady]',
        'load = "push"\nstress_at = { tip = "a" }\n\n[analyses.steady]',
        "analyses.push.stress_at.tip = 'a' is no point",
        "valid are",
    ),
    (
        'kind = "static"\nload = "push"',
        'kind = "basins"\nload = "push"\nfrequency = 50.0\nstarts = [{ values = [0.0], point = "Q" }]',
        "analyses.push.starts[0].point = 'Q' is no point",
        "valid are",
    ),
    ("[mesh]", "[points]\nP = [0.5, 0.5]\n[mesh]", "points.P", "move it inside"),
    ("[material]", "[materials.steel]", "materials.steel", "is no region of the mesh; valid are 'material'"),
    ("[mesh]", "[points]\nA = [0.02, 0.005]\n[mesh]", "points.A", "choose another"),
    ("order = 3", "order = 3\nsize = 1e-9", "mesh.size", "is below 2 %"),
]


@pytest.mark.parametrize("old, new, item, remedy", ON_THE_MESH, ids=[w[2] for w in ON_THE_MESH])
def test_refused_by_the_mesh(old, new, item, remedy):
    text, line = changed(old, new)
    with pytest.raises(CaseError) as error:
        objects.mesh(case_from_text(text, "case.toml"))
    sentence = str(error.value)
    assert re.match(r"case\.toml, line \d+: ", sentence)
    assert item in sentence and remedy in sentence


def test_gmsh_file_and_keys():
    """A gmsh model that is not there, and keys that are for beams."""
    text = """[geometry]
kind = "gmsh"
file = "nowhere.msh"
[mesh]
layout = "tip"
[points]
P = [0.0, 0.0]
[material]
young = 1e9
poisson = 0.3
density = 1000
[analyses.modes]
kind = "modal"
count = 3
"""
    sentences = refused(text).splitlines()
    for line, item, remedy in (
        (3, "geometry.file = 'nowhere.msh'", "name a file relative to the case file"),
        (5, "mesh.layout", "is not for geometry.kind = 'gmsh'"),
        (6, "points", "add them there"),
    ):
        assert any(s.startswith(f"case.toml, line {line}: {item}") and remedy in s for s in sentences), item
    assert any("model.clamped is missing" in s and "clamped = []" in s for s in sentences)


def test_missing_file(tmp_path):
    from sbfem_petsc.study.case.case import read_case

    with pytest.raises(CaseError, match="nowhere.toml: cannot be read .* sbfem new beam FILE"):
        read_case(tmp_path / "nowhere.toml")


def test_binary_file(tmp_path):
    from sbfem_petsc.study.case.case import read_case

    (tmp_path / "case.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CaseError, match=r"case\.toml: is no text in UTF-8"):
        read_case(tmp_path / "case.toml")


@pytest.mark.parametrize("kind", ["a pipe", "a device", "a folder"])
def test_what_is_no_file_is_not_waited_for(kind, tmp_path):
    """Where a case, or what it names, should be: a pipe or a device may have no end."""
    place = str(tmp_path / "place")
    if kind == "a pipe":
        os.mkfifo(place)
    elif kind == "a folder":
        os.mkdir(place)
    else:
        place = "/dev/zero"
    told = "Is a directory" if kind == "a folder" else "no regular file"
    with pytest.raises(CaseError, match=told):
        read_case(place)
    with pytest.raises(ValueError, match=told):
        sb.Samples.from_csv(place)
    named = CASE.replace("fy = 200.0", f'fy = {{ kind = "samples", file = "{place}" }}')
    with pytest.raises(CaseError, match="does not exist in"):
        case_from_text(named, "case.toml", str(tmp_path)).named_files()


def test_endless_nesting():
    with pytest.raises(CaseError, match="nested too deeply"):
        case_from_text("a = " + 100_000 * "[", "case.toml", ".")


def test_rows_that_no_sweep_has_written(tmp_path):
    """Checksums that fit, and lengths beyond the end."""
    path = tmp_path / "0.rows"
    payload = b"no rows at all"
    length = struct.pack("<Q", len(payload))
    head = rows.MAGIC + length + struct.pack("<II", zlib.crc32(length), zlib.crc32(payload))
    path.write_bytes(head + payload)
    with pytest.raises(ValueError, match="are not what a sweep has written"):
        rows.read(str(tmp_path))
    path.write_bytes(rows.MAGIC + rows.HEAD.pack(2**63, zlib.crc32(struct.pack("<Q", 2**63)), 0))
    assert len(list(rows.every(str(tmp_path)))) == 0 and rows.read(str(tmp_path)) == {}


TONE = 'fy = { kind = "harmonic", amplitude = 1.0, frequency = 517.3 }'
TWO = 'probe = "push"\nprobe_frequency = 3000.0\npump = "pump"\npump_frequency = 565.7'
PUMP = '\n\n[loads.pump]\nkind = "point_force"\npoint = "A"\nfy = 1.0\n'
# Load "push", a further analysis, item, sentence.
TONES = [
    (TONE, 'kind = "periodic"\nfrequency = 400.0\nload = "push"', "load is refused", "517.3 Hz"),
    (TONE, 'kind = "load_response"\nfrequency = 400.0\nload = "push"\nperiods = 2', "load", "2 periods"),
    (
        TONE,
        'kind = "basins"\nfrequency = 400.0\nload = "push"\nstarts = [{ values = [0.0] }]',
        "load",
        "517.3 Hz",
    ),
    (
        "fy = 1.0",
        'kind = "periodic"\nfrequency = 400.0\nload = "push"\nsteps = 256\nsegments = 7',
        "segments = 7",
        "must divide the 256 steps",
    ),
    ("fy = 1.0" + PUMP, f'kind = "modulation"\npoint = "A"\n{TWO}', "probe_frequency", "longest"),
    (TONE + PUMP, f'kind = "quasi_periodic"\n{TWO}', "is refused", "belongs to neither tone"),
]


@pytest.mark.parametrize("fault", TONES, ids=[f"{k}-{w[2]}" for k, w in enumerate(TONES)])
def test_tones_without_a_common_period(fault, tmp_path):
    """Refused before the analyses in front of it run, and before there is a folder."""
    load, analysis, item, sentence = fault
    text = CASE.replace("fy = 200.0", load, 1).replace(
        '[analyses.steady]\nkind = "periodic"\nload = "push"',
        '[analyses.steady]\nkind = "periodic"\nload = "still"',
    )
    text = text.replace(
        "[analyses.frequencies]",
        '[loads.still]\nkind = "point_force"\npoint = "A"\nfy = 1.0\n\n[analyses.frequencies]',
        1,
    )
    text = text.replace('kind = "static"\nload = "push"', 'kind = "static"\nload = "still"')
    case = case_from_text(f"{text}\n[analyses.further]\n{analysis}\n", "case.toml")
    with pytest.raises(CaseError, match=rf"case\.toml, line \d+: analyses\.further.*{item}.*{sentence}"):
        case.check_tones(case.tables.analyses)
    with pytest.raises(CaseError):
        run_case(case, tmp_path / "output")
    assert not (tmp_path / "output").exists()


@pytest.mark.parametrize("longest", [99, 100])
def test_tones_with_a_long_common_period(longest):
    """404 Hz and 400 Hz repeat after 100 periods of the latter; the table says how many are looked for."""
    text = CASE.replace("fy = 200.0", TONE.replace("517.3", "404.0"), 1)
    text = text.replace("modes = 12", f"longest = {longest}\nmodes = 12", 1)
    case = case_from_text(text.replace('kind = "static"\nload = "push"', 'kind = "modal"\ncount = 1'))
    with contextlib.nullcontext() if longest == 100 else pytest.raises(CaseError, match="load is refused"):
        case.check_tones(["steady"])


def test_tones_that_a_sweep_gives():
    """Of an analysis whose tones are varied the values in the case itself stand for nothing."""
    text = CASE.replace("fy = 200.0", TONE, 1).replace(
        'kind = "static"\nload = "push"', 'kind = "modal"\ncount = 1'
    )
    text += '[sweep]\nmethod = "list"\n[sweep.parameters]\n"loads.push.fy.frequency" = [400.0, 800.0]\n'
    case = case_from_text(text, "case.toml")
    case.check_tones(case.unvaried)
    with pytest.raises(CaseError, match=r"analyses\.steady\.load.*517\.3 Hz"):
        case.check_tones(["steady"])


MOVED = '[loads.moved]\nkind = "edge_motion"\nwhere = "left"\nuy = 1e-5\n'
FREE = MOVED.replace('"left"', '"right"')
BASINS = 'kind = "basins"\nload = "push"\nfrequency = 400.0\nstarts = [{ values = [0.0], %s }]'
# What a later analysis asks for, a load, key and sentence.
LATER = [
    (
        'kind = "transient"\nload = "burst"\nduration = 0.003\nstep = 1e-6\ndecimation = 3001',
        "",
        "decimation",
        "3000 steps there are",
    ),
    (
        'kind = "transient"\nload = "burst"\nduration = 0.003\ndecimation = 2881',
        "",
        "decimation",
        "2880 steps there are",
    ),
    (
        'kind = "transient"\nload = "moved"\nduration = 0.003',
        MOVED,
        "",
        "where a structure at rest has no displacement",
    ),
    ('kind = "static"\nload = "moved"', FREE, "", "'right'"),
    (
        BASINS % 'kind = "impulse", mode = 2',
        "",
        r"starts\[0\]\.mode",
        "= 2 is no number of a unit load; there are 1, from 1; give one of these",
    ),
    (
        (BASINS % 'kind = "impulse", mode = 1').replace("push", "moved"),
        MOVED,
        r"starts\[0\]\.mode",
        "gives no impulse",
    ),
    (
        BASINS % "mode = 40" + "\nmodes = 9",
        "",
        r"starts\[0\]\.mode",
        "= 40 is more than the 9 modes there are, as the table says; give more modes",
    ),
    (BASINS % "mode = 5000", "", r"starts\[0\]\.mode", "= 5,000 is more than the"),
    (BASINS % "mode = 90", "", r"starts\[0\]\.mode", "= 90 is more than the 80 modes there are"),
    ('kind = "modal"\ncount = 5000', "", "count", "asks for 5,000 modes"),
    ('kind = "modal"\nband = [0.0, 1e20]', "", "band", "asks for [0-9,]+ modes, and there are 355"),
    (
        'kind = "transient"\nload = "burst"\nduration = 0.003\nstep = 1e-12\ndecimation = 100_000',
        "",
        "",
        "3e\\+09 steps of 1e-12 s",
    ),
]


@pytest.mark.parametrize("fault", LATER, ids=[f"{k}-{w[2]}" for k, w in enumerate(LATER)])
def test_later_analyses_are_checked_before_any_is_solved(fault, tmp_path, monkeypatch):
    """What only the structure or the disk can tell, of whichever analysis; sbfem check tells it, too."""
    analysis, load, item, sentence = fault
    case = case_from_text(f"{CASE}\n{load}\n[analyses.later]\n{analysis}\n", "case.toml")
    monkeypatch.setattr(Structure, "solve", lambda *_, **__: pytest.fail("an analysis was solved"))
    told = rf"case\.toml, line \d+: analyses\.later\.?{item} .*{sentence}"
    with pytest.raises(CaseError, match=told):
        run_case(case, tmp_path)
    with pytest.raises(CaseError, match=told):
        requirements(case, MPI.COMM_SELF)


# Analyses that a gigabyte is too little for.
VAST = [
    'kind = "transient"\nload = "burst"\nduration = 0.003\nstep = 5e-10\ndecimation = 1',
    'kind = "periodic"\nload = "push"\nfrequency = 400.0\nsteps = 10_000_000',
    'kind = "frequency_response"\nload = "push"\nstart = 300.0\nstop = 400.0\nsteps = 10_000_000',
    'kind = "backbone"\nmode = 1\nstart = 1e-6\nstop = 1e-3\nsteps = 10_000_000',
    'kind = "load_history"\nload = "push"\ntimes = { start = 0.0, stop = 1.0, count = 100_000 }',
    BASINS.replace(
        "[0.0]", "[0.0, 1.0, 2.0], mode = 2 }, { values = { start = 0.0, stop = 1.0, count = 1_000_000 }"
    )
    % "mode = 1",
    'kind = "swept_response"\nload = "push"\nstart = 300.0\nstop = 400.0\nduration = 2e3',
    'kind = "modulation"\npump = "push"\npump_frequency = 100.0\nprobe = "push"\nprobe_frequency = 1000.0\n'
    'point = "A"\nsteps = 10_000_000',
]


@pytest.mark.parametrize("analysis", VAST, ids=[re.search('"(.*?)"', one)[1] for one in VAST])
def test_too_little_memory_is_told_before_any_is_solved(analysis, tmp_path, monkeypatch):
    """By estimates of which half is never more than the analyses themselves find, which refuse the same."""
    case = case_from_text(f"{CASE}\n[analyses.later]\n{analysis}\n", "case.toml")
    monkeypatch.setattr(capacity, "available_memory", lambda: 1e9)
    solve = Structure.solve
    monkeypatch.setattr(Structure, "solve", lambda *_, **__: pytest.fail("an analysis was solved"))
    with pytest.raises(
        CaseError, match=r"analyses\.later is refused: .* of memory, .* free; ask for less \("
    ) as told:
        run_case(case, tmp_path)
    with contextlib.closing(Structure(case, MPI.COMM_SELF)) as structure:
        with pytest.raises(ValueError, match="of memory, .* are free") as refused:
            solve(structure, case, "later")
    sizes = [float(re.search(r"([\d.]+) GB of memory", str(one.value))[1]) for one in (told, refused)]
    assert sizes[0] <= sizes[1] <= 5.0 * sizes[0]


def test_all_that_is_wrong_is_told_at_once(tmp_path):
    """Once it is mended the same folder serves: it held nothing."""
    case = case_from_text(CASE.replace("count = 5", "count = 5000").replace("modes = 12", "modes = 6000"))
    with pytest.raises(CaseError) as told:
        run_case(case, tmp_path)
    assert [problem.path[1:] for problem in told.value.problems] == [
        ("frequencies", "count"),
        ("steady", "modes"),
        ("burst", "modes"),
    ]
    mended = case_from_text(CASE[: CASE.index("[analyses.push]")])
    assert not run_case(mended, tmp_path)["run"]["failed"] and (tmp_path / "results.h5").is_file()
    with pytest.raises(ValueError, match="holds the run of another case"):
        run_case(case, tmp_path)
    shutil.rmtree(tmp_path / "analyses")  # as who needs room may do: the results are there
    with pytest.raises(ValueError, match="holds the run of another case"):
        run_case(case, tmp_path)


def test_values_that_rows_of_a_sweep_mend(tmp_path):
    """What contradicts in the case itself and not in its rows is refused where the case itself is run."""
    text = (
        CASE.replace("order = 3", "order = 1")
        .replace("damping = 0.01", "rayleigh = [0.0, 0.0]")
        .replace("modes = 12\nsteps = 256", "reduced = false\nsteps = 48")
    )
    varied = '[sweep]\nanalyses = ["steady"]\n[sweep.parameters]\n"model.rayleigh[1]" = [%s, 2e-3]\n'
    case = case_from_text(text + varied % "1e-3", "case.toml")
    assert sb.sweep(case, comm=MPI.COMM_SELF).reasons == ["", ""]
    refused = r"case\.toml, line \d+: analyses\.steady\.reduced = false needs damping"
    with pytest.raises(CaseError, match=refused):
        run_case(case, tmp_path)
    first, second = sb.sweep(case_from_text(text + varied % "0.0"), comm=MPI.COMM_SELF).reasons
    assert "needs damping of all motions" in first and not second
    path = tmp_path / "case.toml"
    path.write_text(text)
    given = sb.sweep(path, {"model.rayleigh[1]": [1e-3]}, analyses=["steady"], comm=MPI.COMM_SELF)
    assert given.reasons == [""]
    for sweep in ("", varied.replace("rayleigh[1]", "thickness") % "1.0"):
        with pytest.raises(CaseError, match=refused):
            case_from_text(text + sweep, "case.toml")


def test_options_that_rows_of_a_sweep_give():
    """Of an analysis that is varied the case's own options stand for nothing, of others they do."""
    text = CASE.replace("count = 5", "count = 5000")
    varied = (
        '[sweep]\nanalyses = ["frequencies"]\n[sweep.parameters]\n"analyses.frequencies.count" = [3, 4]\n'
    )
    case = case_from_text(text + varied)
    assert requirements(case, MPI.COMM_SELF)["sweep"]["rows"] == 2
    dotted = (
        (text + varied).replace('["frequencies"]', '["a.b"]').replace("[analyses.freq", '[analyses."a.b"] #')
    )
    path = '"analyses.frequencies.count"', "'analyses.\"a.b\".count'"
    assert case_from_text(dotted.replace(*path)).unvaried == case.unvaried == ["push", "steady", "burst"]
    assert sb.sweep(case, comm=MPI.COMM_SELF).reasons == ["", ""]
    with pytest.raises(CaseError, match="count = 5000 asks for"):
        requirements(case_from_text(text), MPI.COMM_SELF)
