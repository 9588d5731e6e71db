"""Whether the result of a calibration may be used: grade, reasons, actions; and the mistakes behind one of no use."""
