"""Damage indicators of time histories: spectra, harmonics, subharmonics, sidebands, contact duty, frequency
shifts.

Everything works on plain arrays with a uniform time step. Complex amplitudes are one-sided and refer to the
given times: u(t) = Re sum c_k exp(i 2 pi f_k t), c_0 the mean.
"""

from .detection import ContactDuty, contact_duty, detection_probability, frequency_shift
from .lines import (
    Sidebands,
    Subharmonics,
    beta,
    gamma,
    harmonic_ratios,
    harmonics,
    sidebands,
    subharmonics,
    tones,
)
from .record import coherent_record
from .spectra import Spectrum, spectrum

__all__ = [
    "ContactDuty",
    "Sidebands",
    "Spectrum",
    "Subharmonics",
    "beta",
    "coherent_record",
    "contact_duty",
    "detection_probability",
    "frequency_shift",
    "gamma",
    "harmonic_ratios",
    "harmonics",
    "sidebands",
    "spectrum",
    "subharmonics",
    "tones",
]
