"""The numbers that decide in a diagnosis: levels of significance, odds, and what counts as identifiable.

What they achieve, false alarms and correct names on simulated cells, is measured by `benchmark/diagnosis.py`.
"""

SIGNIFICANCE = 0.01
"""Probability of a false alarm that is accepted where an effect explains the touches clearly better than none does."""
STRICT_SIGNIFICANCE = 1e-3
"""The same where no model selection confirms the test: a model error that no effect explains, noise stated too large or
growing with the force, a fitted curve in place of a physical effect.
"""
FRICTION_SIGNIFICANCE = 2e-3
"""P-value of "the force is radial but for its noise" below which contact friction is named, and above which a model
needs none. Noise that grows with the force looks alike.
"""
CREDIBLE = 10.0
"""Difference of the penalised deviance beyond which a set of effects is ruled out: odds of e⁵. Very strong evidence on
the scale of Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773.
"""
DISTINCT = 3.0
"""Standard deviations by which two frequencies or slip torques must differ to be two."""
INDEPENDENT_PART = 0.012
"""Part of a unit column that must be independent of the fitted parameters for an effect to be identifiable; less is
made by the noise of the measured force.
"""
INDEPENDENT_PART_CAUTIOUS = 0.03
"""The same where all forces are alike, and of the families of functions that test for a lack of fit."""
FORCE_LEVELS = 3.0
"""Standard deviations of the noise by which forces must scatter to be of several levels."""
ROUNDING = 1e-8
"""Mean square of a whitened residual below which it is rounding error."""
NONCENTRALITY = 40.0
"""Noncentrality of chi-square at which an effect is found in all but a few of a hundred recordings: the size of an
effect at the detection limit.
"""
