"""What loci.py checks, writes and draws."""

import dataclasses
import os
from functools import partial

import numpy as np

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_loci, save_picture
from sbfem_petsc.writing import write_table

# Half the range of a curve that checks a point, and its largest step, relative to the frequency.
NEAR, FINE = 2e-4, 5e-5


def new_lines(curve, force, least, most, points, lines):
    """Lines from the bifurcations of a curve over the force, N, that are not among `lines` yet."""
    found = sb.loci(curve, least / force, most / force, points=points)
    return [line for line in (in_newtons(line, force) for line in found) if not known(line, lines)]


def told(line):
    """A line's extent in words."""
    low, high = line.frequency.min(), line.frequency.max()
    forces = f"{line.value.min():.5g} to {line.value.max():.5g} N"
    return f"{line.kind}: {len(line)} points, {low:.7g} to {high:.7g} Hz, {forces}"


def checks(reduced, curve, line, count, steps):
    """Sentences on some points of a line."""
    return [checked(reduced, curve, line, int(k), steps) for k in np.linspace(0, len(line) - 1, count)]


def write(folder, comm, lines):
    """A CSV file each."""
    for number, line in enumerate(lines):
        name = os.path.join(folder, f"line_{number}_{line.kind.replace(' ', '_')}.csv")
        columns = {
            "frequency_Hz": line.frequency,
            "force_N": line.value,
            "multiplier_real": line.multiplier.real,
            "multiplier_imaginary": line.multiplier.imag,
        }
        sb.on_root(comm, partial(write_table, name, columns))


def in_newtons(line, force):
    """A line whose second parameter is the force, N, instead of the factor on it."""
    return dataclasses.replace(line, value=force * line.value)


def known(line, others):
    """Whether the middle of a line is on one that is known, to 1 Hz and 20 N."""
    middle = len(line) // 2
    for other in others:
        if other.kind == line.kind:
            places, whole = np.linspace(0.0, len(other) - 1.0, 2000), np.arange(len(other))
            frequency, force = (np.interp(places, whole, v) for v in (other.frequency, other.value))
            apart = np.hypot(frequency - line.frequency[middle], (force - line.value[middle]) / 20.0)
            if apart.min() < 1.0:
                return True
    return False


def checked(reduced, curve, line, k, steps):
    """How far the bifurcation of a curve over the frequency at a line's own force is from that line."""
    frequency, load = float(line.frequency[k]), sb.PointForce("A", fy=float(line.value[k]))
    start = dataclasses.replace(curve.orbit(0), state=line.states[k])
    for side in (-1.0, 1.0):  # behind a fold there is no motion
        try:
            first = sb.periodic(reduced, load, frequency * (1.0 + side * NEAR), steps=steps, guess=start)
            near = sb.frequency_response(
                reduced,
                load,
                first.frequency,
                frequency * (1.0 - side * NEAR),
                guess=first,
                largest_step=FINE * frequency,
            )
        except sb.SolveError:
            continue
        # in the steps of both, as the line is
        found = [item.own_value for item in near.bifurcations if item.kind == line.kind]
        if found:
            apart = float(np.abs(np.array(found) / frequency - 1.0).min())
            return (
                f"{line.kind} at {line.value[k]:.6g} N, {frequency:.8g} Hz: on a curve {apart:.1e} of it off"
            )
    return f"{line.kind} at {line.value[k]:.6g} N, {frequency:.8g} Hz: no curve there has one"


def picture(folder, comm, lines, damping):
    """The map."""
    axes = plot_loci(lines, label="force, N", title=f"modal damping ratio {damping:g}", comm=comm)
    save_picture(axes, os.path.join(folder, "loci.png"))
