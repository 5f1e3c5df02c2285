"""Types of ROS 2 as they are on the wire, for CycloneDDS: written from the .msg, .srv and .action
definitions, and not from the program's.

Each value has a default, so that a test says only what matters to it.
"""

import dataclasses
import types
import typing

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int32, int64, sequence, uint8, uint16, uint32, uint64


def _default(kind):
    origin = typing.get_origin(kind)
    if origin is typing.Annotated:
        base, *how = typing.get_args(kind)
        if how and isinstance(how[0], array):
            return lambda: [_default(how[0].subtype)() for _ in range(how[0].length)]
        if how and isinstance(how[0], sequence):
            return list
        return lambda: base(0)
    if isinstance(kind, type) and issubclass(kind, IdlStruct):
        return kind
    return {bool: lambda: False, str: str, int: lambda: 0, float: lambda: 0.0}[kind]


def wire(name, /, **fields):
    """Makes the type `name` ("package/msg/Type") with these fields."""
    package, folder, short = name.split("/")

    def body(namespace):
        namespace["__annotations__"] = dict(fields)
        for field, kind in fields.items():
            namespace[field] = dataclasses.field(default_factory=_default(kind))

    whole = f"{package}::{folder}::dds_::{short}_"
    made = types.new_class(short, (IdlStruct,), {"typename": whole}, body)
    made.__module__ = __name__
    return dataclasses.dataclass(made)


def service(name, request, reply):
    """Makes request and reply of a service as rmw_cyclonedds_cpp puts them on the wire."""
    header = {"guid": uint64, "number": int64}
    return wire(f"{name}_Request", **header, **request), wire(f"{name}_Response", **header, **reply)


# builtin_interfaces, std_msgs, rosgraph_msgs
Time = wire("builtin_interfaces/msg/Time", sec=int32, nanosec=uint32)
Header = wire("std_msgs/msg/Header", stamp=Time, frame_id=str)
Bool = wire("std_msgs/msg/Bool", data=bool)
String = wire("std_msgs/msg/String", data=str)
Float64 = wire("std_msgs/msg/Float64", data=float64)
Empty = wire("std_msgs/msg/Empty", structure_needs_at_least_one_member=uint8)
Dimension = wire("std_msgs/msg/MultiArrayDimension", label=str, size=uint32, stride=uint32)
Layout = wire("std_msgs/msg/MultiArrayLayout", dim=sequence[Dimension], data_offset=uint32)
Float64MultiArray = wire("std_msgs/msg/Float64MultiArray", layout=Layout, data=sequence[float64])
Clock = wire("rosgraph_msgs/msg/Clock", clock=Time)

# geometry_msgs, tf2_msgs
Point = wire("geometry_msgs/msg/Point", x=float64, y=float64, z=float64)
Vector3 = wire("geometry_msgs/msg/Vector3", x=float64, y=float64, z=float64)
Quaternion = wire("geometry_msgs/msg/Quaternion", x=float64, y=float64, z=float64, w=float64)
Pose = wire("geometry_msgs/msg/Pose", position=Point, orientation=Quaternion)
PoseStamped = wire("geometry_msgs/msg/PoseStamped", header=Header, pose=Pose)
PoseWithCovariance = wire("geometry_msgs/msg/PoseWithCovariance", pose=Pose, covariance=array[float64, 36])
PoseWithCovarianceStamped = wire(
    "geometry_msgs/msg/PoseWithCovarianceStamped", header=Header, pose=PoseWithCovariance
)
Twist = wire("geometry_msgs/msg/Twist", linear=Vector3, angular=Vector3)
TwistStamped = wire("geometry_msgs/msg/TwistStamped", header=Header, twist=Twist)
TwistWithCovariance = wire("geometry_msgs/msg/TwistWithCovariance", twist=Twist, covariance=array[float64, 36])
Transform = wire("geometry_msgs/msg/Transform", translation=Vector3, rotation=Quaternion)
TransformStamped = wire(
    "geometry_msgs/msg/TransformStamped", header=Header, child_frame_id=str, transform=Transform
)
TFMessage = wire("tf2_msgs/msg/TFMessage", transforms=sequence[TransformStamped])

# nav_msgs, sensor_msgs, diagnostic_msgs, nav2_msgs
Odometry = wire(
    "nav_msgs/msg/Odometry",
    header=Header,
    child_frame_id=str,
    pose=PoseWithCovariance,
    twist=TwistWithCovariance,
)
Path = wire("nav_msgs/msg/Path", header=Header, poses=sequence[PoseStamped])
Imu = wire(
    "sensor_msgs/msg/Imu",
    header=Header,
    orientation=Quaternion,
    orientation_covariance=array[float64, 9],
    angular_velocity=Vector3,
    angular_velocity_covariance=array[float64, 9],
    linear_acceleration=Vector3,
    linear_acceleration_covariance=array[float64, 9],
)
JointState = wire(
    "sensor_msgs/msg/JointState",
    header=Header,
    name=sequence[str],
    position=sequence[float64],
    velocity=sequence[float64],
    effort=sequence[float64],
)
NavSatStatus = wire("sensor_msgs/msg/NavSatStatus", status=int8, service=uint16)
NavSatFix = wire(
    "sensor_msgs/msg/NavSatFix",
    header=Header,
    status=NavSatStatus,
    latitude=float64,
    longitude=float64,
    altitude=float64,
    position_covariance=array[float64, 9],
    position_covariance_type=uint8,
)
KeyValue = wire("diagnostic_msgs/msg/KeyValue", key=str, value=str)
DiagnosticStatus = wire(
    "diagnostic_msgs/msg/DiagnosticStatus",
    level=uint8,
    name=str,
    message=str,
    hardware_id=str,
    values=sequence[KeyValue],
)
DiagnosticArray = wire("diagnostic_msgs/msg/DiagnosticArray", header=Header, status=sequence[DiagnosticStatus])
SpeedLimit = wire("nav2_msgs/msg/SpeedLimit", header=Header, percentage=bool, speed_limit=float64)

# rmw_dds_common: who is on the graph
Gid = wire("rmw_dds_common/msg/Gid", data=array[uint8, 16])
NodeEntitiesInfo = wire(
    "rmw_dds_common/msg/NodeEntitiesInfo",
    node_namespace=str,
    node_name=str,
    reader_gid_seq=sequence[Gid],
    writer_gid_seq=sequence[Gid],
)
ParticipantEntitiesInfo = wire(
    "rmw_dds_common/msg/ParticipantEntitiesInfo",
    gid=Gid,
    node_entities_info_seq=sequence[NodeEntitiesInfo],
)

# The action nav2_msgs/FollowPath, by distribution
UUID = wire("unique_identifier_msgs/msg/UUID", uuid=array[uint8, 16])
GoalInfo = wire("action_msgs/msg/GoalInfo", goal_id=UUID, stamp=Time)
GoalStatus = wire("action_msgs/msg/GoalStatus", goal_info=GoalInfo, status=int8)
GoalStatusArray = wire("action_msgs/msg/GoalStatusArray", status_list=sequence[GoalStatus])
_GOAL = {"path": Path, "controller_id": str, "goal_checker_id": str}
_GOALS = {
    "humble": wire("nav2_msgs/action/FollowPath_Goal", **_GOAL),
    "jazzy": wire("nav2_msgs/action/FollowPath_Goal", **_GOAL, progress_checker_id=str),
}
_GOALS["iron"] = _GOALS["jazzy"]
_RESULTS = {
    "humble": wire("nav2_msgs/action/FollowPath_Result", result=Empty),
    "iron": wire("nav2_msgs/action/FollowPath_Result", result=Empty, error_code=uint16),
    "jazzy": wire("nav2_msgs/action/FollowPath_Result", result=Empty, error_code=uint16, error_msg=str),
}
FollowPathFeedback = wire("nav2_msgs/action/FollowPath_Feedback", distance_to_goal=float32, speed=float32)
FeedbackMessage = wire(
    "nav2_msgs/action/FollowPath_FeedbackMessage", goal_id=UUID, feedback=FollowPathFeedback
)
SendGoal = {
    name: service(
        "nav2_msgs/action/FollowPath_SendGoal",
        {"goal_id": UUID, "goal": goal},
        {"accepted": bool, "stamp": Time},
    )
    for name, goal in _GOALS.items()
}
GetResult = {
    name: service(
        "nav2_msgs/action/FollowPath_GetResult",
        {"goal_id": UUID},
        {"status": int8, "result": result},
    )
    for name, result in _RESULTS.items()
}
FollowPathGoal = _GOALS
CancelGoal = service(
    "action_msgs/srv/CancelGoal",
    {"goal_info": GoalInfo},
    {"return_code": int8, "goals_canceling": sequence[GoalInfo]},
)

# rcl_interfaces: parameters
ParameterValue = wire(
    "rcl_interfaces/msg/ParameterValue",
    type=uint8,
    bool_value=bool,
    integer_value=int64,
    double_value=float64,
    string_value=str,
    byte_array_value=sequence[uint8],
    bool_array_value=sequence[bool],
    integer_array_value=sequence[int64],
    double_array_value=sequence[float64],
    string_array_value=sequence[str],
)
Parameter = wire("rcl_interfaces/msg/Parameter", name=str, value=ParameterValue)
SetParametersResult = wire("rcl_interfaces/msg/SetParametersResult", successful=bool, reason=str)
ListParametersResult = wire(
    "rcl_interfaces/msg/ListParametersResult", names=sequence[str], prefixes=sequence[str]
)
ListParameters = service(
    "rcl_interfaces/srv/ListParameters",
    {"prefixes": sequence[str], "depth": uint64},
    {"result": ListParametersResult},
)
GetParameters = service(
    "rcl_interfaces/srv/GetParameters",
    {"names": sequence[str]},
    {"values": sequence[ParameterValue]},
)
SetParameters = service(
    "rcl_interfaces/srv/SetParameters",
    {"parameters": sequence[Parameter]},
    {"results": sequence[SetParametersResult]},
)

# lifecycle_msgs
State = wire("lifecycle_msgs/msg/State", id=uint8, label=str)
Transition = wire("lifecycle_msgs/msg/Transition", id=uint8, label=str)
GetState = service(
    "lifecycle_msgs/srv/GetState",
    {"structure_needs_at_least_one_member": uint8},
    {"current_state": State},
)
ChangeState = service("lifecycle_msgs/srv/ChangeState", {"transition": Transition}, {"success": bool})
