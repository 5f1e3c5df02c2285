//! What a monitoring system gets at `/metrics`: the newest state, and counts and times since the start.
//!
//! All is made from the messages that the page gets, so the control loop does nothing for it. A value has the name that
//! it has in `/diagnostics`, as [`MetricName`] writes it.

use super::outgoing::TopicMessage;
use super::page::{OLD_NS, STATES};
use crate::messages::{ControllerCycle, LoopCycle, Topic};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, prometheus_text, text};
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use sidehill_bridge::ros2::message::DiagnosticArray;
use sidehill_bridge::ros2::message::cdr::from_cdr;
use sidehill_bridge::safety::{Reason, SafetyState, Transition};
use std::collections::BTreeMap;

/// Upper bounds of the bins of times, s.
const BINS_S: [f64; 12] = [
    5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2,
];

/// What units are called at the end of a key, longest first: spelled out, and how much of the base unit one is.
const UNITS: [(&str, &str, f64); 7] = [
    ("_m_s2", "meters_per_second_squared", 1.0),
    ("_rad_s", "radians_per_second", 1.0),
    ("_m_s", "meters_per_second", 1.0),
    ("_rad", "radians", 1.0),
    ("_us", "seconds", 1e-6),
    ("_s", "seconds", 1.0),
    ("_m", "meters", 1.0),
];

/// Reasons of changes of state that are no stops of a vehicle that drives.
const NO_STOPS: [&str; 6] = [
    "armed",
    "standing",
    "enabled",
    "ramp_ended",
    "handshake",
    "controller_stopped",
];

/// A form of the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    OpenMetrics,
    /// The format of Prometheus, for who reads that only.
    Prometheus,
}

impl Form {
    /// Returns the form for a request with this field `Accept`.
    pub(super) fn accepted(accept: &str) -> Self {
        match accept.contains("text/plain") && !accept.contains("openmetrics") {
            true => Self::Prometheus,
            false => Self::OpenMetrics,
        }
    }

    pub(super) fn content_type(self) -> &'static str {
        match self {
            Self::OpenMetrics => "application/openmetrics-text; version=1.0.0; charset=utf-8",
            Self::Prometheus => "text/plain; version=0.0.4; charset=utf-8",
        }
    }
}

/// The metrics of a drive.
#[derive(Debug, Clone)]
pub(super) struct Metrics {
    /// Time of the newest message, ns.
    newest_ns: u64,
    /// Newest cycle of the loop, with its time, ns.
    cycle: Option<(u64, LoopCycle)>,
    /// Time of the newest step of the controller, ns.
    step_ns: u64,
    /// Newest figures of the controller in the diagnostics.
    figures: BTreeMap<String, f64>,
    lateness_s: Histogram,
    solve_s: Histogram,
    cycles: u64,
    unsent: u64,
    /// Stops by their causes.
    stops: BTreeMap<&'static str, u64>,
}

impl Default for Metrics {
    /// Returns metrics in which nothing has happened.
    fn default() -> Self {
        Self {
            newest_ns: 0,
            cycle: None,
            step_ns: 0,
            figures: BTreeMap::new(),
            lateness_s: Histogram::new(BINS_S),
            solve_s: Histogram::new(BINS_S),
            cycles: 0,
            unsent: 0,
            // With all causes from the start, as the first stop would not be an increase.
            stops: Reason::causes()
                .filter(|cause| !NO_STOPS.contains(cause))
                .map(|cause| (cause, 0))
                .collect(),
        }
    }
}

impl Metrics {
    /// Takes a message of a drive.
    pub(super) fn take(&mut self, message: &TopicMessage) {
        let (time_ns, bytes) = (message.time_ns, &message.message);
        self.newest_ns = time_ns;
        match message.topic {
            Topic::LoopCycle => {
                if let Ok(cycle) = from_cdr::<LoopCycle>(bytes) {
                    self.cycles += 1;
                    self.unsent += u64::from(!cycle.sent);
                    self.lateness_s.observe(cycle.lateness_s.max(0.0));
                    self.cycle = Some((time_ns, cycle));
                }
            }
            Topic::ControllerCycle => {
                if let Ok(step) = from_cdr::<ControllerCycle>(bytes) {
                    self.step_ns = time_ns;
                    if step.solve_us.is_finite() {
                        self.solve_s.observe(1e-6 * step.solve_us);
                    }
                }
            }
            Topic::Diagnostics => {
                if let Ok(array) = from_cdr::<DiagnosticArray>(bytes) {
                    self.figures = figures(array);
                }
            }
            _ => {}
        }
    }

    /// Counts a change of state, if it is a stop.
    pub(super) fn transition(&mut self, transition: &Transition) {
        if transition.from == SafetyState::Driving {
            *self.stops.entry(transition.reason.cause()).or_default() += 1;
        }
    }

    /// Returns the text.
    pub(super) fn text(&self, form: Form) -> String {
        let mut registry = Registry::with_prefix("sidehill");
        registry.register_collector(Box::new(self.clone()));
        let mut text = String::new();
        // Writing to a text does not fail.
        let _ = match form {
            Form::OpenMetrics => text::encode(&mut text, &registry),
            Form::Prometheus => prometheus_text::encode(&mut text, &registry),
        };
        text
    }
}

/// Returns the figures of the controller in diagnostics, those that are known: of several in a value the first.
fn figures(array: DiagnosticArray) -> BTreeMap<String, f64> {
    let of_controller = |name: &str| name == "sidehill: controller";
    let status = array.status.into_iter();
    let status = status.filter(|status| of_controller(&status.name));
    let entries = status.flat_map(|status| status.values);
    let figures = entries.filter_map(|entry| {
        let first = entry.value.split(' ').next()?;
        let figure: f64 = first.parse().ok()?;
        // Its times are counted.
        (figure.is_finite() && entry.key != "solve_us").then_some((entry.key, figure))
    });
    figures.collect()
}

/// The name of a metric: that of a value in `/diagnostics` after `sidehill_`, its unit spelled out and a base unit.
struct MetricName<'a> {
    name: &'a str,
    unit: Option<Unit>,
    /// How much of the unit of the metric one of the value's is.
    scale: f64,
}

impl<'a> From<&'a str> for MetricName<'a> {
    fn from(key: &'a str) -> Self {
        for (end, unit, scale) in UNITS {
            if let Some(name) = key.strip_suffix(end) {
                let unit = Some(Unit::Other(unit.to_owned()));
                return Self { name, unit, scale };
            }
        }
        Self {
            name: key,
            unit: None,
            scale: 1.0,
        }
    }
}

impl Collector for Metrics {
    fn encode(&self, mut to: DescriptorEncoder) -> Result<(), std::fmt::Error> {
        for (key, help, times) in [
            (
                "lateness_s",
                "How much later than due cycles begin",
                &self.lateness_s,
            ),
            (
                "solve_us",
                "Time of the solver in a step of the controller",
                &self.solve_s,
            ),
        ] {
            one(&mut to, key, help, times)?;
        }
        let is_new = |time_ns: u64| self.newest_ns.saturating_sub(time_ns) <= OLD_NS;
        if let Some((time_ns, cycle)) = &self.cycle {
            for (key, help, count) in [
                ("cycles", "Control cycles", self.cycles),
                (
                    "cycles_skipped",
                    "Cycles skipped because earlier ones took too long",
                    cycle.skipped,
                ),
                (
                    "commands_unsent",
                    "Cycles whose command could not be sent",
                    self.unsent,
                ),
                ("refused", "Messages refused", cycle.refused),
            ] {
                one(&mut to, key, help, &ConstCounter::new(count))?;
            }
            if is_new(*time_ns) {
                for (key, help, value) in [
                    (
                        "slack_s",
                        "What was left of the period when the cycle ended",
                        cycle.slack_s,
                    ),
                    (
                        "feedback_age_s",
                        "Age of the drives' feedback",
                        cycle.feedback_age_s,
                    ),
                ] {
                    one(&mut to, key, help, &ConstGauge::new(value))?;
                }
                let states = STATES.map(|state| (state, f64::from(cycle.state == state)));
                let help = "State of the safety: 1 for the present one";
                let gauges = states.map(|(state, value)| (state, ConstGauge::new(value)));
                each(&mut to, "safety", help, "state", &gauges)?;
            }
        }
        let stops = self.stops.iter();
        let stops: Vec<_> = stops
            .map(|(cause, count)| (*cause, ConstCounter::new(*count)))
            .collect();
        each(&mut to, "stops", "Stops while driving", "cause", &stops)?;
        if is_new(self.step_ns) {
            for (key, value) in &self.figures {
                let help = format!("{key} of the controller in /diagnostics");
                let scale = MetricName::from(key.as_str()).scale;
                one(&mut to, key, &help, &ConstGauge::new(scale * value))?;
            }
        }
        Ok(())
    }
}

/// Writes a metric.
fn one(
    to: &mut DescriptorEncoder,
    key: &str,
    help: &str,
    metric: &impl EncodeMetric,
) -> Result<(), std::fmt::Error> {
    let MetricName { name, unit, .. } = key.into();
    metric.encode(to.encode_descriptor(name, help, unit.as_ref(), metric.metric_type())?)
}

/// Writes a metric for each value of a label; there is one at least.
fn each<M: EncodeMetric>(
    to: &mut DescriptorEncoder,
    key: &str,
    help: &str,
    label: &str,
    metrics: &[(&str, M)],
) -> Result<(), std::fmt::Error> {
    let Some((_, first)) = metrics.first() else {
        return Ok(());
    };
    let MetricName { name, unit, .. } = key.into();
    let mut family = to.encode_descriptor(name, help, unit.as_ref(), first.metric_type())?;
    for (value, metric) in metrics {
        metric.encode(family.encode_family(&[(label, *value)])?)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
