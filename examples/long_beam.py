"""The beam of Long et al. driven at twice its first frequency: Fig. 7.

406 x 12 mm, steel, closed crack of 3.8 mm at 176 mm, clamped on the left, modal damping ratio 0.002 (the
paper gives none), from rest under 10 N at A at f_omega = 2 f1, with f1 of this model's open crack. The
acceleration spectrum of A shows f1, 2 f1 and the combination f1 + f_omega = 3 f1, which the beam without a
crack does not have.

f1 lives on the free vibration that the start leaves and decays as exp(-0.75 t), and f1 + f_omega with it,
while the drive's line stays. An early and a late record, each under a Hann window, tell them apart. The crack
being closed, the free vibration's frequency is that of the bilinear beam, a little above f1. The lines beside
f1 and f_omega are small and need a step that contact cannot excite modes in: steps beyond the highest mode's
period of 6.6 us show f1 + f_omega up to 600 times too strong.

    python examples/long_beam.py
    python examples/long_beam.py --damping 0
    mpiexec -n 2 python examples/long_beam.py
"""

import os
import pathlib
import sys
import time
from functools import partial

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sbfem_petsc.command_line import Parser, begin, run


def options():
    """The example's own options; PETSc is started with the rest of the command line."""
    parser = Parser("Beam of Long et al. with a closed crack, driven at twice its first frequency (Fig. 7).")
    parser.add_argument("--force", type=float, default=10.0, help="amplitude at A, N (default 10)")
    parser.add_argument("--damping", type=float, default=0.002, help="modal damping ratio (default 0.002)")
    parser.add_argument(
        "--duration",
        type=float,
        default=8.0,
        help="s; its first and its second half are the early and the late record (default 8)",
    )
    parser.add_argument(
        "--step", type=float, help="time step, s (default: 0.8 of the highest mode's period, about 5e-6)"
    )
    parser.add_argument("--order", type=int, default=5, help="polynomial order of the edges (default 5)")
    parser.add_output("long_beam", "spectra and the picture", "write the spectra only")
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

    models = {}
    for name, notches in (("cracked", [VNotch(x=0.176, depth=0.0038, opening=0.0)]), ("healthy", [])):
        beam = Beam(length=0.406, height=0.012, notches=notches)
        models[name] = sb.Model(
            sb.on_root(comm, partial(beam.mesh, order=own.order)),
            sb.Material(young=206e9, poisson=0.3, density=7850),
            clamped="left",
            damping=own.damping,
        )
    first = {name: float(sb.modal(model, 1).frequencies[0]) for name, model in models.items()}
    drive = 2.0 * first["cracked"]
    if own.duration * first["cracked"] < 40.0:
        raise ValueError(
            f"--duration {own.duration:g} s is too short to tell the lines apart; at least "
            f"{80.0 / drive:.2g} s (20 periods of f1 in each half) are needed"
        )
    out.print(
        f"f1: open crack {first['cracked']:.4f} Hz (paper 58.2), healthy {first['healthy']:.4f} Hz; driven "
        f"at f_omega = {drive:.4f} Hz"
    )

    spectra, rows = {}, []
    for name, model in models.items():
        began = time.perf_counter()
        history = sb.transient(
            model,
            sb.PointForce("A", fy=sb.Harmonic(own.force, drive)),
            own.duration,
            step=own.step,
            decimation=8,
        )
        out.print(
            f"{name}: {model}\n  {round(history.time[-1] / history.step):,d} steps of "
            f"{history.step * 1e6:.3g} us in {time.perf_counter() - began:.1f} s with the reduction"
        )
        u = history.displacement("A")[:, 1]
        for record, part in (("early", slice(0, len(u) // 2)), ("late", slice(len(u) // 2, None))):
            # from the displacement: the acceleration's lines beyond 100 kHz would fold back from the kept
            # instants upon those sought
            lines = indicators.spectrum(history.time[part], u[part], window="hann")
            amplitude = (2.0 * np.pi * lines.frequency) ** 2 * np.abs(lines.amplitude)
            rows.append(
                (
                    name,
                    record,
                    [
                        peak(lines.frequency, amplitude, k * first["cracked"], 0.05 * first["cracked"])
                        for k in range(1, 7)
                    ],
                )
            )
            if record == "early" or name == "cracked":
                spectra[f"{name}, {record} record"] = lines.frequency, amplitude
        model.destroy()
    out.print(table(rows, first["cracked"]))
    values = {(name, record): lines for name, record, lines in rows}
    out.print(
        f"f1 + f_omega of the early record: cracked {values['cracked', 'early'][2][1]:.4e}, healthy "
        f"{values['healthy', 'early'][2][1]:.1e} m/s^2; "
        "from the early to the late record f1 falls to "
        f"{values['cracked', 'late'][0][1] / values['cracked', 'early'][0][1]:.3f}, "
        f"f1 + f_omega to {values['cracked', 'late'][2][1] / values['cracked', 'early'][2][1]:.3f}, 2 "
        f"f_omega to {values['cracked', 'late'][3][1] / values['cracked', 'early'][3][1]:.3f}"
    )
    sb.on_root(comm, lambda: save_spectra(folder, spectra))
    if not own.no_pictures:
        names = ("$f_1$", "$2f_1 = f_ω$", "$3f_1 = f_1 + f_ω$", "$4f_1$", "$5f_1$", "$6f_1$")
        drawing = plot_spectra(
            spectra,
            "$|a_y|$(A) (m/s²)",
            (0.0, 6.5 * first["cracked"]),
            lines={text: k * first["cracked"] for k, text in enumerate(names, 1)},
            decades=6.0,
            comm=comm,
        )
        save_picture(drawing, os.path.join(folder, "figure_7.png"))
    out.print(f"\nspectra and picture are in {folder}")


def peak(frequency, amplitude, centre, width):
    """Strongest line near a frequency: (Hz, amplitude)."""
    import numpy as np

    near = np.flatnonzero(np.abs(frequency - centre) <= width)
    line = near[amplitude[near].argmax()]
    return float(frequency[line]), float(amplitude[line])


def save_spectra(folder, spectra):
    """One CSV for each record."""
    import numpy as np

    for name, columns in spectra.items():
        np.savetxt(
            os.path.join(folder, f"{name.replace(', ', '_').replace(' ', '_')}.csv"),
            np.stack(columns, axis=1),
            delimiter=",",
            fmt="%.9e",
            comments="",
            header="frequency_Hz,acceleration_m_s2",
        )


def table(rows, first):
    """Strongest lines near the multiples of f1."""
    from rich.table import Table

    result = Table(
        title="Acceleration of A in y, m/s^2: strongest line near k f1, and where it stands in multiples of "
        "f1",
        caption="even multiples are harmonics of the drive; odd ones combinations with the free vibration",
    )
    for name in ("beam", "record", "f1", "2 f1", "f1 + f_omega", "4 f1", "5 f1", "6 f1"):
        result.add_column(name, justify="right")
    for name, record, lines in rows:
        result.add_row(
            name,
            record,
            *(
                f"{amplitude:.3e} at {frequency / first:.3f}" if k < 3 else f"{amplitude:.2e}"
                for k, (frequency, amplitude) in enumerate(lines)
            ),
        )
    return result


if __name__ == "__main__":
    run(main)
