"""What long_beam.py reads off its spectra, prints, writes and draws."""

import os

import numpy as np
from rich.table import Table

from sbfem_petsc import indicators
from sbfem_petsc.plot import plot_spectra, save_pictures
from sbfem_petsc.writing import write_table

NAMES = ("$f_1$", "$2f_1 = f_ω$", "$3f_1 = f_1 + f_ω$", "$4f_1$", "$5f_1$", "$6f_1$")


def early_and_late(name, history):
    """Acceleration spectra of A in the record's first and second half: (Hz, m/s^2) by name and half."""
    found = {}
    u = history.displacement("A")[:, 1]
    for record, part in (("early", slice(0, len(u) // 2)), ("late", slice(len(u) // 2, None))):
        # from the displacement: the acceleration's lines beyond 100 kHz would fold back from the kept
        # instants upon those sought
        lines = indicators.spectrum(history.time[part], u[part], window="hann")
        amplitude = (2.0 * np.pi * lines.frequency) ** 2 * np.abs(lines.amplitude)
        found[name, record] = lines.frequency, amplitude
    return found


def strongest_lines(spectra, first):
    """Strongest lines near 1 to 6 f1 of each spectrum: [(Hz, amplitude)] by its key."""
    return {
        key: [peak(*columns, k * first, 0.05 * first) for k in range(1, 7)]
        for key, columns in spectra.items()
    }


def peak(frequency, amplitude, centre, width):
    """Strongest line near a frequency: (Hz, amplitude)."""
    near = np.flatnonzero(np.abs(frequency - centre) <= width)
    line = near[amplitude[near].argmax()]
    return float(frequency[line]), float(amplitude[line])


def table(found, first):
    """Strongest lines near the multiples of f1."""
    result = Table(
        title="Acceleration of A in y, m/s^2: strongest line near k f1, and where it stands in multiples of "
        "f1",
        caption="even multiples are harmonics of the drive; odd ones combinations with the free vibration",
    )
    for name in ("beam", "record", "f1", "2 f1", "f1 + f_omega", "4 f1", "5 f1", "6 f1"):
        result.add_column(name, justify="right")
    for (name, record), lines in found.items():
        result.add_row(
            name,
            record,
            *(
                f"{amplitude:.3e} at {frequency / first:.3f}" if k < 3 else f"{amplitude:.2e}"
                for k, (frequency, amplitude) in enumerate(lines)
            ),
        )
    return result


def print_tables(out, lines, first):
    """Print all."""
    out.print(table(lines, first))
    out.print(comparison(lines))


def comparison(lines):
    """How the lines of the two beams and records differ, in a line."""
    early, late = ([value for _, value in lines["cracked", record]] for record in ("early", "late"))
    return (
        f"f1 + f_omega of the early record: cracked {early[2]:.4e}, healthy "
        f"{lines['healthy', 'early'][2][1]:.1e} m/s^2; "
        f"from the early to the late record f1 falls to {late[0] / early[0]:.3f}, "
        f"f1 + f_omega to {late[2] / early[2]:.3f}, 2 f_omega to {late[3] / early[3]:.3f}"
    )


def drawn(spectra):
    """The three spectra that are written and drawn, by their titles."""
    chosen = (("cracked", "early"), ("cracked", "late"), ("healthy", "early"))
    return {f"{name}, {record} record": spectra[name, record] for name, record in chosen}


def write(folder, spectra):
    """One CSV for each record."""
    for name, (frequency, amplitude) in drawn(spectra).items():
        plain = name.replace(", ", "_").replace(" ", "_")
        columns = {"frequency_Hz": frequency, "acceleration_m_s2": amplitude}
        write_table(os.path.join(folder, f"{plain}.csv"), columns)


def picture(folder, comm, spectra, first):
    """Fig. 7."""
    lines = {text: k * first for k, text in enumerate(NAMES, 1)}
    drawing = plot_spectra(
        drawn(spectra), "$|a_y|$(A) (m/s²)", (0.0, 6.5 * first), lines=lines, decades=6.0, comm=comm
    )
    save_pictures(folder, figure_7=drawing)
