"""A small notched beam with its modes and static cases; as a program, all kinds of result files of it in a
folder.
"""

from __future__ import annotations

import subprocess
import sys

from meshing import Beam, VNotch
from sbfem_petsc.analysis.modal import modal
from sbfem_petsc.analysis.static import static
from sbfem_petsc.loads import PointForce
from sbfem_petsc.material import Material
from sbfem_petsc.petsc import MPI
from sbfem_petsc.system.model import Model

LOADS = {"opening": PointForce("A", fy=-20.0), "closing": PointForce("A", fx=3.0, fy=600.0)}


def on_ranks(ranks: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run this file with `arguments` on several ranks."""
    from tests.parallel import on_ranks as run

    return run(ranks, __file__, *arguments, check=False, timeout=300)


def build():
    """Mesh, model, modes and static cases."""
    beam = Beam(length=0.05, height=0.005, notches=[VNotch(x=0.02, depth=0.0025, opening=0.0458366)])
    mesh = beam.mesh(order=3, tip_size=2e-4)
    model = Model(mesh, Material(young=70e9, poisson=0.33, density=2700.0))
    return mesh, model, modal(model, 4), {name: static(model, load) for name, load in LOADS.items()}


def write_all(folder: str) -> None:
    """HDF5, VTU and PNG files."""
    from sbfem_petsc.plot import (
        plot_contact,
        plot_crack,
        plot_discretisation,
        plot_field,
        plot_modes,
        save_picture,
    )
    from sbfem_petsc.record.files import save
    from sbfem_petsc.results.vtu import write_vtu
    from sbfem_petsc.writing import check_output_folder

    folder = check_output_folder(folder, MPI.COMM_WORLD)
    mesh, model, modes, cases = build()
    save(f"{folder}/results.h5", {"modes": modes, **cases})
    write_vtu(f"{folder}/fields.vtu", model, {"closing": cases["closing"], "mode 2": modes.nodal(1)})
    save_picture(plot_discretisation(mesh if model.comm.rank == 0 else None), f"{folder}/mesh.png")
    save_picture(plot_modes(modes), f"{folder}/modes.png")
    save_picture(plot_crack(model, cases), f"{folder}/crack.png")
    save_picture(plot_contact(cases), f"{folder}/contact.png")
    save_picture(plot_field(model, cases), f"{folder}/field.png")


def fail(folder: str) -> None:
    """Every rank gets the sentence when rank 0's disk is full, and none waits; then an output folder below a
    file.
    """
    import h5py

    from sbfem_petsc.record.files import save
    from sbfem_petsc.writing import check_output_folder

    _, model, modes, cases = build()

    def refuse(*arguments, **options):
        raise OSError(28, "No space left on device")

    h5py.Dataset.__setitem__ = refuse
    try:
        save(f"{folder}/results.h5", {"modes": modes, **cases})
    except ValueError as error:
        print(f"rank {model.comm.rank}: {error}", flush=True)
    check_output_folder(f"{folder}/file", MPI.COMM_WORLD)


if __name__ == "__main__":
    {"write": write_all, "fail": fail}[sys.argv[1]](sys.argv[2])
