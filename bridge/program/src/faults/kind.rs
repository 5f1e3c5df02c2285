//! What can go wrong, and when it does in a run.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::Serialize;

/// A fault of sensors, drives, link or process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// No poses.
    PoseSilent,
    /// The same pose again and again, with new stamps.
    PoseFrozen,
    /// Poses 0.5 m to the right.
    PoseOffset,
    /// Poses that drift to the right by 0.2 m/s.
    PoseDrift,
    /// Poses 0.6 s late.
    PoseLate,
    /// Each second pose is older than the one before.
    PoseOutOfOrder,
    /// Poses that are not numbers.
    PoseNan,
    /// Poses stamped 0.4 s ahead of the clock.
    PoseAhead,
    /// Headings 10 deg off.
    HeadingOffset,
    /// No attitude.
    AttitudeSilent,
    /// Roll 5 deg off.
    AttitudeOffset,
    /// Attitudes that are not numbers.
    AttitudeNan,
    /// No yaw rate.
    GyroscopeSilent,
    /// Yaw rates 0.2 rad/s off.
    GyroscopeOffset,
    /// No tread speeds for the controller.
    SpeedsSilent,
    /// The same tread speeds again and again.
    SpeedsFrozen,
    /// Tread speeds that are not numbers.
    SpeedsNan,
    /// Nothing at all is received: the middleware is silent.
    AllSilent,
    /// No feedback of the drives.
    FeedbackSilent,
    /// The same speeds in the drives' feedback again and again.
    FeedbackFrozen,
    /// Feedback of the opposite sense.
    FeedbackMirrored,
    /// Feedback that is not a number.
    FeedbackNan,
    /// Feedback stamped 1 s ahead of the clock.
    FeedbackAhead,
    /// A drive reports a fault and stops.
    DriveFault,
    /// The drives reboot: off, and then on again as any drive.
    DriveReboots,
    /// The emergency stop of the drives is pressed.
    EmergencyStop,
    /// Another program changes the drives' mode.
    OtherMode,
    /// The motors keep the speed that they have, until they are switched off.
    MotorsStuck,
    /// The motors do not turn.
    MotorsBlocked,
    /// The motors turn the other way.
    MotorsReversed,
    /// The motors reach half of what is commanded.
    MotorsWeak,
    /// The vehicle runs away at half of its largest speed, until the drives are switched off.
    RunsAway,
    /// The interface is down: nothing is sent or received.
    LinkDown,
    /// The controller has left the bus.
    BusOff,
    /// Commands are lost on their way, each second one.
    CommandsLost,
    /// Commands cannot be sent.
    SendFails,
    /// Another node sends with this program's identifiers.
    Foreign,
    /// The process is suspended.
    Suspended,
}

/// A fault of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// From when, s since the vehicle drives.
    pub from_s: f64,
    /// For how long, s.
    pub for_s: f64,
}

impl Fault {
    /// Returns whether it is there at an instant, s since the vehicle drives.
    pub fn is_at(&self, since_s: f64) -> bool {
        (self.from_s..self.from_s + self.for_s).contains(&since_s)
    }
}

/// Share of runs with two faults at once.
const TWO_SHARE: f64 = 0.25;

/// Returns the faults of a run: one, or two that begin within a second.
pub fn draw(seed: u64, run: u64, kinds: &[FaultKind]) -> Vec<Fault> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(run);
    let mut share = || (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    let fault = |from_s: f64, share: &mut dyn FnMut() -> f64| Fault {
        kind: kinds[((share() * kinds.len() as f64) as usize).min(kinds.len() - 1)],
        from_s,
        // From a cycle to 5 s.
        for_s: 0.05 * 100_f64.powf(share()),
    };
    let from_s = 1.0 + 19.0 * share();
    let mut faults = vec![fault(from_s, &mut share)];
    if share() < TWO_SHARE {
        let second_s = from_s + share();
        faults.push(fault(second_s, &mut share));
    }
    faults
}
