//! Every state that the state machine can reach, and every step out of it.
//!
//! The model is the code itself: [`Safety::step`], searched breadth first. What it is given is not remembered from
//! step to step, so sensors, drives, link, controller and clock may do anything at any time; whatever a real vehicle
//! does is among it. Two states are one where nothing tells them apart any more: times are counted from now, in
//! periods, and stop at the longest time that is waited for.
//!
//! The abstraction: one motor turns, at four speeds; times are those of [`AGES`] and [`CLOCKS`]; limits are a few
//! periods long. In each step feedback, controller and requests take every combination, or feedback and requests do
//! and one other input is not as it should be; with `SIDEHILL_SAFETY_MODEL=full` all inputs take every combination.

use super::*;
use std::collections::{HashMap, VecDeque};

/// A power of two, so that sums of periods are exact, s.
const P: f64 = 0.0625;
/// The two speeds that are commanded, and the limit of both, m/s.
const SLOW: f64 = 0.5;
const FAST: f64 = 1.0;

fn config() -> SafetyConfig {
    SafetyConfig {
        command_timeout_s: 2.5 * P,
        feedback_timeout_s: 2.5 * P,
        transmit_timeout_s: 2.5 * P,
        zeroing_time_s: P,
        handshake_timeout_s: 2.5 * P,
        standstill_m_s: 0.02,
        speed_max_m_s: FAST,
        // A step of the ramp takes half of it.
        deceleration_m_s2: SLOW / P,
        plausible_difference_m_s: 0.1,
        response_time_s: 0.5 * P,
        implausible_time_s: 0.5 * P,
    }
}

/// Ages of a reading, s: fresh, older than half its limit, too old, and stamped ahead of the clock.
const AGES: [f64; 5] = [0.0, 2.0 * P, 4.0 * P, -P, -40.0 * P];
/// What the clock does, s.
const CLOCKS: [f64; 5] = [P, 0.0, -P, f64::NAN, 8.0 * P];

/// What one step is given, but for the time.
#[derive(Debug, Clone, Copy)]
struct Given {
    clock_s: f64,
    feedback: Option<(f64, DriveMode, f64)>,
    controller: Option<(f64, ControllerState, f64)>,
    requests: OperatorRequests,
    link: LinkState,
    unsent_s: Option<f64>,
    leaves_geofence: bool,
    forwarded: bool,
}

impl Given {
    fn inputs(&self, before_s: f64) -> SafetyInputs {
        let time_s = before_s + self.clock_s;
        // A broken clock stamps nothing.
        let now_s = if time_s.is_nan() { before_s } else { time_s };
        SafetyInputs {
            time_s,
            controller: self
                .controller
                .map(|(age_s, state, traction_m_s)| ControllerOutput {
                    time_s: now_s - age_s,
                    command: speeds(traction_m_s, 0.0),
                    state,
                }),
            feedback: self.feedback.map(|(age_s, mode, traction_m_s)| Stamped {
                time_s: now_s - age_s,
                value: DriveFeedback {
                    speeds: speeds(traction_m_s, 0.0),
                    mode,
                },
            }),
            forwarded: self.forwarded.then_some(Stamped {
                time_s: now_s,
                value: MotorSpeeds::STOP,
            }),
            link: self.link,
            unsent_since_s: self.unsent_s.map(|unsent_s| now_s - unsent_s),
            requests: self.requests,
            leaves_geofence: self.leaves_geofence,
        }
    }
}

/// What can be given in a step.
fn everything(full: bool) -> Vec<Given> {
    let mut feedback = vec![None];
    for traction_m_s in [0.0, SLOW, FAST, -SLOW, f64::NAN] {
        feedback.push(Some((0.0, DriveMode::Enabled, traction_m_s)));
    }
    for age_s in &AGES[1..] {
        feedback.push(Some((*age_s, DriveMode::Enabled, SLOW)));
    }
    for (age_s, traction_m_s) in [(0.0, 0.0), (0.0, SLOW), (4.0 * P, 0.0)] {
        feedback.push(Some((age_s, DriveMode::Disabled, traction_m_s)));
    }
    for mode in [
        DriveMode::EmergencyStop,
        DriveMode::Fault,
        DriveMode::NotOperational,
        DriveMode::OtherMode,
        DriveMode::Frozen,
    ] {
        feedback.push(Some((0.0, mode, SLOW)));
        feedback.push(Some((4.0 * P, mode, SLOW)));
    }
    let mut controller = vec![None];
    for traction_m_s in [SLOW, 9.0, f64::NAN] {
        controller.push(Some((0.0, ControllerState::Driving, traction_m_s)));
    }
    for age_s in &AGES[1..] {
        controller.push(Some((*age_s, ControllerState::Driving, SLOW)));
    }
    let stopped = ControllerState::Stopped(StopReason::NoPath);
    for state in [ControllerState::Waiting, stopped, ControllerState::Finished] {
        controller.push(Some((0.0, state, SLOW)));
    }
    let cause = Some(StopCause::Operator);
    let requests = [(None, None), (cause, None), (None, cause)]
        .map(|(stop, halt)| [false, true].map(|arm| OperatorRequests { arm, stop, halt }));
    let links = [LinkState::Active, LinkState::Down, LinkState::Foreign];
    let unsent = [None, Some(P), Some(5.0 * P)];
    let mut given = Vec::new();
    for clock_s in CLOCKS {
        for link in links {
            for unsent_s in unsent {
                for (leaves_geofence, forwarded) in
                    [(false, false), (true, false), (false, true), (true, true)]
                {
                    let wrong = [
                        clock_s != P,
                        link != LinkState::Active,
                        unsent_s.is_some(),
                        leaves_geofence,
                        forwarded,
                    ];
                    let wrong = wrong.iter().filter(|wrong| **wrong).count();
                    if wrong > 1 && !full {
                        continue;
                    }
                    let controller = match wrong == 0 || full {
                        true => &controller[..],
                        false => &controller[1..2],
                    };
                    for feedback in &feedback {
                        for controller in controller {
                            for requests in requests.as_flattened() {
                                given.push(Given {
                                    clock_s,
                                    feedback: *feedback,
                                    controller: *controller,
                                    requests: *requests,
                                    link,
                                    unsent_s,
                                    leaves_geofence,
                                    forwarded,
                                });
                            }
                        }
                    }
                }
            }
        }
    }
    given
}

/// All that decides what comes of a state.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Key {
    state: u8,
    since: i64,
    armed_before: bool,
    following: bool,
    command: i64,
    /// Least and greatest recent speeds over one, two and more periods.
    recent: [i64; 4],
    implausible: Option<[i64; 4]>,
}

fn key(safety: &Safety, now_s: f64) -> Key {
    let periods = |time_s: f64| ((now_s - time_s) / P).clamp(-5.0, 5.0).round() as i64;
    let level = |value: f64| (64.0 * value.clamp(-99.0, 99.0)).round() as i64;
    let response_s = safety.config.response_time_s;
    let range = |since_s: f64| safety.recent.range(since_s)[0].map(level);
    // At the same instant the range is the first one, after a period or more the second.
    let ([a, b], [c, d]) = (range(now_s - response_s), range(now_s + 0.25 * P));
    Key {
        state: safety.state as u8,
        since: periods(safety.since_s),
        armed_before: safety.armed_before,
        following: safety.following,
        command: level(safety.command.speeds.traction_m_s),
        recent: [a, b, c, d],
        implausible: safety.implausible.map(|found| {
            [
                periods(found.since_s),
                periods(found.last_s),
                level(found.way_m.min(safety.config.plausible_difference_m_s * P)),
                i64::from(found.first_report_s < now_s),
            ]
        }),
    }
}

/// Returns what is wrong with a step, as the safety page states it.
fn wrong(
    from: &Safety,
    given: &Given,
    inputs: &SafetyInputs,
    to: &Safety,
    order: &DriveCommand,
) -> Option<&'static str> {
    let config = config();
    let speed_m_s = order.speeds.traction_m_s;
    let on = matches!(
        to.state,
        SafetyState::Enabling | SafetyState::Driving | SafetyState::Stopping
    );
    let moves = matches!(to.state, SafetyState::Driving | SafetyState::Stopping);
    let waits = |state| matches!(state, SafetyState::Disarmed | SafetyState::Latched);
    let requested = inputs.requests.stop.or(inputs.requests.halt).is_some();
    let fresh = |age_s: f64, limit_s: f64| age_s.abs() <= limit_s;
    let feedback = given.feedback;
    let cut = inputs.requests.halt.is_some()
        || given.link == LinkState::Foreign
        || feedback.is_some_and(|(_, mode, _)| {
            matches!(mode, DriveMode::EmergencyStop | DriveMode::OtherMode)
                || matches!(mode, DriveMode::Fault | DriveMode::NotOperational)
                    && from.state != SafetyState::Zeroing
        });
    if !speed_m_s.is_finite() || speed_m_s.abs() > config.speed_max_m_s {
        return Some("a speed is not finite or beyond its limit");
    }
    if !moves && speed_m_s != 0.0 {
        return Some("the vehicle is moved while it is not driven");
    }
    if order.enable != on || order.fault_reset != (to.state == SafetyState::Zeroing) {
        return Some("drives are on, or their faults reset, where they should not be");
    }
    let rises = inputs.requests.arm && !from.armed_before;
    if waits(from.state) && !waits(to.state) && (!rises || requested) {
        return Some("the vehicle arms by itself, or against a stop");
    }
    if cut && on {
        return Some("a fault that switches off at once does not");
    }
    if to.state == SafetyState::Driving && from.state == SafetyState::Driving {
        let ready = feedback.is_some_and(|(age_s, mode, _)| {
            mode == DriveMode::Enabled && fresh(age_s, config.feedback_timeout_s)
        });
        if !ready || !given.link.carries() || requested || given.leaves_geofence {
            return Some(
                "it drives on without fresh feedback of drives that are on, or against a stop",
            );
        }
        if given
            .unsent_s
            .is_some_and(|unsent_s| unsent_s > config.transmit_timeout_s)
        {
            return Some("it drives on while nothing is sent");
        }
        if !matches!(given.clock_s, clock_s if clock_s >= 0.0) {
            return Some("it drives on while the clock is wrong");
        }
    }
    if to.state == SafetyState::Driving && speed_m_s != 0.0 {
        let drives = given.controller.is_some_and(|(age_s, state, _)| {
            state == ControllerState::Driving && fresh(age_s, config.command_timeout_s)
        });
        if !drives {
            return Some("it moves without a fresh command");
        }
    }
    if from.state == SafetyState::Stopping {
        if !matches!(to.state, SafetyState::Stopping | SafetyState::Latched) {
            return Some("a stop is taken back");
        }
        let step_m_s = config.deceleration_m_s2 * given.clock_s.max(0.0);
        let most_m_s = (from.command.speeds.traction_m_s.abs() - step_m_s).max(0.0);
        if speed_m_s.abs() > most_m_s {
            return Some("the ramp of a stop is left");
        }
        if to.state == SafetyState::Stopping && !matches!(given.clock_s, clock_s if clock_s >= 0.0)
        {
            return Some("a stop does not end while the clock is wrong");
        }
    }
    let waited_s = inputs.time_s - to.since_s;
    let longest_s = match to.state {
        SafetyState::Disarmed | SafetyState::Latched => f64::INFINITY,
        SafetyState::Zeroing => config.zeroing_time_s + config.handshake_timeout_s,
        SafetyState::Enabling => config.handshake_timeout_s,
        SafetyState::Driving if to.following => f64::INFINITY,
        SafetyState::Driving => config.handshake_timeout_s,
        SafetyState::Stopping => f64::INFINITY,
    };
    if waited_s > longest_s {
        return Some("it waits for longer than it should");
    }
    if let (SafetyState::Driving, Some(found)) = (to.state, to.implausible)
        && inputs.time_s - found.since_s >= 5.0 * config.implausible_time_s
    {
        return Some("it drives on although the drives do not follow");
    }
    None
}

/// The way to a state: the state before and what was given there.
struct Came {
    from: usize,
    by: usize,
}

/// Searches all states; returns their number, that of the steps, and the way to the first wrong one.
fn search(full: bool) -> (usize, usize, Option<String>) {
    let given = everything(full);
    let first = Safety::new(config()).unwrap();
    let mut known = HashMap::from([(key(&first, 0.0), 0)]);
    let mut came = vec![Came { from: 0, by: 0 }];
    let mut open = VecDeque::from([(0, first, 0.0)]);
    let mut steps = 0;
    let mut seen = [false; 6];
    while let Some((index, safety, now_s)) = open.pop_front() {
        seen[safety.state as usize] = true;
        for (by, what) in given.iter().enumerate() {
            let inputs = what.inputs(now_s);
            let mut next = safety.clone();
            let (order, _) = next.step(&inputs);
            steps += 1;
            if let Some(wrong) = wrong(&safety, what, &inputs, &next, &order) {
                let mut way = vec![format!("{what:?}: {wrong}")];
                let mut at = index;
                while at != 0 {
                    way.push(format!("{:?}", given[came[at].by]));
                    at = came[at].from;
                }
                way.reverse();
                return (known.len(), steps, Some(way.join("\n")));
            }
            let then_s = if inputs.time_s.is_nan() {
                now_s
            } else {
                inputs.time_s
            };
            let count = known.len();
            known.entry(key(&next, then_s)).or_insert_with(|| {
                came.push(Came { from: index, by });
                open.push_back((count, next, then_s));
                count
            });
        }
    }
    assert_eq!(seen, [true; 6]);
    (known.len(), steps, None)
}

#[test]
fn no_step_out_of_any_state_is_unsafe() {
    let full = std::env::var("SIDEHILL_SAFETY_MODEL").is_ok_and(|value| value == "full");
    let begun = std::time::Instant::now();
    let (states, steps, wrong) = search(full);
    eprintln!("{states} states, {steps} steps, {:?}", begun.elapsed());
    assert_eq!(wrong, None, "{}", wrong.as_deref().unwrap_or_default());
}
