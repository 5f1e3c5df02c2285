//! Draws what the vehicle on wheels with friction does on a slope: `docs/contact_slide.svg`.
//!
//! ```text
//! cargo run --release --example contact_slide -- docs/contact_slide.svg
//! ```
#![allow(clippy::print_stderr)]

use anyhow::{Context, Result};
use plotters::prelude::*;
use sidehill_plant::contact::{ContactModel, ContactVehicle};
use sidehill_plant::frames::{Attitude, BodyVelocity};
use sidehill_plant::motion::{GroundState, MotionModel};
use sidehill_plant::speeds::{MotorSpeeds, TreadSpeeds};
use std::ops::Range;

const SIZE_PX: (u32, u32) = (1000, 760);
const COLOURS: [RGBColor; 4] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(170, 68, 153),
];
/// Slope on which the slide is measured, as in the paper's identification, deg.
const SLOPE_DEG: f64 = 4.0;
/// Steer at which it is measured, m/s.
const STEER_M_S: f64 = 0.33;

/// A line with its name.
struct ChartLine {
    name: String,
    points: Vec<(f64, f64)>,
    dashed: bool,
}

/// A chart with its lines.
struct ChartPanel {
    title: &'static str,
    x: (&'static str, Range<f64>),
    y: (&'static str, Range<f64>),
    lines: Vec<ChartLine>,
}

fn main() -> Result<()> {
    let out = std::env::args().nth(1).context("which file to write?")?;
    let j8: ContactVehicle =
        serde_yaml::from_str(include_str!("../config/vehicles/j8_contact.yaml"))?;
    let panels = [creep(&j8)?, turn(&j8)?, heading(&j8)?, speed(&j8)?];
    let root = SVGBackend::new(&out, SIZE_PX).into_drawing_area();
    root.fill(&WHITE)?;
    for (panel, area) in panels.into_iter().zip(root.split_evenly((2, 2))) {
        draw(panel, &area)?;
    }
    root.present()
        .with_context(|| format!("{out}: cannot be written"))?;
    eprintln!("{out}: written");
    Ok(())
}

/// Velocity on a plane, heading against straight uphill.
fn velocity(
    vehicle: &ContactVehicle,
    slope_deg: f64,
    heading_deg: f64,
    motors: MotorSpeeds,
) -> Result<BodyVelocity> {
    let ground = GroundState {
        attitude: Attitude::from_slope(slope_deg.to_radians(), heading_deg.to_radians()),
        ..GroundState::default()
    };
    Ok(
        ContactModel::new(vehicle.clone()).body_velocity(
            &ground,
            TreadSpeeds::from(motors),
            0.0,
        )?,
    )
}

/// Downhill velocity that the slope adds, m/s, and the yaw rate, rad/s.
fn slide(
    vehicle: &ContactVehicle,
    slope_deg: f64,
    heading_deg: f64,
    motors: MotorSpeeds,
) -> Result<(f64, f64)> {
    let here = velocity(vehicle, slope_deg, heading_deg, motors)?;
    let level = velocity(vehicle, 0.0, heading_deg, motors)?;
    let (sin, cos) = heading_deg.to_radians().sin_cos();
    // Uphill in body axes is (sin, cos) of the heading.
    let down =
        -(sin * (here.right_m_s - level.right_m_s) + cos * (here.forward_m_s - level.forward_m_s));
    Ok((down, here.yaw_rate_rad_s))
}

/// Slide for each rad/s of turn and rad of slope, m/rad: mean of both ways of turning and of the
/// heading and its opposite.
fn slide_gain(vehicle: &ContactVehicle, heading_deg: f64, traction_m_s: f64) -> Result<f64> {
    let mut total = 0.0;
    for steer_m_s in [-STEER_M_S, STEER_M_S] {
        for heading_deg in [heading_deg, heading_deg + 180.0] {
            let motors = MotorSpeeds {
                traction_m_s,
                steer_m_s,
            };
            let (down, turn) = slide(vehicle, SLOPE_DEG, heading_deg, motors)?;
            total += down / (SLOPE_DEG.to_radians() * turn.abs());
        }
    }
    Ok(0.25 * total)
}

fn with_inner_share(j8: &ContactVehicle, share: f64) -> ContactVehicle {
    let mut vehicle = j8.clone();
    for axle in &mut vehicle.axles {
        let inner = axle.forward_m.abs() < 0.5;
        axle.load_share = 0.5 * if inner { share } else { 1.0 - share };
    }
    vehicle
}

fn line(
    name: impl Into<String>,
    xs: impl Iterator<Item = f64>,
    y: impl Fn(f64) -> Result<f64>,
) -> Result<ChartLine> {
    let points: Result<_> = xs.map(|x| Ok((x, y(x)?))).collect();
    Ok(ChartLine {
        name: name.into(),
        points: points?,
        dashed: false,
    })
}

fn steps(from: f64, to: f64) -> impl Iterator<Item = f64> {
    (0..=60).map(move |i| from + (to - from) * f64::from(i) / 60.0)
}

fn creep(j8: &ContactVehicle) -> Result<ChartPanel> {
    let ahead = MotorSpeeds {
        traction_m_s: 0.5,
        steer_m_s: 0.0,
    };
    let mm_s = |heading_deg: f64| {
        line(
            format!("heading {heading_deg} deg from uphill"),
            steps(0.0, 15.0),
            move |slope_deg| Ok(1e3 * slide(j8, slope_deg, heading_deg, ahead)?.0),
        )
    };
    let turning = MotorSpeeds {
        traction_m_s: 0.5,
        steer_m_s: 0.1,
    };
    let compared = line("turning at steer 0.1 m/s", steps(0.0, 15.0), |slope_deg| {
        Ok(1e3 * slide(j8, slope_deg, 90.0, turning)?.0)
    })?;
    Ok(ChartPanel {
        title: "Straight ahead at 0.5 m/s: a creep only",
        x: ("slope, deg", 0.0..15.0),
        y: ("downhill, mm/s", 0.0..40.0),
        lines: vec![mm_s(0.0)?, mm_s(90.0)?, compared],
    })
}

fn turn(j8: &ContactVehicle) -> Result<ChartPanel> {
    let lines: Result<_> = [0.0, 45.0, 90.0]
        .into_iter()
        .map(|heading_deg| {
            let mut points = Vec::new();
            for steer_m_s in steps(0.0, 0.5) {
                let motors = MotorSpeeds {
                    traction_m_s: 0.0,
                    steer_m_s,
                };
                let (down, turn) = slide(j8, SLOPE_DEG, heading_deg, motors)?;
                points.push((turn.abs(), 100.0 * down));
            }
            Ok(ChartLine {
                name: format!("heading {heading_deg} deg from uphill"),
                points,
                dashed: false,
            })
        })
        .collect();
    Ok(ChartPanel {
        title: "On the spot on 4 deg: in proportion to the turn",
        x: ("yaw rate, rad/s", 0.0..0.5),
        y: ("downhill, cm/s", 0.0..8.0),
        lines: lines?,
    })
}

fn heading(j8: &ContactVehicle) -> Result<ChartPanel> {
    let lines: Result<_> = [0.5, 0.6, 0.743, 0.9]
        .into_iter()
        .map(|share| {
            let vehicle = with_inner_share(j8, share);
            line(
                format!("inner axles carry {:.1} %", 100.0 * share),
                steps(0.0, 180.0),
                |heading_deg| slide_gain(&vehicle, heading_deg, 0.0),
            )
        })
        .collect();
    Ok(ChartPanel {
        title: "Up or down (0, 180) more than across (90)",
        x: ("heading from uphill, deg", 0.0..180.0),
        y: ("slide, m/rad", 0.0..6.0),
        lines: lines?,
    })
}

fn speed(j8: &ContactVehicle) -> Result<ChartPanel> {
    let mut lines = Vec::new();
    for resistance in [0.0, 0.02, 0.1] {
        let mut vehicle = j8.clone();
        vehicle.friction.rolling_resistance = resistance;
        lines.push(line(
            format!("rolling resistance {resistance}"),
            steps(0.0, 0.6),
            |traction_m_s| slide_gain(&vehicle, 0.0, traction_m_s),
        )?);
    }
    let standing = slide_gain(j8, 0.0, 0.0)?;
    let mut model = line("ICRIK, equation (5)", steps(0.0, 0.6), |traction_m_s| {
        Ok(standing * (1.0 - traction_m_s))
    })?;
    model.dashed = true;
    lines.push(model);
    Ok(ChartPanel {
        title: "At speed less, by rolling resistance alone",
        x: ("traction, m/s", 0.0..0.6),
        y: ("slide up and down, m/rad", 0.0..3.5),
        lines,
    })
}

fn draw(panel: ChartPanel, area: &DrawingArea<SVGBackend, plotters::coord::Shift>) -> Result<()> {
    let mut chart = ChartBuilder::on(area)
        .caption(panel.title, ("sans-serif", 15))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(44)
        .build_cartesian_2d(panel.x.1, panel.y.1)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc(panel.x.0)
        .y_desc(panel.y.0)
        .draw()?;
    for (line, colour) in panel.lines.into_iter().zip(COLOURS) {
        let (style, points) = (colour.stroke_width(2), line.points);
        let drawn = if line.dashed {
            chart.draw_series(DashedLineSeries::new(points, 6, 4, style))?
        } else {
            chart.draw_series(LineSeries::new(points, style))?
        };
        drawn
            .label(line.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    Ok(())
}
