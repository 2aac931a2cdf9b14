"""A plate whose crack rubs on three ranks: the numbers of one."""

import numpy as np
import pytest

from tests.parallel import alone, answer, on_ranks

PLATE = """
import json
import numpy as np
import sbfem_petsc as sb
from meshing import CrackLine, Plate
from mpi4py import MPI
crack = CrackLine([(0.043, 0.043), (0.057, 0.057)])
plate = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[crack])
held = [sb.Support("edge1", x=False, y=True), sb.Support("O", x=True, y=False)]
model = sb.Model(
    plate.mesh(order=2, points={"O": (0, 0)}), sb.Material(70e9, 0.33, 2700), damping=0.005, clamped=None,
    supports=held, contact_laws={"crack1": sb.Coulomb(0.3)})
def press(signal):
    return sb.EdgeLoad("edge3", pressure=signal)
one = sb.static(model, press(1e8))
told = {"static": [*one.stress_intensity["crack1:1"], *(1e9 * one.slip), *one.friction_force]}
time = np.arange(5.0)
cycle = sb.load_history(model, press(sb.Samples(time, 1e8 * np.array([0.0, 1.0, 0.5, 0.0, 1.0]))), time)
told["history"] = [*cycle.friction_loss, *(1e5 * cycle.slip.ravel())]
shake = [press(sb.ToneBurst(1e6, frequency=5000.0, cycles=2)), press(2e5)]
motion = sb.transient(model, shake, duration=4e-4, modes=40)
told["transient"] = [*(1e6 * motion.slip[-1]), *motion.friction_force[-1], motion.energy.friction[-1]]
whole = sb.transient(model, shake, duration=1e-5, step=1e-6, reduction=None)
told["unreduced"] = [*(1e6 * whole.slip[-1]), *whole.friction_force[-1]]
orbit = sb.periodic(model, press(sb.Harmonic(1e5, 5000.0) + 2e5), 5000.0, modes=40)
told["periodic"] = [*(1e7 * orbit.slip[::64].ravel()), *orbit.friction_force[::64].ravel()]
told["losses"] = [orbit.friction_loss]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(told))
"""


@pytest.mark.long
def test_plate_on_three_ranks():
    """At rest, over states, in time with and without modes, in a steady state."""
    one, three = alone(PLATE), answer(on_ranks(3, PLATE))
    for name, expected in one.items():
        size = np.abs(expected).max()
        assert size > 0.0 and three[name] == pytest.approx(expected, abs=1e-9 * size), name
