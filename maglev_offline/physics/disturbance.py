"""What disturbs the suspension: a random force (paper, Sec. III) and the irregularity of the rail."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def force_noise(rng: np.random.Generator, shape: tuple[int, ...], std_n: float) -> Array:
    """White force on the mass, redrawn each plant step, in newton.

    The paper writes f ~ N(0, 2.5e5); read as a variance it is a standard deviation of 500 N.
    """
    return rng.normal(0.0, std_n, shape) if std_n else np.zeros(shape)


def rail_profile(
    rng: np.random.Generator,
    distance_m: Array,
    *,
    rms_m: float,
    wavelengths_m: tuple[float, float] = (2.0, 30.0),
    waves: int = 24,
) -> Array:
    """Height of the rail along the track: `waves` sines with log-spaced wavelengths and random phases.

    Amplitudes grow with the wavelength, as track spectra do. Returns an array of the shape of `distance_m`, in
    metres, with the stated root mean square over a long track.
    """
    lengths = np.geomspace(*wavelengths_m, waves)
    amplitude = lengths / np.sqrt(np.sum(lengths**2) / 2) * rms_m
    phase = rng.uniform(0, 2 * np.pi, waves)
    profile = np.zeros_like(distance_m)
    for a, wavelength, p in zip(amplitude, lengths, phase, strict=True):
        profile += a * np.sin(2 * np.pi * distance_m / wavelength + p)
    return profile
