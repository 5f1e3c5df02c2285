//! The texts of the files.

use super::port::PortKind;
use super::robots::{Measures, Robot};
use crate::config::{CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigFile};
use crate::identify;
use anyhow::{Context, Result};
use sidehill_plant::vehicle::Vehicle;
use std::fmt::Write;

/// A file to be written.
pub(super) struct File {
    /// Name within the folder.
    pub(super) name: &'static str,
    /// Its text.
    pub(super) text: String,
}

/// Half length of the wheels' rectangle of the J8, m, to which the figure of eight is made.
const J8_HALF_LENGTH_M: f64 = 1.06;
/// Friction that is assumed until it is measured.
const FRICTION: f64 = 0.8;

/// Returns all files of a set.
pub(super) fn all(robot: Robot, port: PortKind) -> Result<Vec<File>> {
    let (vehicle, contact, identified, scale) = match robot.measures() {
        None => (
            built_in("config/vehicles/j8.yaml")?,
            built_in(CONTACT_VEHICLE)?,
            Some(built_in(CONTACT_IDENTIFIED)?),
            1.0,
        ),
        Some(measures) => {
            let contact = contact_vehicle(&measures);
            let scale = (0.5 * measures.wheelbase_m / J8_HALF_LENGTH_M).clamp(0.4, 1.0);
            (first_guess(&measures, &contact)?, contact, None, scale)
        }
    };
    let known: Vehicle = serde_yaml::from_str(&vehicle)?;
    let track_width_m = known.icrs.right_m - known.icrs.left_m;
    let identified_name = match identified {
        Some(_) => "identified.yaml",
        None => "vehicle.yaml",
    };
    let mut files = vec![
        File {
            name: "vehicle.yaml",
            text: vehicle,
        },
        File {
            name: "contact.yaml",
            text: contact,
        },
        File {
            name: "scenario.yaml",
            text: scenario(&known.name, identified_name, scale),
        },
        File {
            name: "columns.yaml",
            text: COLUMNS.to_owned(),
        },
        File {
            name: "README.md",
            text: readme(&known.name, port),
        },
    ];
    files.extend(identified.map(|text| File {
        name: "identified.yaml",
        text,
    }));
    files.extend(bridge(port, track_width_m)?);
    files.iter_mut().for_each(name_schema);
    let named = |name: &str| files.iter().any(|file| schema_of(file.name) == Some(name));
    let schemas: Vec<File> = SCHEMA_FILES
        .iter()
        .filter(|(name, _)| named(name))
        .map(|(name, text)| File {
            name,
            text: (*text).to_owned(),
        })
        .collect();
    files.extend(schemas);
    Ok(files)
}

/// Folder of the schemas within that of a set.
pub(super) const SCHEMAS: &str = "schema";

/// JSON schemas for editors, by their names in a set.
const SCHEMA_FILES: [(&str, &str); 7] = [
    (
        "schema/vehicle.json",
        include_str!("../../docs/schema/vehicle.json"),
    ),
    (
        "schema/contact_vehicle.json",
        include_str!("../../docs/schema/contact_vehicle.json"),
    ),
    (
        "schema/scenario.json",
        include_str!("../../docs/schema/scenario.json"),
    ),
    (
        "schema/columns.json",
        include_str!("../../docs/schema/columns.json"),
    ),
    (
        "schema/run.json",
        include_str!("../../docs/schema/run.json"),
    ),
    (
        "schema/virtual_rover.json",
        include_str!("../../docs/schema/virtual_rover.json"),
    ),
    (
        "schema/can.json",
        include_str!("../../docs/schema/can.json"),
    ),
];

/// Returns the schema of a file of a set, if it has one.
fn schema_of(name: &str) -> Option<&'static str> {
    Some(match name {
        "vehicle.yaml" | "identified.yaml" => "schema/vehicle.json",
        "contact.yaml" => "schema/contact_vehicle.json",
        "scenario.yaml" => "schema/scenario.json",
        "columns.yaml" => "schema/columns.json",
        "run.yaml" => "schema/run.json",
        "virtual.yaml" => "schema/virtual_rover.json",
        "can.yaml" => "schema/can.json",
        _ => return None,
    })
}

/// Names its schema in a file's first line, for editors.
fn name_schema(file: &mut File) {
    const MARK: &str = "# yaml-language-server: $schema=";
    let Some(schema) = schema_of(file.name) else {
        return;
    };
    let rest = match file.text.split_once('\n') {
        // The repository's own, which names another folder.
        Some((first, rest)) if first.starts_with(MARK) => rest,
        _ => &file.text,
    };
    file.text = format!("{MARK}{schema}\n{rest}");
}

fn built_in(name: &str) -> Result<String> {
    Ok(ConfigFile::built_in(name)?.text().to_owned())
}

/// Returns the vehicle on wheels with the maker's measures and assumptions for the rest.
fn contact_vehicle(measures: &Measures) -> String {
    let Measures {
        name,
        title,
        source,
        mass_kg,
        track_m,
        wheelbase_m,
        axles,
        radius_m,
        centre_of_mass_height_m,
        ..
    } = *measures;
    let half_width_m = 0.5 * track_m;
    // A patch as long as half the wheel's radius; see patch_radius_m in the file.
    let patch_m = 0.5 * radius_m / 6_f64.sqrt();
    let mut lines = String::new();
    for axle in 0..axles {
        let share = axle as f64 / (axles - 1) as f64;
        let _ = writeln!(
            lines,
            "  - {{ forward_m: {:.4}, load_share: {} }}",
            (0.5 - share) * wheelbase_m,
            1.0 / axles as f64
        );
    }
    format!(
        "# {title} as a vehicle on wheels with friction: what `simulate --plant contact` drives and what\n\
         # contact-mpc predicts with. Measures: {source}.\n\
         # What is marked as an assumption is a guess: measure it, or let identification find it.\n\
         \n\
         # Name in tables and plots.\n\
         name: {name}-contact\n\
         \n\
         # Mass, in kg, without payload. Add what the vehicle carries.\n\
         mass_kg: {mass_kg:?}\n\
         \n\
         # Centre of mass from the body's origin (the middle of the wheels), in m; height above the ground.\n\
         # Assumption: over the middle. Payload moves it.\n\
         centre_of_mass_right_m: 0.0\n\
         centre_of_mass_forward_m: 0.0\n\
         centre_of_mass_height_m: {centre_of_mass_height_m:?}\n\
         \n\
         # Lateral distance of the wheel contacts from the origin, in m.\n\
         half_width_m: {half_width_m:?}\n\
         \n\
         # Axles: forward_m from the origin, in m; load_share of the weight on level ground with the centre\n\
         # of mass over the origin, all together 1. Assumption: equal loads.\n\
         axles:\n{lines}\
         \n\
         friction:\n\
         \x20 # Coefficient of friction of tyre and ground, without unit. Assumption: dry firm ground.\n\
         \x20 field: {{ kind: uniform, coefficient: {FRICTION:?} }}\n\
         \x20 # Share of it that acts sideways, without unit. Assumption: as much as lengthways.\n\
         \x20 lateral_share: 1.0\n\
         \x20 # Slip at which friction reaches 71 % of its limit, in m/s. Assumption.\n\
         \x20 slip_scale_m_s: 0.02\n\
         \x20 # Rolling resistance of the ground, force over load, without unit. Assumption.\n\
         \x20 rolling_resistance: 0.03\n\
         \x20 # Radius of gyration of a contact patch, in m: its side over the square root of 6. Assumption: a\n\
         \x20 # patch as long as half the wheel's radius.\n\
         \x20 patch_radius_m: {patch_m:.4}\n"
    )
}

/// Returns the vehicle as ICRIK knows it: ICRs and slide gains that identification finds when the
/// vehicle on wheels drives the paper's procedure in simulation.
fn first_guess(measures: &Measures, contact: &str) -> Result<String> {
    let half_width_m = 0.5 * measures.track_m;
    let half_length_m = 0.5 * measures.wheelbase_m;
    let start: Vehicle = serde_yaml::from_str(&format!(
        "{{name: {}, x_icr_left_m: {}, x_icr_right_m: {}, y_icr_m: 0.0, lambda_1_s_per_rad: 1.0,
          lambda_2_s_per_rad: 1.0, speed_max_m_s: 1.0, base_half_width_m: {half_width_m},
          base_half_length_m: {half_length_m}, correction_left: 1.0, correction_right: 1.0}}",
        measures.name,
        -1.5 * half_width_m,
        1.5 * half_width_m,
    ))?;
    let found = identify::by_simulation(&serde_yaml::from_str(contact)?, &start, 1)
        .with_context(|| format!("{}: first guess", measures.name))?;
    let maker = measures
        .separation_multiplier
        .map_or_else(String::new, |multiplier| {
            format!(
                "# The maker's wheel_separation_multiplier, {multiplier}, would put them {:.3} m apart.\n",
                multiplier * measures.track_m
            )
        });
    let icrs = &found.icrs;
    Ok(format!(
        "# {title}: FIRST GUESSES, found by driving contact.yaml in simulation as\n\
         #     sidehill identify --simulate contact.yaml --vehicle vehicle.yaml --out better.yaml\n\
         # does. Replace them by `sidehill identify` with logs of your vehicle before you trust it on a slope.\n\
         # Measures: {source}.\n\
         \n\
         # Name in tables and plots.\n\
         name: {name}\n\
         \n\
         # Tread ICRs on level ground, in m from the body's origin (the middle of the wheels).\n\
         {maker}\
         x_icr_left_m: {left:.3}   # to the right, so negative: left of the origin\n\
         x_icr_right_m: {right:.3}   # to the right\n\
         y_icr_m: {forward:.3}   # forward\n\
         \n\
         # How far the ICRs move on a slope (ICRIK), in s/rad.\n\
         lambda_1_s_per_rad: {lambda_1:.3}   # all ICRs, with roll and pitch\n\
         lambda_2_s_per_rad: {lambda_2:.3}   # one tread more, when pointing mostly up or down\n\
         \n\
         # Largest speed that is driven (v_y^m), in m/s.\n\
         speed_max_m_s: 1.0\n\
         \n\
         # Half width and half length of the rectangle of the wheels' contact points, in m.\n\
         base_half_width_m: {half_width_m:?}\n\
         base_half_length_m: {half_length_m:?}\n\
         \n\
         # From measured to effective tread speed (c_l, c_r), without unit: 1 until identified.\n\
         correction_left: 1.0\n\
         correction_right: 1.0\n",
        title = measures.title,
        source = measures.source,
        name = measures.name,
        left = icrs.left_m,
        right = icrs.right_m,
        forward = icrs.forward_m,
        lambda_1 = found.slide.shift_s_per_rad,
        lambda_2 = found.slide.aggravated_s_per_rad,
    ))
}

fn scenario(name: &str, identified: &str, scale: f64) -> String {
    format!(
        "# A figure of eight on a hillside of 5 degrees, of a size that fits the vehicle.\n\
         \n\
         # Name in tables and plots.\n\
         name: {name}_figure_eight\n\
         \n\
         # What controllers know of the vehicle, relative to this file; with `plant: icrik` it also moves so.\n\
         vehicle: vehicle.yaml\n\
         \n\
         # What moves the vehicle with `plant: contact`, and what controllers know of it then.\n\
         contact: {{vehicle: contact.yaml, identified: {identified}}}\n\
         \n\
         # Ground: a plane that rises by slope_deg (degrees) towards uphill_heading_deg (degrees,\n\
         # counter-clockwise from Y_g, so 0 is up along +Y_g).\n\
         terrain: {{kind: plane, slope_deg: 5, uphill_heading_deg: 0}}\n\
         \n\
         # Lengths in m, period in s. A recorded route instead: route: {{file: route.gpx}}\n\
         course: {{shape: figure_eight, half_width_m: {width:.2}, half_length_m: {length:.2}, period_s: 60}}\n\
         \n\
         # Controllers, run one after the other.\n\
         controllers: [contact-mpc, icrik-mpc, icrhk-mpc, pure-pursuit]\n\
         \n\
         # What moves the vehicle: icrik (the model itself) or contact (wheels with friction).\n\
         plant: contact\n\
         \n\
         # Seed of everything random, and step of the simulation, s.\n\
         seed: 1\n\
         step_s: 0.005\n",
        width = 2.4 * scale,
        length = 3.9 * scale,
    )
}

/// Returns the configuration of `run` and `vehicle`: the repository's own with the names of this set.
fn bridge(port: PortKind, track_width_m: f64) -> Result<Vec<File>> {
    let replaced = |text: &str, pairs: &[(&str, String)]| -> Result<String> {
        pairs.iter().try_fold(text.to_owned(), |text, (from, to)| {
            anyhow::ensure!(text.contains(from), "the template has no `{from}`");
            Ok(text.replace(from, to))
        })
    };
    let vehicle = ("../vehicles/j8.yaml", "vehicle.yaml".to_owned());
    let world = ("../scenarios/figure_eight.yaml", "scenario.yaml".to_owned());
    let width = (
        "track_width_m: 2.053",
        format!("track_width_m: {track_width_m:.3}"),
    );
    Ok(match port {
        PortKind::Ros2 => {
            let run = include_str!("../../config/bridge/run_ros2.yaml");
            let rover = include_str!("../../config/bridge/vehicle_ros2.yaml");
            vec![
                File {
                    name: "run.yaml",
                    text: replaced(
                        run,
                        &[
                            vehicle,
                            ("vehicle_ros2.yaml", "virtual.yaml".to_owned()),
                            width.clone(),
                        ],
                    )?,
                },
                File {
                    name: "virtual.yaml",
                    text: replaced(rover, &[world, width])?,
                },
            ]
        }
        PortKind::Can => {
            let run = include_str!("../../config/bridge/run_vcan0.yaml");
            let rover = include_str!("../../config/bridge/vehicle_vcan0.yaml");
            vec![
                File {
                    name: "run.yaml",
                    text: replaced(
                        run,
                        &[vehicle, ("vehicle_vcan0.yaml", "virtual.yaml".to_owned())],
                    )?,
                },
                File {
                    name: "virtual.yaml",
                    text: replaced(rover, &[world])?,
                },
                File {
                    name: "can.yaml",
                    text: include_str!("../../config/bridge/can.yaml").to_owned(),
                },
                File {
                    name: "j8.dbc",
                    text: include_str!("../../config/bridge/j8.dbc").to_owned(),
                },
            ]
        }
    })
}

const COLUMNS: &str = "\
# Where your logs have their values, for `identify` and `odometry --columns`. As it stands: a CSV made
# of wheel speeds, an imu and poses of ROS 2. Change the names on the right to those of your columns.
time: t                     # s
tread_speed_left: wheel_left
tread_speed_right: wheel_right
tread_speed_scale: 1.0      # to m/s: a wheel's radius in m where the columns are rad/s
# Roll and pitch: kind paper or rep103 with roll and pitch in rad, quaternion with x, y, z, w, or level.
attitude: { kind: quaternion, x: qx, y: qy, z: qz, w: qw }
# Pose in m; heading: kind paper or rep103 with yaw in rad, or quaternion with x, y, z, w.
# repeats: true where the log repeats a pose until there is a new one.
pose: { x: x, y: y, z: z, heading: { kind: quaternion, x: pose_qx, y: pose_qy, z: pose_qz, w: pose_qw }, repeats: true }
";

fn readme(name: &str, port: PortKind) -> String {
    let drive = match port {
        PortKind::Ros2 => {
            "4. Drive the virtual rover over ROS 2, in two terminals, and send it a path:\n\
             \n\
             \x20       sidehill vehicle virtual.yaml\n\
             \x20       sidehill run run.yaml\n\
             \x20       ros2 action send_goal /follow_path nav2_msgs/action/FollowPath \"{path: {header: {frame_id: odom}, poses: [{header: {frame_id: odom}, pose: {position: {x: 0.5, y: 0.0}, orientation: {w: 1.0}}}, {header: {frame_id: odom}, pose: {position: {x: 3.0, y: 0.0}, orientation: {w: 1.0}}}]}}\"\n\
             \n\
             5. On the vehicle: set the topics in run.yaml (odometry with the wheels' twist, not one that a filter\n\
             \x20  has smoothed: tread speeds are made of it; imu; cmd_vel and whether it is stamped) and\n\
             \x20  `track_width_m`, by which your base makes wheel speeds of a twist (its wheel separation times\n\
             \x20  multiplier).\n"
        }
        PortKind::Can => {
            "4. Drive the virtual rover over a virtual bus, in two terminals:\n\
             \n\
             \x20       ip link add vcan0 type vcan && ip link set vcan0 up\n\
             \x20       sidehill vehicle virtual.yaml\n\
             \x20       sidehill run run.yaml --arm\n\
             \n\
             5. On the vehicle: put your CAN database in place of j8.dbc and name its messages in can.yaml.\n"
        }
    };
    format!(
        "# {name} with Sidehill\n\
         \n\
         1. Read vehicle.yaml and contact.yaml; correct mass, payload and measures. Then\n\
         \n\
         \x20       sidehill check *.yaml\n\
         \n\
         2. Simulate it on wheels with friction, on 5 degrees, and look at out/report.html:\n\
         \n\
         \x20       sidehill simulate scenario.yaml --out out\n\
         \n\
         3. Log your vehicle: varied driving on level ground, then turning on a slope (tread speeds, roll,\n\
         \x20  pitch, poses). Name its columns in columns.yaml and identify:\n\
         \n\
         \x20       sidehill identify --level level.csv --slope slope.csv --columns columns.yaml --vehicle vehicle.yaml --out identified_from_logs.yaml\n\
         \n\
         \x20  Then name the identified file in scenario.yaml and run.yaml.\n\
         {drive}\
         6. First drive: wheels off the ground, emergency stop in reach, low `speed_m_s`, level ground first.\n"
    )
}
