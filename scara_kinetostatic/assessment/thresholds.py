"""Every number that decides about a grade: name, meaning, source. What the grades mean says `grade.Grade`.

What they achieve is measured by `benchmark/assessment.py`: results that must not be fit, and good recordings that must.
"""

LEVERAGE_CAUTION = 0.9
"""Leverage of a touch above which an error of it hardly shows in its residual: caution. Source: redundancy numbers
below 0.1 count as badly checked in adjustment theory (W. Förstner, Zeitschrift für Vermessungswesen 104 (1979) 446).
"""
LEVERAGE_UNFIT = 0.99
"""The same above which nothing checks the touch: unfit. Source: as before, redundancy numbers below 0.01."""
LEAST_FREEDOMS = 10
"""Degrees of freedom below which the residuals say too little of the noise: caution. Source: GUM (JCGM 100), table
E.1: a standard deviation from ten observations is itself uncertain by 24 %.
"""
HELD_OUT_CAUTION = 3.0
"""Force error on held-out touches, in those of the fit, above which touches do not predict each other well: caution.
Source: least squares with 24 touches in an even plan give 1.9 at most, with 36 and more 1.6.
"""
HELD_OUT_UNFIT = 6.0
"""The same above which the result is unfit. Source: twice the former."""
NEGATIVE = 4.0
"""Standard uncertainties below zero beyond which a compliance or backlash is negative: unfit. Source: of the six, none
of which is below zero in truth, one then is in two of ten thousand calibrations at most; with estimated noise the
quantile of Student's t of the same probability.
"""
LARGEST_GRIPPER_BACKLASH = 5e-4
"""Backlash of the gripper above which an error common to all radii, its exact alias, is the likelier reason: caution,
m. Source: twice the largest that the paper measured (figure 4(d): 0.055 to 0.205 mm), and more than any sound gripper
has.
"""
CONCENTRATION = 0.01
"""Probability by chance below which rejected touches are concentrated in one object, recording or span of time; of all
such groups together (Bonferroni). Source: the accepted rate of false alarms of the diagnosis.
"""
CONSISTENT_CONCENTRATION = 0.1
"""The same for the touches of one object that also agree with each other once that object is displaced. Source: three
such touches of 24, which agree by chance in about one case of twenty, then make the same rate of false alarms.
"""
CONSISTENT = 1e-3
"""P-value above which rejected touches agree with a displaced object. Source: one of a thousand true ones is missed."""
FEWEST_MOVED = 3
"""So many rejected touches show that an object was displaced: each gives one precise equation, along its normal, and
the displacement has two unknowns.
"""
MOST_REJECTED = 0.1
"""Part of the touches rejected by the fit above which: caution. Source: up to it the standard uncertainties hold
(`benchmark/statistics`, section outliers).
"""
MOST_UNUSABLE = 1 / 3
"""Part of the touches found that are not used, for whatever reason, above which: caution. Source: convention."""
MODEL_ERROR_UNFIT = 2.0
"""Reduced chi-square above which an unexplained model error is larger than the noise, so that standard uncertainties
say nothing of its bias: unfit, below caution. Source: noise alone gives 1, an error as large as it 2.
"""
MODEL_ERROR_SHARE = 0.5
"""The same where the noise is estimated and contains the error: part of the sum of squares of the residual that the
most significant dependence explains.
"""
NOISE_FACTOR = 3.0
"""Residuals without a pattern, in stated noise, above which the noise is no statement of the cell: unfit, below
caution. Source: such residuals enlarge the standard uncertainties, by a factor that their distribution must justify.
"""
NOISE_OVERSTATED = 0.5
"""Residuals in stated noise below which standard uncertainties are too large to be of use: caution. Source: half."""
FORCE_RANGE = 1.5
"""Largest over smallest force of the touches below which other forces are an extrapolation: caution. Source: p_ee and
g_ee need two levels; at 1.5 their columns are still nearly proportional.
"""
EXTRAPOLATION = 10.0
"""Largest standard uncertainty of the unloaded tip in the workspace, in the median of those at the touches, above
which the touches cover too small a part of it: caution. Source: one order of magnitude; three discs in an even plan
give 3.
"""
