"""What a notebook shows: a picture that ends a cell, and a bar below it while something is under way."""

import base64
import re
import sys
import types

import pytest
from matplotlib.figure import Figure
from mpi4py import MPI

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc import progress
from sbfem_petsc.plot import plot_discretisation, plot_harmonics
from tests.systems import one_mass

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.long
def test_pictures_are_shown():
    """One of several panels, and one of a single one; those in axes of the user's are the user's to show."""
    mesh = Beam(0.4, 0.005).mesh(order=2)
    panels = plot_discretisation(mesh)
    assert isinstance(panels, list) and panels._repr_png_().startswith(PNG)
    orbit = sb.periodic(one_mass(1.0, 0.05), [1e-3], 0.1, steps=64, stability=False)
    single = plot_harmonics(orbit, orbit.points[0])
    assert single._repr_png_().startswith(PNG)
    given = Figure().add_subplot()
    assert not any(hasattr(part, "_repr_png_") for part in (plot_discretisation(mesh, ax=given), given))


@pytest.mark.slow
def test_results_show_a_table_and_a_small_picture(monkeypatch):
    """Numbers of short arrays, and a PNG below half a megabyte; without Matplotlib the table alone."""
    mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.02)]).mesh(order=2)
    model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700.0), damping=0.01)
    force = sb.PointForce("A", fy=100.0)
    modes, pushed = sb.modal(model, count=3), sb.static(model, force)
    orbit = sb.periodic(one_mass(1.0, 0.05), [1e-3], 0.1, steps=64, stability=False)
    for result in (modes, pushed, orbit):
        page = result._repr_html_()
        (data,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
        assert base64.b64decode(data).startswith(PNG) and len(data) < 500_000
        assert page.count("<table>") == 1
    assert f"{modes.frequencies[2]:.6g}" in modes._repr_html_()
    monkeypatch.setitem(sys.modules, "sbfem_petsc.plot.inline", None)
    assert "<img" not in pushed._repr_html_() and "contact forces" in pushed._repr_html_()


@pytest.fixture
def notebook(monkeypatch):
    """A kernel's IPython, whose shows are kept: each a list of what it showed in turn."""
    shows: list[list[str]] = []

    class Handle:
        def __init__(self, first):
            self.texts = [first]
            shows.append(self.texts)

        def update(self, text):
            self.texts.append(text)

    shell = types.SimpleNamespace(kernel=object())
    display = types.ModuleType("IPython.display")
    display.HTML, display.display = str, lambda text, display_id: Handle(text)
    package = types.ModuleType("IPython")
    package.get_ipython, package.display = lambda: shell, display
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr(progress, "MOMENT", 0.0)
    return shows


def test_a_bar_below_the_cell(notebook):
    """It moves, and is gone at the end; quick work shows none."""
    with progress.progress_bar(MPI.COMM_SELF, "curve <1>") as report:
        report(0.25)
        report(0.5)
    (texts,) = notebook
    assert texts[0].startswith("curve &lt;1&gt;") and 'value="0.250"' in texts[0] and "50 %" in texts[1]
    assert texts[-1] == "" and len(texts) == 3
    progress.MOMENT = 60.0
    with progress.progress_bar(MPI.COMM_SELF, "quick") as report:
        report(0.5)
    assert len(notebook) == 1


def test_no_bar_in_a_terminal_session(monkeypatch):
    package = types.ModuleType("IPython")
    package.get_ipython = lambda: types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "IPython", package)
    assert not progress.in_notebook()
