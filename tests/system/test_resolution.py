"""Errors of frequencies estimated cell by cell, and the warnings, against scikit-fem's converged
frequencies.
"""

import re
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate, VNotch
from sbfem_petsc.system.fields.resolution import NEGLIGIBLE, frequency_errors
from tests.parallel import alone, answer, on_ranks
from tests.systems import ALUMINIUM, case_p
from tests.validation.peer import cantilever

SHAPES = {"stubby": (0.04, 0.005, 20), "short": (0.1, 0.01, 30)}


def model_and_errors(name, terms=1, **mesh):
    """Modes of a cantilever, computed without a word, and their relative errors."""
    length, height, count = SHAPES[name]
    model = sb.Model(Beam(length, height).mesh(**mesh), ALUMINIUM, continued_fraction=terms)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sb.MeshWarning)
        found = sb.modal(model, count)
    return found, found.frequencies / cantilever(length, height, count) - 1.0


CASES = [
    ("stubby", {}),
    ("stubby", {"order": 4}),
    ("stubby", {"order": 2, "size": 0.005}),
    ("stubby", {"order": 9}),
    ("short", {}),
    ("short", {"order": 3, "size": 0.01}),
    ("short", {"order": 9}),
    ("short", {"terms": 0, "order": 7, "size": 0.01}),
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "options"), CASES, ids=str)
def test_estimated_errors(name, options):
    """Within a factor of three where the error is more than 5e-5: below, the clamped corners matter, which
    are not looked at. From the first mode on whose error is a good part of the distance to its neighbour,
    modes come in another order.
    """
    found, errors = model_and_errors(name, **options)
    estimated = frequency_errors(found, range(len(errors)))
    distance = np.diff(found.frequencies) / found.frequencies[:-1]
    mixed = np.flatnonzero(errors[:-1] > 0.3 * distance)
    clear = np.arange(len(errors)) < (mixed[0] if len(mixed) else len(errors))
    looked_at = clear & (errors > 5e-5)
    assert looked_at.sum() >= 2
    ratio = estimated[looked_at] / errors[looked_at]
    assert ratio.min() > 1 / 3 and ratio.max() < 3


@pytest.mark.parametrize("order", [2, 3, 5])
def test_small_cells_hardly_count(order):
    """What warnings leave out of the errors of a graded mesh; nothing where order and tips lose as much."""
    beam = Beam(0.1, 0.01, [VNotch(0.04, 0.005, 0.0)]).mesh(order=order, size=0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sb.MeshWarning)
        found = sb.modal(sb.Model(beam, ALUMINIUM), 30)
    modes = range(22, 30)
    whole, less = frequency_errors(found, modes), frequency_errors(found, modes, NEGLIGIBLE)
    assert less.max() == pytest.approx(whole.max(), rel=0.05)
    assert (less == whole).all() == (order == 2)


@pytest.mark.long
@pytest.mark.parametrize(("name", "options"), CASES, ids=str)
def test_modes_off_by_a_thousandth_warn(name, options):
    """Whatever number of modes is asked for; and nobody is warned of what is right to 3e-4."""
    found, errors = model_and_errors(name, **options)
    for count in range(1, len(errors) + 1):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            sb.modal(found.model, count)
        worst = errors[:count].max()
        # of the last eight: the modes take turns
        if errors[max(0, count - 8) : count].max() > 1e-3:
            assert told, f"{count} modes, off by {worst:.1e}"
        elif worst < 3e-4:
            assert not told, f"{count} modes, off by {worst:.1e} only"


def test_what_the_warning_says():
    model = sb.Model(Beam(0.04, 0.005).mesh(), ALUMINIUM)
    words = r"mode 20 .* too high by about 0\.0. .* wavelengths .* order 5 and 1 term"
    with pytest.warns(sb.MeshWarning, match=words):
        sb.modal(model, 20)


@pytest.mark.long
def test_the_usual_is_not_warned_of():
    """The paper's beam: 46 modes to 68 kHz, and steady states up to its 20 kHz."""
    model = case_p()
    load = sb.PointForce("A", fy=300.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.MeshWarning)
        sb.modal(model, 46)
        sb.transient(model, sb.PointForce("A", fy=sb.Harmonic(300.0, 3000.0)), 1e-3)
        sb.periodic(case_p(damping=0.002), load, 20140.0, contact=False)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [1.5e5, 3e5])
def test_loads_beyond_the_mesh_warn(frequency):
    """A plain beam of 100 x 5 mm: amplitudes are off by 6 % at 150 kHz and by 38 % at 300 kHz."""
    model = sb.Model(Beam(0.1, 0.005).mesh(), ALUMINIUM, damping=0.01)
    with pytest.warns(sb.MeshWarning, match="periodic: the load has frequencies up to") as told:
        sb.periodic(model, sb.EdgeLoad("right", ty=1e5), frequency, contact=False)
    ours = [one for one in told if one.category is sb.MeshWarning]
    assert all(one.filename == __file__ for one in ours)


@pytest.mark.long
@pytest.mark.parametrize("frequency", [6e4, 1e5])
def test_warnings_of_loads_state_the_error(frequency):
    """Traction on the end of a plain beam of 100 x 10 mm: the sentence's error is that of the mode's
    receptance by its frequencies in two meshes within a factor of ten, and no less than the harmonic's.
    """
    beam, load, found, words = Beam(0.1, 0.01), sb.EdgeLoad("right", tx=1e5), [], []
    for mesh, modes in ((beam.mesh(), None), (beam.mesh(order=7, size=0.005), 150)):
        model = sb.Model(mesh, ALUMINIUM, damping=0.01)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            orbit = sb.periodic(model, load, frequency, contact=False, modes=modes, stability=False)
        own = sb.modal(model, 20).frequencies
        receptances = 1.0 / (own**2 - frequency**2 + 0.02j * own * frequency)
        found.append((orbit.harmonics("A")[1], receptances))
        words.append([str(one.message) for one in told])
    (harmonic, coarse), (exact, fine) = found
    pattern = "the error of mode ([0-9]+) .* changes its amplitude by about (.*?) of itself"
    ((mode, stated),) = (match.groups() for one in words[0] if (match := re.search(pattern, one)))
    error = abs(coarse[int(mode) - 1] / fine[int(mode) - 1] - 1.0)
    assert not words[1] and 0.1 < float(stated) / error < 10.0
    assert abs(harmonic - exact) <= float(stated) * abs(exact)


def test_too_few_modes_for_the_load_warn():
    model = sb.Model(Beam(0.1, 0.005).mesh(), ALUMINIUM, damping=0.01)
    with pytest.warns(sb.MeshWarning, match="less than twice as high"):
        sb.periodic(model, sb.EdgeLoad("right", ty=1e5), 2e4, modes=5, contact=False)


def test_elastic_supports_are_no_error():
    """A stiff foundation below a beam whose mesh carries its modes: clamped edges say the same without a
    word.
    """
    stiff = [sb.Support("bottom", x=1e12, y=1e12)]
    found = []
    for options in ({"supports": stiff, "clamped": None}, {"clamped": "bottom"}):
        model = sb.Model(Beam(0.02, 0.005).mesh(order=7, size=0.005), ALUMINIUM, **options)
        modal = sb.modal(model, 6)
        found.append(frequency_errors(modal, range(6)))
    assert max(errors.max() for errors in found) < 1e-3


PROGRAM = """
import json, warnings
import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate
from sbfem_petsc.system.fields.resolution import frequency_errors

warnings.simplefilter("ignore")
model = sb.Model(Beam(0.04, 0.005).mesh(), sb.Material(70e9, 0.33, 2700))
errors = frequency_errors(sb.modal(model, 20), range(20))
if model.comm.rank == 0:
    print(json.dumps({"errors": list(errors)}))
"""


@pytest.mark.long
def test_edges_between_ranks():
    one, three = alone(PROGRAM), answer(on_ranks(3, PROGRAM))
    np.testing.assert_allclose(three["errors"], one["errors"], rtol=1e-6)


def _factors_told(mesh, material):
    """K_I and K_II of a crack "c" in tension, and what they are told to be off by."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", sb.MeshWarning)
        model = sb.Model(mesh, material, clamped="edge1")
        found = sb.static(model, sb.EdgeLoad("edge3", pressure=-1e6), contact=False)
    told = [re.search(r"K_I and K_II are off by about (\S+) of", str(w.message)) for w in said]
    return np.array(found.stress_intensity["c"]), [float(one[1]) for one in told if one]


@pytest.mark.parametrize("order", [1, 2, 3])
def test_factors_where_volume_is_kept(order):
    """K in plane strain at nu = .4999 is told to be off by what order 8 changes it by, within a factor of 3
    (70, 5 and .3 % without a word before), and nothing where it is carried.
    """
    plate = Plate([(0, 0), (1, 0), (1, 2), (0, 2)], cracks=[CrackLine([(0, 1), (0.4, 1)], name="c")])
    rubber = sb.Material(1e9, 0.4999, 1000.0, plane="strain")
    exact, silent = _factors_told(plate.mesh(order=8, size=0.4), rubber)
    found, (told,) = _factors_told(plate.mesh(order=order, size=0.4), rubber)
    error = np.abs(found - exact).max() / np.abs(exact).max()
    assert silent == [] and error / 3 < told < 3 * error
    assert _factors_told(plate.mesh(order=3, size=0.4), sb.Material(1e9, 0.33, 1000.0))[1] == []


# K_I in units of sigma (pi a)^(1/2) of a crack through half of a strip under tension and in bending, Kaya and
# Erdogan (1987), Quarterly of Applied Mathematics 45.
STRIP = {"tx": 2.8246, "ty": 1.4972}


@pytest.mark.parametrize("order", [2, 3, 5])
@pytest.mark.parametrize("way", STRIP)
def test_factors_in_low_orders(way, order):
    """K_I of a long beam is told to be off by what it is, within a factor of 3: 1.5e-2 and 1.6e-3, and 2e-5,
    of which nothing is told.
    """
    mesh = Beam(20.0, 1.0, [VNotch(10.0, 0.5, 0.0)]).mesh(order=order)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", sb.MeshWarning)
        found = sb.static(
            sb.Model(mesh, ALUMINIUM), sb.EdgeLoad("right", **{way: {"tx": 1.0, "ty": -1.0}[way]})
        )
    exact = STRIP[way] * {"tx": 1.0, "ty": 60.0}[way] * np.sqrt(0.5 * np.pi)
    error = abs(found.stress_intensity["crack1"][0] / exact - 1.0)
    told = [re.search(r"K_I and K_II are off by about (\S+) of", str(w.message)) for w in said]
    if order == 5:
        assert error < 1e-4 and told == []
    else:
        ((share,),) = [one.groups() for one in told if one]
        assert error / 3 < float(share) < 3 * error


def test_a_history_tells_of_factors_once():
    """By its own name, in the state that is off most: shear of a crack along stiff fibres, beside tension."""
    plate = Plate([(0, 0), (1, 0), (1, 2), (0, 2)], cracks=[CrackLine([(0, 1), (0.4, 1)], name="c")])
    fibres = sb.OrthotropicMaterial(4e11, 1e10, 0.3, 5e9, density=1600)
    model = sb.Model(plate.mesh(order=4), fibres, clamped="edge1")
    load = sb.EdgeLoad("edge3", tx=sb.Samples([0.0, 1.0], [0.0, 1e6]), ty=sb.Samples([0.0, 1.0], [1e6, 0.0]))
    told = []
    for run in (sb.static, sb.load_history):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", sb.MeshWarning)
            if run is sb.static:
                for one in (sb.EdgeLoad("edge3", ty=1e6), sb.EdgeLoad("edge3", tx=1e6)):
                    run(model, one, contact=False)
            else:
                run(model, load, [0.0, 0.5, 1.0], contact=False)
        texts = [str(w.message) for w in said if "K_I and K_II are off" in str(w.message)]
        told.append([re.sub(r"^\w+: ", "", text) for text in texts])
        assert all(text.startswith(run.__name__) for text in texts)
    (less, more), only = told
    assert less != more and only == [more]


@pytest.mark.slow
def test_factors_in_strong_anisotropy():
    """K of a crack through fibres is told to be off by what a higher order changes it by, within a factor of
    3, and no more where it is not; weak anisotropy is carried.
    """
    plate = Plate([(0, 0), (1, 0), (1, 2), (0, 2)], cracks=[CrackLine([(0, 1), (0.4, 1)], name="c")])

    def factor(ratio, order):
        material = sb.OrthotropicMaterial(ratio * 1e10, 1e10, 0.3, 5e9, density=1600, angle=30)
        return _factors_told(plate.mesh(order=order), material)

    assert factor(3, 5)[1] == []
    exact, silent = factor(14, 9)
    assert silent == []
    for order in (4, 5):
        found, (told,) = factor(14, order)
        error = np.abs(found - exact).max() / np.abs(exact).max()
        assert error / 3 < told < 3 * error
