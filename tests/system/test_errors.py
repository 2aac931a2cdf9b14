"""Bad input ends on every rank with one clear sentence and an exit code other than 0, before any long
work.
"""

import json
import warnings

import numpy as np
import pytest
from scipy import sparse

import sbfem_petsc as sb
from meshing import CrackLine, Plate
from tests.parallel import answer, on_ranks

# statement -> what its sentence must say
CASES = {
    "Beam(0.4, 0.005, [VNotch(0.08, 0.006, 0.1)]).mesh()": "depth",
    "Beam(0.4, 0.005, [VNotch(0.08, 0.005, 0.1)]).mesh()": "depth",
    "Beam(0.4, 0.005, [VNotch(0.5, 0.0025, 0.1)]).mesh()": "outside",
    "Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.1), VNotch(0.0801, 0.0025, 10.0)]).mesh()": "notch",
    "Beam(0.4, 0.005, [], [Hole(0.1, 0.0025, 0.001), Hole(0.1005, 0.0025, 0.001)]).mesh()": "hole",
    "Beam(0.4, 0.005, [], [Hole(0.1, 0.0025, 0.006)]).mesh()": "hole",
    "Beam(0.4, 0.005, [], [Hole(0.1, 0.0048, 0.002)]).mesh()": "hole",
    "Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.1)], [Hole(0.08, 0.0025, 0.001)]).mesh()": "hole",
    "Beam(0.0, 0.005).mesh()": "length",
    "Beam(0.4, -0.005).mesh()": "height",
    "Beam(float('nan'), 0.005).mesh()": "length",
    "Beam(0.4, 0.005, [VNotch(0.08, 0.0, 0.1)]).mesh()": "depth",
    "Beam(0.4, 0.005, [VNotch(0.08, 0.0025, -1.0)]).mesh()": "opening",
    "Beam(0.4, 0.005, [], [Hole(0.1, 0.0025, 0.0)]).mesh()": "diameter",
    "Beam(0.4, 0.005).mesh(order=0)": "order",
    "Beam(0.4, 0.005).mesh(order=99)": "order",
    "Beam(0.4, 0.005).mesh(size=-1.0)": "size",
    "Beam(0.4, 0.005).mesh(points={'P': (1.0, 1.0)})": "P",
    "sb.Material(0.0, 0.3, 2700)": "young",
    "sb.Material(-70e9, 0.3, 2700)": "young",
    "sb.Material(70e9, 0.3, float('nan'))": "density",
    "sb.Material(70e9, 0.3, 0.0)": "density",
    "sb.Material(70e9, float('nan'), 2700)": "poisson",
    "sb.Material(70e9, 0.51, 2700)": "poisson",
    "sb.Material(70e9, 0.5, 2700, plane='strain')": "poisson",
    "sb.Material(70e9, -1.0, 2700)": "poisson",
    "sb.Material(70e9, 0.3, 2700, plane='shell')": "plane",
    "sb.Material('stiff', 0.3, 2700)": "young",
    "sb.OrthotropicMaterial(1.0, 1.0, 1.5, 1.0, 1.0)": "poisson_12",
    "sb.Model(mesh, steel, clamped='root')": "'root' is neither an edge set",
    "sb.Model(mesh, 7.0)": "material",
    "sb.Model(mesh, {'steel': steel})": "no material is given for",
    "sb.Model(mesh, steel, continued_fraction=-1)": "continued_fraction",
    "sb.Model(mesh, steel, damping=1.5)": "damping",
    "sb.Model(mesh, steel, thickness=0.0)": "thickness",
    "sb.Model(None, steel)": "mesh is None",
    "sb.Model(mesh, steel, supports=[sb.Support('left', x=-1.0)])": "stiffness",
    "sb.static(model, sb.PointForce('Z', fy=1.0))": "point 'Z' does not exist",
    "sb.static(model, sb.EdgeLoad('roof', tx=1.0))": "edge set 'roof' does not exist",
    "sb.static(sb.Model(mesh, steel, clamped=None), sb.PointForce('A', fy=1.0))": "rigid-body motion",
    "sb.modal(model)": "needs count (number of lowest frequencies) or band",
    "sb.modal(mesh, 3)": "must be a Model",
    "sb.modal(model, band=5)": "band",
    "sb.Model(Beam(0.4, 0.005), steel)": "call its .mesh()",
    "sb.Model(mesh, steel, clamped=5)": "clamped",
    "sb.Model(mesh, steel, supports='right')": "supports",
    "sb.OrthotropicMaterial(1.0, 1.0, '0.3', 0.4, 1.0)": "poisson_12",
    "sb.OrthotropicMaterial(1.0, 1.0, 0.3, 0.4, 1.0, plane='strain', poisson_13=float('nan'))": "poisson_13",
    "sb.static(model, sb.PointForce('A', fy='1'))": "fy",
    "sb.static(model, sb.PointForce('A', fy=sb.Harmonic(1.0, 10.0)))": "signals",
    "sb.static(model, sb.PointForce(['A'], fy=1.0))": "must be a string",
    "read_gmsh('nowhere.msh')": "nowhere.msh",
    "check_output_folder('/proc/nowhere/out', comm)": "/proc/nowhere/out",
}

PROGRAM = """
import json, sys
from mpi4py import MPI
import sbfem_petsc as sb
from meshing import *
from sbfem_petsc.writing import check_output_folder
comm = MPI.COMM_WORLD
steel = sb.Material(206e9, 0.3, 7850)
mesh = Beam(0.4, 0.005).mesh(order=2)
model = sb.Model(mesh, steel)
said = {}
for case in json.loads(sys.argv[1]):
    try:
        eval(case)
        mine = ["none", "no error"]
    except Exception as error:
        mine = [type(error).__mro__[1].__name__ + " " + type(error).__name__, str(error)]
    said[case] = comm.allgather(mine)
if comm.rank == 0:
    print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def said():
    return answer(on_ranks(2, PROGRAM, json.dumps(list(CASES))))


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_sentence_on_every_rank(said, case):
    """Both ranks raise the same one-line sentence, of a documented kind, that names the item."""
    messages = said[case]
    assert messages[0] == messages[1]
    kind, text = messages[0]
    assert any(
        k in kind
        for k in (
            "ValueError",
            "TypeError",
            "KeyError",
            "OSError",
            "FileNotFoundError",
            "PermissionError",
            "NotADirectoryError",
        )
    ), messages[0]
    assert CASES[case] in text
    assert "\n" not in text and len(text) < 400


@pytest.mark.long
@pytest.mark.parametrize(
    "arguments, sentence, ranks",
    [
        (["--output", "/proc/nowhere"], "/proc/nowhere", 2),
        (["--order", "0"], "order", 1),
        (["--tip-size", "-1"], "tip_size", 2),
        (["--nonsense"], "--nonsense", 1),
        (["-static_ksp_typ", "cg", "plain"], "plain", 2),
        (["-foo"], "-foo", 2),
    ],
)
def test_example_ends_with_one_sentence(arguments, sentence, ranks, tmp_path):
    """The example prints the sentence once, no traceback, and ends with an exit code other than 0."""
    folder = [] if "--output" in arguments else ["--output", str(tmp_path)]
    done = on_ranks(ranks, "examples/beam_notch.py", *folder, *arguments, check=False, timeout=300)
    assert done.returncode != 0
    errors = [line for line in done.stderr.splitlines() if "error:" in line and "mpiexec" not in line]
    assert len(errors) == 1 and sentence in errors[0], done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.long
def test_misspelt_petsc_option_is_reported(tmp_path):
    done = on_ranks(
        1,
        "examples/beam_notch.py",
        "--no-pictures",
        "--order",
        "2",
        "--output",
        str(tmp_path),
        "-modal_epss_tol",
        "1e-9",
    )
    assert "modal_epss_tol" in done.stdout.split("Option left")[-1]


def test_unreachable_tolerance_is_an_error():
    """A solve that does not converge raises SolveError that names the solve and the remedy."""
    from sbfem_petsc.petsc import PETSc
    from tests.reference import paper_beam

    model = sb.Model(paper_beam().mesh(order=2), sb.Material(70e9, 0.33, 2700))
    options = PETSc.Options()
    given = {"static_ksp_type": "cg", "static_pc_type": "jacobi", "static_ksp_max_it": "3"}
    for name, value in given.items():
        options.setValue(name, value)
    try:
        with pytest.raises(sb.SolveError, match="static: the linear solve did not converge.*static_ksp"):
            sb.static(model, sb.PointForce("A", fy=1.0))
    finally:
        for name in given:
            options.delValue(name)
    options.setValue("modal_eps_max_it", "1")
    options.setValue("modal_eps_ncv", "14")
    try:
        with pytest.raises(sb.SolveError, match="modal: SLEPc found"):
            sb.modal(model, 12)
    finally:
        options.delValue("modal_eps_max_it")
        options.delValue("modal_eps_ncv")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"modal_inertia_pc_type": "jacobi"}, "modal: PETSc gave up .*options for PETSc right"),
        ({"modal_inertia_pc_factor_mat_solver_type": "petsc"}, "modal: PETSc gave up .*options for PETSc"),
        ({"modal_eps_interval": "0,1e9"}, "-modal_eps_interval .* leave it out: modal.*band"),
    ],
)
def test_options_that_find_no_modes(options, sentence):
    """They had been raw errors of PETSc, the last one the end of the process: SLEPc looks for a factor."""
    from sbfem_petsc.petsc import PETSc
    from tests.reference import paper_beam

    model = sb.Model(paper_beam().mesh(order=2), sb.Material(70e9, 0.33, 2700))
    for name, value in options.items():
        PETSc.Options().setValue(name, value)
    try:
        with pytest.raises(sb.SolverFailure, match=sentence):
            sb.modal(model, 8)
    finally:
        for name in options:
            PETSc.Options().delValue(name)


@pytest.mark.parametrize("option", [("type", "ksponly"), ("atol", "1e9"), ("rtol", "0.999")])
def test_newton_that_options_end_early(option):
    """A motion that does not come back to where it began is warned of, by what it misses."""
    from meshing.warnings import OptionWarning
    from sbfem_petsc.petsc import PETSc
    from tests.systems import one_mass

    stop = one_mass(0.5, 0.05, stiffness=5.0)
    PETSc.Options().setValue(f"shooting_snes_{option[0]}", option[1])
    try:
        with pytest.warns(
            OptionWarning, match=r"end \(CONVERGED_.* with x\(T\) - x\(0\) at .* no steady state"
        ):
            sb.periodic(stop, 1.0, 0.15, steps=256, stability=False)
    finally:
        PETSc.Options().delValue(f"shooting_snes_{option[0]}")


@pytest.fixture
def options():
    """Sets options of PETSc, which are gone afterwards."""
    from sbfem_petsc.petsc import PETSc

    given = {}

    def put(**values):
        given.update(values)
        for name, value in values.items():
            PETSc.Options().setValue(name, value)

    yield put
    for name in given:
        PETSc.Options().delValue(name)


def test_monitors_that_an_option_cancels(options):
    """-shooting_snes_monitor_cancel takes the library's own away too, and motions stay what they are with
    their errors; those near another one ended with a bare IndexError.
    """
    from tests.contact.test_friction_in_periods import chain

    calls = [sb.Harmonic(0.3, 0.09) + 0.02, sb.Harmonic(0.4, 0.18, 0.4)], 0.09
    usual = sb.periodic(chain(), *calls, steps=512, stability=False)
    options(shooting_snes_monitor_cancel=None)
    found, told = told_of_options(lambda: sb.periodic(chain(), *calls, steps=512, stability=False))
    assert not told and len(found.residuals) == len(usual.residuals)
    assert np.abs(found.contact_resultant - usual.contact_resultant).max() < 1e-8
    assert found.mode_error == pytest.approx(usual.mode_error, rel=1e-3)


def told_of_options(call):
    """What a call gives, and sentences on options of the command line that it warns of."""
    from meshing.warnings import OptionWarning

    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = call()
    return found, [str(item.message) for item in told if issubclass(item.category, OptionWarning)]


def test_steps_whose_linear_solves_end_early(options):
    """A third of the displacement was off without a word: told once of all steps, by the residual."""
    from tests.systems import short_beam

    def moved():
        load = sb.PointForce("A", fy=sb.Harmonic(1.0, 1600.0))
        history = sb.transient(short_beam(0.01), load, 5e-4, step=5e-6, reduction=None)
        return history.displacement("A")[:, 1]

    direct = moved()
    options(newmark_ksp_type="cg", newmark_pc_type="jacobi")
    iterated, told = told_of_options(moved)
    assert abs(iterated - direct).max() < 1e-8 * abs(direct).max() and not told
    options(newmark_ksp_rtol="1e-2")
    loose, told = told_of_options(moved)
    assert abs(loose - direct).max() > 0.1 * abs(direct).max()
    assert len(told) == 1 and "-newmark_... let a linear solve end" in told[0]
    assert float(told[0].split("with ")[1].split()[0]) > 1e-2


def test_statics_that_options_leave_out_of_balance(options):
    """Not the supports alone are blamed."""
    from meshing.warnings import OptionWarning
    from tests.systems import short_beam

    options(static_ksp_type="cg", static_pc_type="jacobi", static_ksp_rtol="0.1")
    words = r"the options -static_\.\.\. leave that .*supports hardly hold"
    with pytest.warns(OptionWarning, match="-static_"), pytest.raises(sb.SolveError, match=words):
        sb.static(short_beam(0.01), sb.PointForce("A", fy=1.0))


def test_rounding_is_not_laid_to_options(options):
    """3e-5 of the right-hand side is what a direct solver leaves of a beam of 1500 springs: any option of its
    had been told to end it early.
    """
    second = 2.0 * sparse.eye(1500) - sparse.eye(1500, k=1) - sparse.eye(1500, k=-1)
    load = np.eye(1500, 1)
    options(modal_st_mat_mumps_icntl_14="50")
    reduced, told = told_of_options(
        lambda: sb.reduce_matrices(
            sparse.eye(1500, format="csr"),
            (second @ second).tocsr(),
            np.zeros((0, 1500)),
            np.zeros(0),
            loads=load,
            sensors={"1": 0},
            modes=5,
        )
    )
    exact = 4.0 * np.sin(0.5 * np.pi * np.arange(1, 6) / 1501) ** 2
    assert abs(reduced.omega / exact - 1.0).max() < 1e-6 and not told


def test_contact_forces_that_end_early(options):
    """By conjugate gradients on the forces themselves, 15 % off without a word; GMRES, whose own residual
    after a solve is none, is right and not warned of; a type that cannot do it is one sentence.
    """
    body = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[CrackLine([(0.03, 0.045), (0.07, 0.055)])])
    mesh = body.mesh(order=3, size=0.012, face_edges=2, tip_element=False)

    def forces():
        model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), clamped="edge1")
        return sb.static(model, sb.EdgeLoad("edge3", pressure=1e6, tx=8e5)).contact_force

    direct = forces()
    options(contact_dual="1", contact_dual_ksp_type="gmres")
    iterated, told = told_of_options(forces)
    assert abs(iterated - direct).max() < 1e-8 * direct.max() and not told
    options(contact_dual_ksp_atol="1e2")
    loose, told = told_of_options(forces)
    assert abs(loose - direct).max() > 0.1 * direct.max()
    assert len(told) == 1 and "-contact_dual_... let a linear solve end" in told[0]
    options(contact_dual_ksp_type="preonly")
    with pytest.raises(sb.SolverFailure, match="static contact: PETSc gave up .*preonly"):
        forces()


def test_multipliers_that_end_early(options, monkeypatch):
    """Of lightly damped motions, all near the unit circle: a tenth off without a word."""
    from sbfem_petsc.continuation import multipliers
    from tests.systems import short_beam

    reduced = sb.reduce(short_beam(1e-4), sb.PointForce("A", fy=1e-3), modes=30)

    def largest():
        return abs(sb.periodic(reduced, 1.0, 1000.0, steps=256).multipliers[0])

    exact = largest()
    monkeypatch.setattr(multipliers, "WHOLE", 0)
    options(floquet_eps_ncv="10")
    iterated, told = told_of_options(largest)
    assert abs(iterated - exact) < 1e-8 * exact and not told
    options(floquet_eps_tol=".5")
    loose, told = told_of_options(largest)
    assert abs(loose - exact) > 0.05 * exact
    assert len(told) == 1 and "-floquet_... let multipliers miss" in told[0]


def test_options_are_told_of_once_in_a_call(options):
    """Each of the points of a curve, or each attempt in more steps, had told of the same ones."""
    from tests.systems import one_mass

    stop = one_mass(0.5, 0.05, stiffness=5.0)
    options(shooting_snes_atol="1e9")
    for _ in range(2):
        told = told_of_options(lambda: sb.periodic(stop, 1.0, 0.15, stability=False))[1]
        assert len(told) == 1 and "-shooting_snes_..." in told[0]


def test_a_reduction_is_told_of_options_once(options):
    """It is no analysis: each of its solves had told of them, as "steady state"."""
    from tests.systems import short_beam

    model, load = short_beam(0.01), sb.PointForce("A", fy=1.0)
    options(modal_st_ksp_type="cg", modal_st_pc_type="jacobi", modal_st_ksp_rtol="1e-5")
    told = told_of_options(lambda: sb.reduce(model, load, modes=4))[1]
    assert len(told) == 1 and told[0].startswith("PETSc: the options -modal_st_... let a linear solve end")
