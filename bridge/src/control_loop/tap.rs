//! What the controller's thread leaves for the recording, without waiting and without allocating.

use crate::control_loop::record::{RecordSink, RecordSource, ring};
use sidehill_controller::controller::{Controller, Decision, DriveResponse};
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sample::Sample;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use triple_buffer::{Input, Output, triple_buffer};

/// Steps that the ring holds: 10 s at 100 Hz.
const STEPS: usize = 1024;
/// Paths that wait to be recorded.
const PATHS: usize = 64;

/// One step of the controller.
#[derive(Debug, Clone, Copy)]
pub struct StepRecord {
    /// Steps before this one.
    pub index: u64,
    /// What it got.
    pub sample: Sample,
    /// Whether commands reached the drives.
    pub engaged: bool,
    /// Serial of the path that was applied before it; 0 for none.
    pub path: u64,
    /// Which look at the deadline ended a solve.
    pub cut_at: Option<u32>,
    /// What it decided.
    pub decision: Decision,
    /// How the drives respond, as learned.
    pub drives: DriveResponse,
}

/// What the controller predicts.
#[derive(Debug, Clone, Default)]
pub struct PlanView {
    /// Instant of the cycle, s.
    pub time_s: f64,
    /// Predicted poses, the present first; empty without a plan.
    pub plan: Vec<PlanarPose>,
    /// Poses of the reference over the same time.
    pub reference: Vec<PlanarPose>,
}

impl PlanView {
    /// Takes over the controller's plan; allocates only until `stages` fit.
    pub fn set(&mut self, time_s: f64, controller: &Controller, stages: usize) {
        self.time_s = time_s;
        self.plan.clear();
        self.plan.reserve_exact(stages + 1);
        if let Some(plan) = controller.plan() {
            let states = plan.states.iter();
            self.plan.extend(states.map(|state| PlanarPose {
                x_m: state.x,
                y_m: state.y,
                yaw_rad: state.z,
            }));
        }
        self.reference.clear();
        self.reference.reserve_exact(stages + 1);
        let targets = controller.targets().iter();
        self.reference.extend(targets.map(|target| target.pose));
    }
}

/// A path as the controller gets it.
#[derive(Debug, Clone)]
pub struct PathRecord {
    /// Number under which steps name it; 0 is what the controller followed from the start.
    pub serial: u64,
    /// What is followed; none if the path was removed.
    pub path: Option<RecordedPath>,
}

/// What a [`PathRecord`] says of its path.
#[derive(Debug, Clone)]
pub struct RecordedPath {
    /// What is followed.
    pub trajectory: Trajectory,
    /// Number that decisions on it carry.
    pub number: u64,
    /// Rounds of a periodic trajectory.
    pub laps: u32,
    /// Arc length at which the vehicle joins it, m; none for its start.
    pub from_m: Option<f64>,
}

impl PathRecord {
    /// Returns what a controller follows before its first step; none without a path.
    pub fn initial(controller: &Controller) -> Option<Self> {
        let reference = controller.reference()?;
        Some(Self {
            serial: 0,
            path: Some(RecordedPath {
                trajectory: reference.trajectory().clone(),
                number: reference.number(),
                laps: reference.laps(),
                from_m: None,
            }),
        })
    }
}

/// The controller's end.
pub struct ControllerTap {
    steps: RecordSink<StepRecord>,
    plan: Input<PlanView>,
    count: u64,
    stages: usize,
}

impl ControllerTap {
    /// Leaves a step with its plan.
    pub fn take(
        &mut self,
        sample: &Sample,
        engaged: bool,
        path: u64,
        decision: &Decision,
        controller: &Controller,
    ) {
        self.steps.push(StepRecord {
            index: self.count,
            sample: *sample,
            engaged,
            path,
            cut_at: controller.was_cut_at(),
            decision: *decision,
            drives: controller.drive_response(),
        });
        self.count += 1;
        self.plan
            .input_buffer_mut()
            .set(sample.time_s, controller, self.stages);
        self.plan.publish();
    }
}

/// Where paths are left for the recording; clones share it.
#[derive(Debug, Clone)]
pub struct PathLog {
    paths: SyncSender<PathRecord>,
    lost: Arc<AtomicU64>,
}

impl PathLog {
    /// Leaves a path, or counts it as lost.
    pub fn push(&self, path: PathRecord) {
        if self.paths.try_send(path).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The recording's end.
pub struct ControllerLog {
    /// Steps, in their order.
    pub steps: RecordSource<StepRecord>,
    paths: Receiver<PathRecord>,
    plan: Output<PlanView>,
    paths_lost: Arc<AtomicU64>,
}

impl ControllerLog {
    /// Returns the next path.
    pub fn next_path(&mut self) -> Option<PathRecord> {
        self.paths.try_recv().ok()
    }

    /// Returns the newest plan, where it is a new one.
    pub fn new_plan(&mut self) -> Option<&PlanView> {
        self.plan.update().then(|| self.plan.output_buffer())
    }

    /// Returns the steps and paths that found no place.
    pub fn lost(&self) -> u64 {
        self.steps.lost() + self.paths_lost.load(Ordering::Relaxed)
    }
}

/// Returns the ends of a tap on a controller whose horizon has at most `stages`.
pub fn tap(stages: usize) -> (ControllerTap, PathLog, ControllerLog) {
    let (sink, steps) = ring(STEPS);
    let (plan, newest) = triple_buffer(&PlanView::default());
    let (sender, paths) = sync_channel(PATHS);
    let lost = Arc::new(AtomicU64::new(0));
    (
        ControllerTap {
            steps: sink,
            plan,
            count: 0,
            stages,
        },
        PathLog {
            paths: sender,
            lost: Arc::clone(&lost),
        },
        ControllerLog {
            steps,
            paths,
            plan: newest,
            paths_lost: lost,
        },
    )
}
