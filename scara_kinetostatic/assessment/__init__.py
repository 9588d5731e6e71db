"""Whether the result of a calibration may be used: grade, reasons, actions."""
