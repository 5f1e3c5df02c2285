//! What numbers of CiA 301 and CiA 402 mean, in words.

/// Error codes of CiA 301 and CiA 402 that drives send, those of a class ending in zeros.
const ERRORS: [(u16, &str); 60] = [
    (0x1000, "generic error"),
    (0x2000, "current"),
    (0x2100, "current on the input side"),
    (0x2200, "current inside the device"),
    (0x2300, "current on the output side"),
    (0x2310, "continuous over-current"),
    (0x2320, "short circuit or earth leakage"),
    (0x2330, "earth leakage"),
    (0x2340, "short circuit between phases"),
    (0x3000, "voltage"),
    (0x3100, "mains voltage"),
    (0x3110, "mains over-voltage"),
    (0x3120, "mains under-voltage"),
    (0x3130, "phase of the mains missing"),
    (0x3200, "voltage inside the device"),
    (0x3210, "DC link over-voltage"),
    (0x3220, "DC link under-voltage"),
    (0x3300, "output voltage"),
    (0x4000, "temperature"),
    (0x4100, "ambient temperature"),
    (0x4200, "temperature of the device"),
    (0x4210, "device too hot"),
    (0x4220, "device too cold"),
    (0x4300, "temperature of the motor"),
    (0x4310, "motor too hot"),
    (0x4320, "motor too cold"),
    (0x5000, "hardware of the device"),
    (0x5100, "supply of the electronics"),
    (0x5200, "control hardware"),
    (0x5300, "operating unit"),
    (0x5400, "power section"),
    (0x5500, "memory"),
    (0x6000, "software of the device"),
    (0x6010, "software reset by its watchdog"),
    (0x6100, "internal software"),
    (0x6200, "user software"),
    (0x6300, "parameters"),
    (0x7000, "additional module"),
    (0x7100, "power module"),
    (0x7110, "brake chopper"),
    (0x7120, "motor"),
    (0x7121, "motor blocked"),
    (0x7122, "motor or its commutation"),
    (0x7300, "sensor"),
    (0x7305, "encoder"),
    (0x7310, "speed sensor"),
    (0x7320, "position sensor"),
    (0x8000, "monitoring"),
    (0x8100, "communication"),
    (0x8110, "CAN messages lost"),
    (0x8120, "CAN error-passive"),
    (0x8130, "heartbeat or life guarding lost"),
    (0x8140, "recovered from bus-off"),
    (0x8150, "identifier used by another node"),
    (0x8210, "PDO too short"),
    (0x8250, "commands missing (RPDO time-out)"),
    (0x8300, "torque control"),
    (0x8400, "speed control"),
    (0x8500, "position control"),
    (0x8611, "following error"),
];

/// Returns what an error code means: its own words, or those of its class.
pub fn error_words(code: u16) -> &'static str {
    if code == 0 {
        return "no error";
    }
    let of = |code| ERRORS.iter().find(|(listed, _)| *listed == code);
    [code, code & 0xFFF0, code & 0xFF00, code & 0xF000]
        .into_iter()
        .find_map(of)
        .map_or(
            match code & 0xF000 {
                0x9000 => "external error",
                _ => "of its maker's own, see its manual",
            },
            |(_, words)| words,
        )
}

/// Returns what the bits of an error register (object 0x1001) mean.
pub fn register_words(register: u8) -> String {
    const BITS: [&str; 8] = [
        "generic",
        "current",
        "voltage",
        "temperature",
        "communication",
        "profile",
        "reserved",
        "maker's own",
    ];
    let set: Vec<&str> = (0..8)
        .filter(|bit| register >> bit & 1 == 1)
        .map(|bit| BITS[bit])
        .collect();
    match set.is_empty() {
        true => "no error".to_owned(),
        false => set.join(", "),
    }
}

/// Profile of a drive.
pub(crate) const PROFILE_402: u32 = 402;

/// Returns what a device type (object 0x1000) means.
pub fn device_words(device: u32) -> String {
    let profile = device & 0xFFFF;
    let name = match (profile, device >> 16 & 0xFF) {
        (0, _) => return "no standard profile".to_owned(),
        (401, _) => "inputs and outputs",
        (404, _) => "measuring device",
        (405, _) => "programmable controller",
        (406, _) => "encoder",
        (408, _) => "hydraulic drive",
        (410, _) => "inclinometer",
        (418, _) => "battery",
        (419, _) => "battery charger",
        (PROFILE_402, 0x01) => "frequency converter",
        (PROFILE_402, 0x02) => "servo drive",
        (PROFILE_402, 0x04) => "stepper drive",
        (PROFILE_402, _) => "drive",
        _ => "device",
    };
    format!("{name} (CiA {profile})")
}

/// Returns what a mode of operation (objects 0x6060 and 0x6061) means.
pub fn mode_words(mode: i8) -> &'static str {
    match mode {
        0 => "no mode",
        1 => "profile position",
        2 => "velocity",
        3 => "profile velocity",
        4 => "profile torque",
        6 => "homing",
        7 => "interpolated position",
        8 => "cyclic synchronous position",
        9 => "cyclic synchronous velocity",
        10 => "cyclic synchronous torque",
        ..0 => "a mode of its maker's own",
        _ => "reserved mode",
    }
}

/// Returns what the bits of a statusword beside the state say, where it is worth saying.
pub fn statusword_notes(statusword: u16) -> Vec<&'static str> {
    let bit = |number: u32| statusword >> number & 1 == 1;
    let mut notes = Vec::new();
    if bit(7) {
        notes.push("warning");
    }
    if !bit(9) {
        notes.push("not remote: it takes no commands by CAN");
    }
    if bit(11) {
        notes.push("at an internal limit");
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_named_by_its_code_or_its_class() {
        assert_eq!(error_words(0), "no error");
        assert_eq!(error_words(0x3210), "DC link over-voltage");
        assert_eq!(error_words(0x2311), "continuous over-current");
        assert_eq!(error_words(0x32FF), "voltage inside the device");
        assert_eq!(error_words(0x8FFF), "monitoring");
        assert_eq!(error_words(0x9001), "external error");
        assert_eq!(error_words(0xFF03), "of its maker's own, see its manual");
        // In order and without doubles, so that the table can be checked by eye.
        assert!(ERRORS.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }

    #[test]
    fn registers_devices_and_statuswords_have_words() {
        assert_eq!(register_words(0), "no error");
        assert_eq!(register_words(0x15), "generic, voltage, communication");
        assert_eq!(device_words(0x0002_0192), "servo drive (CiA 402)");
        assert_eq!(device_words(0x0001_0191), "inputs and outputs (CiA 401)");
        assert_eq!(device_words(0), "no standard profile");
        assert_eq!(statusword_notes(0x0237), [""; 0]);
        let notes = ["warning", "not remote: it takes no commands by CAN"];
        assert_eq!(statusword_notes(0x00B7), notes);
    }
}
