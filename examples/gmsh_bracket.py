"""A gmsh model of one's own: a bolted bracket with bronze bushes and a crack in its arm.

Reads `bracket.geo`, which lies beside this file, and finds the natural frequencies 1-10 with the crack open,
the static contact when the arm's end is pushed up with 4 kN, the linear response when it is pulled down, and
the stress intensity factors of both. The crack ends below the arm's neutral axis: pushed up, its upper part
closes and its tip still opens. All is repeated for edges of orders 3 to 6, so that the error can be read off;
tables are printed, files and pictures written to an output folder.

    python examples/gmsh_bracket.py
    python examples/gmsh_bracket.py --order 7 --size 0.01 -modal_eps_view
    mpiexec -n 2 python examples/gmsh_bracket.py -static_ksp_type cg -static_pc_type gamg
"""

import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

GEOMETRY = pathlib.Path(__file__).parent / "bracket.geo"
ORDERS = (3, 4, 5, 6)
FORCE = 4000.0  # N
THICKNESS = 0.020  # m


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser(
        "A bracket from a gmsh model: two materials, curved edges, a crack; frequencies 1-10 and static "
        "contact at 4 kN."
    )
    parser.add_argument("--order", type=int, default=5, help="polynomial order of the edges (default 5)")
    parser.add_argument(
        "--size",
        type=float,
        help="largest size of the cells, m (default: the sizes in bracket.geo, at most 0.020)",
    )
    parser.add_output("gmsh_bracket", "files and pictures", "write the HDF5 and VTU files only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import sbfem_petsc as sb
    from sbfem_petsc.plot import plot_contact, plot_crack, plot_discretisation, plot_modes, save_picture
    from sbfem_petsc.results.hdf5 import write_results
    from sbfem_petsc.results.vtu import write_modes, write_vtu

    comm, out, folder = begin(own.output)

    mesh, model, modes, cases = solve(sb, comm, own.order, own.size)
    out.print(f"{model}\n")
    measured = {own.order: summary(model, modes, cases)}
    for order in ORDERS:
        if order not in measured:
            _, other, other_modes, other_cases = solve(sb, comm, order, own.size)
            measured[order] = summary(other, other_modes, other_cases)
            other.destroy()

    out.print(frequency_table(modes, measured, own.order))
    out.print(
        f"{modes.solver}: {modes.iterations} iteration(s), {modes.unknowns} unknowns, largest residual "
        f"{modes.residuals.max():.1e}\n"
    )
    out.print(static_table(cases))
    out.print(pair_table(model, cases["closing"]))
    out.print(convergence_table(measured))

    write_results(os.path.join(folder, "gmsh_bracket.h5"), model, modal=modes, static=cases)
    write_vtu(os.path.join(folder, "static.vtu"), model, cases)
    write_modes(os.path.join(folder, "modes.vtu"), modes, range(3))
    if not own.no_pictures:
        for name, drawing in (
            ("discretisation", plot_discretisation(mesh, comm=comm)),
            ("modes", plot_modes(modes, range(6), columns=3)),
            ("crack", plot_crack(model, cases)),
            ("contact", plot_contact({"closing": cases["closing"]})),
        ):
            save_picture(drawing, os.path.join(folder, f"{name}.png"))
    out.print(f"\nfiles and pictures are in {folder}")
    model.destroy()


def solve(sb, comm, order, size):
    """Mesh (on rank 0), model, modes and static cases of one order."""
    from meshing import read_gmsh

    mesh = sb.on_root(comm, lambda: read_gmsh(GEOMETRY, order=order, size=size))
    materials = {
        "steel": sb.Material(young=210e9, poisson=0.30, density=7850),
        "bronze": sb.Material(young=105e9, poisson=0.34, density=8700),
    }
    model = sb.Model(mesh, materials, clamped="bolts", thickness=THICKNESS)
    modes = sb.modal(model, count=10)
    cases = {
        "closing": sb.static(model, sb.PointForce("load", fy=FORCE)),
        "opening": sb.static(model, sb.PointForce("load", fy=-FORCE), contact=False),
    }
    return mesh, model, modes, cases


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
    from rich.table import Table

    highest = max(measured)
    table = Table(title="Natural frequencies, Hz (open crack)")
    for name in ("mode", "sbfem-petsc", f"difference to order {highest}"):
        table.add_column(name, justify="right")
    for i, (frequency, other) in enumerate(zip(modes.frequencies, measured[highest]["frequencies"])):
        table.add_row(
            str(i + 1), f"{frequency:.4f}", "" if order == highest else f"{frequency / other - 1:+.1e}"
        )
    return table


def static_table(cases):
    """Displacements, contact and stress intensity factors of the static cases."""
    from rich.table import Table

    table = Table(
        title=f"Static response, {FORCE:.0f} N at the arm's end",
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
    from rich.table import Table

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
    from rich.table import Table

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


if __name__ == "__main__":
    run(main)
