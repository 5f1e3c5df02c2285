//! Words and objects are coded as the standards have them.

use super::*;

#[test]
fn statuswords_are_told_apart_as_cia_402_tells_them() {
    use PowerState::*;
    // The table of the profile: mask, value, state. Whatever is in the other bits changes nothing.
    let table = [
        (0x4F, 0x00, NotReadyToSwitchOn),
        (0x4F, 0x40, SwitchOnDisabled),
        (0x6F, 0x21, ReadyToSwitchOn),
        (0x6F, 0x23, SwitchedOn),
        (0x6F, 0x27, OperationEnabled),
        (0x6F, 0x07, QuickStopActive),
        (0x4F, 0x0F, FaultReactionActive),
        (0x4F, 0x08, Fault),
    ];
    let mut legal = 0_u32;
    for word in 0..=u16::MAX {
        let rows: Vec<_> = table
            .iter()
            .filter(|(mask, value, _)| word & mask == *value)
            .collect();
        assert!(rows.len() <= 1, "{word:#06X}");
        let expected = rows.first().map(|(_, _, state)| *state);
        assert_eq!(PowerState::of(word), expected, "{word:#06X}");
        legal += u32::from(expected.is_some());
    }
    // Four rows leave bit 5 free: of the 64 patterns of six bits, 12 are legal.
    assert_eq!(legal, 12 * 1024);
}

#[test]
fn objects_are_written_as_cia_301_has_it() {
    let node = NodeId::new(0x22).unwrap();
    let request = |object, sub, kind, value| {
        let object = ObjectValue {
            object,
            sub,
            kind,
            value,
        };
        object.write(node).map(|request| request.frame.to_string())
    };
    for (object, sub, kind, value, frame) in [
        (0x6060, 0, ObjectType::I8, 3, "622#2F60600003000000"),
        (0x6007, 0, ObjectType::I16, -2, "622#2B076000FEFF0000"),
        (
            0x1016,
            1,
            ObjectType::U32,
            0x7F_00C8,
            "622#23161001C8007F00",
        ),
        (0x60FF, 0, ObjectType::I32, -1, "622#23FF6000FFFFFFFF"),
        (0x1017, 0, ObjectType::U16, 0xFFFF, "622#2B171000FFFF0000"),
    ] {
        assert_eq!(request(object, sub, kind, value).unwrap(), frame);
    }
    for (kind, value) in [
        (ObjectType::U8, 256),
        (ObjectType::U8, -1),
        (ObjectType::I8, 128),
        (ObjectType::I16, -32_769),
        (ObjectType::U32, 1 << 32),
        (ObjectType::I32, i64::MIN),
    ] {
        assert_eq!(request(0x6060, 0, kind, value), None);
    }
}

/// Frames written by hand from CiA 301.
#[test]
fn answers_are_read_as_cia_301_has_them() {
    let node = NodeId::new(1).unwrap();
    let mut reading = NodeReading::default();
    for (kind, bits) in [
        (0x60, Some(Ok(None))),
        (0x80, Some(Err(0x0403_0201))),
        (0x43, Some(Ok(Some(0x0403_0201)))),
        (0x42, Some(Ok(Some(0x0403_0201)))),
        (0x47, Some(Ok(Some(0x03_0201)))),
        (0x4B, Some(Ok(Some(0x0201)))),
        (0x4F, Some(Ok(Some(0x01)))),
        // The begin of segments, and a segment.
        (0x41, None),
        (0x00, None),
    ] {
        let before = reading.answers.count();
        let data = [kind, 0x07, 0x60, 0x00, 0x01, 0x02, 0x03, 0x04];
        let frame = Frame::new(node.answer(), &data).unwrap();
        reading.take(node, &frame, 0.0).unwrap();
        let answer = reading.answers.since(before).next();
        assert_eq!(answer.map(|answer| answer.result), bits, "{kind:#04X}");
        assert!(answer.is_none_or(|answer| (answer.object, answer.sub) == (0x6007, 0)));
    }
    let request = SdoRequest::read(node, 0x1016, 1, 0).frame;
    assert_eq!(request.to_string(), "601#4016100100000000");
}
