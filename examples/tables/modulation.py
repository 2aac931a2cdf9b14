"""What modulation.py reads off its histories, prints, writes and draws."""

import os

import numpy as np
from rich.table import Table

import sbfem_petsc as sb
from sbfem_petsc import indicators
from sbfem_petsc.plot import plot_spectra, save_pictures
from sbfem_petsc.writing import write_table

LOW, HIGH = 433.0, 3000.0
RECORD, SAMPLING = 1.0, 2e-5
PAIRS = 3


def rising_tone(amplitude, frequency, rise):
    """A sine that rises as sin^2 in the first `rise` seconds."""

    def signal(t):
        envelope = np.sin(0.5 * np.pi * np.minimum(t / rise, 1.0)) ** 2 if rise else 1.0
        return amplitude * envelope * np.sin(2.0 * np.pi * frequency * t)

    return sb.Custom(signal, highest_frequency=frequency)


def sampling_steps(own):
    """Steps between the instants that are kept, and the time before the record, s."""
    steps = round(SAMPLING / own.step) if own.step > 0.0 else 0
    if steps < 1 or abs(steps * own.step - SAMPLING) > 1e-9 * SAMPLING:
        raise ValueError(f"--step {own.step:g} s must divide the sampling interval of {SAMPLING:g} s")
    if own.rise < 0.0 or own.settle < 0.0:
        raise ValueError(f"--rise {own.rise:g} s and --settle {own.settle:g} s must not be negative")
    return steps, SAMPLING * round((own.rise + own.settle) / SAMPLING)


class Record:
    """The last second of a history: sidebands of it and of its halves, tones, spectrum, contact."""

    def __init__(self, history):
        kept = slice(-round(RECORD / SAMPLING), None)
        time, u = history.time[kept], history.displacement("A")[kept, 1]
        half = len(u) // 2
        self.sidebands, *self.halves = (
            indicators.sidebands(time[part], u[part], HIGH, LOW, order=PAIRS)
            for part in (slice(None), slice(None, half), slice(half, None))
        )
        self.tones = indicators.tones(time, u, [LOW, HIGH])
        lines = indicators.spectrum(time, u, frequencies=[LOW, HIGH])
        self.spectrum = lines.frequency, np.abs(lines.amplitude)
        forces = history.contact_force[kept]
        self.contact = f"\n  {indicators.contact_duty(time, forces)}" if forces.shape[1] else ""


def modulation(name, record):
    """Modulation indices in a line."""
    bands = record.sidebands
    line = (
        f"{name}: modulation index (A_L + A_R)/A_0 of the first pair {bands.modulation_index:.4e}, of "
        f"pairs 1-{PAIRS} " + ", ".join(f"{i:.3e}" for i in bands.indices)
    )
    if name == "cracked":
        first, second = (half.modulation_index for half in record.halves)
        line += f"; of the record's halves {first:.4e} and {second:.4e}"
    return line


def write(folder, records):
    """CSV of the spectra."""
    columns = {"frequency_Hz": records["healthy"].spectrum[0]}
    columns |= {f"{name}_m": record.spectrum[1] for name, record in records.items()}
    write_table(os.path.join(folder, "spectra.csv"), columns)


def picture(folder, comm, records):
    """Fig. 10."""
    marks = {
        ("3000 Hz" if n == 0 else f"{n:+d} × 433".replace("-", "−")): HIGH + n * LOW
        for n in range(-PAIRS, PAIRS + 1)
    }
    drawing = plot_spectra(
        {name: record.spectrum for name, record in records.items()},
        "$|u_y|$(A) (m)",
        (1500.0, 4500.0),
        lines=marks,
        decades=7.0,
        harmonics={"harmonics of 433 Hz": [k * LOW for k in range(1, 11)]},
        comm=comm,
    )
    save_pictures(folder, figure_10=drawing)


def table(read):
    """Amplitudes of carrier and sidebands."""
    result = Table(
        title="Amplitudes of u_y(A), m", caption="coherent record; modulation index: (A_L + A_R)/A_0"
    )
    for name in ("line", "Hz", *read):
        result.add_column(name, justify="right")
    result.add_row(
        "pump", f"{LOW:g}", *(f"{abs(tones[0]):.4e}" for tones in (record.tones for record in read.values()))
    )
    for n in range(-PAIRS, PAIRS + 1):
        values = (
            bands.centre if n == 0 else (bands.lower if n < 0 else bands.upper)[abs(n) - 1]
            for bands in (record.sidebands for record in read.values())
        )
        result.add_row(
            "carrier" if n == 0 else f"{n:+d}",
            f"{HIGH + n * LOW:g}",
            *(f"{abs(value):.4e}" for value in values),
        )
    return result
