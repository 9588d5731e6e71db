"""The simulated cell: plan, motion, sensors, streams."""
