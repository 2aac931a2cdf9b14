"""Natural frequencies against the independent reference, closed forms and themselves."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Hole, VNotch
from sbfem_petsc.system.model import count_below
from sbfem_petsc.system.solve import modes
from tests.reference import frequencies, paper_beam

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
STEEL = sb.Material(206e9, 0.3, 7850)


def largest_error(found, case, count):
    return np.abs(found.frequencies[:count] / frequencies(case)[:count] - 1.0).max()


@pytest.mark.slow
def test_paper_case_by_default():
    """Order 5, continued_fraction=1, at most 2,000 boundary unknowns: 1e-4 is asked for, 1.1e-5 is what the
    default mesh gives. It has 2,034, of which 180 are for the contact front's harmonics: frequencies need
    none of them.
    """
    for options in ({}, {"face_edges": 1}):
        model = sb.Model(paper_beam().mesh(order=5, **options), ALUMINIUM)
        assert largest_error(sb.modal(model, 46), "crack80_nu33", 46) < 1.5e-5
    assert model.boundary_unknowns <= 2000


@pytest.mark.slow
def test_paper_case_at_its_best():
    """At most 5,000 boundary unknowns of any order: 1e-5 is asked for; the reference itself is good to
    1e-6.
    """
    model = sb.Model(paper_beam().mesh(order=7), ALUMINIUM)
    assert model.boundary_unknowns <= 5000
    assert largest_error(sb.modal(model, 46), "crack80_nu33", 46) < 2e-6


@pytest.mark.long
def test_orders_converge_and_stay():
    """Orders 3 to 12 on one mesh: errors fall until their floor and never rise above three times it."""
    errors = []
    for order in range(3, 13):
        model = sb.Model(paper_beam().mesh(order=order), ALUMINIUM)
        errors.append(largest_error(sb.modal(model, 46), "crack80_nu33", 46))
        model.destroy()
    errors = np.array(errors)
    floor = errors.min()
    bottom = int(np.argmax(errors <= 3 * floor))
    assert (np.diff(errors[: bottom + 1]) < 0).all(), errors
    assert (errors[bottom:] <= 3 * floor).all(), errors
    assert floor < 2e-6


@pytest.mark.parametrize(
    "case, notches", [("long_cracked", [VNotch(0.176, 0.0038, 0.0)]), ("long_healthy", [])]
)
def test_long_beam(case, notches):
    """Beam of Long et al. (2019), frequencies 1-10."""
    model = sb.Model(Beam(0.406, 0.012, notches).mesh(), STEEL)
    assert largest_error(sb.modal(model, 10), case, 10) < 2e-5


@pytest.mark.parametrize(
    "case, notches", [("hole_crack80_nu33", [VNotch(0.080, 0.0015, 0.0458366)]), ("hole_healthy_nu33", [])]
)
def test_beam_with_hole(case, notches):
    """Beam with a hole of 2.5 mm, frequencies 1-20."""
    model = sb.Model(Beam(0.400, 0.005, notches, [Hole(0.065, 0.0025, 0.0025)]).mesh(), ALUMINIUM)
    assert largest_error(sb.modal(model, 20), case, 20) < 2e-5


def test_case_q():
    """Case Q of the paper's reading: 0.06 degrees, nu = 0.30."""
    model = sb.Model(paper_beam(0.06).mesh(), sb.Material(70e9, 0.30, 2700))
    assert largest_error(sb.modal(model, 46), "crack80", 46) < 1.5e-5


@pytest.mark.slow
def test_band_equals_count():
    """A band returns the modes that counting returns there."""
    model = sb.Model(paper_beam().mesh(order=4), ALUMINIUM)
    counted = sb.modal(model, 46).frequencies
    band = sb.modal(model, band=(20e3, 30e3)).frequencies
    np.testing.assert_allclose(band, counted[(counted >= 20e3) & (counted <= 30e3)], rtol=1e-7)


def test_free_structure_has_three_rigid_modes():
    """An unsupported beam: three modes at zero, then the elastic ones of a second code path (free end, other
    shift).
    """
    found = sb.modal(sb.Model(paper_beam().mesh(order=4), ALUMINIUM, clamped=None), 8)
    assert (found.frequencies[:3] < 1e-2).all()
    assert found.frequencies[3] > 100.0


@pytest.mark.slow
@pytest.mark.parametrize("tolerance, moved", [(1e-4, 3e-7), pytest.param(1e-5, 6e-8, marks=pytest.mark.long)])
def test_auxiliary_projection(tolerance, moved):
    """Leaving out auxiliary unknowns that the band does not need moves the frequencies by no more than
    stated.
    """
    model = sb.Model(paper_beam().mesh(), ALUMINIUM)
    reduced = sb.modal(model, 46, auxiliary_tolerance=tolerance)
    whole = sb.modal(model, 46, auxiliary_tolerance=0)
    assert whole.unknowns == model.unknowns and reduced.unknowns < 0.65 * whole.unknowns
    np.testing.assert_allclose(reduced.frequencies, whole.frequencies, rtol=moved)


def test_thickness_changes_no_frequency():
    thin = sb.modal(sb.Model(paper_beam().mesh(order=3), ALUMINIUM, thickness=0.01), 6).frequencies
    np.testing.assert_allclose(
        thin, sb.modal(sb.Model(paper_beam().mesh(order=3), ALUMINIUM), 6).frequencies, rtol=1e-7
    )


def test_elastic_root_tends_to_the_clamp():
    """Distributed springs on the left edge: softer than the clamp, converging to it as 1 / stiffness."""
    mesh = Beam(0.4, 0.005).mesh(order=4)
    clamp = sb.modal(sb.Model(mesh, ALUMINIUM), 1).frequencies[0]
    drops = []
    for stiffness in (1e15, 1e16):
        model = sb.Model(mesh, ALUMINIUM, clamped=None, supports=[sb.Support("left", stiffness, stiffness)])
        drops.append(1.0 - sb.modal(model, 1).frequencies[0] / clamp)
    assert drops[0] > drops[1] > 0
    assert drops[0] / drops[1] == pytest.approx(10, rel=0.3)


def test_mode_shapes_are_mass_normalised():
    """sum over modes of (participation in x)^2 tends to the moving mass: here it stays below it and is
    large.
    """
    model = sb.Model(paper_beam().mesh(order=4), ALUMINIUM)
    found = sb.modal(model, 8)
    assert found.displacement("A").shape == (8, 2)
    # cantilever: tip amplitude of a mass-normalised bending mode is 2 / sqrt(mass)
    assert abs(found.displacement("A")[0, 1]) == pytest.approx(2.0 / np.sqrt(2700 * 0.4 * 0.005), rel=0.02)


def test_displacements_anywhere(tmp_path):
    """Longitudinal modes of a rod that does not contract are sines; a file keeps no model for them."""
    length, height, steel = 1.0, 0.3, sb.Material(206e9, 0.0, 7850)
    found = sb.modal(sb.Model(Beam(length, height).mesh(order=5, size=0.1), steel), 12)
    x = np.array([0.0, 0.137, 0.52, 0.777, 1.0])
    shapes = np.array([found.displacement((place, 0.11)) for place in x])
    for k, tolerance in enumerate([1e-6, 1e-5, 1e-4]):  # 6e-8, 2e-6 and 1e-5 of a mesh of order 5
        frequency = (2 * k + 1) * np.sqrt(206e9 / 7850) / (4.0 * length)
        mode = shapes[:, np.abs(found.frequencies - frequency).argmin()]
        sine = np.sin((2 * k + 1) * np.pi * x / (2.0 * length)) * np.sqrt(2.0 / (7850 * length * height))
        mode *= np.sign(mode[-1, 0] * sine[-1])
        np.testing.assert_allclose(mode, np.stack([sine, 0.0 * x], axis=1), atol=tolerance * sine.max())
    sb.save(tmp_path / "modes.h5", found)
    with pytest.raises(sb.SolveError, match="solve them again"):
        sb.read(tmp_path / "modes.h5").displacement((0.5, 0.1))
    with pytest.raises(TypeError, match="name of a point or coordinates"):
        found.displacement((0.5, 0.1, 0.0))


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({}, "needs count .* or band"),
        ({"count": 3, "band": (1.0, 2.0)}, "needs count .* not both"),
        ({"count": 0}, "count = 0"),
        ({"count": 10**6}, "between 1 and half"),
        ({"band": (5.0, 1.0)}, "band"),
        ({"band": (1.0, float("nan"))}, "band"),
    ],
)
def test_bad_requests(arguments, sentence):
    model = sb.Model(Beam(0.4, 0.005).mesh(order=2), ALUMINIUM)
    with pytest.raises(ValueError, match=sentence):
        sb.modal(model, **arguments)


@pytest.mark.parametrize("terms", [2, 3, 4])
def test_projection_keeps_the_later_terms(terms):
    """Free unit square, one S-element of order 10: the default is the whole continued fraction within 1e-5;
    four terms give the printed digits.
    """
    model = sb.Model(
        Beam(1.0, 1.0).mesh(order=10, size=1.0, corners=()),
        sb.Material(1.0, 0.3, 1.0),
        clamped=None,
        continued_fraction=terms,
    )
    reduced, whole = (
        2 * np.pi * sb.modal(model, 15, auxiliary_tolerance=t).frequencies[3:] for t in (1e-5, 0)
    )
    np.testing.assert_allclose(reduced, whole, rtol=1e-5)
    if terms == 4:
        expected = [
            2.43265,
            2.59096,
            2.59096,
            2.75536,
            3.13163,
            3.61893,
            3.90289,
            3.90289,
            4.51085,
            5.20854,
            5.20854,
            5.28911,
        ]
        np.testing.assert_allclose(reduced, expected, atol=8e-6)


def clamped_square() -> sb.Model:
    edges = ["left", "right", "top", "bottom"]
    mesh = Beam(1.0, 1.0).mesh(order=3, size=0.25, corners=())
    return sb.Model(mesh, sb.Material(1.0, 0.3, 1.0), clamped=edges)


@pytest.fixture(scope="module")
def exact():
    """The lowest 20 frequencies of the square by a dense solution, Hz."""
    from scipy import linalg, sparse

    from sbfem_petsc.system.solve.pencil import Pencil

    pencil = Pencil(clamped_square().statics, 1.0, 0.0)
    dense = [
        sparse.csr_matrix(m.getValuesCSR()[::-1], shape=m.getSize()).toarray()
        for m in (pencil.stiffness.convert("aij"), pencil.mass.convert("aij"))
    ]
    return np.sqrt(linalg.eigh(*dense, eigvals_only=True, subset_by_index=(0, 19))) / (2 * np.pi)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 7, 8, 9, 10, 14, 15, 16])
def test_multiple_frequencies_are_all_found(count, exact):
    """A clamped square has many double frequencies: every count gives the lowest of a dense solution."""
    model = clamped_square()
    np.testing.assert_allclose(
        sb.modal(model, count, auxiliary_tolerance=0).frequencies, exact[:count], rtol=1e-8
    )
    low, high = 0.99 * exact[count], 1.01 * exact[count + 2]
    inside = exact[(exact >= low) & (exact <= high)]
    if high < exact[-1]:
        np.testing.assert_allclose(
            sb.modal(model, band=(low, high), auxiliary_tolerance=0).frequencies, inside, rtol=1e-8
        )


def test_inertia_counts():
    """The law of inertia counts the eigenvalues below a shift, auxiliary unknowns eliminated."""
    from sbfem_petsc.petsc import PETSc
    from sbfem_petsc.system.solve.pencil import Pencil

    if not PETSc.Sys.hasExternalPackage("mumps"):
        pytest.skip("only MUMPS tells the inertia")
    model = sb.Model(paper_beam().mesh(order=3), ALUMINIUM)
    pencil = Pencil(model.statics, 1e6, 0.0)
    found = sb.modal(model, 12, auxiliary_tolerance=0).frequencies
    middles = 0.5 * (found[1:] + found[:-1])
    assert [pencil.eigenvalues_below((2 * np.pi * f) ** 2) for f in middles] == list(range(1, 12))


@pytest.mark.parametrize("count", [0, 2, 3, 4, 5, 7, 8, 10, 13, 15])
def test_counted_modes_and_one_more(monkeypatch, count, exact):
    """Modes below a frequency and one more are the lowest of a dense solution, by the matrices by which they
    were counted alone: of double frequencies, too, where one of the two is the one more.
    """
    from sbfem_petsc.petsc import PETSc
    from sbfem_petsc.system.solve import modes

    if not PETSc.Sys.hasExternalPackage("mumps"):
        pytest.skip("only MUMPS tells the inertia")
    made, original = [], modes.Pencil

    def pencil(*given):
        made.append(given)
        return original(*given)

    monkeypatch.setattr(modes, "Pencil", pencil)
    model = clamped_square()
    frequency = 0.5 * (exact[count - 1] + exact[count]) if count else 0.9 * exact[0]
    below = count_below(model, frequency)
    assert below == count
    np.testing.assert_allclose(model.modes(below + 1).frequencies, exact[: below + 1], rtol=1e-8)
    assert len(made) == 1


@pytest.mark.parametrize("clamped, below", [("left", 0), (None, 3)])
def test_inertia_counts_next_to_no_frequency(clamped, below):
    """Where S-elements would have no mass but rounding: rigid motions alone are below .1 Hz, of a beam whose
    modes begin at 400 Hz, and nothing of a clamped one, at whatever frequency.
    """
    with sb.Model(Beam(0.1, 0.005).mesh(order=3), ALUMINIUM, clamped=clamped) as model:
        for frequency in (1e-1, *([1e-4, 1e-7] if clamped else [])):
            assert count_below(model, frequency) in (below, None)


@pytest.mark.parametrize("clamped", ["left", None])
def test_small_systems(monkeypatch, clamped):
    """PETSc's own factor and full blocks, which small systems take, against MUMPS and upper halves."""
    from sbfem_petsc.petsc import PETSc
    from sbfem_petsc.system.solve import pencil

    if not PETSc.Sys.hasExternalPackage("mumps"):
        pytest.skip("both would be PETSc's own")
    mesh = paper_beam().mesh(order=4)
    make = lambda: sb.modal(sb.Model(mesh, ALUMINIUM, clamped=clamped), 20)
    small = make()
    monkeypatch.setattr(pencil, "_SMALL", 0)
    large = make()
    assert "lu by petsc" in small.solver and "cholesky by mumps" in large.solver
    elastic = 0 if clamped else 3
    # a factorisation's round-off in modes 1 and 2 of a slender beam that none refines: free ones
    np.testing.assert_allclose(
        small.frequencies[elastic:], large.frequencies[elastic:], rtol=1e-10 if clamped else 1e-8
    )


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_rigid_modes_alone(count):
    """Few modes of a free structure, and of one held at a point, are no failure."""
    free = sb.modal(sb.Model(Beam(1.0, 0.3).mesh(order=4), ALUMINIUM, clamped=None), count).frequencies
    assert (free[:3] < 1e-2).all()
    held = sb.modal(
        sb.Model(Beam(1.0, 0.3).mesh(order=4), ALUMINIUM, clamped=None, supports=[sb.Support("A")]), count
    ).frequencies
    assert held[0] < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("slenderness, tolerance", [(300, 1e-4), (1000, 5e-4)])
def test_very_slender_beams(slenderness, tolerance):
    """Round-off in K is no reason to refuse: f1 is Euler's within what the condition number leaves."""
    model = sb.Model(Beam(0.01 * slenderness, 0.01).mesh(), ALUMINIUM)
    euler = 1.87510407**2 / (2 * np.pi * (0.01 * slenderness) ** 2) * np.sqrt(70e9 * 1e-4 / 12 / 2700)
    assert sb.modal(model, 3).frequencies[0] == pytest.approx(euler, rel=tolerance)


def test_many_modes_are_solved_for_once(monkeypatch):
    """Where the law of the band is too low, as of a crack inside: as those that are solved for until they
    lie in their band.
    """
    mesh = Beam(0.2, 0.01, cracks=[CrackLine([(0.06, 0.003), (0.066, 0.008)])]).mesh(order=3)
    solved, solve = [], modes._solve
    monkeypatch.setattr(modes, "_solve", lambda *args, **more: solved.append(args[2]) or solve(*args, **more))
    once = sb.modal(sb.Model(mesh, ALUMINIUM), 110)
    assert solved == [110]
    monkeypatch.setattr(modes, "COUNTED", 111)
    twice = sb.modal(sb.Model(mesh, ALUMINIUM), 110)
    assert solved == [110, 110, 110]
    np.testing.assert_allclose(once.frequencies, twice.frequencies, rtol=1e-8)
