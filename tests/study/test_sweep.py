"""Sweeps: their rows, numbers of the Python interface, resuming after kill -9, ranks, failed rows, noise."""

import csv
import itertools
import json
import re
import signal
import time

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc import indicators
from sbfem_petsc.plot.maps import indicator_figure
from sbfem_petsc.study import rows
from sbfem_petsc.study.case.case import case_from_text, read_case
from sbfem_petsc.study.case.sweep import parsed, replaced_in, words_of
from sbfem_petsc.study.folder import hold_folder
from sbfem_petsc.study.kinds.kind import Wanted
from sbfem_petsc.study.revive import described, read_any
from sbfem_petsc.study.rows import Row
from sbfem_petsc.study.structure import Structure
from tests.parallel import on_ranks
from tests.study.small_case import CASE, SWEEP, WAITING, sbfem, started, stopped_sweep, written

DEPTHS, FORCES = [0.002, 0.004], [100.0, 200.0, 300.0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with the case and its sweep in out/."""
    folder = tmp_path_factory.mktemp("sweep")
    done = sbfem("sweep", written(folder, CASE + SWEEP), "--output", folder / "out", "--quiet")
    assert done.code == 0, done.err
    return folder


@pytest.fixture(scope="module")
def found(folder):
    return read_any(folder / "out")


def model(depth):
    notches = [VNotch(x=0.05, depth=depth, opening=0.005)] if depth else []
    return sb.Model(
        Beam(length=0.1, height=0.01, notches=notches).mesh(order=3),
        sb.Material(young=70e9, poisson=0.33, density=2700),
        clamped="left",
        damping=0.01,
        comm=MPI.COMM_SELF,
    )


# ---------------------------------------------------------------------- rows and paths
def table(text):
    return case_from_text(CASE + "\n[sweep]\n" + text).tables.sweep


def test_grid():
    """Every combination, the last parameter fastest, ends as written."""
    got = case_from_text(CASE + SWEEP).tables.sweep.rows()
    names = ("geometry.notches[0].depth", "loads.push.fy")
    assert [tuple(row[n] for n in names) for row in got] == list(itertools.product(DEPTHS, FORCES))


def test_list_and_spacing():
    sweep = table(
        'method = "list"\n[sweep.parameters]\n"mesh.order" = [2, 3]\n'
        '"loads.push.fy" = { start = 1.0, stop = 100.0, count = 2, scale = "logarithmic" }'
    )
    got = sweep.rows()
    assert got == [{"mesh.order": 2, "loads.push.fy": 1.0}, {"mesh.order": 3, "loads.push.fy": 100.0}]
    assert all(type(row["mesh.order"]) is int for row in got)
    three = table(
        '[sweep.parameters]\n"loads.push.fy" = { start = 1.0, stop = 100.0, count = 3, scale = '
        '"logarithmic" }'
    )
    np.testing.assert_allclose([row["loads.push.fy"] for row in three.rows()], [1, 10, 100], rtol=1e-14)


def test_latin_hypercube():
    """One sample in each of n equal strips of each parameter; the seed decides."""
    text = (
        'method = "latin_hypercube"\nsamples = 16\nseed = {}\n[sweep.parameters]\n'
        '"geometry.notches[0].depth" = {{ start = 0.001, stop = 0.005 }}\n'
        '"loads.push.fy" = {{ start = 1.0, stop = 1e4, scale = "logarithmic" }}'
    )
    first, again, other = (table(text.format(seed)).rows() for seed in (1, 1, 2))
    assert first == again != other
    depth = np.array([row["geometry.notches[0].depth"] for row in first])
    force = np.log10([row["loads.push.fy"] for row in first])
    for share in ((depth - 0.001) / 0.004, force / 4.0):
        assert sorted(np.floor(16 * share).astype(int)) == list(range(16))


def test_paths():
    assert parsed('a.b[2]."c d".e') == ("a", "b", 2, "c d", "e")
    data = {"a": {"b": [{"c": 1}]}}
    assert replaced_in(data, {"a.b[0].c": 2, "new.key": 3}) == {
        "a": {"b": [{"c": 2}]},
        "new": {"key": 3},
    }
    assert data == {"a": {"b": [{"c": 1}]}}
    for wrong in ("", "a..b", "[0]", "a[x]", ".a", "a b"):
        with pytest.raises(ValueError, match="is no path"):
            parsed(wrong)


@pytest.mark.slow
# ---------------------------------------------------------------------- numbers
def test_numbers_of_the_python_interface(found):
    """Frequency shifts, harmonics and ratios of each row; tolerances as for single analyses."""
    healthy_model = model(0.0)
    healthy = sb.modal(healthy_model, count=5).frequencies
    for row, (depth, force) in enumerate(itertools.product(DEPTHS, FORCES)):
        cracked = model(depth)
        modes = sb.modal(cracked, count=5)
        np.testing.assert_allclose(found.values["frequencies/frequencies"][row], modes.frequencies, rtol=1e-7)
        np.testing.assert_allclose(
            found.values["frequencies/frequency_shift"][row],
            indicators.frequency_shift(modes.frequencies, healthy),
            atol=3e-7,
        )
        orbit = sb.periodic(cracked, sb.PointForce("A", fy=force), 400.0, modes=12, steps=256)
        exact = orbit.harmonics("A")[:21]
        np.testing.assert_allclose(
            found.values["steady/harmonics/A"][row], exact, atol=1e-6 * np.abs(exact).max()
        )
        assert found.values["steady/A2_A1/A"][row] == pytest.approx(abs(exact[2] / exact[1]), abs=1e-6)
        cracked.destroy()


def test_reactions_of_rows():
    """In equilibrium they are the load's; of a motion, the most that each support bears."""
    case = case_from_text(CASE)
    structure = Structure(case, MPI.COMM_SELF)
    wanted = Wanted(["A"], None, False, lambda: None)
    kinds, results = case.tables.analyses, {name: structure.solve(case, name) for name in ("push", "burst")}
    rows = {name: kinds[name].row(result, wanted) for name, result in results.items()}
    force, unit = rows["push"]["reactions/left"]
    assert unit == "N" and force == pytest.approx([0.0, -200.0], abs=2e-6)
    peaks, unit = rows["burst"]["peak_reactions/left"]
    assert unit == "N" and np.array_equal(peaks, np.abs(results["burst"].reaction("left")).max(axis=0))
    structure.close()


def test_convergence(found):
    """Rows say how well they converged, and what contact and supports bear."""
    assert (found.values["steady/converged"] == 1.0).all()
    assert (found.values["steady/residual"] < 1e-6).all()
    assert (found.values["steady/peak_contact_resultant"][[2, 5]] > 0.0).all()
    assert found.values["steady/peak_reactions/left"].shape == (6, 2)


@pytest.mark.slow
def test_noise(found, folder):
    """A signal-to-noise ratio of 60 dB: harmonics are off by its share, alike at every repetition."""
    clean, noisy = found.values["steady/harmonics/A"], found.values["steady/harmonics_noisy/A"]
    signal_power = 0.5 * (np.abs(clean[:, 1:]) ** 2).sum(axis=1)
    # white noise of 256 samples leaves 4 sigma^2 / 256 in each line's |c_k|^2, on the average
    measured = (np.abs((noisy - clean)[:, 1:]) ** 2).mean()
    expected = (4.0 / 256 * 1e-6 * signal_power).mean()
    assert (
        0.6 < measured / expected < 1.6
    )  # 120 values of chi-square with 2 degrees of freedom: +- 9 %, 4 sigma
    case = read_case(folder / "case.toml")
    again = sb.sweep(case.with_data({**case.data, "sweep": {**case.data["sweep"], "analyses": ["steady"]}}))
    np.testing.assert_allclose(
        again.values["steady/harmonics_noisy/A"], noisy, atol=1e-6 * np.abs(noisy).max()
    )


# ---------------------------------------------------------------------- files, resuming
def test_csv(found, folder):
    with open(folder / "out" / "sweep.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 6 == len(found)
    for name in ("geometry.notches[0].depth", "loads.push.fy"):
        assert [float(line[name]) for line in lines] == found.inputs[name].tolist()
    ratio = [float(line["steady/A2_A1/A"]) for line in lines]
    assert ratio == found.values["steady/A2_A1/A"].tolist()
    assert [float(line["frequencies/frequencies/1 [Hz]"]) for line in lines] == found.values[
        "frequencies/frequencies"
    ][:, 0].tolist()


def test_units_of_the_inputs(found):
    assert found.input_units == {"geometry.notches[0].depth": "m", "loads.push.fy": "N"}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("geometry.notches[1].depth", "depth of notch 2"),
        ("geometry.length", "length"),
        ("mesh.tip_size", "tip size"),
        ("material.young", "Young's modulus"),
        ("materials.steel.young", "Young's modulus of steel"),
        ("model.damping", "damping"),
        ("model.damping.ratio", "ratio of damping"),
        ("loads.pump.fy", "force of pump along y"),
        ("loads.burst.fy.amplitude", "amplitude of fy of burst"),
        ("points.A[0]", "A[0]"),
        ('analyses."my run".frequency', "frequency of my run"),
    ],
)
def test_parameters_in_words(name, words):
    assert words_of(name) == words


def test_pictures_in_fitting_units(found):
    """Depths in mm, forces in N, the quantity in words; what is below round-off is drawn at it. A panel each
    column; parameters that change nothing make no curves.
    """
    values = np.where(found.values["steady/A2_A1/A"] > 0.0, 1e-17, np.nan)
    values[-1] = 1e-3
    words = found.value_words
    columns = {words["steady/A2_A1/A"]: values, words["steady/A2_A1_noisy/A"]: np.ones(len(values))}
    drawing = indicator_figure(found, columns, "1")
    axes, below = drawing.axes
    assert below.get_ylabel() == "steady: A2/A1 with noise, A"
    over = max(found.inputs, key=lambda name: len(np.unique(found.inputs[name])))
    assert over == "loads.push.fy" and below.get_xlabel() == "force of push along y (N)"
    assert axes.get_ylabel() == "steady: A2/A1, A" and axes.get_yscale() == "log"
    texts = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert texts == ["depth of notch 1 = 2 mm", "depth of notch 1 = 4 mm"]
    heights = np.concatenate([line.get_ydata() for line in axes.get_lines()])
    assert heights.min() == 1e-12 and heights.max() == 1e-3
    force = found.inputs["loads.push.fy"]
    alike = indicator_figure(found, {"frequency": 2.0 * force}, "Hz")
    assert not alike.legends and len(alike.axes[0].get_lines()) == 1


def test_row_files(tmp_path):
    """Whole rows are read; what a kill cut off is removed and appended after."""
    path = str(tmp_path / "00000.rows")
    ends = []
    for number in range(3):
        rows.append(path, Row(number, "", 0.5, {"a/b": (np.arange(number + 1) * 1j, "m")}))
        ends.append((tmp_path / "00000.rows").stat().st_size)
    whole = (tmp_path / "00000.rows").read_bytes()
    for cut in (len(whole) - 1, (ends[1] + ends[2]) // 2, 10):
        (tmp_path / "00000.rows").write_bytes(whole[:cut])
        kept = rows.read(str(tmp_path))
        assert sorted(kept) == list(range(2 if cut > 10 else 0))
        rows.append(path, Row(7, "why", 0.0))
        assert sorted(rows.read(str(tmp_path))) == [*sorted(kept), 7]
    (tmp_path / "00000.rows").write_bytes(whole)
    values, unit = rows.read(str(tmp_path))[2].values["a/b"]
    assert unit == "m" and np.array_equal(values, [0, 1j, 2j])


@pytest.mark.long
def test_killed_and_resumed(found, tmp_path):
    """kill -9 in the middle: the rows are those of an undisturbed sweep, and none is computed twice."""
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"
    stopped_sweep(signal.SIGKILL, path, out)
    before = rows.read(str(out / "rows"))
    assert len(before) == 2
    assert sbfem("sweep", path, "--output", out, "--quiet").code == 0
    assert len(list(rows.every(str(out / "rows")))) == 6
    again = read_any(out)
    for number, row in before.items():
        assert again.seconds[number] == row.seconds
    for name in ("steady/harmonics/A", "frequencies/frequencies"):
        np.testing.assert_allclose(
            again.values[name], found.values[name], atol=1e-6 * np.abs(found.values[name]).max()
        )


JOINING = """
import time
from mpi4py import MPI
from sbfem_petsc.cli import main
from sbfem_petsc.study.shares import Shares
comm, taken = MPI.COMM_WORLD, []
def together():  # both ranks at a row, however busy the machine is
    request, limit = comm.Ibarrier(), time.monotonic() + 60.0
    while not request.Test() and time.monotonic() < limit:
        time.sleep(1e-3)
with Shares(comm, 1, [9]) as shares:
    while (place := shares.structure()) is not None:
        while (row := shares.row(place)) is not None:
            taken.append(row)
            if len(taken) <= 3:
                together()
    comm.Barrier()
    assert not shares.left().any()
with Shares(comm, 1, [1]) as shares:  # a last row has its group, who makes the structure for it
    given = shares.structure()
    comm.Barrier()
    assert given is None or shares.row(given) == 0
assert set(comm.allgather(given)) == {0, None}
each = comm.allgather(taken)
assert sorted(sum(each, [])) == list(range(9)) and min(map(len, each)) >= 3, each
"""


@pytest.mark.long
def test_two_ranks(found, tmp_path):
    """Two groups of a rank each share the rows, those of one structure too where that saves time; every row
    once, one rank's numbers.
    """
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"
    words = ["sweep", str(path), "--output", str(out), "--json"]
    done = on_ranks(2, f"{JOINING}\nmain({words!r})")
    assert json.loads(done.stdout)["failed"] == 0
    assert len(list((out / "rows").iterdir())) == 2  # both had rows
    assert len(list(rows.every(str(out / "rows")))) == 6
    again = read_any(out)
    for name, values in found.values.items():
        if name.split("/")[1] in ("harmonics", "harmonics_noisy", "frequencies", "amplitude"):
            np.testing.assert_allclose(again.values[name], values, atol=1e-6 * np.abs(values).max())


def test_failed_rows(tmp_path, monkeypatch):
    """A notch that leaves the beam, a range that is none: each row keeps its own reason, the others their
    numbers; exit code 3. What is no sentence, as a key that a program misses, bears its kind.
    """
    text = (
        CASE
        + """
[analyses.curve]
kind = "frequency_response"
load = "push"
start = 100.0
stop = 200.0

[sweep]
analyses = ["frequencies"]

[sweep.parameters]
"geometry.notches[0].x" = [0.05, 0.2]
"analyses.curve.start" = [200.0, 100.0]
"""
    )
    done = sbfem("sweep", written(tmp_path, text), "--output", tmp_path / "out", "--quiet")
    assert done.code == 3 and "3 of 4 rows failed" in done.err
    found = read_any(tmp_path / "out")
    assert all("curve.stop = 200 is start itself" in found.reasons[k] for k in (0, 2))
    assert found.reasons[1] == "" and "geometry.notches[0]" in found.reasons[3] and "0.2" in found.reasons[3]
    values = found.values["frequencies/frequencies"]
    assert np.isfinite(values[1]).all() and np.isnan(values[[0, 2, 3]]).all()
    monkeypatch.setattr(Structure, "solve", lambda *_, **__: {}["lost"])
    assert sb.sweep(str(tmp_path / "case.toml"), {"loads.push.fy": [1.0]}).reasons == ["KeyError: 'lost'"]


@pytest.mark.slow
def test_structures_are_shared(tmp_path, monkeypatch):
    """One model for all forces, and one healthy one; modes are solved once a structure."""
    made, solved = [], []
    begin, solve = Structure.__init__, Structure.solve
    monkeypatch.setattr(Structure, "__init__", lambda self, *a: (made.append(1), begin(self, *a))[1])
    monkeypatch.setattr(
        Structure,
        "solve",
        lambda self, case, name, **o: (solved.append(name), solve(self, case, name, **o))[1],
    )
    found = sb.sweep(case_from_text(CASE + SWEEP), output=tmp_path / "out", comm=MPI.COMM_SELF)
    assert len(found) == 6 and not found.failed
    assert len(made) == 3
    assert solved.count("frequencies") == 3 and solved.count("steady") == 6


@pytest.mark.parametrize(
    ("what", "named"),
    [
        ('point = "A"\nfy = 200.0', 'point = "B"\nfy = 200.0'),
        ("pictures = false", 'pictures = false\npoints = ["A", "B"]'),
        (
            "damping = 0.01",
            'damping = 0.01\ncontact_laws.crack1 = { kind = "unilateral", compliance = 1e-12 }',
        ),
    ],
)
def test_a_healthy_structure_lacks_what_a_crack_has(what, named):
    """Frequency shifts of a case whose loads, points or laws name a crack, which the healthy beam has not."""
    case, rows = case_from_text(CASE.replace(what, named)), {"loads.push.fy": [1.0]}
    found = sb.sweep(case, rows, analyses=["frequencies"], comm=MPI.COMM_SELF)
    assert found.reasons == [""]
    cracked, healthy = (sb.modal(model(depth), count=5).frequencies for depth in (0.004, 0.0))
    expected = indicators.frequency_shift(cracked, healthy)
    np.testing.assert_allclose(found.values["frequencies/frequency_shift"][0], expected, atol=3e-7)


def test_from_python(tmp_path):
    """`sb.sweep` with parameters of its own, and its refusals."""
    case = case_from_text(CASE)
    found = sb.sweep(case, {"loads.push.fy": [1.0, 2.0]}, analyses=["push"], comm=MPI.COMM_SELF)
    # the load is too small to close the crack: linear
    u = found.values["push/displacement/A"]
    np.testing.assert_allclose(u[1], 2.0 * u[0], rtol=1e-6)
    assert "2 rows over loads.push.fy" in repr(found)
    texts = sb.sweep(case, {"loads.push.point": ["B", "A"]}, analyses=["push"], comm=MPI.COMM_SELF)
    assert "  loads.push.point: 2 values from A to B\n" in described(texts)
    with pytest.raises(ValueError, match="sweep is missing"):
        sb.sweep(case)
    with pytest.raises(ValueError, match="did you mean 'push'"):
        sb.sweep(case, {"loads.pusch.fy": [1.0]})


def test_another_sweep_is_refused(folder, tmp_path):
    other = written(tmp_path, CASE + SWEEP.replace("count = 3", "count = 4"))
    done = sbfem("sweep", other, "--output", folder / "out")
    assert done.code == 2 and "sweep of another case" in done.err


def test_another_sweep_that_came_to_nothing(tmp_path):
    """Its folder serves, for some of the rows too, unless others are at work in it for the former case."""
    first, other = (
        case_from_text(CASE + SWEEP),
        case_from_text(CASE + SWEEP.replace("count = 3", "count = 4")),
    )
    (tmp_path / "out").mkdir()
    path = str(tmp_path / "out")
    begun = hold_folder(path, first, "sweep", shared=True)
    with pytest.raises(ValueError, match="holds the sweep of another case"):
        hold_folder(path, other, "sweep", shared=True)
    beside = hold_folder(path, first, "sweep", shared=True)
    begun.close()
    with pytest.raises(ValueError, match="holds the sweep of another case"):
        hold_folder(path, other, "sweep", shared=True)
    beside.close()
    found = sb.sweep(other, output=path, rows=(0, 1), comm=MPI.COMM_SELF)
    assert found.reasons == [""]
    for shared in (False, True):
        with pytest.raises(ValueError, match="holds the sweep of another case"):
            hold_folder(path, first, "sweep", shared=shared)


def test_rows_have_numbers_in_the_order_of_what_varies():
    """A sweep whose parameters, or with noise analyses, are in another order has other rows; what else is in
    another order, and comments, make no difference.
    """
    depth, force = SWEEP.rstrip().splitlines()[-2:]
    key = case_from_text(CASE + SWEEP).sweep_key
    assert case_from_text(CASE + SWEEP.replace(f"{depth}\n{force}", f"{force}\n{depth}")).sweep_key != key
    push, steady, burst = (CASE.index(f"[analyses.{name}]") for name in ("push", "steady", "burst"))
    turned = CASE[:push] + CASE[steady:burst] + CASE[push:steady] + CASE[burst:]
    assert case_from_text(turned + SWEEP).sweep_key != key
    quiet = SWEEP.replace("noise", "# noise")
    assert case_from_text(turned + quiet).sweep_key == case_from_text(CASE + quiet).sweep_key
    thrust, blast, modal = (CASE.index(name) for name in ("[loads.push]", "[loads.burst]", "[analyses.freq"))
    loads = CASE[:thrust] + CASE[blast:modal] + CASE[thrust:blast] + CASE[modal:]
    alike = loads.replace("count = 5", "count = 5  # of many").replace(
        "young = 70e9\npoisson = 0.33", "poisson = 0.33\nyoung = 7e10"
    )
    assert alike != CASE and case_from_text(alike + SWEEP).sweep_key == key


def test_rows_without_a_state_are_nobodys(tmp_path):
    """A kill while --replace clears a folder leaves rows of the former case, which no other one takes for its
    own.
    """
    path, row = str(tmp_path), Row(0, "", 0.5, {"a/b": (np.ones(1), "m")})
    folder = hold_folder(path, case_from_text(CASE + SWEEP), "sweep")
    file = tmp_path / "rows" / "00000.rows"
    with rows.held(str(file), "rows"):
        rows.append(str(file), row)
    folder.close()
    (tmp_path / "sweep.json").unlink()
    other = case_from_text(CASE + SWEEP.replace("count = 3", "count = 4"))
    folder = hold_folder(path, other, "sweep", shared=True)
    assert rows.read(str(tmp_path / "rows")) == {}
    with rows.held(str(file), "rows"):
        rows.append(str(file), row)
    hold_folder(path, other, "sweep", shared=True).close()  # those of others at work stay
    assert list(rows.read(str(tmp_path / "rows"))) == [0]
    folder.close()


# 80 rows on eight structures.
MANY = (
    CASE[: CASE.index("[analyses.frequencies]")]
    + CASE[CASE.index("[analyses.push]") : CASE.index("[analyses.burst]")].replace("modes = 12", "modes = 6")
    + """
[sweep.parameters]
"geometry.notches[0].depth" = { start = 0.002, stop = 0.006, count = 8 }
"loads.push.fy" = { start = 100.0, stop = 300.0, count = 4 }
"""
)


def values(folder) -> tuple[list[dict[str, str]], list[str]]:
    """The table without the times, and the reasons."""
    with open(folder / "sweep.csv", newline="") as file:
        found = list(csv.DictReader(file))
    return [{k: v for k, v in row.items() if k != "seconds"} for row in found], [r["reason"] for r in found]


@pytest.mark.long
def test_rows_by_eight_processes(tmp_path):
    """Two of them are killed within their rows; a last call finishes those and writes the table that one
    process makes, to the last digit. While one is at work the last call waits to be made again.
    """
    path, one, out = written(tmp_path, MANY), tmp_path / "one", tmp_path / "out"
    assert sbfem("sweep", path, "--output", one, "--quiet").code == 0
    killed, processes = (2, 5), []
    for k in range(8):
        program = ("-c", WAITING) if k in killed else ("-m", "sbfem_petsc")
        command = ("sweep", path, "--output", out, "--rows", f"{4 * k}:{4 * k + 4}", "--quiet")
        processes.append(started(*command, program=program))
    try:
        for k in killed:
            file, limit = out / "rows" / f"{4 * k:07d}-{4 * k + 4:07d}-00000.rows", time.monotonic() + 300
            while not (file.is_file() and len(list(rows.of_file(str(file)))) == 2):
                assert processes[k].poll() is None and time.monotonic() < limit
                time.sleep(0.05)
        early = sbfem("sweep", path, "--output", out, "--quiet")
        assert early.code == 2 and "another process is at work" in early.err
        again = sbfem("sweep", path, "--output", out, "--rows", "8:12", "--quiet")
        assert again.code == 2 and "rows 8 to 11 are computed by another process" in again.err
        for k in killed:
            processes[k].kill()
        codes = [process.communicate(timeout=600) and process.returncode for process in processes]
    finally:
        for process in processes:
            process.kill()
    assert codes == [-9 if k in killed else 0 for k in range(8)]
    assert len(rows.read(str(out / "rows"))) == 6 * 4 + 2 * 2 and not (out / "sweep.csv").exists()
    last = sbfem("sweep", path, "--output", out)
    assert last.code == 0 and "28 of them finished before" in last.err
    assert len(list(rows.every(str(out / "rows")))) == 32
    assert values(out) == values(one) and values(out)[1] == 32 * [""]


@pytest.mark.long
def test_some_of_the_rows(tmp_path):
    """They alone are computed, and counted; the others are left to a call without a range."""
    path, out = written(tmp_path, CASE + SWEEP), tmp_path / "out"
    done = sbfem("sweep", path, "--output", out, "--rows", "4:", "--json", "--quiet")
    assert (
        done.code == 0
        and done.answer["rows"] == 2
        and done.answer["inputs"]["loads.push.fy"] == [200.0, 300.0]
    )
    assert sorted(rows.read(str(out / "rows"))) == [4, 5] and not (out / "sweep.csv").exists()
    with pytest.raises(ValueError, match="call  sbfem sweep CASE --output .* without --rows"):
        sb.read(out)
    part = sb.sweep(path, output=out, rows=(3, 5))
    assert len(part) == 2 and part.failed == 0
    assert len(list(rows.every(str(out / "rows")))) == 3  # one of the two was there
    whole = sb.sweep(path, output=out)
    assert len(whole) == 6 and len(list(rows.every(str(out / "rows")))) == 6
    np.testing.assert_array_equal(whole.values["steady/amplitude/A"][3:5], part.values["steady/amplitude/A"])


@pytest.mark.parametrize(
    "options, sentence",
    [
        (("--rows", "6:9"), "holds none of the 6 rows"),
        (("--rows", "3:3"), "holds none of the 6 rows"),
        (("--rows", "3"), "must be A:B, two numbers of rows from 0"),
        (("--rows", "-1:3"), "must be A:B|expected one argument"),
        (("--rows", "0:3", "--replace"), "call it once without rows"),
    ],
)
def test_rows_that_are_none(options, sentence, tmp_path):
    done = sbfem("sweep", written(tmp_path, CASE + SWEEP), "--output", tmp_path / "out", *options, "--quiet")
    assert done.code == 2 and re.search(sentence, done.err), done.err
    assert not (tmp_path / "out").exists()
