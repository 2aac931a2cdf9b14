"""Map of behaviour of the cracked beam around 14.1 kHz: where the curves of Fig. 11 lose their stability.

Case P under a sine at A. Response curves at some forces are followed over the frequency; from each
bifurcation on them a line leads over the force, each line once (a minute or two):
    python examples/loci.py --forces 700
"""

import pathlib
import sys
from dataclasses import replace

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Loci of bifurcations of the cracked beam over frequency and force, 13.9-14.6 kHz.")
parser.add_numbers(forces=([700.0, 1500.0], "forces of the curves from which the lines begin, N"))
parser.add_numbers(least=(300.0, "N"), most=(1500.0, "N"), modes=(80, "modes kept"))
parser.add_numbers(start=(13900.0, "Hz"), stop=(14600.0, "Hz"))
parser.add_output("loci", "lines and the picture", "write the lines only")


def passes(line, other):
    """Whether a line passes the middle of another one, to 1 Hz and 20 N."""
    k, places, fine = len(other) // 2, np.arange(len(line)), np.linspace(0, len(line) - 1, 2000)
    frequency, force = (np.interp(fine, places, values) for values in (line.frequency, line.value))
    return np.hypot(frequency - other.frequency[k], (force - other.value[k]) / 20.0).min() < 1.0


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.plot import plot_loci, save_picture

    comm, out, folder = begin(own.output)
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    model = sb.Model(sb.on_root(comm, beam.mesh), sb.Material(70e9, 0.33, 2700), damping=0.002)
    reduced, lines = sb.reduce(model, sb.PointForce("A", fy=1.0), modes=own.modes), []
    out.print(model, reduced, sep="\n")
    for force in own.forces:
        load = sb.PointForce("A", fy=force)
        curve = sb.frequency_response(reduced, load, own.start, own.stop, steps=256)
        out.print(f"{force:g} N: {curve}", *curve.bifurcations, sep="\n  ")
        for found in sb.loci(curve, own.least / force, own.most / force):
            line = replace(found, value=force * found.value)  # N
            if not any(passes(other, line) for other in lines):
                lines.append(line)
    out.print(*lines, sep="\n")
    sb.save(f"{folder}/lines.h5", lines)
    if not own.no_pictures and lines:
        save_picture(plot_loci(lines, label="force, N", comm=comm), f"{folder}/loci.png")
    out.print(f"lines and picture are in {folder}")


if __name__ == "__main__":
    run(main)
