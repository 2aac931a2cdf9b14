"""Units in which values are written with few digits before and behind the point."""

from __future__ import annotations

Unit = tuple[float, str]


def length_unit(top: float) -> Unit:
    """Factor and name for lengths up to `top`, m."""
    return _largest(top, ((1.0, "m"), (1e3, "mm"), (1e6, "µm"), (1e9, "nm")), 0.5)


def place_unit(extent: float) -> Unit:
    """Factor and name for coordinates of a structure, m: drawings are read in mm up to 2 m."""
    return _largest(extent, ((1.0, "m"), (1e3, "mm"), (1e6, "µm")), 2.0)


def velocity_unit(top: float) -> Unit:
    """Factor and name for velocities up to `top`, m/s."""
    factor, name = length_unit(top)
    return factor, f"{name}/s"


def impulse_unit(top: float) -> Unit:
    """Factor and name for impulses up to `top`, N s."""
    return _largest(top, ((1e-3, "kN s"), (1.0, "N s"), (1e3, "mN s"), (1e6, "µN s")), 0.5)


def time_unit(top: float) -> Unit:
    """Factor and name for times up to `top`, s."""
    return _largest(top, ((1.0, "s"), (1e3, "ms"), (1e6, "µs")), 1.0)


def frequency_unit(top: float) -> Unit:
    """Factor and name for frequencies up to `top`, Hz."""
    return _largest(top, ((1e-6, "MHz"), (1e-3, "kHz"), (1.0, "Hz")), 1.0)


def force_unit(top: float) -> Unit:
    """Factor and name for forces up to `top`, N."""
    return _largest(top, ((1e-6, "MN"), (1e-3, "kN"), (1.0, "N")), 1.0)


def stress_unit(top: float) -> Unit:
    """Factor and name for stresses up to `top`, Pa."""
    return _largest(top, ((1e-9, "GPa"), (1e-6, "MPa"), (1e-3, "kPa"), (1.0, "Pa")), 1.0)


def _largest(top: float, units: tuple[Unit, ...], least: float) -> Unit:
    """The largest unit in which `top` is at least so much."""
    return next((unit for unit in units if top * unit[0] >= least), units[-1])
