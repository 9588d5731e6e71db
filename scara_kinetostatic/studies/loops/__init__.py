"""Loops of load and deflection, read by dial gauge or recorded: compliance, backlash, and which law beyond both."""
