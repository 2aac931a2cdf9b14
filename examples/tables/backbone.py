"""What backbone.py follows, writes and draws."""

import dataclasses
import os

import numpy as np
from scipy.interpolate import PchipInterpolator

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_branches, save_picture

# Half the range of a curve in bandwidths of its damping, and points of it.
WIDE, POINTS = 2.5, 40


def forced(reduced, free, ratio, force, steps):
    """Name and response curve at a damping ratio and a force (N), around the free motion that it leads to."""
    damped = dataclasses.replace(reduced, damping=np.full(len(reduced.omega), ratio))
    # a linear system's amplitude tells where the peak is to be expected
    k = free.mode - 1
    shape = abs(reduced.load_modes[k, 0])
    amplitude = force * shape**2 / (2.0 * ratio * reduced.omega[k] ** 2)
    middle = float(at(free, min(amplitude, float(free.amplitude("A").max()))))
    half = WIDE * ratio * middle
    curve = sb.frequency_response(
        damped,
        [force],
        middle - half,
        middle + half,
        steps=steps,
        stability=False,
        largest_step=2.0 * half / POINTS,
    )
    return f"{ratio:g}, {force:g} N", curve


def at(free, amplitude):
    """Frequency (Hz) of the free motion of an amplitude of A."""
    amplitudes = free.amplitude("A")
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(amplitudes)) > 0.0])
    return PchipInterpolator(amplitudes[rising], free.frequency[rising])(amplitude)


def told(curve, free):
    """A peak and its relative distance from the free motion of its amplitude."""
    peak = curve.peak("A")
    own = float(at(free, peak.amplitude))
    return (
        f"peak {1e6 * peak.amplitude:.4f} um at {peak.frequency:.3f} Hz, free motion {own:.3f} Hz, "
        f"{peak.frequency / own - 1.0:+.2e} from it"
    )


def write(folder, free, curves):
    """The free motions and the curves as CSV files."""
    columns = np.column_stack([free.energy, free.frequency, free.amplitude("A")])
    head = "energy_J,frequency_Hz,amplitude_A_m"
    np.savetxt(os.path.join(folder, "backbone.csv"), columns, delimiter=",", header=head, comments="")
    for number, curve in enumerate(curves.values()):
        curve.to_csv(os.path.join(folder, f"curve_{number}.csv"))


def picture(folder, free, curves, comm):
    """Curves over the free motions."""
    axes = plot_branches(curves, backbone=free, title="damping ratio, force", comm=comm)
    save_picture(axes, os.path.join(folder, "backbone.png"))
