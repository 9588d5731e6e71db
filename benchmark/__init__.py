"""Measurements that back the figures in the documentation: `python -m benchmark.NAME`, one module or folder each.

| name | what is measured |
|---|---|
| `statistics` | the calibration as an estimator: efficiency, coverage, random starts, outliers |
| `recordings` | the stated standard deviations, from streams to parameters |
| `diagnosis`, `mujoco` | effects found and named, false alarms: in our own simulator, in MuJoCo |
| `odds` | probabilities of gross effects among small errors, names, the tip, time |
| `peers`, `reading`, `command` | processor time beside other libraries; the command as a whole process |
| `live`, `faults` | the collector at 1 kHz; damaged files, killed nodes, full disks |
| `design`, `dial_gauge`, `hysteresis` | the studies |
| `pictures` | the pictures of the documentation |
"""
