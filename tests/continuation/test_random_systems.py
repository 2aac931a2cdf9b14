"""Response curves of random systems of stops, stiff and soft, in few steps a period."""

import numpy as np
import pytest

import sbfem_petsc as sb
from tests.systems import one_mass, two_masses

TURN, COUNT = 2.0 * np.pi, 20
# What came to its end when all families went onto the one continuation; the others end in teeth of the steps.
COMPLETE = 18


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_curves_that_come_to_their_ends():
    """Of 20 systems, up and down in turns, as many as before come to the end of their range; of those that do
    each turn to a higher frequency is followed by one to a lower one.
    """
    random, complete = np.random.default_rng(1), 0
    for trial in range(COUNT):
        if trial % 3 == 0:
            damping, compliance = random.uniform(0.005, 0.02), 10 ** random.uniform(-2, -1)
            system = one_mass(1.0, damping, stiffness=1.0 / compliance, towards=1.0)
            force, ends = random.uniform(0.1, 0.4), (random.uniform(0.5, 0.8), random.uniform(1.3, 1.6))
        else:
            system = two_masses(random.uniform(0.01, 0.03), 10 ** random.uniform(-2, -0.5))
            force, ends = random.uniform(0.08, 0.13), (0.5, random.uniform(0.85, 1.1))
        steps, (start, stop) = int(random.choice([256, 512, 1024])), ends if trial % 2 == 0 else ends[::-1]
        try:
            curve = sb.frequency_response(
                system, [force], start / TURN, stop / TURN, steps=steps, stability=False
            )
        except sb.SolveError:
            continue
        complete += curve.complete
        turns = np.count_nonzero(np.diff(np.sign(np.diff(curve.value))))
        assert not curve.complete or (turns % 2 == 0 and curve.value[-1] == stop / TURN)
    assert complete >= COMPLETE
