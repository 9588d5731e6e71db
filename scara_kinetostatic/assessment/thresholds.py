"""Every number that decides about a grade: its meaning and where it comes from."""

LEVERAGE_CAUTION = 0.95
"""Leverage of a touch beyond which an error of it is nearly all absorbed by the parameters: caution."""
LEVERAGE_UNFIT = 0.99
"""The same beyond which nothing checks it: unfit. A residual shows one hundredth of such an error (redundancy number
below 0.01; W. Förstner, Zeitschrift für Vermessungswesen 104 (1979) 446).
"""
HELD_OUT_CAUTION = 3.0
"""Held-out force error, in fitted ones, from which on the touches do not predict each other: caution."""
HELD_OUT_UNFIT = 6.0
"""The same from which on the result is unfit."""
NEGATIVE = 4.0
"""Standard uncertainties below zero from which on a compliance or backlash is negative: of six parameters that are
zero, one is so in five thousand calibrations.
"""
