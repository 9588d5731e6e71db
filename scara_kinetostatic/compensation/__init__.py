"""Use of a calibration: the tip under load (H̄) and the joint angles that compensate it (Ḡ), with uncertainty."""

from scara_kinetostatic.compensation.arm import CalibratedArm, UsedRange

__all__ = ['CalibratedArm', 'UsedRange']
