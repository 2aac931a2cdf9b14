"""What hole.py prints and draws."""

from sbfem_petsc.results.harmonics import harmonics_table

from . import harmonics
from .harmonics import COUNT, told


def print_tables(out, orbits, first, own):
    """Print all."""
    for name, orbit in orbits.items():
        out.print(f"{name}: {told(orbit)}")
    title = (
        f"Amplitudes of u_y(A) at the multiples of {own.frequency:g} Hz under {own.force:g} N, m; modal "
        f"damping ratio {own.damping:g}"
    )
    out.print(harmonics_table(orbits, "A", count=COUNT, title=title))
    c = {name: abs(orbit.harmonics("A")) for name, orbit in orbits.items()}
    out.print(
        "against the healthy beam the first harmonic changes by "
        f"{c['without contact'][1] / c['healthy'][1] - 1.0:+.4%} by the open crack and by "
        f"{c['cracked'][1] / c['healthy'][1] - 1.0:+.4%} by the breathing one, "
        f"f1 by {first['cracked'] / first['healthy'] - 1.0:+.4%}"
    )
    out.print(
        f"largest of harmonics 2-{COUNT} over the first: "
        + ", ".join(f"{name} {max(values[2 : COUNT + 1]) / values[1]:.2e}" for name, values in c.items())
    )


def pictures(folder, comm, orbits, own):
    """Harmonics of all; the motion of the cracked beam."""
    names = ("figure_13", "orbit", "multipliers")
    title = f"{own.frequency:g} Hz, {own.force:g} N"
    harmonics.pictures(folder, comm, orbits, names, title=title, last_title=title)
