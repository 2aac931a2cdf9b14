"""The beam of Long et al. driven at twice its first frequency: Fig. 7.

406 x 12 mm, steel, closed crack of 3.8 mm at 176 mm, clamped on the left, modal damping ratio 0.002 (the
paper gives none), from rest under 10 N at A at f_omega = 2 f1, with f1 of this model's open crack. A
shows f1, 2 f1 and the combination f1 + f_omega = 3 f1, which the healthy beam does not have.
f1 lives on the free vibration that the start leaves, which decays as exp(-0.75 t); the drive's line stays: an
early and a late record tell them apart. Steps beyond the highest mode's period of 6.6 us, in which contact
excites modes, show f1 + f_omega up to 600 times too strong.

    mpiexec -n 2 python examples/long_beam.py --damping 0
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Beam of Long et al. with a closed crack, driven at twice its first frequency (Fig. 7).")
parser.add_numbers(force=(10.0, "amplitude at A, N"), damping=(0.002, "modal damping ratio"))
parser.add_numbers(duration=(8.0, "s; its first and its second half are the early and the late record"))
parser.add_numbers(step=(float, "time step, s (default: 0.8 of the highest mode's period, about 5e-6)"))
parser.add_numbers(order=(5, "polynomial order of the edges"))
parser.add_output("long_beam", "spectra and the picture", "write the spectra only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables.long_beam import early_and_late, picture, print_tables, strongest_lines, write
    from meshing import Beam, VNotch

    comm, out, folder = begin(own.output)
    steel, models, spectra = sb.Material(young=206e9, poisson=0.3, density=7850), {}, {}
    for name, notches in (("cracked", [VNotch(x=0.176, depth=0.0038, opening=0.0)]), ("healthy", [])):
        beam = Beam(length=0.406, height=0.012, notches=notches)
        mesh = sb.on_root(comm, lambda beam=beam: beam.mesh(order=own.order))
        models[name] = sb.Model(mesh, steel, clamped="left", damping=own.damping)
    first, healthy = (float(sb.modal(model, 1).frequencies[0]) for model in models.values())
    if own.duration * first < 40.0:
        few = f"at least {40.0 / first:.2g} s (20 periods of f1 in each half) are needed"
        raise ValueError(f"--duration {own.duration:g} s is too short to tell the lines apart; {few}")
    told = f"f1: open crack {first:.4f} Hz (paper 58.2), healthy {healthy:.4f} Hz"
    out.print(f"{told}; driven at f_omega = {2.0 * first:.4f} Hz")
    drive = sb.PointForce("A", fy=sb.Harmonic(own.force, 2.0 * first))
    for name, model in models.items():
        history = sb.transient(model, drive, own.duration, step=own.step, decimation=8)
        out.print(f"{name}: {model}\n  {history}")
        spectra |= early_and_late(name, history)
    print_tables(out, strongest_lines(spectra, first), first)
    sb.on_root(comm, lambda: write(folder, spectra))
    if not own.no_pictures:
        picture(folder, comm, spectra, first)
    out.print(f"\nspectra and picture are in {folder}")


if __name__ == "__main__":
    run(main)
