"""Is a calibration still right? Verification, comparison of calibrations, drift in production, history, archives."""

from scara_kinetostatic.monitoring.drift import Alarm, DriftMonitor
from scara_kinetostatic.monitoring.record import CalibrationRecord

__all__ = ['Alarm', 'CalibrationRecord', 'DriftMonitor']
