use super::*;
use crate::config::CanConfig;
use crate::database::Database;
use crate::layout::Layout;
use proptest::prelude::*;

/// A drive as makers describe one, with the objects that the shipped layout needs.
const EDS: &str = "\
[FileInfo]
FileName=drive.eds
Description=Umrichter f\u{fc}r Motoren
[DeviceInfo]
VendorName=Nobody
VendorNumber=0x2A
ProductNumber=1026
[Comments]
Lines=1
a line of another kind
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x00020192
PDOMapping=0
[1008]
ParameterName=Name
DataType=0x0009
AccessType=const
DefaultValue=Drive 7
[1016]
ParameterName=Consumer heartbeat
ObjectType=0x8
DataType=0x0007
AccessType=rw
CompactSubObj=2
[1016Value]
NrOfEntries=1
1=0x7F0064
[1017]
DataType=0x0006
AccessType=rw
DefaultValue=0
[1400sub1]
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x200
[1401sub1]
DataType=0x0007
AccessType=rw
DefaultValue=0x80000300
[1400sub5]
DataType=0x0006
AccessType=rw
[1600sub0]
DataType=0x0005
AccessType=rw
DefaultValue=2
[1600sub1]
DataType=0x0007
AccessType=rw
DefaultValue=0x60400010
[1600sub2]
DataType=0x0007
AccessType=rw
DefaultValue=0x60FF0020
[1800SUB1]
DataType=0x0007
AccessType=rw
DefaultValue=0x180+$NODEID ; of this node
[1800sub5]
DataType=0x0006
AccessType=rw
LowLimit=10
HighLimit=1000
[1A00sub0]
DataType=0x0005
AccessType=rw
DefaultValue=2
[1A00sub1]
DataType=0x0007
AccessType=rw
DefaultValue=0x60410010
[1A00sub2]
DataType=0x0007
AccessType=rw
DefaultValue=0x606C0020
[6007]
DataType=0x0003
AccessType=rww
LowLimit=0xFFFF
HighLimit=3
[6040]
DataType=0x0006
AccessType=rww
PDOMapping=1
[6041]
DataType=0x0006
AccessType=ro
PDOMapping=1
[605A]
DataType=0x0003
AccessType=rw
[6060]
DataType=0x0002
AccessType=rw
[606C]
DataType=0x0004
AccessType=ro
PDOMapping=1
[60FF]
DataType=0x0004
AccessType=rww
PDOMapping=1
[6502]
DataType=0x0007
AccessType=ro
DefaultValue=0x104
";

fn node() -> NodeId {
    NodeId::new(1).unwrap()
}

/// Returns what is wrong with the first drive of the shipped layout.
fn complaints(eds: &str) -> Vec<String> {
    let yaml = include_str!("../../../../config/bridge/cia402.yaml");
    let dbc = include_str!("../../../../config/bridge/cia402.dbc");
    let config: CanConfig = serde_yaml::from_str(yaml).unwrap();
    let layout = Layout::new(&config, &Database::parse("dbc", dbc).unwrap()).unwrap();
    let drive = &config.cia402.as_ref().unwrap().drives[0];
    let eds = Eds::parse("drive.eds", eds, node()).unwrap();
    eds.complaints(drive, &layout.command[0], &layout.drives[0].message)
}

#[test]
fn a_data_sheet_that_fits_the_layout_has_no_complaint() {
    assert_eq!(complaints(EDS), [""; 0]);
    // Lines of Windows end otherwise.
    assert_eq!(complaints(&EDS.replace('\n', "\r\n")), [""; 0]);
    let eds = Eds::parse("drive.eds", EDS, node()).unwrap();
    assert_eq!(eds.identity, [Some(0x2A), Some(1026)]);
    let value = |index, sub| eds.objects[&(index, sub)].value;
    assert_eq!(
        (value(0x1400, 1), value(0x1800, 1)),
        (Some(0x201), Some(0x181))
    );
    assert_eq!(
        (value(0x1016, 0), value(0x1016, 1)),
        (Some(2), Some(0x7F_0064))
    );
    assert_eq!((value(0x1016, 2), value(0x1008, 0)), (None, None));
    assert_eq!(eds.objects[&(0x6007, 0)].limits, [Some(-1), Some(3)]);
}

#[test]
fn what_the_drive_does_not_allow_is_named_with_its_object() {
    let read_only = "[605A]\nDataType=0x0003\nAccessType=rw";
    for (old, new, expected) in [
        (
            "[1400sub5]",
            "[1400sub6]",
            "object 0x1400:05 of the setup, to be 200, is not there: take it out",
        ),
        (
            read_only,
            "[605A]\nDataType=0x0003\nAccessType=ro",
            "object 0x605A:00 of the setup, to be 2, can only be read",
        ),
        (
            "[1017]\nDataType=0x0006",
            "[1017]\nDataType=0x0007",
            "object 0x1017:00 of the setup, to be 50, has type u32, not u16",
        ),
        (
            "LowLimit=10",
            "LowLimit=30",
            "object 0x1800:05 of the setup, to be 25, is out of the range from 30 to 1000",
        ),
        (
            "DefaultValue=0x104",
            "DefaultValue=0xA1",
            "object 0x6060 is to be mode 3, and object 0x6502 has modes 1, 6, 8",
        ),
        (
            "[606C]",
            "[606D]",
            "object 0x606C, actual velocity, is not there",
        ),
        (
            "$NODEID+0x200",
            "$NODEID+0x300",
            "no RPDO has the identifier 201 of message TractionRpdo1, they have 301",
        ),
        (
            "DefaultValue=0x60410010",
            "DefaultValue=0x60610008",
            "TPDO 0x1A00 does not map 0x6041, statusword",
        ),
        (
            "DefaultValue=0x60400010",
            "DefaultValue=0x60400008",
            "RPDO 0x1600 has 0x6040, controlword, from bit 0 on, 8 bits, little endian; the signal of message TractionRpdo1 begins \
             at bit 0, 16 bits",
        ),
    ] {
        let eds = EDS.replacen(old, new, 1);
        assert_ne!(eds, EDS);
        let said = complaints(&eds);
        assert!(
            said.iter().any(|said| said.starts_with(expected)),
            "{expected}: {said:?}"
        );
    }
    let unmapped = EDS.replacen("PDOMapping=1", "PDOMapping=0", 1);
    assert_eq!(
        complaints(&unmapped),
        ["object 0x6040, controlword, cannot be mapped to a PDO"]
    );
}

#[test]
fn the_values_of_a_dcf_count_before_the_defaults() {
    let dcf = EDS.replace(
        "DefaultValue=$NODEID+0x200",
        "DefaultValue=$NODEID+0x200\nParameterValue=0x222",
    );
    let said = complaints(&dcf);
    assert!(said[0].contains("they have 222"), "{said:?}");
    // An empty one does not.
    let dcf = EDS.replace(
        "DefaultValue=$NODEID+0x200",
        "DefaultValue=$NODEID+0x200\nParameterValue=",
    );
    assert_eq!(complaints(&dcf), [""; 0]);
}

#[test]
fn a_file_that_is_no_data_sheet_is_named_with_its_line() {
    let said = |text: &str| Eds::parse("a.eds", text, node()).unwrap_err().to_string();
    assert!(said("").starts_with("a.eds: has no section of an object, as [6040] is"));
    assert!(said("VERSION \"\"\nBO_ 256 DriveCommand: 8 X\n").starts_with("a.eds: has no section"));
    let no_key = said("[6040]\nDataType 0x6\n");
    assert!(
        no_key.starts_with("a.eds: line 2: `DataType 0x6` is no `key=value`"),
        "{no_key}"
    );
    let huge = said("[6040]\nDataType=6\nDefaultValue=9223372036854775807+1\n");
    assert!(huge.contains("is no number"), "{huge}");
    let no_number = said("[6040]\nDataType=6\nDefaultValue=0xZZ\n");
    assert!(
        no_number.starts_with("a.eds: line 3: DefaultValue: `0xZZ` is no number"),
        "{no_number}"
    );
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in "(\\[[0-9A-Fa-f]{4}(sub[0-9A-F]{1,3})?\\]|[A-Za-z]{1,15}=[-+$0-9A-Fa-fxX]{0,20}|CompactSubObj=[0-9]{1,20}|.{0,20})(\n.{0,40}){0,5}") {
        let _ = Eds::parse("a.eds", &text, node());
        let _ = Eds::parse("a.eds", &format!("{EDS}{text}"), node()).map(|eds| eds.objects.len());
    }
}
