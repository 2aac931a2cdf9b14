"""What all pictures share: axes of one's own to draw in, points by coordinates, directions, harmonics, a
style that ends with the picture.
"""

from __future__ import annotations

import json
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import sbfem_petsc as sb
from sbfem_petsc import plot
from tests.fuzz import examples
from tests.parallel import on_ranks
from tests.systems import same_products

CORNER = (0.1, 0.01)  # of the beam, where point "A" is


def steady() -> sb.Orbit:
    """A motion of the beam."""
    return sb.periodic(examples.model(), examples.PUSH, 300.0, steps=64, modes=6, stability=False)


def lines(axes) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata(), dtype=float) for line in axes.get_lines()]


def test_in_axes_of_ones_own():
    """One axes, several, a figure and a part of one; what was there stays."""
    ours = Figure()
    left, right = ours.subplots(1, 2)
    right.set_title("mine", fontsize=20)
    assert plot.plot_branches(examples.branch(), ax=left) is left and left.get_lines()
    assert left.xaxis.label.get_size() == matplotlib.rcParams["font.size"]
    panels = plot.plot_multipliers(examples.orbit(), ax=[left, right], title="both")
    assert panels == [left, right] and left.get_title("left") == "both"
    assert right.get_title() == "mine" and right.title.get_size() == 20.0
    whole = Figure(layout="constrained")
    drawn = plot.plot_orbit(examples.orbit(), ax=whole)
    assert whole.axes == drawn and len(drawn) == 3
    part = whole.subfigures(1, 2)[0]
    assert all(axes.figure is part for axes in plot.plot_discretisation(examples.mesh(), ax=part))


def test_fewer_axes_show_the_first_panels():
    alone = Figure().subplots()
    (phase,) = plot.plot_orbit(examples.orbit(), ax=alone)
    assert phase is alone
    expected = plot.plot_orbit(examples.orbit())[0]
    for found, whole in zip(lines(phase), lines(expected)):
        np.testing.assert_array_equal(found, whole)
    (gaps,) = plot.plot_contact(examples.static(), ax=Figure().subplots())
    assert gaps.get_xlabel() and gaps.get_ylabel().startswith("contact pressure")


@pytest.mark.parametrize("wrong", [3, [], ["axes"], {"a": 1}])
def test_what_nothing_can_be_drawn_in(wrong):
    with pytest.raises(
        TypeError, match="plot_orbit: ax = .* must be axes of Matplotlib, several, or a figure"
    ):
        plot.plot_orbit(examples.orbit(), ax=wrong)


def test_a_keyword_that_there_is_not():
    with pytest.raises(TypeError, match="plot_orbit: got an unexpected keyword argument 'titel'"):
        plot.plot_orbit(examples.orbit(), titel="mine")


def test_more_axes_than_panels():
    with pytest.raises(ValueError, match="plot_branches: ax has 2 axes, and the picture 1; give 1"):
        plot.plot_branches(examples.branch(), ax=Figure().subplots(1, 2))


def test_the_style_ends_with_the_picture():
    before = dict(matplotlib.rcParams)
    plot.plot_branches(examples.branch())
    with pytest.raises(KeyError):
        plot.plot_branches(examples.branch(), "nowhere")
    assert dict(matplotlib.rcParams) == before


# ---------------------------------------------------------------------- points, directions, harmonics
@pytest.mark.slow
def test_a_point_by_its_coordinates():
    """The corner of the beam is point "A": whatever is drawn there is drawn of it."""
    branch, orbit = examples.model_branch(), steady()
    pictures = {
        "branches": lambda p: [plot.plot_branches(branch, p)],
        "first harmonic": lambda p: [plot.plot_branches(branch, p, harmonic=1)],
        "harmonics": lambda p: [plot.plot_harmonics(orbit, p)],
        "orbit": lambda p: plot.plot_orbit(orbit, p),
        "history": lambda p: plot.plot_history(examples.motion(), p),
        "load history": lambda p: plot.plot_load_history(examples.loads_in_time(), p),
    }
    for name, draw in pictures.items():
        for one, other in zip(draw("A"), draw(CORNER)):
            for known, found in zip(lines(one), lines(other), strict=True):
                if len(known):  # the pictures' own bound of what is no rounding
                    np.testing.assert_allclose(found, known, rtol=1e-6, atol=1e-9 * np.abs(known).max())
            assert one.get_ylabel().replace("A", "0.1 m, 0.01 m") == other.get_ylabel(), name


@pytest.mark.slow
def test_amplitudes_beside_those_kept():
    """Integrated again, at "A" as kept; along x, of an orbit's own displacement."""
    branch = examples.model_branch()
    np.testing.assert_allclose(branch.amplitude(CORNER), branch.amplitude("A"), rtol=1e-6)
    same_products(branch.harmonics(CORNER)[:, 1], branch.harmonics("A")[:, 1])
    for k, x in enumerate(branch.amplitude("A", "x")):
        assert x == pytest.approx(0.5 * np.ptp(branch.orbit(k).displacement("A")[:, 0]), rel=1e-12)
    with pytest.raises(KeyError, match="point 'nowhere' does not exist; the model has 'A'"):
        branch.amplitude("nowhere", "x")


def test_directions_and_harmonics():
    branch = examples.branch()
    axes = plot.plot_branches({"a": branch}, harmonic=1)
    x, y = max((line.get_data() for line in axes.get_lines()), key=lambda data: len(data[0]))
    scale = {"mm": 1e3, "m": 1.0, "µm": 1e6}[axes.get_ylabel().split("(")[-1][:-1]]
    assert axes.get_ylabel().startswith("harmonic 1 of $u$(A)")  # a row of matrices
    for value, height in zip(branch.value, np.abs(branch.harmonics("A")[:, 1])):
        assert np.hypot(x - value, y / scale / height - 1.0).min() < 1e-9
    (alone,) = plot.plot_history(examples.motion(), direction="x")[:1]
    assert [line.get_label() for line in alone.get_lines()][:1] == ["$u_x$"]
    assert alone.get_ylabel().startswith("$u_x$ of A")
    with pytest.raises(ValueError, match="direction = 'z' must be one of"):
        plot.plot_orbit(examples.orbit(), direction="z")
    with pytest.raises(ValueError, match="harmonic = 21 must be"):
        plot.plot_branches(branch, harmonic=21)


def test_legends_say_stable_and_unstable_where_both_are():
    labels = [
        text.get_text() for text in plot.plot_branches(examples.with_bifurcation(), "1").get_legend().texts
    ]
    assert labels[:2] == ["stable", "unstable"]


def test_a_place_of_motions_with_a_tone_of_their_own(monkeypatch):
    """Integrated again at a place that moves as the first mass does, in the place of a model's."""
    branch = examples.quasi_periodic_branch()
    with pytest.raises(sb.SolveError, match="knows its named points alone"):
        branch.line(0, 1, (0.1, 0.0))
    monkeypatch.setattr(
        type(branch.motions[0].reduced), "output_at", lambda self, *_: self.points.of("1", "point")
    )
    np.testing.assert_allclose(branch.line(1, -1, (0.1, 0.0)), branch.line(1, -1, "1"), rtol=1e-9)
    named, placed = (plot.plot_quasi_periodic(branch, point) for point in ("1", (0.1, 0.0)))
    np.testing.assert_allclose(lines(placed[0])[1], lines(named[0])[1], rtol=1e-9)
    assert "0.1 m, 0 m" in placed[0].get_ylabel()


def test_more_families_of_a_spectrum_than_colours():
    """All of them are marked and named."""
    frequency = np.arange(1.0, 200.0)
    families = {f"family {k}": [20.0 * k + 10.0] for k in range(9)}
    peaks = np.isin(frequency, [at for (at,) in families.values()])
    (axes,) = plot.plot_spectra(
        {"a": (frequency, np.where(peaks, 1.0, 1e-3))}, "u (m)", (1.0, 199.0), harmonics=families
    )
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(families)
    marked = [line.get_xdata() for line in axes.get_lines() if line.get_marker() == "v"]
    assert np.concatenate(marked).tolist() == [at for (at,) in families.values()]


# ---------------------------------------------------------------------- ranks
def on_rank() -> None:
    """A program: at a place both ranks find the displacement, and rank 0 alone has the picture."""
    comm = examples.model().comm
    axes = plot.plot_branches(examples.model_branch(), CORNER)
    named = plot.plot_branches(examples.model_branch() if comm.rank == 0 else None, "A")
    assert (axes is None) == (named is None) == (comm.rank > 0)
    if comm.rank == 0:
        print(
            json.dumps([float(line.max()) for drawn in (axes, named) for line in lines(drawn) if len(line)])
        )
    orbit = steady()
    try:
        plot.plot_orbit(None if comm.rank == 1 else orbit, CORNER)
    except TypeError as error:
        print(f"rank {comm.rank}: {error}", flush=True)


@pytest.mark.long
def test_a_place_on_two_ranks():
    done = on_ranks(2, __file__, check=True, timeout=300)
    first = next(line for line in done.stdout.splitlines() if line.startswith("["))
    heights = json.loads(first)
    half = len(heights) // 2
    np.testing.assert_allclose(heights[:half], heights[half:], rtol=1e-6)
    for rank in (0, 1):
        assert f"rank {rank}: plot_orbit: orbit = None must be an Orbit" in done.stdout


if __name__ == "__main__":
    sys.exit(on_rank())
