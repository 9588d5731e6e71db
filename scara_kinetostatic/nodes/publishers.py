"""Who publishes a topic, and by which quality of service: as the ROS graph says, for a recording."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

_HISTORY = {
    HistoryPolicy.KEEP_LAST: QosHistory.KEEP_LAST,
    HistoryPolicy.KEEP_ALL: QosHistory.KEEP_ALL,
}
_RELIABILITY = {
    ReliabilityPolicy.RELIABLE: QosReliability.RELIABLE,
    ReliabilityPolicy.BEST_EFFORT: QosReliability.BEST_EFFORT,
}
_DURABILITY = {
    DurabilityPolicy.TRANSIENT_LOCAL: QosDurability.TRANSIENT_LOCAL,
    DurabilityPolicy.VOLATILE: QosDurability.VOLATILE,
}
_LIVELINESS = {
    LivelinessPolicy.AUTOMATIC: QosLiveliness.AUTOMATIC,
    LivelinessPolicy.MANUAL_BY_TOPIC: QosLiveliness.MANUAL_BY_TOPIC,
}


def full_name(publisher: TopicEndpointInfo) -> str:
    """Name of the node that publishes, with its namespace."""
    return f'{publisher.node_namespace.rstrip("/")}/{publisher.node_name}'


def recorded_qos(profile: QoSProfile) -> Qos:
    """The quality of service that a publisher offers, as a recording states it; history and depth are unknown."""
    return Qos(
        history=_HISTORY.get(profile.history, QosHistory.UNKNOWN),
        depth=profile.depth,
        reliability=_RELIABILITY.get(profile.reliability, QosReliability.UNKNOWN),
        durability=_DURABILITY.get(profile.durability, QosDurability.UNKNOWN),
        deadline=_time(profile.deadline),
        lifespan=_time(profile.lifespan),
        liveliness=_LIVELINESS.get(profile.liveliness, QosLiveliness.UNKNOWN),
        liveliness_lease_duration=_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=bool(profile.avoid_ros_namespace_conventions),
    )


def _time(duration: Duration) -> QosTime:
    seconds, nanoseconds = divmod(duration.nanoseconds, 1_000_000_000)
    return QosTime(seconds, nanoseconds)
