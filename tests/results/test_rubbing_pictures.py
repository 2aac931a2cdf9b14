"""Pictures of faces that rub, against the arrays of the motions and the law."""

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from sbfem_petsc import plot
from sbfem_petsc.indicators import friction_power
from sbfem_petsc.study.kinds.kind import Drawn
from sbfem_petsc.study.kinds.load_history import LoadHistory
from sbfem_petsc.study.kinds.periodic import Periodic
from tests.contact.test_friction import square
from tests.contact.test_friction_in_motion import slider
from tests.fuzz import examples

COEFFICIENT = 0.2


@pytest.fixture(scope="module")
def loads():
    """An oblique crack pressed, let go, opened and pressed again, and the same as a motion."""
    levels = 1e6 * np.array([0.0, 0.5, 1.0, 0.6, 0.2, -0.3, 0.4, 1.0])
    load = sb.EdgeLoad("edge3", pressure=sb.Samples(np.arange(8.0), levels))
    with square([[(0.03, 0.035), (0.07, 0.065)]], sb.Coulomb(COEFFICIENT), order=2) as model:
        yield sb.load_history(model, load, np.arange(8.0))


def lines(axes):
    return [line.get_data() for line in axes.get_lines()]


def test_a_map_of_states(loads):
    """What the law says of each pair and state: bounded friction sticks, friction at its bound slips."""
    axes = plot.plot_slips(loads)
    (mesh,) = axes.collections
    state = np.asarray(mesh.get_array()).reshape(-1, 7)
    order = np.argsort(loads.states[0].model.pairs.arc)
    pressure, along = (part[1:, order].T for part in (loads.contact_force, loads.friction_force))
    slip = np.diff(loads.slip[:, order], axis=0).T
    assert ((state == 0) == (pressure == 0.0)).all()
    held = np.abs(along) < COEFFICIENT * pressure * (1.0 - 1e-9)
    assert ((state == 1) | ~held).all() and held.any()
    assert (slip[state == 3] > 0.0).all() and (slip[state == 2] < 0.0).all()
    assert set(np.unique(state)) == {0, 1, 2, 3}
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "apart", "sticks", "slips back", "slips forth"
    ]  # fmt: skip
    assert axes.get_ylabel() == "along crack1 (mm)" and axes.get_xlim() == (0.0, 7.0)
    with pytest.raises(ValueError, match="has fewer than two instants"):
        plot.plot_slips(loads, window=(0.1, 0.2))
    with pytest.raises(ValueError, match="crack = 'crack7' does not exist; the model has crack1"):
        plot.plot_slips(loads, crack="crack7")


def test_a_loop_and_power_are_what_is_lost(loads):
    pair = int(np.argmax(friction_power(loads.time, loads.slip, loads.friction_force)))
    axes = plot.plot_hysteresis({"a": loads, "b": loads}, pair=None)
    (slip, along), other = lines(axes)
    scale = {"µm": 1e6, "nm": 1e9, "mm": 1e3}[axes.get_xlabel()[-3:-1]]
    force = {"(N)": 1.0, "kN)": 1e-3}[axes.get_ylabel()[-3:]]
    assert slip == pytest.approx(scale * loads.slip[:, pair]) and np.array_equal(slip, other[0])
    assert along == pytest.approx(force * loads.friction_force[:, pair])
    (place, power), *_ = lines(plot.plot_friction_power(loads))
    pairs = loads.states[0].model.pairs
    assert place == pytest.approx(1e3 * np.sort(pairs.arc))
    lost = power @ pairs.weight[np.argsort(pairs.arc)] * 7.0
    # that of tip elements is in the whole alone, and what begins to slip within a state
    assert 0.5 * loads.friction_loss[-1] < lost < loads.friction_loss[-1]
    for wrong, told in [
        (dict(pair=99), "pair = 99 does not exist"),
        (dict(window=(8.0, 9.0)), "has fewer than two instants"),
    ]:
        with pytest.raises(ValueError, match=told):
            plot.plot_hysteresis(loads, **wrong)


@pytest.mark.long
def test_a_case_draws_them(loads):
    """Beside the history, where faces rub alone."""
    drawn = Drawn("slow", ("P",), MPI.COMM_SELF)
    kind = LoadHistory.model_construct()
    names = [name for name, _ in kind.pictures(loads, drawn)]
    assert names == ["history", *LoadHistory.captions]
    names = [name for name, _ in kind.pictures(examples.loads_in_time(), Drawn("slow", (), MPI.COMM_SELF))]
    assert names == ["history"]
    orbit = sb.periodic(slider(), [sb.Harmonic(1.5, 0.3), sb.Constant(-2.0)], 0.3, steps=512)
    names = [
        name for name, _ in Periodic.model_construct().pictures(orbit, Drawn("steady", (), MPI.COMM_SELF))
    ]
    assert set(names) == {"harmonics", *Periodic.captions}


def test_power_along_cracks_of_other_lengths(loads):
    """Two cracks on one axis: places of both in its unit, whatever the unit that suits each alone; numbers of
    pairs are no places.
    """
    with square([[(0.04, 0.05), (0.0415, 0.05)]], sb.Coulomb(COEFFICIENT), order=2) as model:
        load = sb.EdgeLoad("edge3", pressure=sb.Samples([0.0, 1.0], [0.0, 1e6]))
        small = sb.load_history(model, load, [0.0, 1.0])
        assert plot.plot_friction_power(small).get_xlabel() == "along crack1 (µm)"
        for motions in ({"a": loads, "b": small}, {"b": small, "a": loads}):
            axes = plot.plot_friction_power(motions)
            factor = {"µm": 1e6, "mm": 1e3}[axes.get_xlabel()[-3:-1]]
            for name, (place, _) in zip(motions, lines(axes)):
                arc = motions[name].states[0].model.pairs.arc
                assert place == pytest.approx(factor * np.sort(arc))
    with pytest.raises(ValueError, match="some only their numbers; draw them apart"):
        plot.plot_friction_power({"a": loads, "b": examples.rubbing_loads()})


def test_power_in_closed_form():
    """A constant friction times the speed of a slip forth and back."""
    time = np.linspace(0.0, 2.0, 401)
    slip = np.stack([np.abs(1.0 - time), np.zeros(401)], axis=1)
    found = friction_power(time, slip, np.full((401, 2), -3.0))
    assert found == pytest.approx([3.0, 0.0])
    for wrong, told in [
        ((time[:-1], slip, slip), "400 times, slip of shape"),
        ((time[::-1], slip, slip), "does not rise"),
        ((time, slip, slip[:, :1]), r"friction_force of shape \(401, 1\)"),
        ((time, slip * np.nan, slip), "slip"),
        ((time, slip, slip, slip[:, :1]), r"and slid of shape \(401, 1\)"),
    ]:
        with pytest.raises(ValueError, match=told):
            friction_power(*wrong)


@pytest.mark.long
def test_losses_over_amplitude():
    """Each motion's own numbers, lowest amplitude first, whatever order they are given in."""
    orbits = [
        sb.periodic(slider(damping=0.05), [sb.Harmonic(force, 0.3), sb.Constant(-2.0)], 0.3, steps=512)
        for force in (1.5, 0.8, 3.0)
    ]
    first, second = plot.plot_losses(orbits, "x", count=3)
    ((level, loss),) = lines(first)
    chosen = [orbits[k] for k in (1, 0, 2)]
    assert level == pytest.approx([np.abs(orbit.harmonics("x")[1]) for orbit in chosen])
    assert loss == pytest.approx([orbit.friction_loss for orbit in chosen]) and (np.diff(loss) > 0.0).all()
    for k, (_, ratio) in zip((2, 3), lines(second), strict=True):
        assert ratio == pytest.approx([np.abs(o.harmonics("x")[k] / o.harmonics("x")[1]) for o in chosen])
    for wrong in (3.0, [], [examples.orbit()], orbits[0]):
        with pytest.raises(TypeError, match="plot_losses: orbits"):
            plot.plot_losses(wrong, "x")


def test_losses_of_motions_told_over_several_periods():
    """Twice the loads' period holds twice the loss, which the picture tells a period, as that of one."""
    load = [sb.Harmonic(1.5, 0.3), sb.Constant(-2.0)]
    one, two = (sb.periodic(slider(damping=0.05), load, 0.3, steps=512, periods=n) for n in (1, 2))
    assert two.friction_loss == pytest.approx(2.0 * one.friction_loss)
    assert "J lost to friction in a period" in repr(one) and "J lost to friction in 2 periods" in repr(two)
    first, _ = plot.plot_losses([one, two], "x")
    ((_, loss),) = lines(first)
    assert loss == pytest.approx([one.friction_loss, one.friction_loss])


def test_motions_without_friction_or_a_model():
    rubbing = examples.rubbing_loads()
    assert plot.plot_slips(rubbing).get_ylabel() == "pair"
    assert plot.plot_friction_power(rubbing).get_ylabel() == "power lost to friction (W)"
    for draw in (plot.plot_slips, plot.plot_hysteresis, plot.plot_friction_power):
        with pytest.raises(ValueError, match=f"{draw.__name__}: nothing rubs in History"):
            draw(examples.motion())
    with pytest.raises(ValueError, match="does not know which pairs it has"):
        plot.plot_slips(rubbing, crack="crack1")
