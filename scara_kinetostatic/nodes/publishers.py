"""Who publishes a topic, and by which quality of service, as the ROS graph says."""

from __future__ import annotations

from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo

from scara_kinetostatic.bags.writer import OfferedQos, offered_qos


def full_name(publisher: TopicEndpointInfo) -> str:
    """Name of the node that publishes, with its namespace."""
    return f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'


def recorded_qos(profile: QoSProfile) -> OfferedQos:
    """The quality of service that a publisher offers, as a recording states it."""
    return offered_qos(
        profile.reliability.name,
        profile.durability.name,
        profile.liveliness.name,
        profile.deadline.nanoseconds,
        profile.lifespan.nanoseconds,
        profile.liveliness_lease_duration.nanoseconds,
    )
