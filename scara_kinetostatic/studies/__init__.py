"""Studies beside the calibration, each with its mathematics, text, page and template."""
