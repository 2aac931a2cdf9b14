"""Backbones, loci, basins, swept responses and quasi-periodic motions in files: what is read is what was
found, and can be gone on with.
"""

import dataclasses

import h5py
import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.continuation.problems.free import FreeSystem
from sbfem_petsc.continuation.problems.own_tone import OwnTone
from sbfem_petsc.plot import plot_backbone, plot_branches, plot_quasi_periodic
from sbfem_petsc.reduction.reduced_model import ReducedModel
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


RECORDS = ("loci", "locus", "basins", "swept response", "swept responses", "orbit", "branch")


def same(found, expected, name):
    """Every field, but for the model, the loads and what is made of the others."""
    assert type(found) is type(expected) or isinstance(expected, float), name
    if isinstance(expected, np.ndarray):
        np.testing.assert_array_equal(found, expected, err_msg=name)
    elif isinstance(expected, tuple):
        assert len(found) == len(expected), name
        for k, (one, other) in enumerate(zip(found, expected)):
            same(one, other, f"{name}[{k}]")
    elif isinstance(expected, FreeSystem):
        assert (found.mode, found.steps) == (expected.mode, expected.steps)
        same(found.reduced, expected.reduced, f"{name}.reduced")
    elif isinstance(expected, OwnTone):
        assert (found.parameter, found.frequency, found.samples) == (
            expected.parameter,
            expected.frequency,
            expected.samples,
        )
        assert (found.period.steps, found.period.pairs) == (expected.period.steps, expected.period.pairs)
        same(found.period.excitation, expected.period.excitation, f"{name}.excitation")
    elif dataclasses.is_dataclass(expected):
        for field in dataclasses.fields(expected):
            if isinstance(expected, ReducedModel) and field.name in ("loads", "model", "modal"):
                continue
            if field.name not in ("uncertainty", "period"):
                same(getattr(found, field.name), getattr(expected, field.name), f"{name}.{field.name}")
    else:
        assert found == expected or (found != found and expected != expected), name


@pytest.mark.parametrize("kind", MADE)
def test_what_is_read_is_what_was_found(kind, tmp_path):
    result, path = MADE[kind](), tmp_path / "result.h5"
    if kind in RECORDS:
        sb.save(path, result)
        found = sb.read(path)
        compared(found, result)
        return
    sb.save_result(result, path)
    found = sb.read_result(path)
    assert repr(found) == repr(result)
    same(found, result, kind)
    missing = []

    def look(name, item):
        if isinstance(item, h5py.Dataset) and not {"unit", "description"} <= set(item.attrs):
            missing.append(name)

    with h5py.File(path) as file:
        file.visititems(look)
    assert not missing


def test_a_backbone_gives_its_motions(tmp_path):
    result = examples.backbone()
    sb.save_result(result, tmp_path / "backbone.h5")
    found = sb.read_result(tmp_path / "backbone.h5")
    same_products(found.orbit(-1).displacement("A"), result.orbit(-1).displacement("A"))


def test_tori_are_gone_on_with(tmp_path):
    """From what was read as from what was found: the next motion, and one of more samples."""
    branch = examples.quasi_periodic_branch()
    sb.save_result(branch, tmp_path / "tori.h5")
    found = sb.read_result(tmp_path / "tori.h5")
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
    for wrong in (3, [], (backbone,), [locus, backbone], {"a": locus}):
        if wrong == []:  # no lines at all are loci
            sb.save_result(wrong, tmp_path / "none.h5")
            assert sb.read_result(tmp_path / "none.h5") == ()
            continue
        with pytest.raises(TypeError, match="save_result: result = "):
            sb.save_result(wrong, tmp_path / "wrong.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["none.h5"]


def test_picture_of_tori():
    """Amplitude and frequency of the own tone at every motion, in kHz and m."""
    branch = examples.quasi_periodic_branch()
    upper, lower = plot_quasi_periodic({"a": branch}, "1")
    for axes, values in ((upper, np.abs(branch.line(0, 1, "1"))), (lower, branch.frequencies[:, 1])):
        drawn = np.concatenate([line.get_xydata() for line in axes.lines])
        factor = 1.0 if "(m)" in axes.get_ylabel() or "(Hz)" in axes.get_ylabel() else 1e3
        for point in np.column_stack([branch.value, values * factor]):
            assert np.abs(drawn - point).sum(axis=1).min() < 1e-9
    with pytest.raises(ValueError, match="branches of one parameter"):
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
        np.testing.assert_allclose(np.unique(drawn(panel), axis=0), np.unique(expected, axis=0), rtol=1e-12)


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
    x, y = line.get_xdata(), line.get_ydata()
    np.testing.assert_allclose(x, found.frequency, rtol=1e-12)
    np.testing.assert_allclose(y / y[0], found.amplitude("A") / found.amplitude("A")[0], rtol=1e-12)
    with pytest.raises(ValueError, match="are not divided by forces"):
        plot_branches({"a": examples.branch()}, backbone=found, forces={"a": 1.0})
