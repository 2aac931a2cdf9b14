"""Beam with a hole and a breathing crack: Figs. 12 and 13.

400 x 5 mm aluminium, clamped on the left, a hole of 2.5 mm diameter at mid-height at x = 65 mm, and a V-notch
of 1.5 mm at 80 mm with a total angle of 0.0458366 degrees (mouth 1.2 micrometres). Fig. 12 is the
discretisation, Fig. 13 the harmonics of u_y(A) under a sine of 3000 Hz and 300 N at A: the beam with the hole
alone answers with a sine, the breathing crack adds a mean and higher harmonics. A crack without contact,
which cannot breathe, adds none: it changes the first harmonic alone, by 8 % at this frequency, close to mode
7.

The paper prints a hole radius of 2.5 mm, which would cut the beam through, and gives neither force nor
damping; here the modal damping ratio is 0.002 unless --damping says otherwise.

    python examples/hole.py
    python examples/hole.py --force 100 --damping 0.005
    mpiexec -n 2 python examples/hole.py
"""

import os
import pathlib
import sys
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser(
        "Beam with a hole and a breathing crack: mesh and harmonics at 3000 Hz (Figs. 12 and 13)."
    )
    parser.add_argument("--frequency", type=float, default=3000.0, help="Hz (default 3000)")
    parser.add_argument("--force", type=float, default=300.0, help="amplitude at A, N (default 300)")
    parser.add_argument("--damping", type=float, default=0.002, help="modal damping ratio (default 0.002)")
    parser.add_argument("--steps", type=int, default=1024, help="time steps a period (default 1024)")
    parser.add_argument("--order", type=int, default=6, help="polynomial order of the edges (default 6)")
    parser.add_argument(
        "--grading", type=float, default=1.8, help="ratio of successive rings around the tip (default 1.8)"
    )
    parser.add_argument(
        "--tip-size", type=float, default=5e-6, help="half-size of the S-element at the tip, m (default 5e-6)"
    )
    parser.add_output("hole", "numbers and pictures", "write the numbers only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import sbfem_petsc as sb
    from examples.harmonics import COUNT, table, told, write
    from meshing import Beam, Hole, VNotch
    from sbfem_petsc.plot import (
        plot_discretisation,
        plot_harmonics,
        plot_multipliers,
        plot_orbit,
        save_picture,
    )

    comm, out, folder = begin(own.output)

    beams = {
        "healthy": ([], {"order": own.order}),
        "cracked": (
            [VNotch(x=0.080, depth=0.0015, opening=0.0458366)],
            {"order": own.order, "grading": own.grading, "tip_size": own.tip_size},
        ),
    }
    orbits, first, load = {}, {}, sb.PointForce("A", fy=own.force)
    for name, (notches, choice) in beams.items():
        beam = Beam(
            length=0.400, height=0.005, holes=[Hole(x=0.065, y=0.0025, diameter=0.0025)], notches=notches
        )
        mesh = sb.on_root(comm, partial(beam.mesh, **choice))
        model = sb.Model(
            mesh, sb.Material(young=70e9, poisson=0.33, density=2700), clamped="left", damping=own.damping
        )
        first[name] = sb.modal(model, 1).frequencies[0]
        out.print(f"{name}: {model}, f1 {first[name]:.4f} Hz")
        orbits[name] = sb.periodic(model, load, own.frequency, steps=own.steps)
        if notches:
            orbits["without contact"] = sb.periodic(
                orbits[name].reduced, load, own.frequency, steps=own.steps, contact=False
            )
            if not own.no_pictures:
                save_picture(plot_discretisation(mesh, comm=comm), os.path.join(folder, "figure_12.png"))
        model.destroy()
    orbits = {name: orbits[name] for name in ("healthy", "without contact", "cracked")}
    for name, orbit in orbits.items():
        out.print(f"{name}: {told(orbit)}")
    out.print(
        table(
            orbits,
            f"Amplitudes of u_y(A) at the multiples of {own.frequency:g} Hz under {own.force:g} N, m; modal "
            f"damping ratio {own.damping:g}",
        )
    )
    c = {name: orbit.harmonics("A") for name, orbit in orbits.items()}
    out.print(
        "against the healthy beam the first harmonic changes by "
        f"{abs(c['without contact'][1]) / abs(c['healthy'][1]) - 1.0:+.4%} by the open crack and by "
        f"{abs(c['cracked'][1]) / abs(c['healthy'][1]) - 1.0:+.4%} by the breathing one, "
        f"f1 by {first['cracked'] / first['healthy'] - 1.0:+.4%}"
    )
    out.print(
        f"largest of harmonics 2-{COUNT} over the first: "
        + ", ".join(
            f"{name} {max(abs(values[2 : COUNT + 1])) / abs(values[1]):.2e}" for name, values in c.items()
        )
    )
    sb.on_root(comm, lambda: write(folder, f"{own.frequency:g}Hz", orbits))
    if not own.no_pictures:
        title = f"{own.frequency:g} Hz, {own.force:g} N"
        cracked = orbits["cracked"]
        pairs = cracked.contact_force.shape[1]
        shown = {"at the tip": 0, "middle pair": pairs // 2, "mouth": pairs - 1}
        for name, drawing in (
            ("figure_13", plot_harmonics(orbits, "A", count=COUNT, title=title, comm=comm)),
            ("orbit", plot_orbit(cracked, "A", pairs=shown, title=title, comm=comm)),
            ("multipliers", plot_multipliers(cracked, title=title, comm=comm)),
        ):
            save_picture(drawing, os.path.join(folder, f"{name}.png"))
    out.print(f"\nnumbers{'' if own.no_pictures else ' and pictures'} are in {folder}")


if __name__ == "__main__":
    run(main)
