"""The three ROS 2 nodes of a cell, thin: they convert, delegate and publish.

- `contact_simulator` plays a cell: joint states and wrenches of a plan of touches;
- `collector` records the two topics and counts the touches;
- `calibrator` turns a recording into twelve parameters on a service call.

The only modules of the package that import `rclpy`. Shared by them: `runtime`
(start, spin, stop), `declare` (parameters with descriptors), `qos`,
`conversion` (messages to numbers and back).
"""
