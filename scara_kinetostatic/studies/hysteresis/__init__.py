"""Hysteresis of a joint from measured force–displacement loops: which law beyond compliance and backlash they need."""
