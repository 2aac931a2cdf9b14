"""A plate with ten cracks without reduction, beside its reduced model: a history and a steady state.

    mpiexec -n 2 python benchmarks/unreduced.py --unknowns 100000 --file unreduced.json

A tone shakes the edge opposite the clamped one, and the cracks breathe. The history is that of both models by
average acceleration with the same step, from rest; the steady state that of shooting. Differences are the
largest ones of the displacement at the corner and of the contact resultant over all instants, relative to
the largest value. The contact forces of an unreduced model are means over the step that ends at an instant:
beside them are set those of the reduced one at these instants, and their means over the same steps. Set
OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import sbfem_petsc as sb
from benchmarks.plate import MATERIAL, Stages, plate
from sbfem_petsc.petsc import MPI, version_line


def difference(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference, relative to the largest value of the second."""
    return float(np.abs(first - second).max() / max(np.abs(second).max(), np.finfo(float).tiny))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--unknowns", type=int, default=100_000)
    parser.add_argument("--cracks", type=int, default=10)
    parser.add_argument("--modes", type=int, default=80, help="of the reduced model")
    parser.add_argument("--frequency", type=float, default=400.0, help="Hz")
    parser.add_argument("--steps", type=int, default=129, help="a period")
    parser.add_argument("--periods", type=float, default=0.5, help="length of the history")
    parser.add_argument("--orbit", action="store_true", help="the steady state too")
    parser.add_argument("--file")
    own = parser.parse_args()
    comm = MPI.COMM_WORLD
    stages = Stages(comm)
    if comm.rank == 0:
        print(f"{'stage':14s} {'wall s':>9s} {'CPU s':>9s} {'peak MB':>9s} {'left MB':>9s}")
    size = math.sqrt(18.0 / own.unknowns)
    make = lambda: plate(own.cracks, 0, 0).mesh(size=size, points={"P": (1.0, 1.0)})
    mesh = stages("mesh", lambda: sb.on_root(comm, make))
    model = stages("model", lambda: sb.Model(mesh, MATERIAL, clamped="edge1", rayleigh=(100.0, 2e-6)))
    load = sb.EdgeLoad("edge3", ty=sb.Harmonic(1e6, own.frequency), tx=sb.Harmonic(2e5, own.frequency))
    reduced = stages("reduction", lambda: sb.reduce(model, load, modes=own.modes))
    step = 1.0 / own.frequency / own.steps
    timing = {"duration": round(own.periods * own.steps) * step, "step": step}
    beside = stages("reduced", lambda: sb.transient(reduced, load, scheme="newmark", **timing))
    whole = stages("unreduced", lambda: sb.transient(model, load, reduction=None, **timing))
    between = 0.5 * (beside.contact_resultant[1:] + beside.contact_resultant[:-1])
    forces = 0.5 * (beside.contact_force[1:] + beside.contact_force[:-1])
    found = {
        "versions": version_line(),
        "ranks": comm.size,
        "boundary_unknowns": model.boundary_unknowns,
        "unknowns": model.unknowns,
        "contact_rows": len(model.contact),
        "steps": len(whole.time) - 1,
        "most_rows_in_contact": int((whole.contact_force > 0.0).sum(axis=1).max()),
        "history_displacement": difference(whole.displacement("P"), beside.displacement("P")),
        "history_resultant_at_instants": difference(whole.contact_resultant, beside.contact_resultant),
        "history_resultant": difference(whole.contact_resultant[1:], between),
        "history_forces": difference(whole.contact_force[1:], forces),
    }
    if comm.rank == 0:
        print(found, flush=True)
    if own.orbit:
        asked = {"frequency": own.frequency, "steps": own.steps}
        short = stages("reduced orbit", lambda: sb.periodic(reduced, load, stability=False, **asked))
        long = stages("orbit", lambda: sb.periodic(model, load, reduction=None, **asked))
        harmonics = [orbit.harmonics("P")[:8] for orbit in (long, short)]
        found["orbit_harmonics"] = difference(*harmonics)
        found["orbit_amplitudes"] = [np.abs(part).tolist() for part in harmonics]
    found["stages"] = stages.rows
    if comm.rank == 0:
        print({name: value for name, value in found.items() if name != "stages"})
        if own.file:
            with open(own.file, "w", encoding="utf-8") as file:
                json.dump(found, file, indent=2)


if __name__ == "__main__":
    main()
