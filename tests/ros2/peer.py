"""An independent peer on the graph of ROS 2: CycloneDDS by its Python binding, without ROS."""

import math
import random
import time
import uuid

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

import wire
from programs import PATIENCE_S, wait_for


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def stamp(time_s):
    """The stamp of a time, s."""
    nanos = round(time_s * 1e9)
    return wire.Time(sec=nanos // 10**9, nanosec=nanos % 10**9)


def now():
    return stamp(time.time())


class Reader:
    """A subscription that keeps all that has come."""

    def __init__(self, reader):
        self.reader = reader
        self.all = []

    def take(self):
        """Returns what has come since the last call."""
        came = [sample for sample in self.reader.take(N=10_000) if isinstance(sample, self.reader.topic.data_type)]
        self.all += came
        return came

    def last(self):
        self.take()
        return self.all[-1] if self.all else None

    def next(self, what, timeout_s=PATIENCE_S):
        """Returns the newest of what comes next."""
        self.take()
        return wait_for(self.take, what, timeout_s)[-1]

    def silent(self, for_s):
        """Whether nothing comes for so long."""
        self.take()
        time.sleep(for_s)
        return not self.take()

    def matched(self):
        return len(self.reader.get_matched_publications()) > 0


class Client:
    """A client of a service by the mapping of rmw_cyclonedds_cpp."""

    def __init__(self, peer, name, types):
        request, reply = types
        self.request = request
        self.guid = random.getrandbits(63)
        self.number = 0
        self.reader = peer.raw_reader(f"rr{name}Reply", reply)
        self.writer = peer.raw_writer(f"rq{name}Request", request)
        self.replies = {}

    def ready(self):
        """Whether both ways to a server are matched."""
        return self.writer.get_matched_subscriptions() and self.reader.get_matched_publications()

    def wait(self):
        wait_for(self.ready, f"server of {self.request.__name__}")
        # rmw does not call before the server has matched too; here that is waited for.
        time.sleep(0.3)
        return self

    def send(self, **fields):
        self.number += 1
        self.writer.write(self.request(guid=self.guid, number=self.number, **fields))
        return self.number

    def reply(self, number):
        for sample in self.reader.take(N=1000):
            if getattr(sample, "guid", None) == self.guid:
                self.replies[sample.number] = sample
        return self.replies.get(number)

    def call(self, timeout_s=PATIENCE_S, **fields):
        number = self.send(**fields)
        return wait_for(lambda: self.reply(number), self.request.__name__, timeout_s, 0.0005)


class Goal:
    """A goal of FollowPath that was sent."""

    def __init__(self, action, goal_id, reply):
        self.action, self.id, self.reply = action, goal_id, reply

    def result(self, timeout_s=PATIENCE_S):
        try:
            return self.action.get_result.call(timeout_s, goal_id=self.id)
        except AssertionError as late:
            # Whether the goal has not ended, or its answer was lost.
            raise AssertionError(f"{late}; the goal's status is {self.status()}") from late

    def cancel(self):
        return self.action.cancel.call(goal_info=wire.GoalInfo(goal_id=self.id))

    def feedback(self):
        """All feedback of this goal so far."""
        self.action.feedback.take()
        return [message.feedback for message in self.action.feedback.all if message.goal_id == self.id]

    def status(self):
        """The goal's status as last published; None where there is none."""
        self.action.status.take()
        found = None
        for message in self.action.status.all:
            for entry in message.status_list:
                if entry.goal_info.goal_id == self.id:
                    found = entry.status
        return found


class FollowPath:
    """A client of the action, by the definition of a distribution."""

    EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = 2, 3, 4, 5, 6

    def __init__(self, peer, definition="jazzy"):
        base = "/follow_path/_action"
        self.goal_type = wire.FollowPathGoal[definition]
        self.send_goal = Client(peer, f"{base}/send_goal", wire.SendGoal[definition])
        self.get_result = Client(peer, f"{base}/get_result", wire.GetResult[definition])
        self.cancel = Client(peer, f"{base}/cancel_goal", wire.CancelGoal)
        self.feedback = peer.reader(f"{base}/feedback", wire.FeedbackMessage)
        self.status = peer.reader(f"{base}/status", wire.GoalStatusArray, latched=True)

    def wait(self):
        for client in (self.send_goal, self.get_result, self.cancel):
            wait_for(client.ready, "action server")
        wait_for(self.feedback.matched, "feedback")
        time.sleep(0.3)
        return self

    def send(self, path, **names):
        goal_id = wire.UUID(uuid=uuid.uuid4().bytes)
        reply = self.send_goal.call(goal_id=goal_id, goal=self.goal_type(path=path, **names))
        return Goal(self, goal_id, reply)


class Peer:
    """A participant with readers and writers on topics of ROS."""

    def __init__(self, domain):
        self.participant = DomainParticipant(domain)

    def raw_reader(self, topic, kind, latched=False, depth=100_000):
        topic = Topic(self.participant, topic, kind)
        return DataReader(self.participant, topic, qos=_qos(latched, depth))

    def raw_writer(self, topic, kind, latched=False, depth=10):
        topic = Topic(self.participant, topic, kind)
        return DataWriter(self.participant, topic, qos=_qos(latched, depth))

    def reader(self, topic, kind, latched=False):
        return Reader(self.raw_reader(f"rt{topic}", kind, latched))

    def writer(self, topic, kind, latched=False):
        return self.raw_writer(f"rt{topic}", kind, latched)

    def best_effort_writer(self, topic, kind):
        """A writer with the quality of service of sensor data."""
        qos = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, Policy.History.KeepLast(10))
        return DataWriter(self.participant, Topic(self.participant, f"rt{topic}", kind), qos=qos)

    def client(self, name, types):
        return Client(self, name, types).wait()

    def nodes(self):
        """A reader of who is on the graph, and a function that returns their names."""
        reader = Reader(self.raw_reader("ros_discovery_info", wire.ParticipantEntitiesInfo, latched=True))

        def names():
            reader.take()
            newest = {bytes(info.gid.data): info for info in reader.all}
            return {
                node.node_namespace.rstrip("/") + "/" + node.node_name
                for info in newest.values()
                for node in info.node_entities_info_seq
            }

        return names


def _qos(latched, depth):
    return Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
    )


# --- rotations and paths -------------------------------------------------------------------------


def yaw(q):
    """REP-103 yaw of a quaternion, rad."""
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def rotate(q, v):
    """A vector turned by a quaternion."""
    u = (q.x, q.y, q.z)
    cross = lambda a, b: (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    t = tuple(2 * c for c in cross(u, v))
    s = cross(u, t)
    return tuple(v[i] + q.w * t[i] + s[i] for i in range(3))


def path_of(points, frame="map"):
    """A nav_msgs/Path through points, its orientations along it."""
    header = wire.Header(stamp=now(), frame_id=frame)
    poses = []
    for index, (x, y) in enumerate(points):
        ahead = points[min(index + 1, len(points) - 1)]
        behind = points[max(index - 1, 0)]
        half = 0.5 * math.atan2(ahead[1] - behind[1], ahead[0] - behind[0])
        poses.append(
            wire.PoseStamped(
                header=header,
                pose=wire.Pose(
                    position=wire.Point(x=x, y=y),
                    orientation=wire.Quaternion(z=math.sin(half), w=math.cos(half)),
                ),
            )
        )
    return wire.Path(header=header, poses=poses)
