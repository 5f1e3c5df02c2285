//! What is wrong with a layout of CiA 402 is named.

use super::*;

#[test]
fn what_is_wrong_with_a_layout_is_named() {
    let wrong = |old: &str, new: &str| {
        assert!(YAML.contains(old), "{old}");
        layout_of(&YAML.replacen(old, new, 1))
            .err()
            .unwrap()
            .to_string()
    };
    for (old, new, expected) in [
        (
            "node_id: 2",
            "node_id: 1",
            "node_id 1 is out of range (from 1 to 127) or given twice",
        ),
        ("node_id: 2", "node_id: 127", "node_id 127"),
        ("node_id: 1 ", "node_id: 128 ", "node_id 128"),
        ("role: steer", "role: right", "the roles must be"),
        (
            "value: 3}",
            "value: 300}",
            "object 0x6060:00: 300 does not fit",
        ),
        (
            "statusword: Statusword",
            "statusword: VelocityActual",
            "overlap",
        ),
        (
            "quick_stop_time_s: 1.0",
            "quick_stop_time_s: .nan",
            "cia402.quick_stop_time_s: NaN is out of range",
        ),
        (
            "answer_time_s: 0.5",
            "answer_time_s: 0",
            "cia402.answer_time_s: 0",
        ),
        (
            "controlword: Controlword",
            "controlword: Control",
            "cia402.dbc: message TractionRpdo1 has no signal Control",
        ),
        (
            "message: SteerTpdo1",
            "message: TractionTpdo1",
            "one and the same",
        ),
    ] {
        let error = wrong(old, new);
        assert!(error.contains(expected), "{error}");
    }
    let config: CanConfig = serde_yaml::from_str(YAML).unwrap();
    for (old, new, expected) in [
        (
            "BO_ 513 ",
            "BO_ 129 ",
            "identifier 081 belongs to a service",
        ),
        (
            "BO_ 386 ",
            "BO_ 1794 ",
            "identifier 702 belongs to a service",
        ),
        (
            "Controlword : 0|16@1+ (1,0)",
            "Controlword : 0|16@1+ (2,0)",
            "Controlword must be unsigned with 16 bits",
        ),
        (
            "Statusword : 0|16@1+",
            "Statusword : 0|15@1+",
            "Statusword must be unsigned with 16 bits",
        ),
    ] {
        assert!(DBC.contains(old), "{old}");
        let database = Database::parse("cia402.dbc", &DBC.replacen(old, new, 1)).unwrap();
        let error = Layout::new(&config, &database).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let both = YAML.replace(
        "cia402:\n",
        "command: [{message: TractionRpdo1}]\ncia402:\n",
    );
    assert_eq!(layout_of(&both).err(), Some(LayoutError::Profile));
}
