"""An integrator without time steps beside the steps, on the paper's beam at 3 kHz: seconds at equal error.

Between two changes of the rows in contact the motion is linear. With the eigenvectors of each set of closed
rows it is known in closed form, and a change is the next root of a gap or a contact force: signs are looked
at at equal instants, roots found to rounding. Eigenvectors are kept for every set that has occurred. Its
error is rounding's (1e-15), whatever the number of instants; that of the steps is measured against it.

The state is that of energy norm, CPU seconds of one core, steps as compiled, events in NumPy and LAPACK.

    ./run python benchmarks/events.py
"""

from __future__ import annotations

import os
import pathlib
import sys
import time

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import numpy as np
from scipy import optimize

import sbfem_petsc as sb
from benchmarks.default_mesh import model, push
from sbfem_petsc.contact.complementarity import solve_complementarity
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import Period
from sbfem_petsc.reduction.reduced_model import ReducedModel

FREQUENCY, FORCE, MODES = 3000.0, 300.0, 80
STEPS, SAMPLES, PERIODS = (512, 2048, 8192, 32768), 128, 100
# Instants that are looked at together.
CHUNK = 16


class Phase:
    """The motion with a set of rows in contact: Re sum 2 vectors exp(values t) alpha and the response to the
    load Re s exp(i omega t); `out`, `rest` and `load` make of them gaps of open and forces of closed rows.
    """

    def __init__(self, reduced: ReducedModel, closed: np.ndarray, omega: float):
        rows, flexibility, count = reduced.gap.modes, reduced.gap.contact, len(reduced.omega)
        push, shut = reduced.gap.loads[:, 0], np.flatnonzero(closed)
        stiff = np.linalg.inv(flexibility[np.ix_(shut, shut)])
        spread = flexibility[:, shut] @ stiff
        # forces -stiff (gap without them); the gaps of the other rows under these
        gaps, rest, load = (item - spread @ item[shut] for item in (rows, reduced.initial_gap, push))
        for item, whole in ((gaps, rows), (rest, reduced.initial_gap), (load, push)):
            item[shut] = -stiff @ whole[shut]
        total = np.diag(reduced.omega**2) + rows[shut].T @ stiff @ rows[shut]
        friction = np.diag(2.0 * reduced.damping * reduced.omega)
        unit = np.eye(count)
        values, vectors = np.linalg.eig(np.block([[0.0 * unit, unit], [-total, -friction]]))
        upper = values.imag > 0.0
        assert upper.sum() == count  # every mode swings
        self.values, self.vectors = values[upper], vectors[:, upper]
        self.inverse = np.linalg.inv(vectors)[upper]
        static = np.linalg.solve(total, rows[shut].T @ rest[shut])
        modal = reduced.load_modes[:, 0] + rows[shut].T @ load[shut]
        driven = np.linalg.solve(total - omega**2 * unit + 1j * omega * friction, modal)
        self.static = np.concatenate([static, np.zeros(count)])
        self.driven = np.concatenate([driven, 1j * omega * driven])
        self.out = 2.0 * gaps @ self.vectors[:count]
        self.rest, self.load = rest + gaps @ static, load + gaps @ driven


class Events:
    """The motion under a sine, from change to change of the rows in contact."""

    def __init__(self, reduced: ReducedModel, frequency: float, amplitude: float):
        self.reduced, self.omega, self.amplitude = reduced, 2.0 * np.pi * frequency, amplitude
        self.phases: dict[bytes, Phase] = {}
        self.changes = 0

    def sine(self, at):
        return -1j * self.amplitude * np.exp(1j * self.omega * at)

    def begin(self, state, closed, at):
        key = closed.tobytes()
        if key not in self.phases:
            self.phases[key] = Phase(self.reduced, closed, self.omega)
        phase = self.phases[key]
        return phase, phase.inverse @ (state - phase.static - (phase.driven * self.sine(at)).real)

    def state(self, phase, alpha, since, at):
        free = phase.vectors @ (alpha * np.exp(phase.values * (at - since)))
        return phase.static + (phase.driven * self.sine(at) + 2.0 * free).real

    def run(self, state, closed, stop: float, samples: int):
        """State and closed rows at `stop` from those at t = 0."""
        closed, grid = closed.copy(), stop * np.arange(1, samples + 1) / samples
        since, done, self.changes = 0.0, 0, 0
        phase, alpha = self.begin(state, closed, since)
        while done < samples:
            times = grid[done : done + CHUNK]
            free = alpha[:, None] * np.exp(np.multiply.outer(phase.values, times - since))
            signs = (phase.out @ free + phase.load[:, None] * self.sine(times)).real + phase.rest[:, None]
            wrong = signs < 0.0
            if not wrong.any():
                done += len(times)
                continue
            first = int(np.argmax(wrong.any(axis=0)))
            late = times[first]
            early = max(since, late - stop / samples)
            roots = {
                self.root(phase, alpha, since, row, early, late): row
                for row in np.flatnonzero(wrong[:, first])
            }
            at = min(roots)
            state, done = self.state(phase, alpha, since, at), done + first
            closed[roots[at]] = ~closed[roots[at]]
            since, self.changes = at, self.changes + 1
            phase, alpha = self.begin(state, closed, since)
        return self.state(phase, alpha, since, stop), closed

    def root(self, phase, alpha, since, row, early, late):
        factors = phase.out[row] * alpha

        def value(at):
            free = factors @ np.exp(phase.values * (at - since))
            return float((free + phase.load[row] * self.sine(at)).real) + phase.rest[row]

        return early if value(early) <= 0.0 else optimize.brentq(value, early, late, xtol=1e-18, rtol=1e-14)


def seconds(work, *arguments):
    began = time.process_time()
    result = work(*arguments)
    return time.process_time() - began, result


def main():
    orbit = sb.periodic(model(), push(FORCE), FREQUENCY, modes=MODES, stability=False)
    reduced, modes = orbit.reduced, MODES
    weights = np.concatenate([reduced.omega, np.ones(modes)])
    print(f"{modes} modes up to {reduced.frequencies[-1]:.0f} Hz, {len(reduced.initial_gap)} contact rows")
    start = orbit.state / weights
    gap = reduced.gap.modes @ start[:modes] + reduced.initial_gap
    closed = solve_complementarity(reduced.gap.contact, gap).force > 0.0
    excitation = Excitation(np.array([1]), np.array([[-1j * FORCE]]), 1)

    print("\none period of the steady state")
    events, stop = Events(reduced, FREQUENCY, FORCE), 1.0 / FREQUENCY
    cold, (exact, _) = seconds(events.run, start, closed, stop, SAMPLES)
    warm, _ = seconds(events.run, start, closed, stop, SAMPLES)
    finer, _ = events.run(start, closed, stop, 8 * SAMPLES)
    size = np.linalg.norm(weights * exact)
    print(f"{events.changes} changes among {len(events.phases)} sets of rows")
    print(f"events, sets new   {cold:9.4f} s")
    print(f"events, sets known {warm:9.4f} s   {np.linalg.norm(weights * (finer - exact)) / size:.1e}")
    phases = list(events.phases.values())

    def carried():
        matrix = np.eye(2 * modes)
        for k in range(events.changes):
            p = phases[k % len(phases)]
            matrix = 2.0 * ((p.vectors * np.exp(1e-6 * p.values)) @ (p.inverse @ matrix)).real
        return matrix

    print(f"derivative of so many phases {seconds(carried)[0]:.4f} s")
    for steps in STEPS:
        driven = Period(reduced, excitation, steps).at(FREQUENCY)
        driven.run(orbit.state)
        spent, motion = seconds(driven.run, orbit.state)
        error = np.linalg.norm(orbit.state + motion.residual - weights * exact) / size
        more = f"   derivative {seconds(driven.monodromy, motion)[0]:.4f} s" if steps < 4096 else ""
        print(f"{steps:6d} steps        {spent:9.4f} s   {error:.1e}{more}")

    print(f"\nhistory of {PERIODS} periods from rest")
    stop, still = PERIODS / FREQUENCY, np.zeros(2 * modes)
    nothing = np.zeros(len(closed), dtype=bool)
    spent, (exact, _) = seconds(events.run, still, nothing, stop, PERIODS * SAMPLES)
    size = np.linalg.norm(weights * exact)
    print(f"{events.changes} changes among {len(events.phases)} sets of rows")
    finer, _ = events.run(still, nothing, stop, 4 * PERIODS * SAMPLES)
    print(f"events, sets known {spent:9.4f} s   {np.linalg.norm(weights * (finer - exact)) / size:.1e}")
    for steps in STEPS[:-1]:
        longer = Period(
            reduced, Excitation(np.array([PERIODS]), excitation.amplitudes, PERIODS), PERIODS * steps
        )
        at = longer.at(FREQUENCY)
        spent, motion = seconds(at.run, 0.0 * orbit.state)
        error = np.linalg.norm(motion.residual - weights * exact) / size
        print(f"{steps:6d} steps        {spent:9.4f} s   {error:.1e}")


if __name__ == "__main__":
    main()
