"""Vibro-acoustic modulation on the paper's beam, healthy and with a breathing crack: Fig. 10.

Case P with a modal damping ratio of 0.002 under 433 Hz, 300 N and 3000 Hz, 1 N at A. The crack that opens and
closes with the low tone modulates the high one: sidebands at 3000 -+ n 433 Hz, absent in the healthy beam.

Free vibration of mode 1 (24.6 Hz) decays as exp(-0.31 t): ten seconds and more for what a sudden start
leaves. Both tones therefore rise smoothly, as sin^2, over 0.5 s (12 periods of it), which hardly starts it,
and are held for 0.5 s before the record of 1 s, whole periods of both tones. How steady the record is follows
from its two halves. `sb.quasi_periodic` finds the steady state itself.

    mpiexec -n 2 python examples/modulation.py --step 2e-6 --settle 1
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Vibro-acoustic modulation, 433 and 3000 Hz, healthy and cracked beam (Fig. 10).")
parser.add_numbers(pump=(300.0, "amplitude at 433 Hz, N"), probe=(1.0, "amplitude at 3000 Hz, N"))
parser.add_numbers(damping=(0.002, "modal damping ratio"), order=(5, "polynomial order of the edges"))
parser.add_numbers(rise=(0.5, "time in which the tones rise, s"))
parser.add_numbers(settle=(0.5, "time held before the record of 1 s, s"))
parser.add_numbers(step=(4e-6, "time step, s; a divisor of the sampling interval 2e-5"))
parser.add_output("modulation", "spectra and the picture", "write the spectra only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from examples.tables import modulation as tables
    from meshing import Beam, VNotch

    comm, out, folder = begin(own.output)
    decimation, before = tables.sampling_steps(own)
    tones = ((own.pump, tables.LOW), (own.probe, tables.HIGH))
    pump, probe = (tables.rising_tone(amplitude, frequency, own.rise) for amplitude, frequency in tones)
    load, records = sb.PointForce("A", fy=pump + probe), {}
    for name, notches in (("healthy", []), ("cracked", [VNotch(x=0.080, depth=0.0025, opening=0.0458366)])):
        beam = Beam(length=0.400, height=0.005, notches=notches)
        mesh = sb.on_root(comm, lambda beam=beam: beam.mesh(order=own.order))
        material = sb.Material(young=70e9, poisson=0.33, density=2700)
        model = sb.Model(mesh, material, clamped="left", damping=own.damping)
        history = sb.transient(model, load, before + 1.0, step=own.step, decimation=decimation)
        records[name] = tables.Record(history)
        out.print(f"{name}: {model}\n  {history}{records[name].contact}")
    out.print(tables.table(records))
    for name, record in records.items():
        out.print(tables.modulation(name, record))
    sb.on_root(comm, lambda: tables.write(folder, records))
    if not own.no_pictures:
        tables.picture(folder, comm, records)
    out.print(f"\nspectra and picture are in {folder}")


if __name__ == "__main__":
    run(main)
