"""The paper's beam with a breathing crack: discretisation, natural frequencies and static contact.

Case P: 400 x 5 mm, aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres, clamped on the left.
Frequencies 1-46 and displacements at 1, 100 and 300 N stand beside converged values of an independent finite
element code; the paper's columns are in the report that `examples/paper/reproduce.py` writes.
    mpiexec -n 2 python examples/beam_notch.py --order 7 -static_ksp_type cg -static_pc_type gamg
"""

import json
import pathlib
import sys
import warnings

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("The paper's beam with a breathing crack: frequencies 1-46, static contact at 1, 100, 300 N.")
parser.add_numbers(order=(5, "order of the edges"), tip_size=(5e-5, "half-size of the tip's S-element, m"))
parser.add_output("beam_notch", "files and pictures", "write the HDF5 and VTU files only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    from rich.table import Table

    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_contact, plot_crack, plot_discretisation, plot_modes, save_pictures

    comm, out, folder = begin(own.output)
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    mesh = sb.on_root(comm, lambda: beam.mesh(order=own.order, tip_size=own.tip_size))
    model = sb.Model(mesh, sb.Material(young=70e9, poisson=0.33, density=2700), clamped="left")
    modes = sb.modal(model, count=46)
    warnings.simplefilter("ignore", sb.MeshWarning)  # at 1 N faces touch within the tip's S-element alone
    pushes = {f"{f:g} N": sb.static(model, sb.PointForce("A", fy=f)) for f in (1.0, 100.0, 300.0)}
    known = json.loads((HERE / "reference" / "reference.json").read_text())
    exact = known["modes"]["crack80_nu33"]["frequency_Hz"], known["static"]["x80_mouth2um_nu33"]["contact"]
    frequencies = Table("mode", "f, Hz", "reference", "error", title="Natural frequencies, crack open")
    for number, (f, e) in enumerate(zip(modes.frequencies, exact[0]), 1):
        frequencies.add_row(str(number), f"{f:.4f}", f"{e:.4f}", f"{f / e - 1:+.1e}")
    contact = Table("force", "u_y(A), m", "reference", "error", title="Static contact, force at A in +y")
    for name, push in pushes.items():
        u, e = push.displacement("A")[1], exact[1][name]["u"]["A"]["uy"]
        contact.add_row(name, f"{u:.6e}", f"{e:.6e}", f"{u / e - 1:+.1e}")
    out.print(model, modes, frequencies, contact, *pushes.values(), sep="\n")
    sb.save(f"{folder}/beam_notch.h5", {"modes": modes, **pushes})
    sb.write_vtu(f"{folder}/static_300N.vtu", model, {"displacement": pushes["300 N"]})
    if not own.no_pictures:
        crack = plot_crack(model, {name: pushes[name] for name in ("1 N", "100 N")})
        save_pictures(folder, discretisation=plot_discretisation(mesh, comm=comm), crack=crack)
        save_pictures(folder, modes=plot_modes(modes, range(8)), contact=plot_contact(pushes))
    out.print(f"files and pictures are in {folder}")


if __name__ == "__main__":
    run(main)
