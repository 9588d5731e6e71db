"""The numbers printed in the paper, section 5: what ours are held against."""

from __future__ import annotations

from scara_kinetostatic.model.parameters import Parameters

ESTIMATED = Parameters(
    2.500000e-3, -2.199999e-3, -1.700003e-3, 3.301999e-1, 6.999950e-4, 3.298000e-1,
    1.100712e-5, 1.100000e-5, 1.100017e-5, 9.528501e-5, 2.900022e-4, 2.899924e-4,
)  # fmt: skip
"""Table 2, "estimated values"."""

ESTIMATED_FROM_NOISE = Parameters(
    2.499527e-3, -2.202042e-3, -1.7480221e-3, 3.301951e-1, 7.120833e-4, 3.298156e-1,
    1.541640e-5, 7.951966e-6, 5.696328e-6, 2.829870e-4, 3.869342e-4, 3.744674e-4,
)  # fmt: skip
"""Table 2, "when random noise"."""

FORCE_ERROR = 4.491026e-5
"""e_f without noise, N."""
FORCE_ERROR_FROM_NOISE = 1.312684
"""e_f of the column with noise, N."""
FORCE_ERROR_RANGE = (1.25, 1.35)
"""e_f with noise in the text, N."""
FORCE = 40.0
"""f of figure 3, N."""
POINTS_PER_DISC = 12
"""npc of figure 3."""
