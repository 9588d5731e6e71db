"""The ROS 2 nodes of a cell, thin: they convert, delegate and publish.

- `contact_simulator` publishes the joint states and wrenches of a simulated cell that runs through a plan of touches;
- `collector` records the two topics and counts the touches;
- `calibrator` calibrates from a recording on a service call;
- `visualizer` shows arm, objects, touches and results as markers;
- `compensator` publishes where the tip is under load, and answers a wanted pose and force with joint angles;
- `monitor` holds each touch of production against the calibration;
- `contour_tracker` traces the outline of an object along which the tip slides.
- `touch_runner` moves the robot, touches and calibrates by itself.

The only modules of the package that import `rclpy`. Shared by them: `executables` and `runtime` (start, spin, stop),
`cell_node` (parameters, status, services, a calibration followed) with `parameters.yaml`, `streams` (the two topics),
`conversion` (messages to numbers and back).
"""
