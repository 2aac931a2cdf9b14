"""Tables of gmsh_bracket.py."""

import os

from rich.table import Table

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_contact, plot_crack, plot_discretisation, plot_modes, save_pictures
from sbfem_petsc.record.files import save


def print_tables(out, model, modes, cases, measured, *, order, force):
    """Print all."""
    out.print(frequency_table(modes, measured, order))
    out.print(
        f"{modes.solver}: {modes.iterations} iteration(s), {modes.unknowns} unknowns, largest residual "
        f"{modes.residuals.max():.1e}\n"
    )
    out.print(static_table(cases, force))
    out.print(pair_table(model, cases["closing"]))
    out.print(convergence_table(measured))


def write(folder, mesh, model, modes, cases, *, pictures):
    """Write results, files for ParaView and pictures."""
    save(os.path.join(folder, "gmsh_bracket.h5"), {"modes": modes, **cases})
    sb.write_vtu(os.path.join(folder, "static.vtu"), model, cases)
    sb.write_modes(os.path.join(folder, "modes.vtu"), modes, range(3))
    if pictures:
        save_pictures(
            folder,
            discretisation=plot_discretisation(mesh, comm=model.comm),
            modes=plot_modes(modes, range(6), columns=3),
            crack=plot_crack(model, cases),
            contact=plot_contact({"closing": cases["closing"]}),
        )


def summary(model, modes, cases):
    """The numbers that are compared between orders."""
    closing, opening = cases["closing"], cases["opening"]
    return {
        "unknowns": model.boundary_unknowns,
        "frequencies": modes.frequencies,
        "u_y, opening": opening.displacement("corner")[1],
        "u_y, closing": closing.displacement("corner")[1],
        "K_I, opening": opening.stress_intensity["arm"][0],
        "K_II, opening": opening.stress_intensity["arm"][1],
        "K_I, closing": closing.stress_intensity["arm"][0],
        "K_II, closing": closing.stress_intensity["arm"][1],
        "contact": closing.contact_resultant,
    }


def frequency_table(modes, measured, order):
    """Frequencies and how far they are from those of the highest order."""
    highest = max(measured)
    table = Table(title="Natural frequencies, Hz (open crack)")
    for name in ("mode", "sbfem-petsc", f"difference to order {highest}"):
        table.add_column(name, justify="right")
    for i, (frequency, other) in enumerate(zip(modes.frequencies, measured[highest]["frequencies"])):
        table.add_row(
            str(i + 1), f"{frequency:.4f}", "" if order == highest else f"{frequency / other - 1:+.1e}"
        )
    return table


def static_table(cases, force):
    """Displacements, contact and stress intensity factors of the static cases."""
    table = Table(
        title=f"Static response, {force:.0f} N at the arm's end",
        caption="opening: without contact, the smallest gap shows that none is needed",
    )
    table.add_column("quantity")
    for name in cases:
        table.add_column(name, justify="right")
    rows = {
        f"u_{'xy'[axis]}({point}), m": lambda c, point=point, axis=axis: f"{c.displacement(point)[axis]:.6e}"
        for point in ("load", "corner")
        for axis in (0, 1)
    }
    rows |= {
        "contact resultant, N": lambda c: f"{c.contact_resultant:.1f}",
        "pairs in contact": lambda c: f"{int(c.active.sum())} of {len(c.gap)}",
        "smallest gap, m": lambda c: f"{c.gap.min():.3e}",
        "largest gap, m": lambda c: f"{c.gap.max():.3e}",
        "K_I, MPa m^1/2": lambda c: f"{c.stress_intensity['arm'][0] / 1e6:.5f}",
        "K_II, MPa m^1/2": lambda c: f"{c.stress_intensity['arm'][1] / 1e6:.5f}",
    }
    for name, text in rows.items():
        table.add_row(name, *(text(case) for case in cases.values()))
    return table


def pair_table(model, case):
    """Force and gap of every contact pair."""
    table = Table(
        title="Contact along the crack, closing load",
        caption="the force on a pair is that on its share of the face; nodes inside an edge have larger "
        "shares",
    )
    for name in ("pair", "from the tip, mm", "force, N", "gap, µm"):
        table.add_column(name, justify="right")
    for i, (at, force, gap) in enumerate(
        zip(model.pairs.position * model.cracks[0].length, case.contact_force, case.gap)
    ):
        table.add_row(
            str(i + 1),
            f"{1e3 * at:.3f}",
            f"{force:.2f}" if case.active[i] else "",
            "" if case.active[i] else f"{1e6 * gap:.4f}",
        )
    return table


def convergence_table(measured):
    """Relative difference of each order's numbers to those of the highest order."""
    highest = max(measured)
    columns = {"f 1": lambda m: m["frequencies"][0], "f 10": lambda m: m["frequencies"][9]}
    columns |= {
        name: lambda m, name=name: m[name]
        for name in ("u_y, opening", "K_I, opening", "u_y, closing", "K_I, closing", "contact")
    }
    table = Table(
        title=f"Convergence with the order of the edges, relative to order {highest}",
        caption="u_y at the corner; closing: where contact ends is known to a node, so that its numbers "
        "converge irregularly",
    )
    for name in ("order", "unknowns", *columns):
        table.add_column(name, justify="right")
    for order in sorted(measured):
        errors = [
            "" if order == highest else f"{value(measured[order]) / value(measured[highest]) - 1:+.1e}"
            for value in columns.values()
        ]
        table.add_row(str(order), str(measured[order]["unknowns"]), *errors)
    return table
