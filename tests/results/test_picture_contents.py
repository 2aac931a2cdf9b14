"""What pictures show is what was found: the numbers behind the lines, marks and titles of their axes."""

import re

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.plot.animation import animate_crack
from sbfem_petsc.plot.fields import plot_contact, plot_crack, plot_modes
from sbfem_petsc.plot.meshes import plot_discretisation
from sbfem_petsc.plot.orbits import plot_multipliers, plot_orbit
from tests.systems import two_masses

FACTORS = {"GPa": 1e9, "MPa": 1e6, "kPa": 1e3, "Pa": 1.0, "m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}


def unit(label: str) -> float:
    """Factor of the unit in brackets at the end of an axis' label."""
    return FACTORS[re.search(r"\((\S+)\)$", label)[1]]


def data(line) -> np.ndarray:
    """(n, 2): points of a line as they are drawn."""
    return np.column_stack([line.get_xdata(), line.get_ydata()])


@pytest.fixture(scope="module")
def orbit():
    """Two masses with a stop that is met."""
    return sb.periodic(two_masses(), [0.1], 0.1, steps=256)


def test_pressure_and_gap_along_the_crack(solved):
    """The gap of each pair at its place; the pressure is its force on its share of the face."""
    mesh, model, _, cases = solved
    pressure, gap = plot_contact(cases)
    lengths, place = mesh.pairs.weight, mesh.pairs.position * mesh.cracks[0].length
    lines = {line.get_label(): data(line) for line in gap.get_lines()}
    scale = [unit(gap.get_xlabel()), unit(gap.get_ylabel())]
    shown = {"initial": mesh.pairs.gap, **{name: case.gap for name, case in cases.items()}}
    assert set(lines) == set(shown)
    for name, expected in shown.items():
        np.testing.assert_allclose(
            lines[name] * scale, np.column_stack([place, expected]), rtol=1e-12, atol=1e-20
        )
    for name, case in cases.items():
        (line,) = (line for line in pressure.get_lines() if line.get_label().startswith(name))
        assert f"{case.active.sum()} of {len(case.gap)} pairs" in line.get_label()
        drawn = np.asarray(line.get_ydata()) * unit(pressure.get_ylabel())
        known = np.isfinite(drawn)
        assert np.count_nonzero(~known) == 1  # the pair on the tip element's boundary has no share
        np.testing.assert_allclose((drawn * lengths)[known], case.contact_force[known], rtol=1e-12)
    assert cases["closing"].contact_force.max() > 0.0


def test_modes_are_drawn_as_they_move(solved):
    """One panel a mode, its frequency above; the free end's corner at rest and moved along the mode."""
    _, _, modes, _ = solved
    panels = plot_modes(modes, [0, 2])
    corner = np.array([50.0, 5.0])  # mm
    for axes, number in zip(panels, (0, 2)):
        found = re.fullmatch(r"mode (\d+):\s+([\d.]+) (k?)Hz", axes.get_title())
        assert int(found[1]) == number + 1
        frequency = float(found[2]) * (1e3 if found[3] else 1.0)
        assert frequency == pytest.approx(modes.frequencies[number], rel=1e-4)
        vertices = [np.asarray(path.vertices) for item in axes.collections for path in item.get_paths()]
        vertices += [np.asarray(patch.get_path().vertices) for patch in axes.patches]
        away = np.concatenate([*vertices, *(data(line) for line in axes.get_lines())]) - corner
        x, y = modes.displacement("A")[number] / np.linalg.norm(modes.displacement("A")[number])
        along, across = away @ [x, y], away @ [-y, x]
        on_the_way = np.abs(across) < 1e-9
        assert (on_the_way & (np.abs(along) < 1e-9)).any() and (on_the_way & (np.abs(along) > 0.1)).any()


def test_mesh_panels(solved):
    """The whole with its numbers in the title, and two views of the crack about its tip."""
    mesh, _, _, _ = solved
    whole, *zooms = plot_discretisation(mesh)
    numbers = [int(n) for n in re.findall(r"(\d+) (?:S-elements|nodes|contact)", whole.get_title())]
    assert numbers == [mesh.elements, len(mesh.nodes), len(mesh.pairs)]
    widths = []
    for axes in zooms:
        factor = unit(axes.get_xlabel())
        left, right = np.array(axes.get_xlim()) * factor
        assert 0.5 * (left + right) == pytest.approx(mesh.cracks[0].tip[0], abs=1e-9) and axes.collections
        widths.append(right - left)
    assert len(widths) == 2 and 0.05 > widths[0] >= mesh.cracks[0].length > widths[1]


def test_orbit_panels(orbit):
    """The phase plane holds displacement and velocity, the last panel the resultant of one period: each in a
    unit that is a power of ten.
    """
    plane, *_, resultant = plot_orbit(orbit, "1")
    loop = max((data(line) for line in plane.get_lines()), key=len)
    shown = max((data(line)[:, 1] for line in resultant.get_lines()), key=len)
    for drawn, values in (
        (loop[:, 0], orbit.displacement("1")[:, 1]),
        (loop[:, 1], orbit.velocity("1")[:, 1]),
        (shown, orbit.contact_resultant),
    ):
        power = np.log10(np.ptp(drawn) / np.ptp(values))
        assert power == pytest.approx(round(power), abs=1e-9)
        np.testing.assert_allclose(drawn[: len(values)], 10.0 ** round(power) * values, rtol=1e-9, atol=1e-12)


def test_multipliers_in_the_plane(orbit):
    """Each of them is a mark, and none of a stable motion one of those outside the unit circle."""
    plane, _ = plot_multipliers(orbit)
    marks = {line.get_label(): data(line) for line in plane.get_lines()}
    assert orbit.stable and "outside" not in marks
    np.testing.assert_allclose(marks["inside"] @ [1.0, 1j], orbit.multipliers, rtol=1e-12)


def test_a_wide_notch_at_rest(tmp_path):
    """Its opening is drawn as it is, and the displacement, of which there is none, once."""
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 20.0)]).mesh(order=1)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700.0))
    rest = sb.transient(model, sb.PointForce("A", fy=sb.Step(1.0, 1.0)), 1e-5, 1e-6, modes=2)
    assert not rest.displacement("A").any()
    whole, near = plot_crack(model, {"rest": rest.field(0.0)})
    assert {axes.get_title() for axes in (whole, near)} == {"rest, displacement × 1"}
    lines = np.concatenate([data(line) for line in whole.get_lines()]) * unit(whole.get_xlabel())
    mouth = 0.008 * np.tan(np.radians(10.0))  # its width, 4 mm deep
    for side in (-1.0, 1.0):
        assert np.hypot(lines[:, 0] - 0.5 * side * mouth, lines[:, 1] - 0.004).min() < 1e-9
    assert animate_crack(rest, str(tmp_path / "rest.gif"), frames=2) is not None
