"""Damage indicators of time histories: spectra, harmonics, subharmonics, sidebands, contact duty, frequency
shifts.

Everything works on plain arrays with a uniform time step. Complex amplitudes are one-sided and refer to the
given times: u(t) = Re sum c_k exp(i 2 pi f_k t), c_0 the mean.
"""

from __future__ import annotations

from meshing.lazily import loaded

# Public names by the module they stand in.
_HOME = {
    "detection": (
        "ContactDuty",
        "contact_duty",
        "detection_probability",
        "frequency_shift",
        "friction_power",
    ),
    "lines": (
        "Sidebands",
        "Subharmonics",
        "beta",
        "gamma",
        "harmonic_ratios",
        "harmonics",
        "sidebands",
        "subharmonics",
        "tones",
    ),
    "spectra": ("Spectrum", "spectrum"),
    "record": ("coherent_record",),
}

__all__ = [name for names in _HOME.values() for name in names]

__getattr__, __dir__ = loaded(__name__, _HOME)
