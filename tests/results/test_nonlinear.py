"""Backbones, loci, basins, swept responses and quasi-periodic motions in files: what is read is what was
found, and can be gone on with.
"""

import dataclasses
import json

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_backbone, plot_branches, plot_quasi_periodic
from sbfem_petsc.record.layout import bare
from tests.fuzz import examples
from tests.results.same import compared
from tests.systems import same_products

MADE = {
    "backbone": examples.backbone,
    "loci": lambda: (examples.locus(), dataclasses.replace(examples.locus(), kind="grazing")),
    "locus": examples.locus,
    "basins": examples.two_axes,
    "swept response": examples.swept_response,
    "swept responses": lambda: (examples.swept_response(),) * 2,
    "two tones": examples.quasi_periodic,
    "own tone": examples.with_own_tone,
    "branch of tori": examples.quasi_periodic_branch,
    "orbit": examples.orbit,
    "branch": examples.branch,
}


@pytest.mark.parametrize("kind", MADE)
def test_what_is_read_is_what_was_found(kind, tmp_path):
    result, path = MADE[kind](), tmp_path / "result.h5"
    sb.save(path, result)
    found = sb.read(path)
    compared(found, result)
    assert repr(found) == repr(result)
    missing = []

    def look(name, item):
        told = {"units", "long_name"} <= set(item.attrs)
        if isinstance(item, h5py.Dataset) and not bare(item) and not told:
            missing.append(name)

    with h5py.File(path) as file:
        file.visititems(look)
    assert not missing


@pytest.mark.parametrize("kind", ["backbone", "two tones", "own tone", "branch of tori"])
def test_tables_and_views(kind, tmp_path):
    """One table an axis, with units; a summary that JSON holds; a table in notebooks."""
    result = MADE[kind]()
    result.to_csv(tmp_path / "a.csv")
    first = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    if kind == "backbone":
        np.testing.assert_array_equal(first["frequency_Hz"], result.frequency)
        np.testing.assert_array_equal(first["amplitude_A_m"], result.amplitude("A"))
    elif kind == "branch of tori":
        np.testing.assert_array_equal(first["frequencies_f2_Hz"], result.frequencies[:, 1])
        np.testing.assert_array_equal(first["amplitude_f1_plus_f2_1_m"], np.abs(result.line(1, 1, "1")))
    else:
        point = result.points[0]
        for m, n, frequency, real, imag, *_ in first.tolist():
            assert frequency == pytest.approx(abs(m * result.frequencies[0] + n * result.frequencies[1]))
            value = result.line(int(m), int(n), point)
            assert value == complex(real, imag) or np.conj(value) == complex(real, imag)
        assert len(first) > 100 and (np.diff(first["frequency_Hz"]) >= 0.0).all()
    assert json.loads(json.dumps(result.summary(), allow_nan=False))
    assert result._repr_html_().startswith("<b>")


@pytest.mark.parametrize("kind", ["backbone", "two tones", "branch of tori"])
def test_views(kind, tmp_path):
    """Of xarray, from memory and from the file."""
    xarray, result = pytest.importorskip("xarray"), MADE[kind]()
    found = result.to_xarray()
    assert all({"units", "long_name"} <= set(item.attrs) for item in found.data_vars.values())
    pytest.importorskip("netCDF4")
    sb.save(tmp_path / "a.h5", result)
    name = {"backbone": "energy", "two tones": "states", "branch of tori": "value"}[kind]
    with xarray.open_datatree(tmp_path / "a.h5") as tree:
        np.testing.assert_array_equal(tree[name], getattr(result, name))


def test_a_backbone_gives_its_motions(tmp_path):
    result = examples.backbone()
    sb.save(tmp_path / "backbone.h5", result)
    found = sb.read(tmp_path / "backbone.h5")
    same_products(found.orbit(-1).displacement("A"), result.orbit(-1).displacement("A"))


@pytest.mark.long
def test_tori_are_gone_on_with(tmp_path):
    """From what was read as from what was found: the next motion, and one of more samples."""
    branch = examples.quasi_periodic_branch()
    sb.save(tmp_path / "tori.h5", branch)
    found = sb.read(tmp_path / "tori.h5")
    options = {"points": 2, "stability": False, "progress": None}
    one, other = (sb.quasi_periodic_response(item.motions[0], 0.095, **options) for item in (found, branch))
    assert len(one) == 2
    np.testing.assert_allclose(one.frequencies, other.frequencies, rtol=1e-12)
    last = found.motions[-1]
    more = {"guess": last, "samples": 21, "steps": 128, "stability": False}
    finer = sb.quasi_periodic(last.reduced, [0.1], (last.frequencies[0], None), **more)
    assert finer.frequencies[1] == pytest.approx(last.frequencies[1], rel=0.01)


def test_what_is_no_result(tmp_path):
    backbone, locus = examples.backbone(), examples.locus()
    for wrong in (3, [], (backbone, 3), {"a": None}):
        with pytest.raises(ValueError if wrong == [] else TypeError, match="save: result = "):
            sb.save(tmp_path / "wrong.h5", wrong)
    assert not list(tmp_path.iterdir())
    for several in ((locus, backbone), {"a": locus, "b": backbone}):
        sb.save(tmp_path / "several.h5", several)
        compared(sb.read(tmp_path / "several.h5"), several)


def test_picture_of_tori():
    """Amplitude and frequency of the own tone at every motion, in kHz and m."""
    branch = examples.quasi_periodic_branch()
    upper, lower = plot_quasi_periodic({"a": branch}, "1")
    for axes, values in ((upper, np.abs(branch.line(0, 1, "1"))), (lower, branch.frequencies[:, 1])):
        drawn = np.concatenate([line.get_xydata() for line in axes.lines])
        factor = 1.0 if "(m)" in axes.get_ylabel() or "(Hz)" in axes.get_ylabel() else 1e3
        for point in np.column_stack([branch.value, values * factor]):
            assert np.abs(drawn - point).sum(axis=1).min() < 1e-9
    (upper, _), second = plot_quasi_periodic(branch, "1", harmonic=2), np.abs(branch.line(0, 2, "1"))
    heights = np.concatenate([line.get_ydata() for line in upper.lines if len(line.get_ydata())])
    scaled = second * heights.max() / second.max()
    assert all(np.abs(heights - value).min() < 1e-9 * heights.max() for value in scaled)
    assert upper.get_ylabel().startswith("harmonic 2 of the own tone")
    with pytest.raises(
        ValueError, match="plot_quasi_periodic: some branches are over the frequency and some over the load"
    ):
        plot_quasi_periodic({"a": branch, "b": dataclasses.replace(branch, parameter="load")}, "1")


def test_picture_of_damped_backbones():
    """Frequencies above damping ratios, over one axis of energies; the undamped one has no ratio."""
    undamped = examples.backbone()
    damped = sb.backbone(
        examples.oscillator(), 1, 0.1, 0.2, damping=True, refine=False, stability=False, steps=64
    )
    axes = plot_backbone({"undamped": undamped, "damped": damped})
    upper, lower = axes.figure.axes
    assert axes is upper and lower.get_ylabel() == "damping ratio (decay)" and lower.get_xscale() == "log"
    assert len(plot_backbone(undamped).figure.axes) == 1

    def drawn(panel):
        return np.concatenate([line.get_xydata() for line in panel.lines if len(line.get_xydata())])

    for panel, backbones, values in (
        (upper, (undamped, damped), "frequency"),
        (lower, (damped,), "damping_ratio"),
    ):
        expected = np.concatenate([np.column_stack([b.energy, getattr(b, values)]) for b in backbones])
        far = np.abs(drawn(panel)[:, None] / expected - 1.0).max(axis=2).min(axis=0)
        assert far.max() < 1e-12 and len(drawn(panel)) > 5 * len(expected)


def test_frequencies_are_drawn_as_they_are():
    """Labels are not relative to an offset, and differences of rounding make no curve."""
    backbone = examples.backbone()
    rounded = 14e3 * (1.0 + 1e-12 * np.arange(len(backbone.energy)))
    for frequency, least in ((rounded, 0.99e-5), (14e3 + np.arange(len(backbone.energy)), 1e-4)):
        axes = plot_backbone(dataclasses.replace(backbone, frequency=frequency))
        axes.figure.canvas.draw()
        low, high = axes.get_ylim()
        assert high - low > least * high and low < 14.0 < high
        labels = [label.get_text() for label in axes.get_yticklabels()]
        assert axes.yaxis.get_offset_text().get_text() == "" and any(text.startswith("14") for text in labels)


def test_picture_of_a_backbone_over_curves():
    """The free motions that the peaks stand on, as a dotted line at their own amplitudes."""
    found = examples.backbone()
    axes = plot_branches(examples.branch(), backbone=found)
    (line,) = [line for line in axes.lines if line.get_linestyle() == ":"]
    drawn = line.get_xydata() / [1.0, line.get_ydata()[0]]
    expected = np.column_stack([found.frequency, found.amplitude("A") / found.amplitude("A")[0]])
    assert np.abs(drawn[:, None] / expected - 1.0).max(axis=2).min(axis=0).max() < 1e-12
    with pytest.raises(ValueError, match="are not divided by forces"):
        plot_branches({"a": examples.branch()}, backbone=found, forces={"a": 1.0})
