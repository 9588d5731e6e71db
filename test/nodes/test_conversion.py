"""Reading messages from their bytes gives what deserializing them gives."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3, WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker

from scara_kinetostatic.model.cell import Plane
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.conversion import JointReader, Sample, UnusableMessageError, frame_of, wrench_sample

NAMES = ('joint1', 'joint2')
STAMP = 1_700_000_000_123_456_789


def joints(names: list[str], position: list[float], frame: str = '') -> bytes:
    message = JointState(name=names, position=position, velocity=[1.0] * len(position))
    message.header.frame_id = frame
    message.header.stamp = conversion.stamp_of(STAMP)
    return bytes(serialize_message(message))


@pytest.mark.parametrize('frame', ['', 'b', 'base', 'tool0', 'länger als sonst'])
def test_a_wrench(frame):
    message = conversion.wrench((STAMP, 1.5, -2.5), frame)
    assert wrench_sample(bytes(serialize_message(message))) == Sample(STAMP, 1.5, -2.5)
    assert frame_of(bytes(serialize_message(message))) == frame


@pytest.mark.parametrize('frame', ['', 'b', 'base', 'tool0'])
@pytest.mark.parametrize(
    ('names', 'position'),
    [
        (['joint1', 'joint2'], [0.25, -0.5]),
        (['joint2', 'lift', 'joint1'], [-0.5, 7.0, 0.25]),
        (['a', 'bc', 'joint1', 'defgh', 'joint2'], [1.0, 2.0, 0.25, 3.0, -0.5]),
    ],
)
def test_joint_angles_by_name(frame, names, position):
    assert JointReader(NAMES).samples(joints(names, position, frame)) == [Sample(STAMP, 0.25, -0.5)]


@pytest.mark.parametrize(
    ('names', 'position', 'said'),
    [
        ([], [], 'got 0 positions of no joints'),
        (['joint1', 'joint2'], [1.0], 'got 1 positions of joint1 joint2'),
        (['shoulder', 'elbow'], [1.0, 2.0], 'got 2 positions of shoulder elbow'),
        (['joint1', 'joint2'], [nan, 2.0], 'expected plausible numbers'),
        (['joint1', 'joint2'], [1.7e308, 2.0], 'expected plausible numbers'),
    ],
)
def test_joint_states_that_cannot_be_used(names, position, said):
    with pytest.raises(UnusableMessageError, match=said):
        JointReader(NAMES).samples(joints(names, position))


def test_a_message_that_is_cut_off():
    whole = joints(['joint1', 'joint2'], [0.25, -0.5])
    needed = len(whole) - 4 - 4 - 2 * 8 - 8
    for length in range(4, needed):
        with pytest.raises(UnusableMessageError):
            JointReader(NAMES).samples(whole[:length])
    whole = bytes(serialize_message(WrenchStamped()))
    for length in range(4, len(whole)):
        with pytest.raises(UnusableMessageError, match='cut off'):
            wrench_sample(whole[:length])
    with pytest.raises(UnusableMessageError):
        JointReader(NAMES).samples(b'\0\1\0\0' + b'\xff' * 60)


def test_a_trajectory_begins_when_it_is_heard():
    """Its stamp is zero: one of now would be in the past on arrival, and a controller would drop its beginning."""
    made = conversion.joint_trajectory(NAMES, [0.5, 1.25], [[0.1, 0.2], [0.3, 0.4]], [[1.0, 2.0], [0.0, 0.0]])
    assert (made.header.stamp.sec, made.header.stamp.nanosec, made.joint_names) == (0, 0, [*NAMES])
    times, positions, velocities = conversion.trajectory_points(made)
    assert (times, [list(row) for row in positions]) == ([0.5, 1.25], [[0.1, 0.2], [0.3, 0.4]])
    assert [list(row) for row in velocities] == [[1.0, 2.0], [0.0, 0.0]]


def test_times_before_1970():
    message = JointState(name=list(NAMES), position=[1.0, 2.0])
    message.header.stamp.sec, message.header.stamp.nanosec = -1, 5
    assert JointReader(NAMES).samples(bytes(serialize_message(message))) == [Sample(-999_999_995, 1.0, 2.0)]


def test_other_joints_are_found_by_name():
    message = joints([*NAMES, 'wrist'], [0.25, -0.5, 0.3])
    (sample,) = JointReader(NAMES, ('lift', 'wrist')).samples(message)
    assert sample[1:3] == (0.25, -0.5)
    assert np.isnan(sample.others[0])
    assert sample.others[1] == 0.3


PLANE = Plane('world', (0.1, 0.2, 0.3), (0.6, 0.8, 0.0), (0.0, 0.0, 1.0))


@pytest.mark.parametrize('place', [(0.3, -0.2, 2.5), (0.0, 0.4, -1.0)])
def test_poses_and_markers_are_in_the_frame_of_the_robot(place):
    message = conversion.pose_stamped(STAMP, PLANE, place)
    at, turn = message.pose.position, message.pose.orientation
    assert message.header.frame_id == 'world'
    np.testing.assert_allclose([at.x, at.y, at.z], PLANE.in_robot(np.array(place[:2])), atol=1e-15)
    matrix = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    c, s = np.cos(place[2]), np.sin(place[2])
    np.testing.assert_allclose(matrix, PLANE.axes @ [[c, -s, 0], [s, c, 0], [0, 0, 1]], atol=1e-15)
    assert conversion.planar(at, PLANE, is_place=True) == pytest.approx(place[:2], abs=1e-15)
    off = np.array([at.x, at.y, at.z]) + 0.02 * np.array(PLANE.axes)[:, 2]
    with pytest.raises(conversion.UnusableMessageError, match=r'20 mm off the plane of the arm \(robot\.plane\)'):
        conversion.planar(type(at)(x=off[0], y=off[1], z=off[2]), PLANE, is_place=True)
    red, size = (1.0, 0.0, 0.0, 1.0), (0.01, 0.02, 0.03)
    made = [
        conversion.marker(group, Marker.SPHERE, points, PLANE, red, size)
        for group, points in (('a', place[:2]), ('b', [place[:2], (0.0, 0.0)]))
    ]
    _, dot, line = conversion.marker_array(made, PLANE).markers
    there = PLANE.in_robot(np.array(place[:2]))
    np.testing.assert_allclose([dot.pose.position.x, dot.pose.position.y, dot.pose.position.z], there, atol=1e-15)
    turn, at, point = line.pose.orientation, line.pose.position, line.points[0]
    drawn = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply([point.x, point.y, point.z])
    np.testing.assert_allclose(np.add(drawn, (at.x, at.y, at.z)), there, atol=1e-15)
    assert (dot.color.r, dot.color.g, dot.color.b, dot.color.a) == red
    assert (dot.scale.x, dot.scale.y, dot.scale.z) == size
    assert dot.header.frame_id == line.header.frame_id == 'world'


@pytest.mark.parametrize('frame', ['world', 'left/base_link', '', 'abc'])
def test_the_covariance_of_a_pose_is_in_the_frame_of_the_robot(frame):
    plane = PLANE._replace(frame=frame)
    covariance, pose = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]]), (0.3, -0.2, 2.5)
    message = deserialize_message(conversion.pose_bytes(STAMP, plane, pose, covariance), PoseWithCovarianceStamped)
    assert (message.header.frame_id, conversion.nanoseconds_of(message.header.stamp)) == (frame, STAMP)
    assert message.pose.pose == conversion.pose_stamped(STAMP, plane, pose).pose
    found = np.reshape(message.pose.covariance, (6, 6))
    x, y, n = PLANE.axes.T
    by = np.stack([[*x, 0, 0, 0], [*y, 0, 0, 0], [0, 0, 0, *n]])
    np.testing.assert_allclose(by @ found @ by.T, covariance, atol=1e-14)
    assert np.linalg.matrix_rank(found, tol=1e-9) == 3


def test_a_force_in_the_frame_of_the_robot_has_its_part_in_the_plane():
    force = Vector3(x=3.0, y=4.0, z=2.0)
    assert conversion.planar(force, PLANE, is_place=False) == pytest.approx((5.0, 2.0), abs=1e-14)
