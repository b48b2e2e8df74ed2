"""Standard atmosphere (ISO 2533) below 11 km."""

from __future__ import annotations

import numpy as np

G0 = 9.80665  # m/s2
_R = 287.05287  # J/(kg K)
_T0, _P0, _LAPSE = 288.15, 101325.0, 0.0065  # K, Pa, K/m


def air_at(altitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Density [kg/m3] and speed of sound [m/s] at a geopotential altitude [m]."""
    temperature = _T0 - _LAPSE * altitude
    pressure = _P0 * (temperature / _T0) ** (G0 / (_R * _LAPSE))
    return pressure / (_R * temperature), np.sqrt(1.4 * _R * temperature)
