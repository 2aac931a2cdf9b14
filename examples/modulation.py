"""Vibro-acoustic modulation on the paper's beam, healthy and with a breathing crack: Fig. 10.

Case P (400 x 5 mm aluminium, V-notch of 2.5 mm at 80 mm with a mouth of 2 micrometres) with a modal damping
ratio of 0.002 under 433 Hz, 300 N and 3000 Hz, 1 N at A. The crack that opens and closes with the low tone
modulates the high one: sidebands at 3000 -+ n 433 Hz, absent in the beam without a crack.

Free vibration of mode 1 (24.6 Hz) decays as exp(-0.31 t): ten seconds and more for what a sudden start
leaves. Both tones therefore rise smoothly, as sin^2, over 0.5 s (12 periods of it), which hardly starts it,
and are held for 0.5 s before the record of 1 s, whole periods of both tones. How steady the record is follows
from its two halves of 0.5 s.

    python examples/modulation.py
    python examples/modulation.py --step 2e-6 --settle 1
    mpiexec -n 2 python examples/modulation.py
"""

import os
import pathlib
import sys
import time
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run

LOW, HIGH = 433.0, 3000.0
RECORD, SAMPLING = 1.0, 2e-5
PAIRS = 3


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser(
        "Vibro-acoustic modulation, 433 Hz 300 N and 3000 Hz 1 N, healthy and cracked beam (Fig. 10)."
    )
    parser.add_argument("--pump", type=float, default=300.0, help="amplitude at 433 Hz, N (default 300)")
    parser.add_argument("--probe", type=float, default=1.0, help="amplitude at 3000 Hz, N (default 1)")
    parser.add_argument("--damping", type=float, default=0.002, help="modal damping ratio (default 0.002)")
    parser.add_argument(
        "--rise", type=float, default=0.5, help="time in which the tones rise, s (default 0.5)"
    )
    parser.add_argument(
        "--settle", type=float, default=0.5, help="time held before the record of 1 s, s (default 0.5)"
    )
    parser.add_argument(
        "--step",
        type=float,
        default=4e-6,
        help="time step, s; a divisor of the sampling interval 2e-5 (default 4e-6)",
    )
    parser.add_argument("--order", type=int, default=5, help="polynomial order of the edges (default 5)")
    parser.add_output("modulation", "spectra and the picture", "write the spectra only")
    return parser.parse()


def main():
    """Run the example."""
    own = options()
    import numpy as np

    import sbfem_petsc as sb
    from meshing import Beam, VNotch
    from sbfem_petsc import indicators
    from sbfem_petsc.plot import plot_spectra, save_picture

    comm, out, folder = begin(own.output)
    decimation = round(SAMPLING / own.step) if own.step > 0.0 else 0
    if decimation < 1 or abs(decimation * own.step - SAMPLING) > 1e-9 * SAMPLING:
        raise ValueError(f"--step {own.step:g} s must divide the sampling interval of {SAMPLING:g} s")
    if own.rise < 0.0 or own.settle < 0.0:
        raise ValueError(f"--rise {own.rise:g} s and --settle {own.settle:g} s must not be negative")
    before = SAMPLING * round((own.rise + own.settle) / SAMPLING)

    def tone(amplitude, frequency):
        def rising(t):
            envelope = np.sin(0.5 * np.pi * np.minimum(t / own.rise, 1.0)) ** 2 if own.rise else 1.0
            return amplitude * envelope * np.sin(2.0 * np.pi * frequency * t)

        return sb.Custom(rising, highest_frequency=frequency)

    load = sb.PointForce("A", fy=tone(own.pump, LOW) + tone(own.probe, HIGH))
    spectra, found = {}, {}
    for name, notches in (("healthy", []), ("cracked", [VNotch(x=0.080, depth=0.0025, opening=0.0458366)])):
        beam = Beam(length=0.400, height=0.005, notches=notches)
        model = sb.Model(
            sb.on_root(comm, partial(beam.mesh, order=own.order)),
            sb.Material(young=70e9, poisson=0.33, density=2700),
            clamped="left",
            damping=own.damping,
        )
        began = time.perf_counter()
        history = sb.transient(model, load, before + RECORD, step=own.step, decimation=decimation)
        out.print(
            f"{name}: {model}\n  {len(history.reduced.omega)} modes, "
            f"{round(history.time[-1] / history.step):,d} steps in {time.perf_counter() - began:.1f} s with "
            "the reduction; "
            f"settled for {before:g} s, record {RECORD:g} s"
        )
        kept = slice(-round(RECORD / SAMPLING), None)
        instants, u = history.time[kept], history.displacement("A")[kept, 1]
        half = len(u) // 2
        first, second = (
            indicators.sidebands(instants[part], u[part], HIGH, LOW, PAIRS)
            for part in (slice(None, half), slice(half, None))
        )
        found[name] = (
            indicators.sidebands(instants, u, HIGH, LOW, PAIRS),
            (first, second),
            indicators.tones(instants, u, [LOW, HIGH]),
        )
        lines = indicators.spectrum(instants, u, frequencies=[LOW, HIGH])
        spectra[name] = lines.frequency, np.abs(lines.amplitude)
        if len(model.pairs):
            out.print(f"  {indicators.contact_duty(instants, history.contact_force[kept])}")
        model.destroy()
    out.print(table(found))
    for name, (bands, halves, _) in found.items():
        change = (
            f"; of the record's halves {halves[0].modulation_index:.4e} and {halves[1].modulation_index:.4e}"
            if name == "cracked"
            else ""
        )
        out.print(
            f"{name}: modulation index (A_L + A_R)/A_0 of the first pair {bands.modulation_index:.4e}, of "
            f"pairs 1-{PAIRS} " + ", ".join(f"{i:.3e}" for i in bands.indices) + change
        )
    sb.on_root(
        comm,
        lambda: np.savetxt(
            os.path.join(folder, "spectra.csv"),
            np.stack([spectra["healthy"][0], *(s[1] for s in spectra.values())], axis=1),
            delimiter=",",
            fmt="%.9e",
            comments="",
            header="frequency_Hz," + ",".join(f"{name}_m" for name in spectra),
        ),
    )
    if not own.no_pictures:
        marks = {
            ("3000 Hz" if n == 0 else f"{n:+d} × 433".replace("-", "−")): HIGH + n * LOW
            for n in range(-PAIRS, PAIRS + 1)
        }
        drawing = plot_spectra(
            spectra,
            "$|u_y|$(A) (m)",
            (1500.0, 4500.0),
            lines=marks,
            decades=7.0,
            harmonics={"harmonics of 433 Hz": [k * LOW for k in range(1, 11)]},
            comm=comm,
        )
        save_picture(drawing, os.path.join(folder, "figure_10.png"))
    out.print(f"\nspectra and picture are in {folder}")


def table(found):
    """Amplitudes of carrier and sidebands."""
    from rich.table import Table

    result = Table(
        title="Amplitudes of u_y(A), m", caption="coherent record; modulation index: (A_L + A_R)/A_0"
    )
    for name in ("line", "Hz", *found):
        result.add_column(name, justify="right")
    result.add_row("pump", f"{LOW:g}", *(f"{abs(tones[0]):.4e}" for _, _, tones in found.values()))
    for n in range(-PAIRS, PAIRS + 1):
        values = (
            bands.centre if n == 0 else (bands.lower if n < 0 else bands.upper)[abs(n) - 1]
            for bands, _, _ in found.values()
        )
        result.add_row(
            "carrier" if n == 0 else f"{n:+d}",
            f"{HIGH + n * LOW:g}",
            *(f"{abs(value):.4e}" for value in values),
        )
    return result


if __name__ == "__main__":
    run(main)
