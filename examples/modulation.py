"""Vibro-acoustic modulation on the paper's beam, healthy and with a breathing crack: Fig. 10.

Case P with a modal damping ratio of 0.002 under 433 Hz, 300 N and 3000 Hz, 1 N at A. The crack that opens and
closes with the low tone modulates the high one: sidebands at 3000 -+ n 433 Hz, absent in the healthy beam.
Free vibration of mode 1 (24.6 Hz) decays as exp(-0.31 t): ten seconds for what a sudden start leaves. Both
tones therefore rise as sin^2 over 12 of its periods and are held as long before the record of 1 s. The steady
state itself is found by `sb.quasi_periodic`.
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

parser = Parser("Vibro-acoustic modulation, 433 and 3000 Hz, healthy and cracked beam (Fig. 10).")
parser.add_numbers(rise=(0.5, "s"), step=(4e-6, "s, a divisor of 2e-5"), order=(5, "of the edges"))
parser.add_output("modulation", "spectra and the picture", "write the spectra only")


def main():
    """Run the example."""
    own = parser.parse()  # PETSc starts with the rest of the command line
    import numpy as np

    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc.indicators import contact_duty, sidebands, spectrum
    from sbfem_petsc.plot import plot_spectra, save_picture

    low, high = 433.0, 3000.0  # Hz

    def tones(t):
        rise, turns = np.sin(0.5 * np.pi * np.minimum(t / own.rise, 1.0)) ** 2, 2.0 * np.pi * t
        return rise * (300.0 * np.sin(low * turns) + np.sin(high * turns))

    comm, out, folder = begin(own.output)
    load, spectra = sb.PointForce("A", fy=sb.Custom(tones, highest_frequency=high)), {}
    for name, notches in (("healthy", []), ("cracked", [VNotch(x=0.080, depth=0.0025, opening=0.0458366)])):
        beam = Beam(length=0.400, height=0.005, notches=notches)
        mesh = sb.on_root(comm, lambda beam=beam: beam.mesh(order=own.order))
        model = sb.Model(mesh, sb.Material(young=70e9, poisson=0.33, density=2700), damping=0.002)
        every, duration = round(2e-5 / own.step), 2.0 * own.rise + 1.0
        history = sb.transient(model, load, duration, step=own.step, decimation=every)
        time, u = history.time[-50000:], history.displacement("A")[-50000:, 1]
        out.print(f"{name}: {history}\n{sidebands(time, u, high, low, order=3)}")
        found = spectrum(time, u, frequencies=[low, high])
        spectra[name] = found.frequency, abs(found.amplitude)
    out.print(contact_duty(time, history.contact_force[-50000:]))
    sb.on_root(comm, lambda: np.savez(f"{folder}/spectra.npz", **spectra))
    if not own.no_pictures:
        marks = {f"{n:+d} × 433" if n else "3000 Hz": high + n * low for n in range(-3, 4)}
        axes = plot_spectra(spectra, "$|u_y|$(A) (m)", (1500.0, 4500.0), lines=marks, decades=7.0, comm=comm)
        save_picture(axes, f"{folder}/figure_10.png")
    out.print(f"spectra and picture are in {folder}")


if __name__ == "__main__":
    run(main)
