"""Case P on a mesh, and what harmonics.py and hole.py print and draw."""

import os

import numpy as np
from rich.table import Table

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.plot import plot_harmonics, plot_multipliers, plot_orbit, save_pictures
from sbfem_petsc.results.harmonics import write_harmonics

FIGURES = {3000.0: "figure_8", 20140.0: "figure_9"}
COUNT = 10
# order, grading and tip_size of the meshes of the convergence table; the last is the one the others are
# measured against
MESHES = ((5, 2.5, 5e-5), (6, 1.8, 5e-5), (6, 1.8, 1.6e-5), (6, 1.8, 5e-6), (7, 1.6, 1.6e-6))


def build(comm, damping, *, notched=True, **choice):
    """Case P, or the beam without its notch, on a mesh."""
    notches = [VNotch(x=0.080, depth=0.0025, opening=0.0458366)] if notched else []
    beam = Beam(length=0.400, height=0.005, notches=notches)
    mesh = sb.on_root(comm, lambda: beam.mesh(**choice))
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    return sb.Model(mesh, material, clamped="left", damping=damping)


def told(orbit):
    """An orbit in one line."""
    last = orbit.residuals[-1] / orbit.residuals[0] if orbit.residuals[0] > 0.0 else 0.0
    return (
        f"{orbit.iterations} Newton iterations to {last:.0e}, {len(orbit.reduced.omega)} modes, "
        f"{'stable' if orbit.stable else 'unstable'} (largest multiplier {abs(orbit.multipliers[0]):.6f}), "
        f"peak contact resultant {orbit.contact_resultant.max(initial=0.0):.4g} N"
    )


def comparison(orbits, linear, forces):
    """Higher harmonics of each motion, and what contact does to the first, in a line each."""
    for name, orbit in orbits.items():
        c = orbit.harmonics("A")
        largest = max(abs(c[2 : COUNT + 1])) / abs(c[1])
        line = f"{name}: largest of harmonics 2-{COUNT} {largest:.2e} of the first"
        if name in forces:
            apart = abs(c[1] / (forces[name] * linear.harmonics("A")[1]) - 1.0)
            line += f"; the first differs from that without contact by {apart:.2e}"
        yield line


def convergence(model, own, frequency):
    """Tables of harmonics at the last force over steps, modes and meshes, if --convergence asks for them."""
    if not own.convergence:
        return
    load = sb.PointForce("A", fy=own.forces[-1])

    def study(title, parameter, orbits):
        result = Table(
            title=f"{title}: {own.forces[-1]:g} N at {frequency:g} Hz",
            caption="change: of the complex harmonics 0-6 together to those of the last row, over the first",
        )
        for name in (parameter, "A1, m", *(f"A{k}/A1" for k in (0, 2, 3, 4)), "change"):
            result.add_column(name, justify="right")
        finest = orbits[-1][1].harmonics("A")
        for name, orbit in orbits:
            c = orbit.harmonics("A")
            change = np.linalg.norm(c[:7] - finest[:7]) / abs(finest[1])
            result.add_row(
                name,
                f"{abs(c[1]):.5e}",
                *(f"{abs(c[k] / c[1]):.4e}" for k in (0, 2, 3, 4)),
                f"{change:.1e}" if change > 0.0 else "",
            )
        return result

    yield study(
        "Steps",
        "steps",
        [
            (str(n), sb.periodic(model, load, frequency, steps=n, modes=own.modes, stability=False))
            for n in (256, 512, 1024, 2048, 4096)
        ],
    )
    yield study(
        "Modes",
        "modes",
        [
            (str(m), sb.periodic(model, load, frequency, steps=own.steps, modes=m, stability=False))
            for m in (40, 80, 150, 250)
        ],
    )
    orbits = []
    for order, grading, tip_size in MESHES:
        other = build(model.comm, own.damping, order=order, grading=grading, tip_size=tip_size)
        orbits.append(
            (
                f"{order} / {grading:g} / {tip_size * 1e6:g} um / {len(other.pairs)}",
                sb.periodic(other, load, frequency, steps=own.steps, modes=own.modes, stability=False),
            )
        )
        other.destroy()
    yield study("Meshes", "order / grading / tip / pairs", orbits)


def write(comm, folder, frequency, orbits):
    """CSV of the complex harmonics; HDF5 of the motions, which all ranks save."""
    file = os.path.join(folder, f"harmonics_{frequency:g}Hz.csv")
    sb.on_root(comm, lambda: write_harmonics(orbits, file, "A", count=COUNT))
    for name, orbit in orbits.items():
        plain = name.replace(", ", "_").replace(" ", "_")
        sb.save(os.path.join(folder, f"orbit_{frequency:g}Hz_{plain}.h5"), orbit)


def pictures_at(folder, comm, orbits, frequency):
    """The pictures of a frequency."""
    text = f"{frequency:g} Hz"
    names = (
        FIGURES.get(frequency, f"harmonics_{frequency:g}Hz"),
        f"orbit_{frequency:g}Hz",
        f"multipliers_{frequency:g}Hz",
    )
    pictures(folder, comm, orbits, names, title=text, last_title=f"{list(orbits)[-1]}, {text}")


def pictures(folder, comm, orbits, names, *, title, last_title):
    """Harmonics of all; phase plot, gaps and resultant, and multipliers of the last motion."""
    last = list(orbits.values())[-1]
    pairs = last.contact_force.shape[1]
    shown = {"at the tip": 0, "middle pair": pairs // 2, "mouth": pairs - 1}
    drawings = (
        plot_harmonics(orbits, "A", count=COUNT, title=title, comm=comm),
        plot_orbit(last, "A", pairs=shown, title=last_title, comm=comm),
        plot_multipliers(last, title=last_title, comm=comm),
    )
    save_pictures(folder, **dict(zip(names, drawings)))
