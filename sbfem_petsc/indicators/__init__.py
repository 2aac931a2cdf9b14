"""Damage indicators of time histories: spectra, harmonics, subharmonics, sidebands, contact duty, frequency
shifts.

Everything works on plain arrays with a uniform time step. Complex amplitudes are one-sided and refer to the
given times: u(t) = Re sum c_k exp(i 2 pi f_k t), c_0 the mean.
"""

from __future__ import annotations

from meshing.lazily import loaded

_HOME = {
    "ContactDuty": "detection",
    "Sidebands": "lines",
    "Spectrum": "spectra",
    "Subharmonics": "lines",
    "beta": "lines",
    "coherent_record": "record",
    "contact_duty": "detection",
    "detection_probability": "detection",
    "frequency_shift": "detection",
    "friction_power": "detection",
    "gamma": "lines",
    "harmonic_ratios": "lines",
    "harmonics": "lines",
    "sidebands": "lines",
    "spectrum": "spectra",
    "subharmonics": "lines",
    "tones": "lines",
}

__all__ = [*_HOME]

__getattr__, __dir__ = loaded(__name__, _HOME)
