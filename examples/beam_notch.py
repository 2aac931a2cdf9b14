"""The paper's beam with a breathing crack: discretisation, natural frequencies and static contact.

Case P: 400 x 5 mm, aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres, clamped on the left.
Prints the natural frequencies 1-46 and the displacements at 1, 100 and 300 N beside converged values of an
independent finite element code and the columns printed in the paper, and writes files and pictures to an
output folder.

    python examples/beam_notch.py
    python examples/beam_notch.py --order 7 -modal_eps_view
    mpiexec -n 2 python examples/beam_notch.py -static_ksp_type cg -static_pc_type gamg
"""

import json
import os
import pathlib
import sys
import warnings

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

REFERENCE = pathlib.Path(__file__).parent / "reference" / "reference.json"


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser(
        "The paper's beam with a breathing crack: frequencies 1-46 and static contact at 1, 100 and 300 N."
    )
    parser.add_argument("--order", type=int, default=5, help="polynomial order of the edges (default 5)")
    parser.add_argument("--size", type=float, help="length of the cells along the beam, m (default 0.0125)")
    parser.add_argument(
        "--tip-size", type=float, help="half-size of the S-element at the crack tip, m (default 5e-5)"
    )
    parser.add_argument(
        "--layout",
        choices=("tip", "vertex"),
        default="tip",
        help='"vertex": the paper\'s layout with the tip as a corner of four S-elements',
    )
    parser.add_argument(
        "--continued-fraction", type=int, default=1, help="terms of the continued fraction (default 1)"
    )
    parser.add_output("beam_notch", "files and pictures", "write the HDF5 and VTU files only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_contact, plot_crack, plot_discretisation, plot_modes, save_picture
    from sbfem_petsc.results.hdf5 import write_results
    from sbfem_petsc.results.vtu import write_modes, write_vtu

    comm, out, folder = begin(own.output)
    reference = json.loads(REFERENCE.read_text())

    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    mesh = sb.on_root(
        comm, lambda: beam.mesh(order=own.order, size=own.size, tip_size=own.tip_size, layout=own.layout)
    )
    model = sb.Model(
        mesh,
        sb.Material(young=70e9, poisson=0.33, density=2700),
        clamped="left",
        continued_fraction=own.continued_fraction,
    )
    out.print(f"{model}\n")

    modes = sb.modal(model, count=46)
    forces = (1, 100, 300)
    with warnings.catch_warnings():  # at 1 N; the line of K_I below says it
        warnings.simplefilter("ignore", sb.MeshWarning)
        pushes = {f"{force} N": sb.static(model, sb.PointForce("A", fy=float(force))) for force in forces}

    out.print(frequency_table(modes.frequencies, reference))
    out.print(
        f"{modes.solver}: {modes.iterations} iteration(s), {modes.unknowns} unknowns, largest residual "
        f"{modes.residuals.max():.1e}\n"
    )
    out.print(static_table(pushes, reference))
    for name, push in pushes.items():
        if push.stress_intensity and own.layout == "tip":
            opening, sliding = push.stress_intensity["crack1"]
            out.print(
                f"{name}: K_I = {opening / 1e6:.5g}, K_II = {sliding / 1e6:.3g} MPa m^1/2; "
                f"{int(push.active.sum())} of {len(push.gap)} pairs in contact, {push.iterations} "
                f"iteration(s), {push.solver}; not resolved next to the tip: "
                f"{sum(push.unresolved_contact.values()):.3g} N"
            )

    write_results(os.path.join(folder, "beam_notch.h5"), model, modal=modes, static=pushes)
    write_vtu(os.path.join(folder, "static_300N.vtu"), model, {"displacement": pushes["300 N"]})
    write_modes(os.path.join(folder, "modes.vtu"), modes, range(3))
    if not own.no_pictures:
        regions = {name: pushes[name] for name in ("1 N", "100 N")}
        for name, drawing in (
            ("discretisation", plot_discretisation(mesh, comm=comm)),
            ("modes", plot_modes(modes, range(8))),
            ("crack", plot_crack(model, regions)),
            ("contact", plot_contact(pushes)),
        ):
            save_picture(drawing, os.path.join(folder, f"{name}.png"))
    out.print(f"\nfiles and pictures are in {folder}")
    model.destroy()


def frequency_table(found, reference):
    """Frequencies beside the converged reference and the paper's columns, Hz; errors relative to the
    reference.
    """
    from rich.table import Table

    exact = reference["modes"]["crack80_nu33"]["frequency_Hz"]
    table = Table(title="Natural frequencies, Hz (open crack)")
    for name in (
        "mode",
        "sbfem-petsc",
        "reference",
        "error",
        "paper p = 5",
        "paper p = 7",
        "paper p = 9",
        "paper FEM",
    ):
        table.add_column(name, justify="right")
    for i, frequency in enumerate(found):
        printed = reference["paper"]["T6"].get(str(i + 1), {})
        columns = [f"{printed[c]:.6g}" if c in printed else "" for c in ("p5", "p7", "p9", "FEM")]
        table.add_row(
            str(i + 1), f"{frequency:.4f}", f"{exact[i]:.4f}", f"{frequency / exact[i] - 1:+.1e}", *columns
        )
    largest = max(abs(f / e - 1) for f, e in zip(found, exact))
    table.caption = f"largest relative error of frequencies 1-{len(found)}: {largest:.2e}"
    return table


def static_table(pushes, reference):
    """Displacements and contact resultants beside the converged reference and the paper's columns."""
    from rich.table import Table

    exact = reference["static"]["x80_mouth2um_nu33"]["contact"]
    table = Table(
        title="Static contact, force at A in +y",
        caption="paper columns at 100 N: one pass ties every penetrating pair (u at p = 5); FEM: unilateral "
        "contact",
    )
    for name in ("force", "quantity", "sbfem-petsc", "reference", "error", "paper p = 5", "paper FEM"):
        table.add_column(name, justify="right")
    for name, push in pushes.items():
        paper = {
            ("A", 1): f"T{3 if name == '1 N' else 5}_uy_{name.replace(' ', '')}",
            ("B", 0): f"T{2 if name == '1 N' else 4}_ux_{name.replace(' ', '')}",
        }
        paper["C", 0] = paper["B", 0]
        for point, axis in (("A", 1), ("B", 0), ("C", 0)):
            value = push.displacement(point)[axis]
            truth = exact[name]["u"][point]["uy" if axis else "ux"]
            printed = reference["paper"].get(paper[point, axis], {})
            columns = [f"{printed[c]['ABC'.index(point)]:.5g}" if printed else "" for c in ("p5", "FEM")]
            table.add_row(
                name,
                f"u_{'xy'[axis]}({point}), m",
                f"{value:.6e}",
                f"{truth:.6e}",
                f"{value / truth - 1:+.1e}",
                *columns,
            )
        truth = exact[name]["cracks"][0]["resultant"]
        table.add_row(
            name,
            "contact resultant, N",
            f"{push.contact_resultant:.1f}",
            f"{truth:.1f}",
            f"{push.contact_resultant / truth - 1:+.1e}",
            "",
            "",
            end_section=True,
        )
    return table


if __name__ == "__main__":
    run(main)
