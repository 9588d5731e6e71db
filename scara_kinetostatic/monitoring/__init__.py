"""Is a calibration still right? Verification, comparison of calibrations, drift in production, history, archives."""
