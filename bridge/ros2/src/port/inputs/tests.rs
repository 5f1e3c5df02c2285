//! The thread against publishers of another node of the same process.

use super::*;
use crate::node::time::RosTime;
use crate::port::Ros2Port;
use ros2_client::Publisher;
use sidehill_bridge::control_loop::channel::{
    CommandClient, ControllerEnd, LoopEnd, command_channel,
};
use sidehill_bridge::drives::Port;
use sidehill_bridge::ros2::arguments::ServiceMapping;
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::conversions::{stamp, to_pose};
use sidehill_bridge::ros2::convert::{TwistMapping, world_from_base_link};
use sidehill_bridge::ros2::message::Header;
use sidehill_bridge::ros2::settings::topics::{CommandsConfig, Frames};
use sidehill_bridge::safety::{OperatorRequests, SafetyState, StopCause};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::vehicle::SpeedCorrection;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;

/// Longest wait on a busy machine: a limit for liveness, not a measurement.
const PATIENCE: Duration = Duration::from_secs(60);

/// The thread of a node, another node that publishes, and a control loop that the test plays.
struct Bench {
    publishers: RosNode,
    latest: Output<LatestInputs>,
    context: PortContext,
    loop_end: LoopEnd,
    _ends: (CommandClient, ControllerEnd),
    worker: Worker,
    node: RosNode,
}

impl Bench {
    fn new(change: impl FnOnce(&mut InputSubscriber)) -> Self {
        static TESTS: AtomicU32 = AtomicU32::new(0);
        let test = TESTS.fetch_add(1, Ordering::Relaxed);
        let environment = RosEnvironment {
            domain_id: 1 + ((7 * std::process::id() + test) % 200) as u16,
            service_mapping: ServiceMapping::Enhanced,
            loopback_only: true,
        };
        let arguments = RosArguments::default();
        let start = |name| RosNode::start(name, &arguments, &environment).unwrap();
        let (mut node, publishers) = (start("inputs"), start("publishers"));
        let (client, loop_end, controller_end) = command_channel(10);
        let context = PortContext {
            frames: Frames::default(),
            mapping: TwistMapping { track_width_m: 2.0 },
            time: RosTime::simulated(|| 10.0),
            clock: None,
            shared: Arc::default(),
            fixes: None,
        };
        let mut subscriber = InputSubscriber {
            config: InputsConfig::default(),
            context: context.clone(),
            halt: client.halt_switch(),
            forwarded: None,
            sensors: true,
        };
        change(&mut subscriber);
        let (worker, latest) = subscriber.start(&mut node).unwrap();
        Self {
            publishers,
            latest,
            context,
            loop_end,
            _ends: (client, controller_end),
            worker,
            node,
        }
    }

    fn publisher<M: TopicMessage>(&mut self, topic: &str) -> Publisher<M> {
        self.publishers.publisher(topic, &qos::RELIABLE_10).unwrap()
    }

    /// Sends until there is what is looked for.
    #[track_caller]
    fn until<T>(&mut self, send: impl Fn(), found: impl Fn(&mut Self) -> Option<T>) -> T {
        let begin = Instant::now();
        loop {
            send();
            if let Some(found) = found(self) {
                return found;
            }
            assert!(begin.elapsed() < PATIENCE, "nothing arrived");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns what the loop is asked in its next cycle.
    fn requests(&mut self) -> OperatorRequests {
        let idle = OperatorRequests {
            arm: false,
            stop: None,
            halt: None,
        };
        self.loop_end.merge(idle, SafetyState::Driving)
    }
}

fn header(frame: &str) -> Header {
    Header {
        stamp: stamp(9_900_000_000),
        frame_id: frame.to_owned(),
    }
}

const SLOPE: Attitude = Attitude {
    roll_rad: 0.2,
    pitch_rad: -0.1,
};

#[test]
fn odometry_and_imu_of_another_node_become_the_newest_readings() {
    let mut bench = Bench::new(|_| {});
    let pose = Pose {
        x_m: 1.0,
        y_m: 2.0,
        z_m: 0.5,
        yaw_rad: 0.3,
    };
    let in_world = to_pose(&world_from_base_link(&pose, &SLOPE));
    let mut odometry = Odometry {
        header: header("odom"),
        child_frame_id: "base_link".to_owned(),
        ..Odometry::default()
    };
    odometry.pose.pose = in_world.clone();
    odometry.twist.twist.linear.x = 0.5;
    let imu = Imu {
        header: header("base_link"),
        orientation: in_world.orientation,
        ..Imu::default()
    };
    let (odometries, imus) = (
        bench.publisher::<Odometry>("odom"),
        bench.publisher::<Imu>("imu"),
    );
    let read = bench.until(
        || {
            odometries.publish(odometry.clone()).unwrap();
            imus.publish(imu.clone()).unwrap();
        },
        |bench| {
            let read = *bench.latest.read();
            (read.pose.is_some() && read.attitude.is_some()).then_some(read)
        },
    );
    assert_eq!(bench.context.shared.rejected(), 0);
    let (read_pose, attitude) = (read.pose.unwrap(), read.attitude.unwrap());
    assert!((read_pose.time_s - 9.9).abs() < 1e-9, "{read_pose:?}");
    assert!((read_pose.value.y_m - 2.0).abs() < 1e-9, "{read_pose:?}");
    assert!((attitude.value.roll_rad - 0.2).abs() < 1e-9, "{attitude:?}");
    assert_eq!(read.motors.unwrap().value.traction_m_s, 0.5);
    assert!(read.forwarded.is_none());
}

#[test]
fn the_yaw_rate_of_an_imu_reaches_the_sample_once() {
    let mut bench = Bench::new(|subscriber| {
        subscriber.config.attitude = AttitudeSource::Odometry;
        subscriber.config.yaw_rate = YawRateSource::Imu;
    });
    let imus = bench.publisher::<Imu>("imu");
    let mut imu = Imu {
        header: header("base_link"),
        ..Imu::default()
    };
    imu.angular_velocity.z = 0.4;
    // The vehicle drives without it.
    let inputs = bench.context.shared.graph().inputs();
    let of_imu = inputs.iter().find(|input| input.input == "imu").unwrap();
    assert_eq!(of_imu.missing, None);
    let (mut node, inputs) = (bench.node, (bench.worker, bench.latest));
    let scale = SpeedCorrection {
        left: 1.0,
        right: 1.0,
    };
    let commands = CommandsConfig::default();
    let mut port = Ros2Port::new(
        &mut node,
        (&commands, SpeedSource::default()),
        scale,
        bench.context,
        inputs,
    )
    .unwrap();
    let begin = Instant::now();
    let sample = loop {
        imus.publish(imu.clone()).unwrap();
        let sample = port.receive(10.0).sample;
        if sample.yaw_rate.is_some() {
            break sample;
        }
        assert!(begin.elapsed() < PATIENCE, "nothing arrived");
        std::thread::sleep(Duration::from_millis(20));
    };
    let yaw_rate = sample.yaw_rate.unwrap();
    assert!((yaw_rate.time_s - 9.9).abs() < 1e-9 && yaw_rate.value == 0.4);
    assert_eq!(sample.attitude, None);
    assert_eq!(port.receive(10.05).sample.yaw_rate, None);
    imu.header.stamp = stamp(9_950_000_000);
    let begin = Instant::now();
    while port.receive(10.1).sample.yaw_rate.is_none() {
        imus.publish(imu.clone()).unwrap();
        assert!(begin.elapsed() < PATIENCE, "no newer one arrived");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn the_emergency_stop_halts_the_loop_without_sensors_until_it_is_released() {
    let mut bench = Bench::new(|subscriber| subscriber.sensors = false);
    let odometries = bench.publisher::<Odometry>("odom");
    let stop = bench.publisher::<Bool>("emergency_stop");
    for (data, cause) in [(true, Some(StopCause::EmergencyStop)), (false, None)] {
        bench.until(
            || {
                odometries.publish(Odometry::default()).unwrap();
                stop.publish(Bool { data }).unwrap();
            },
            |bench| (bench.requests().halt == cause).then_some(()),
        );
        assert_eq!(bench.context.shared.emergency_stop.get(), cause);
    }
    // The odometry, which nobody could use, was not even read.
    assert!(bench.latest.read().pose.is_none());
    assert_eq!(bench.context.shared.rejected(), 0);
    let waited: Vec<_> = bench.context.shared.graph().inputs();
    assert_eq!(waited.len(), 1, "{waited:?}");
}

#[test]
fn silence_of_a_repeated_emergency_stop_halts_the_loop() {
    let silent = Some(StopCause::EmergencyStopSilent);
    let mut bench = Bench::new(|subscriber| subscriber.config.emergency_stop_timeout_s = 1.0);
    bench.until(
        || {},
        |bench| (bench.requests().halt == silent).then_some(()),
    );
    let stop = bench.publisher::<Bool>("emergency_stop");
    bench.until(
        || stop.publish(Bool { data: false }).unwrap(),
        |bench| bench.requests().halt.is_none().then_some(()),
    );
    bench.until(
        || {},
        |bench| (bench.requests().halt == silent).then_some(()),
    );
}

#[test]
fn the_forwarded_command_is_read_with_and_without_a_stamp() {
    for stamped in [false, true] {
        let mut bench = Bench::new(|subscriber| {
            subscriber.forwarded = Some(TwistConfig {
                topic: "cmd_vel_smoothed".to_owned(),
                stamped,
            });
        });
        let mut twist = Twist::default();
        twist.linear.x = 0.25;
        let read = |bench: &mut Bench| bench.latest.read().forwarded;
        let forwarded = if stamped {
            let topic = bench.publisher::<TwistStamped>("cmd_vel_smoothed");
            let message = TwistStamped {
                header: header("base_link"),
                twist,
            };
            bench.until(|| topic.publish(message.clone()).unwrap(), read)
        } else {
            let topic = bench.publisher::<Twist>("cmd_vel_smoothed");
            bench.until(|| topic.publish(twist.clone()).unwrap(), read)
        };
        assert_eq!(forwarded.value.traction_m_s, 0.25);
        assert_eq!(bench.context.shared.rejected(), 0);
    }
}

#[test]
fn a_message_in_another_frame_is_rejected_with_its_topic() {
    let mut bench = Bench::new(|_| {});
    let odometry = Odometry {
        header: header("elsewhere"),
        ..Odometry::default()
    };
    let odometries = bench.publisher::<Odometry>("odom");
    bench.until(
        || odometries.publish(odometry.clone()).unwrap(),
        |bench| (bench.context.shared.rejected() > 0).then_some(()),
    );
    let reason = bench.context.shared.last_rejection();
    assert!(
        reason.contains("odom") && reason.contains("elsewhere"),
        "{reason}"
    );
    assert!(bench.latest.read().pose.is_none());
}
