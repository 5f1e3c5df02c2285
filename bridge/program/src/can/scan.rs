//! `sidehill can scan`: the nodes of a bus.

use super::bus::{BUS_KNOWN_S, ConfiguredBus};
use anyhow::{Result, bail, ensure};
use serde::Serialize;
use sidehill::config::ConfigFile;
use sidehill::console;
use sidehill::drive::CanScanArgs;
use sidehill::exit::Exit;
use sidehill::simulate::Format;
use sidehill_bridge::drives::{Epoch, LinkState, SendError};
use sidehill_can::canopen::{FoundNode, NetworkScan};
use sidehill_can::cia402::{
    Cia402, NmtState, NodeId, PowerState, device_words, error_words, mode_words, register_words,
};
use sidehill_can::config::CanConfig;
use sidehill_can::eds::Eds;
use sidehill_can::layout::Profile;
use sidehill_can::message::DriveRole;
use sidehill_can_port::{BusEvent, BusMonitor, Sender, bit_rate, bus_fault};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Duration;

/// Longest time of a scan, s: a second for each of the nodes that may be there, and as much to listen.
const LONGEST_S: f64 = 60.0;

/// What was found, as it is printed.
#[derive(Debug, Serialize)]
struct ScanReport {
    interface: String,
    /// bit/s; none for a virtual bus.
    bit_rate: Option<u32>,
    nodes: Vec<NodeRow>,
    /// What is wrong, for a person.
    complaints: Vec<String>,
}

/// A node, as it is printed.
#[derive(Debug, Serialize)]
struct NodeRow {
    node: u8,
    /// What the configuration has it move.
    role: Option<DriveRole>,
    nmt: Option<NmtState>,
    answers: bool,
    device_type: Option<u32>,
    device: Option<String>,
    vendor: Option<u32>,
    product: Option<u32>,
    revision: Option<u32>,
    serial: Option<u32>,
    cia402: bool,
    power: Option<PowerState>,
    mode: Option<i8>,
    error_register: Option<u8>,
    errors: Vec<ErrorRow>,
}

#[derive(Debug, Serialize)]
struct ErrorRow {
    code: u16,
    meaning: &'static str,
}

/// Scans a bus and prints its nodes. The exit status is 0 only if there is a node, and every drive of the configuration.
///
/// # Errors
/// A file that cannot be read, or a bus that carries nothing.
pub(super) fn run(args: &CanScanArgs) -> Result<ExitCode> {
    let configured = args.config.as_deref().map(ConfiguredBus::read);
    let configured = configured.transpose()?;
    let of_file = configured.as_ref().map(|bus| bus.interface.as_str());
    let interface = args.interface.as_deref().or(of_file).unwrap_or_default();
    let sheets = match &configured {
        Some(bus) if !args.eds.is_empty() => DataSheet::read(bus, &args.eds)?,
        _ => Vec::new(),
    };
    // Those of a layout are known without a bus, too.
    let unfit: Vec<String> = sheets
        .iter()
        .flat_map(|sheet| sheet.unfit.clone())
        .collect();
    let scanned = scan(interface).inspect_err(|_| unfit.iter().for_each(console::complain));
    let (found, foreign) = scanned?;
    let cia402 = configured.as_ref().map(|bus| match &bus.layout.profile {
        Profile::Cia402(cia402) => Ok((cia402, [0, 1].map(|i| bus.layout.drives[i].role))),
        Profile::Values(_) => Err(bus.file.name()),
    });
    let mut complaints = Vec::new();
    if found.is_empty() {
        complaints.push(
            "no node was heard and none answers: check power, wiring, termination, and that all have the bit rate of the \
             interface"
                .to_owned(),
        );
    }
    complaints.extend(foreign.map(|id| {
        format!("{id}: another program reads or writes objects at the same time, so values may be mixed up: scan again without it")
    }));
    let fits = unfit.is_empty();
    complaints.extend(unfit);
    complaints.extend(
        sheets
            .iter()
            .filter_map(|sheet| sheet.other_product(&found)),
    );
    let roles = match &cia402 {
        Some(Ok((cia402, roles))) => {
            complaints.extend(complaints_of(cia402, *roles, &found));
            [0, 1].map(|i| Some((cia402.nodes[i], roles[i])))
        }
        Some(Err(file)) => {
            complaints.push(format!("the drives of {file} do not speak CANopen: `sidehill can monitor` shows what they send"));
            [None; 2]
        }
        None => [None; 2],
    };
    let report = ScanReport {
        interface: interface.to_owned(),
        bit_rate: bit_rate(interface),
        nodes: found
            .iter()
            .map(|node| {
                let role = roles.iter().flatten().find(|(id, _)| *id == node.node);
                NodeRow::of(node, role.map(|(_, role)| *role))
            })
            .collect(),
        complaints,
    };
    match args.format {
        Format::Json => console::line(serde_json::to_string(&report)?),
        Format::Table => print(&report),
    }
    let missing = roles
        .iter()
        .flatten()
        .any(|(id, _)| !found.iter().any(|node| node.node == *id && node.answers));
    Ok(Exit::answer(!missing && !found.is_empty() && fits).into())
}

/// What the maker's file says of a drive of the configuration.
struct DataSheet {
    file: String,
    node: NodeId,
    identity: [Option<u32>; 2],
    /// What of the layout does not fit.
    unfit: Vec<String>,
}

impl DataSheet {
    fn read(bus: &ConfiguredBus, paths: &[PathBuf]) -> Result<Vec<Self>> {
        let layout = bus.layout_file()?;
        let config: CanConfig = layout.parse()?;
        let (Profile::Cia402(cia402), Some(drives)) = (&bus.layout.profile, &config.cia402) else {
            bail!(
                "--eds: the drives of {} do not speak CANopen",
                layout.name()
            );
        };
        ensure!(
            paths.len() <= 2,
            "--eds: there are two drives, name at most two files"
        );
        let mut sheets = Vec::new();
        for (i, drive) in drives.drives.iter().enumerate() {
            let file = ConfigFile::read(&paths[i.min(paths.len() - 1)])?;
            let (name, node) = (file.name(), cia402.nodes[i]);
            let eds = Eds::parse(&name, file.text(), node)?;
            let feedback = &bus.layout.drives[i].message;
            let complaints = eds.complaints(drive, &bus.layout.command[i], feedback);
            let role = drive.role.name();
            let unfit = complaints
                .iter()
                .map(|complaint| format!("{role} drive, by {name}: {complaint}"));
            sheets.push(Self {
                unfit: unfit.collect(),
                identity: eds.identity,
                file: name,
                node,
            });
        }
        Ok(sheets)
    }

    /// Returns that the file is of another product than the node, if both say so.
    fn other_product(&self, found: &[FoundNode]) -> Option<String> {
        let found = found.iter().find(|found| found.node == self.node)?;
        let [vendor, product, ..] = found.identity;
        let differs =
            |own: Option<u32>, other: Option<u32>| own.zip(other).is_some_and(|(a, b)| a != b);
        let [of_file, product_of_file] = self.identity;
        (differs(vendor, of_file) || differs(product, product_of_file)).then(|| {
            let hex = |value: Option<u32>| value.map_or("-".to_owned(), |value| format!("{value:#X}"));
            format!(
                "node {} is product {} of vendor {}, and {} is of product {} of vendor {}: take the maker's file of this drive",
                self.node.get(),
                hex(product),
                hex(vendor),
                self.file,
                hex(product_of_file),
                hex(of_file)
            )
        })
    }
}

/// Returns what was found, and the identifier of a request that another program has sent meanwhile.
fn scan(interface: &str) -> Result<(Vec<FoundNode>, Option<String>)> {
    let epoch = Epoch::now();
    let mut scan = NetworkScan::new(epoch.elapsed_s());
    let (news, heard) = mpsc::channel();
    let _monitor = BusMonitor::start(interface, &scan.received_ids(), epoch, move |event| {
        // The scan has ended.
        let _ = news.send(event);
    })?;
    let mut sender = Sender::start(interface, &scan.request_ids())?;
    let (mut bus, mut sent, mut foreign) = (LinkState::Absent, false, None);
    loop {
        let news = heard.recv_timeout(Duration::from_millis(2));
        for event in news.into_iter().chain(heard.try_iter()) {
            match event {
                BusEvent::Frame { time_s, frame } => scan.take(&frame, time_s),
                BusEvent::Bus { state, .. } => bus = state,
                BusEvent::Restart { .. } => {}
            }
        }
        let now_s = epoch.elapsed_s();
        if scan.is_done(now_s) || now_s > LONGEST_S {
            return Ok((scan.found(), foreign));
        }
        if now_s > BUS_KNOWN_S {
            check(bus, sent, interface)?;
        }
        if let Some(frame) = sender.foreign() {
            foreign = Some(frame.id.to_string());
        }
        if let Some(frame) = scan.next(now_s) {
            match sender.send(&frame) {
                // One that is lost is sent again when its answer is late.
                Ok(()) | Err(SendError::QueueFull) => sent = true,
                Err(error) => bail!("{interface}: {error}"),
            }
        }
    }
}

/// Checks that the bus carries frames without errors: a scan with a wrong bit rate would disturb those of others.
fn check(bus: LinkState, sent: bool, interface: &str) -> Result<()> {
    if let Some(fault) = bus_fault(bus, interface) {
        bail!("{interface}: {fault}");
    }
    match (bus, sent) {
        (LinkState::Warning | LinkState::Passive, false) => bail!(
            "{interface}: there are errors on the bus before anything was sent, so nothing is sent: check that the interface \
             has the bit rate of the bus (ip -details link show {interface}), the termination and the wiring"
        ),
        (LinkState::Passive, true) => bail!(
            "{interface}: nobody acknowledges what is sent: check power, wiring and bit rate of the nodes (ip -details link \
             show {interface})"
        ),
        _ => Ok(()),
    }
}

/// Returns what does not fit the configuration.
fn complaints_of(cia402: &Cia402, roles: [DriveRole; 2], found: &[FoundNode]) -> Vec<String> {
    let mut complaints = Vec::new();
    for (id, role) in cia402.nodes.into_iter().zip(roles) {
        let (number, role) = (id.get(), role.name());
        let complaint = match found.iter().find(|node| node.node == id) {
            None => format!(
                "node {number}, the {role} drive of the configuration, is not there: check its power, its number and its bit \
                 rate, or set its node_id"
            ),
            Some(node) if !node.answers => format!(
                "node {number}, the {role} drive of the configuration, sends heartbeats and does not answer: a node that is \
                 stopped does not; `sidehill run` starts it"
            ),
            Some(node) if !node.is_drive => format!(
                "node {number} is the {role} drive of the configuration, but it is no drive of CiA 402: set its node_id"
            ),
            Some(_) => continue,
        };
        complaints.push(complaint);
    }
    let own = cia402.own.get();
    if found.iter().any(|node| node.node == cia402.own) {
        complaints.push(format!(
            "node {own} is there and has the number of this program: end the other controller, or set cia402.node_id"
        ));
    }
    complaints
}

impl NodeRow {
    fn of(found: &FoundNode, role: Option<DriveRole>) -> Self {
        let [vendor, product, revision, serial] = found.identity;
        let meanwhile = found.emergency.map(|emergency| emergency.code);
        let mut codes: Vec<u16> = meanwhile.into_iter().filter(|code| *code != 0).collect();
        codes.extend(found.errors.iter().filter(|code| Some(**code) != meanwhile));
        Self {
            node: found.node.get(),
            role,
            nmt: found.nmt,
            answers: found.answers,
            device_type: found.device_type,
            device: found.device_type.map(device_words),
            vendor,
            product,
            revision,
            serial,
            cia402: found.is_drive,
            power: found.power,
            mode: found.mode,
            error_register: found.error_register,
            errors: codes
                .into_iter()
                .map(|code| ErrorRow {
                    code,
                    meaning: error_words(code),
                })
                .collect(),
        }
    }
}

fn print(report: &ScanReport) {
    console::line(format_args!(
        "{}, {}: {} nodes",
        report.interface,
        report
            .bit_rate
            .map_or("no bit rate".to_owned(), |rate| format!(
                "{} kbit/s",
                f64::from(rate) / 1e3
            )),
        report.nodes.len()
    ));
    if !report.nodes.is_empty() {
        console::line(format_args!(
            "{:>4} {:<9} {:<16} {:<28} {:>10} {:>10} {:>10} {:>10}  {}",
            "node",
            "role",
            "NMT state",
            "device",
            "vendor",
            "product",
            "revision",
            "serial",
            "drive of CiA 402"
        ));
    }
    let hex = |value: Option<u32>| value.map_or("-".to_owned(), |value| format!("{value:#X}"));
    for node in &report.nodes {
        let nmt = match node.nmt {
            Some(nmt) => nmt.to_string(),
            None => "no heartbeat".to_owned(),
        };
        let drive = match (node.cia402, node.power, node.mode) {
            (false, ..) => "no".to_owned(),
            (true, None, _) => "yes".to_owned(),
            (true, Some(power), None) => power.to_string(),
            (true, Some(power), Some(mode)) => format!("{power}, {}", mode_words(mode)),
        };
        console::line(format_args!(
            "{:>4} {:<9} {:<16} {:<28} {:>10} {:>10} {:>10} {:>10}  {drive}",
            node.node,
            node.role.map_or("-", DriveRole::name),
            nmt,
            node.device.as_deref().unwrap_or("does not answer"),
            hex(node.vendor),
            hex(node.product),
            hex(node.revision),
            node.serial
                .map_or("-".to_owned(), |serial| serial.to_string()),
        ));
        if let Some(register) = node.error_register.filter(|register| *register != 0) {
            console::line(format_args!(
                "     error register {register:#04X}: {}",
                register_words(register)
            ));
        }
        for error in &node.errors {
            console::line(format_args!(
                "     error {:#06X}: {}",
                error.code, error.meaning
            ));
        }
    }
    for complaint in &report.complaints {
        console::line(complaint);
    }
}
