"""Compliance and backlash from readings of a dial gauge and a force gauge (section 5.2)."""
