"""Qualities of service: who may lose what.

A calibration wants every sample, so the simulator offers reliable streams with
a deep history, and the collector asks for the same. Many drivers offer sensor
topics as best effort only, which a reliable subscription does not match; the
collector then steps down to best effort (`stream_subscription`).
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

STREAM_DEPTH = 5000
"""Samples held while the other side is busy: 5 s at 1 kHz."""

RELIABLE_STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=STREAM_DEPTH,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Joint states and wrenches, both ends."""

BEST_EFFORT_STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=STREAM_DEPTH,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""The same for a driver that offers no more."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""The last value, also for whoever comes later."""

DIAGNOSTICS = 10
"""Depth of `/diagnostics`, as everywhere in ROS."""
