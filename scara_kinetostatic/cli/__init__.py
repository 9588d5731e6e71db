"""Kinetostatic calibration of a SCARA robot by touch: the robot presses against
discs of known position while joint angles and forces are recorded; from the
recording its link lengths, offsets, compliances and backlashes are estimated,
each with its uncertainty. Model errors are detected, identified and corrected.

Example:
try it without a robot:
  scara-kinetostatic simulate --out recording
  scara-kinetostatic inspect recording
  scara-kinetostatic calibrate recording --out result
with an effect that the base model lacks:
  scara-kinetostatic simulate --effect 'object_radius[disc_2]:radius=6e-5' --out larger
  scara-kinetostatic calibrate larger --out result
"""
