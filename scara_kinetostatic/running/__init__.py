"""A robot that touches by itself: what to touch next, how to move there, when to stop. No ROS."""
