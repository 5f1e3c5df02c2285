use super::*;
use ros2_client::action::GoalId;
use sidehill_controller::controller::{Decision, StopReason};
use sidehill_controller::estimator::{Estimate, Refused};
use sidehill_plant::speeds::MotorSpeeds;

const TOLERANCES: Tolerances = Tolerances {
    goal_xy_m: 0.25,
    goal_yaw_rad: 0.25,
    progress_m: 0.5,
    progress_time_s: 10.0,
    transform_s: 0.5,
    failure_s: 1.0,
};

/// A vehicle in words: the state of its safety, and what the controller says.
struct World {
    executive: Executive,
    now_s: f64,
    state: SafetyState,
    armed: u64,
    stopped_by: Option<Reason>,
    status: Status,
    reference: u64,
    x_m: f64,
    yaw_rad: f64,
    transform: Option<&'static str>,
    emergency_stop: Option<StopCause>,
    emergency_stop_awaited: bool,
    clock_jumped: bool,
    client_lost: bool,
    /// The heading where the path begins, where that is behind.
    turn_to_rad: Option<f64>,
    /// The path is to be prepared again under this number.
    prepare: Option<u64>,
    told: Vec<(Client, GoalEnd, Outcome)>,
    arm: u64,
    stop: Option<StopCause>,
}

impl World {
    fn new() -> Self {
        Self {
            executive: Executive::default(),
            now_s: 1.0,
            state: SafetyState::Disarmed,
            armed: 0,
            stopped_by: None,
            status: Status::Tracking,
            reference: 0,
            x_m: 0.0,
            yaw_rad: 0.0,
            transform: None,
            emergency_stop: None,
            emergency_stop_awaited: false,
            clock_jumped: false,
            client_lost: false,
            turn_to_rad: None,
            prepare: None,
            told: Vec::new(),
            arm: 0,
            stop: None,
        }
    }

    fn carry_out(&mut self, effects: Vec<Effect>) {
        for effect in effects {
            match effect {
                Effect::Arm(number) => self.arm = number,
                Effect::Stop(cause) => self.stop = cause,
                Effect::Told(client, end, outcome) => self.told.push((client, end, outcome)),
                Effect::Clear => self.reference = 0,
                Effect::Prepare(number) => self.prepare = Some(number),
                Effect::Turn {
                    number, angle_rad, ..
                } => {
                    self.reference = number;
                    self.yaw_rad += angle_rad;
                }
            }
        }
    }

    /// A cycle of the safety as far as it matters here, and a look at it.
    fn cycle(&mut self) {
        self.now_s += 0.05;
        let off = matches!(self.state, SafetyState::Disarmed | SafetyState::Latched);
        let free = self.emergency_stop.or(self.stop).is_none();
        self.state = match (self.state, self.emergency_stop, self.stop) {
            (_, Some(cause), _) if !off => {
                self.stopped_by = Some(Reason::Requested(cause));
                SafetyState::Latched
            }
            _ if off && self.arm > self.armed && free => {
                self.armed = self.arm;
                SafetyState::Zeroing
            }
            (SafetyState::Zeroing, ..) => SafetyState::Enabling,
            (SafetyState::Enabling, ..) => SafetyState::Driving,
            (SafetyState::Driving, _, Some(cause)) => {
                self.stopped_by = Some(Reason::Requested(cause));
                SafetyState::Stopping
            }
            (SafetyState::Stopping, ..) => SafetyState::Latched,
            (state, ..) => state,
        };
        let decision = Decision {
            time_s: self.now_s,
            command_effective: MotorSpeeds::STOP,
            status: self.status,
            estimate: Some(estimate(self.now_s, self.x_m, self.yaw_rad)),
            progress: None,
            solve: None,
            refused: Refused::default(),
            reference: self.reference,
        };
        let effects = self.executive.step(
            &Seen {
                now_s: self.now_s,
                cycle_s: self.now_s,
                state: self.state,
                armed: self.armed,
                stopped_by: self.stopped_by,
                decision: Some(&decision),
                transform: self.transform,
                emergency_stop: self.emergency_stop,
                emergency_stop_awaited: self.emergency_stop_awaited,
                clock_jumped: self.clock_jumped,
                client_lost: self.client_lost,
            },
            &TOLERANCES,
        );
        self.carry_out(effects);
    }

    fn cycles(&mut self, count: u32) {
        for _ in 0..count {
            self.cycle();
        }
    }

    /// Takes a path up that leads 10 m ahead, and returns its client.
    fn follow(&mut self) -> Client {
        let client = Client::Goal(GoalId::new_random());
        let (number, effects) = self.executive.begin(client);
        self.carry_out(effects);
        self.cycles(2);
        self.reference = number;
        let goal = PlanarPose {
            x_m: 10.0,
            ..PlanarPose::default()
        };
        let effects = self
            .executive
            .ready(self.now_s, self.state, goal, self.turn_to_rad);
        self.carry_out(effects);
        client
    }

    fn driving(&mut self) -> Client {
        let client = self.follow();
        self.cycles(10);
        assert_eq!(self.state, SafetyState::Driving);
        client
    }

    /// The safety ends the drive by itself.
    fn end_by(&mut self, reason: Reason) {
        self.state = SafetyState::Latched;
        self.stopped_by = Some(reason);
    }

    fn finish(&mut self) {
        self.end_by(Reason::Finished);
        self.cycles(3);
    }

    #[track_caller]
    fn assert_told(&self, client: Client, end: GoalEnd, code: u16) {
        let told: Vec<_> = self
            .told
            .iter()
            .filter(|(who, ..)| *who == client)
            .collect();
        assert_eq!(told.len(), 1, "{told:?}");
        assert_eq!((told[0].1, told[0].2.code), (end, code), "{told:?}");
        assert_eq!(told[0].2.message.is_empty(), end == GoalEnd::Succeeded);
    }
}

fn estimate(time_s: f64, x_m: f64, yaw_rad: f64) -> Estimate {
    use nalgebra::{Matrix3, Vector3};
    Estimate {
        time_s,
        pose: PlanarPose {
            x_m,
            y_m: 0.0,
            yaw_rad,
        },
        covariance: Matrix3::zeros(),
        attitude: sidehill_plant::frames::Attitude::LEVEL,
        normal_in_world: Vector3::z(),
        treads: sidehill_plant::speeds::TreadSpeeds::default(),
        slip_gains: sidehill_plant::slip_gains::SlipGains::default(),
        model_error_m_s: 0.0,
        pose_age_s: 0.0,
        attitude_age_s: 0.0,
        speeds_age_s: 0.0,
        poses_gated: 0,
    }
}

#[test]
fn a_path_is_armed_for_driven_and_succeeds_within_the_tolerances() {
    for (x_m, end, code) in [
        (9.9, GoalEnd::Succeeded, code::NONE),
        (9.0, GoalEnd::Aborted, code::NO_VALID_CONTROL),
    ] {
        let mut world = World::new();
        let client = world.driving();
        world.x_m = x_m;
        world.cycle();
        world.finish();
        world.assert_told(client, end, code);
        // Nothing is asked for any more.
        world.cycles(3);
        assert_eq!((world.arm, world.stop), (0, None));
        assert_eq!(world.executive.client(), None);
    }
}

#[test]
fn a_newer_path_is_gone_over_to_without_a_stop() {
    let mut world = World::new();
    let first = world.driving();
    let armed = world.armed;
    let second = world.follow();
    world.assert_told(first, GoalEnd::Aborted, code::UNKNOWN);
    world.cycles(20);
    assert_eq!(
        (world.state, world.armed, world.stop),
        (SafetyState::Driving, armed, None)
    );
    world.x_m = 10.0;
    world.cycle();
    world.finish();
    world.assert_told(second, GoalEnd::Succeeded, code::NONE);
}

#[test]
fn a_path_that_comes_as_the_one_before_ends_is_armed_for_anew() {
    let mut world = World::new();
    world.driving();
    let (number, effects) = world.executive.begin(Client::Topic);
    world.carry_out(effects);
    let effects = world
        .executive
        .ready(world.now_s, world.state, PlanarPose::default(), None);
    world.carry_out(effects);
    // The controller finishes the old path before it sees the new one.
    world.state = SafetyState::Latched;
    world.stopped_by = Some(Reason::Finished);
    world.cycle();
    world.reference = number;
    world.cycles(5);
    assert_eq!(world.state, SafetyState::Driving);
    assert_eq!(world.armed, number);
}

#[test]
fn a_cancelled_path_is_told_when_the_vehicle_stands() {
    let mut world = World::new();
    let client = world.driving();
    let cancelled = doubt(code::NONE, StopCause::Cancelled);
    let effects = world
        .executive
        .end(world.now_s, GoalEnd::Canceled, cancelled);
    world.carry_out(effects);
    assert_eq!(world.stop, Some(StopCause::Cancelled));
    assert!(world.told.is_empty());
    world.cycle();
    assert_eq!(world.state, SafetyState::Stopping);
    assert!(world.told.is_empty());
    world.cycles(2);
    world.assert_told(client, GoalEnd::Canceled, code::NONE);
    assert_eq!(world.stop, None);
    assert_eq!(
        world.stopped_by,
        Some(Reason::Requested(StopCause::Cancelled))
    );
    // And a path after it drives.
    world.driving();
}

#[test]
fn an_end_before_the_drives_are_armed_does_not_arm_them() {
    let mut world = World::new();
    let client = world.follow();
    let cancelled = doubt(code::NONE, StopCause::Cancelled);
    let effects = world
        .executive
        .end(world.now_s, GoalEnd::Canceled, cancelled);
    world.carry_out(effects);
    world.cycles(20);
    assert_eq!((world.armed, world.state), (0, SafetyState::Disarmed));
    world.assert_told(client, GoalEnd::Canceled, code::NONE);
}

#[test]
fn an_arming_that_crosses_the_end_is_taken_back() {
    let mut world = World::new();
    let client = world.follow();
    // The cycle has armed, but its word has not come yet.
    let cancelled = doubt(code::NONE, StopCause::Cancelled);
    let effects = world
        .executive
        .end(world.now_s, GoalEnd::Canceled, cancelled);
    world.carry_out(effects);
    let seen = Seen {
        now_s: world.now_s,
        cycle_s: world.now_s - 0.05,
        state: SafetyState::Disarmed,
        armed: 0,
        stopped_by: None,
        decision: None,
        transform: None,
        emergency_stop: None,
        emergency_stop_awaited: false,
        clock_jumped: false,
        client_lost: false,
    };
    let effects = world.executive.step(&seen, &TOLERANCES);
    assert!(effects.is_empty(), "{effects:?}");
    assert!(world.stop.is_some());
    world.cycles(3);
    world.assert_told(client, GoalEnd::Canceled, code::NONE);
}

#[test]
fn newer_paths_do_not_hide_that_the_vehicle_does_not_get_on() {
    for (step_m, gets_on) in [(0.0, false), (0.6, true)] {
        let mut world = World::new();
        let mut client = world.driving();
        // A planner that plans anew every 4 s.
        for _ in 0..3 {
            world.x_m += step_m;
            client = world.follow();
            world.cycles(80);
        }
        assert_eq!(world.state == SafetyState::Driving, gets_on);
        if !gets_on {
            world.assert_told(client, GoalEnd::Aborted, code::FAILED_TO_MAKE_PROGRESS);
            // One that comes after it has its own time.
            world.driving();
            world.cycles(80);
            assert_eq!(world.state, SafetyState::Driving);
        }
    }
}

#[test]
fn every_doubt_ends_with_its_code() {
    type Disturb = fn(&mut World);
    // What is wrong, the goal's code, and how the end of the drive is told.
    let doubts: [(Disturb, u16, &str); 11] = [
        (
            |world| world.emergency_stop_awaited = true,
            code::UNKNOWN,
            "who may press the emergency stop has come and is not heard",
        ),
        (
            |world| world.emergency_stop = Some(StopCause::EmergencyStop),
            code::UNKNOWN,
            "the emergency stop is pressed",
        ),
        (
            |world| world.emergency_stop = Some(StopCause::EmergencyStopSilent),
            code::UNKNOWN,
            "the emergency stop is silent",
        ),
        (
            |world| world.clock_jumped = true,
            code::TF_ERROR,
            "the clock has jumped",
        ),
        (
            |world| world.client_lost = true,
            code::UNKNOWN,
            "the client has left",
        ),
        (
            |world| world.transform = Some("there is no transform"),
            code::TF_ERROR,
            "the path's frame is no longer known",
        ),
        (
            |world| {
                world.status = Status::Fallback {
                    reason: sidehill_controller::mpc::QpFailure::Infeasible,
                    cycles: 1,
                };
            },
            code::PATIENCE_EXCEEDED,
            "there was no plan for longer than tolerated",
        ),
        (
            |_| {},
            code::FAILED_TO_MAKE_PROGRESS,
            "there was no progress for longer than tolerated",
        ),
        (
            |world| world.end_by(Reason::CommandTimeout { age_s: 0.2 }),
            code::CONTROLLER_TIMED_OUT,
            "the command is 0.200 s old",
        ),
        (
            |world| world.end_by(Reason::FeedbackTimeout { age_s: 0.3 }),
            code::TF_ERROR,
            "the feedback is 0.300 s old",
        ),
        (
            |world| {
                let why = StopReason::OffPath { cross_track_m: 3.0 };
                world.end_by(Reason::ControllerStopped { why });
                world.status = Status::Stopping(why);
            },
            code::NO_VALID_CONTROL,
            "the controller stops: the vehicle is 3.00 m off the path",
        ),
    ];
    for (disturb, code, told) in doubts {
        let mut world = World::new();
        let client = world.driving();
        disturb(&mut world);
        world.cycles(220);
        assert_eq!(world.state, SafetyState::Latched, "{told}");
        assert_eq!(world.stopped_by.unwrap().to_string(), told);
        world.assert_told(client, GoalEnd::Aborted, code);
        assert_eq!(world.arm, 0, "{told}: arms nothing");
    }
}

#[test]
fn nothing_is_armed_under_an_emergency_stop() {
    let mut world = World::new();
    world.emergency_stop = Some(StopCause::EmergencyStop);
    let client = world.follow();
    world.cycles(20);
    assert_eq!((world.armed, world.state), (0, SafetyState::Disarmed));
    world.assert_told(client, GoalEnd::Aborted, code::UNKNOWN);
}

#[test]
fn a_drive_that_nobody_asked_for_is_stopped() {
    let mut world = World::new();
    world.state = SafetyState::Driving;
    world.cycles(3);
    assert_eq!(world.state, SafetyState::Latched);
    let cause = StopCause::NobodyAsked;
    assert_eq!(world.stopped_by, Some(Reason::Requested(cause)));
    world.cycles(2);
    assert_eq!(world.stop, None);
}

#[test]
fn a_vehicle_that_looks_elsewhere_at_the_goal_turns_where_it_may() {
    for turns in [true, false] {
        let mut world = World::new();
        world.executive = Executive::new(Turns {
            at_start: false,
            at_goal: turns,
        });
        world.yaw_rad = 2.0;
        let client = world.driving();
        let armed = world.armed;
        world.x_m = 9.9;
        world.cycle();
        world.finish();
        if !turns {
            world.assert_told(client, GoalEnd::Aborted, code::NO_VALID_CONTROL);
            continue;
        }
        assert!(world.told.is_empty(), "it is armed for the turn");
        world.cycles(5);
        assert_eq!(world.state, SafetyState::Driving);
        assert!(world.armed > armed);
        // A turn takes its time and gets nowhere.
        world.cycles(250);
        assert_eq!(world.state, SafetyState::Driving);
        world.finish();
        world.assert_told(client, GoalEnd::Succeeded, code::NONE);
    }
}

const AT_START: Turns = Turns {
    at_start: true,
    at_goal: false,
};

#[test]
fn a_path_that_leads_off_behind_is_begun_by_a_turn() {
    let mut world = World::new();
    world.executive = Executive::new(AT_START);
    (world.yaw_rad, world.turn_to_rad) = (2.5, Some(-0.1));
    let client = world.follow();
    world.cycles(10);
    assert_eq!(
        (world.armed, world.state),
        (world.reference, SafetyState::Driving)
    );
    assert!((world.yaw_rad + 0.1).abs() < 1e-9, "{}", world.yaw_rad);
    // A turn gets nowhere, and its end is not the path's.
    world.cycles(250);
    assert_eq!(world.state, SafetyState::Driving);
    world.finish();
    let number = world.prepare.expect("the path follows");
    assert!(number > world.armed);
    assert!(world.told.is_empty(), "{:?}", world.told);
    // It still begins behind: one turn has to do.
    world.reference = number;
    let goal = PlanarPose::default();
    let effects = world
        .executive
        .ready(world.now_s, world.state, goal, world.turn_to_rad);
    world.carry_out(effects);
    world.cycles(10);
    assert_eq!((world.armed, world.state), (number, SafetyState::Driving));
    world.finish();
    world.assert_told(client, GoalEnd::Succeeded, code::NONE);
}

#[test]
fn a_vehicle_under_way_stands_before_it_turns() {
    let mut world = World::new();
    world.executive = Executive::new(AT_START);
    let first = world.driving();
    world.turn_to_rad = Some(3.0);
    let second = world.follow();
    world.assert_told(first, GoalEnd::Aborted, code::UNKNOWN);
    let armed = world.armed;
    world.cycle();
    assert_eq!((world.state, world.armed), (SafetyState::Stopping, armed));
    assert_eq!(world.yaw_rad, 0.0, "not while it drives");
    world.cycles(10);
    assert_eq!(world.state, SafetyState::Driving);
    assert!(world.armed > armed);
    assert!((world.yaw_rad - 3.0).abs() < 1e-9);
    // A cancel in the turn ends all of it.
    let cause = StopCause::Cancelled;
    let ending = (cause, Outcome::new(code::NONE, cause.to_string()));
    let effects = world.executive.end(world.now_s, GoalEnd::Canceled, ending);
    world.carry_out(effects);
    world.cycles(5);
    world.assert_told(second, GoalEnd::Canceled, code::NONE);
    assert_eq!(world.prepare, None);
}

#[test]
fn a_path_that_leads_off_behind_is_driven_as_it_is_where_turns_are_not_wanted() {
    let mut world = World::new();
    world.turn_to_rad = Some(3.0);
    world.driving();
    assert_eq!(world.yaw_rad, 0.0);
}

#[test]
fn a_path_that_leads_nowhere_is_ended_standing_with_a_turn_where_it_takes_one() {
    for (yaw_rad, turns) in [(0.1, false), (2.0, true)] {
        let mut world = World::new();
        world.executive = Executive::new(Turns {
            at_start: false,
            at_goal: true,
        });
        // It comes in place of a path that is driven, as a planner sends one anew.
        world.driving();
        let client = Client::Goal(GoalId::new_random());
        let (_, effects) = world.executive.begin(client);
        world.carry_out(effects);
        let goal = PlanarPose {
            yaw_rad,
            ..PlanarPose::default()
        };
        let effects = world.executive.arrived(world.now_s, world.state, goal);
        world.carry_out(effects);
        world.cycle();
        assert_eq!(world.state, SafetyState::Stopping);
        world.cycles(10);
        if turns {
            assert_eq!(world.state, SafetyState::Driving);
            world.finish();
        }
        world.assert_told(client, GoalEnd::Succeeded, code::NONE);
        assert!((world.yaw_rad - if turns { yaw_rad } else { 0.0 }).abs() < 1e-9);
    }
}
