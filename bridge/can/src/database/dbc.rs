//! The parts of a DBC file that say where signals are: `BO_`, `SG_`, `SIG_VALTYPE_` and `SG_MUL_VAL_`. All other
//! sections are skipped, but must be sections.

/// Messages of a file, in its order.
#[derive(Debug, Clone, Default)]
pub(super) struct Dbc {
    pub(super) messages: Vec<DbcMessage>,
    /// Identifiers of messages with extended multiplexing.
    pub(super) extended_multiplexing: Vec<u64>,
}

#[derive(Debug, Clone)]
pub(super) struct DbcMessage {
    /// Identifier; bit 31 marks one of 29 bits.
    pub(super) id: u64,
    pub(super) name: String,
    pub(super) bytes: u64,
    pub(super) signals: Vec<DbcSignal>,
}

#[derive(Debug, Clone)]
pub(super) struct DbcSignal {
    pub(super) name: String,
    pub(super) multiplexing: Multiplexing,
    pub(super) start_bit: u64,
    pub(super) bits: u64,
    pub(super) is_intel: bool,
    pub(super) is_signed: bool,
    /// Bits of a floating-point number; none for whole numbers.
    pub(super) float: Option<u64>,
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) limits: [f64; 2],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Multiplexing {
    Plain,
    Switch,
    Page(u64),
    /// A switch that another one switches.
    PagedSwitch,
}

/// Sections that end with a semicolon.
const SKIPPED: [&str; 25] = [
    "VAL_TABLE_",
    "BO_TX_BU_",
    "EV_",
    "EV_DATA_",
    "ENVVAR_DATA_",
    "SGTYPE_",
    "SGTYPE_VAL_",
    "SIG_TYPE_REF_",
    "SIGTYPE_VALTYPE_",
    "SIG_GROUP_",
    "CM_",
    "CAT_DEF_",
    "CAT_",
    "FILTER",
    "BA_DEF_",
    "BA_DEF_DEF_",
    "BA_DEF_REL_",
    "BA_DEF_DEF_REL_",
    "BA_DEF_SGTYPE_",
    "BA_",
    "BA_REL_",
    "BA_SGTYPE_",
    "VAL_",
    "BU_SG_REL_",
    "NS_DESC_",
];
impl Dbc {
    /// Reads a file.
    ///
    /// # Errors
    /// The line, and what is wrong with it.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let tokens = tokens(text)?;
        let mut reader = Reader {
            tokens: &tokens,
            at: 0,
        };
        let mut dbc = Self::default();
        while let Some(token) = reader.take() {
            if !token.begins_line {
                return Err(token.fault("is not expected here"));
            }
            match token.text {
                "VERSION" => {
                    reader.string()?;
                }
                "NS_" | "BU_" => reader.names()?,
                "BS_" => reader.rest_of_line(),
                "BO_" => dbc.messages.push(reader.message()?),
                "SG_" => {
                    let signal = reader.signal()?;
                    let message = dbc.messages.last_mut();
                    let message = message.ok_or_else(|| token.fault("belongs to no message"))?;
                    message.signals.push(signal);
                }
                "SIG_VALTYPE_" => {
                    let (id, name) = (reader.whole("an identifier")?, reader.name()?);
                    reader.skip(":");
                    let float = match reader.whole("a type")? {
                        0 => None,
                        1 => Some(32),
                        2 => Some(64),
                        _ => return Err(token.fault("has a type other than 0, 1 or 2")),
                    };
                    reader.sign(";")?;
                    let messages = dbc.messages.iter_mut().filter(|message| message.id == id);
                    let signals = messages.flat_map(|message| &mut message.signals);
                    for signal in signals.filter(|signal| signal.name == name) {
                        signal.float = float;
                    }
                }
                "SG_MUL_VAL_" => {
                    dbc.extended_multiplexing
                        .push(reader.whole("an identifier")?);
                    reader.skip_section(token)?;
                }
                section if SKIPPED.contains(&section) => reader.skip_section(token)?,
                _ => return Err(token.fault("is no section of a DBC file")),
            }
        }
        Ok(dbc)
    }
}

/// A word, a sign or a quoted text.
#[derive(Clone, Copy)]
struct Token<'a> {
    text: &'a str,
    quoted: bool,
    line: usize,
    begins_line: bool,
}

impl Token<'_> {
    fn fault(&self, what: &str) -> String {
        let short: String = self.text.chars().take(40).collect();
        format!("line {}: `{short}` {what}", self.line)
    }
}

/// Returns the tokens of a text.
fn tokens(text: &str) -> Result<Vec<Token<'_>>, String> {
    let mut found = Vec::new();
    let (mut rest, mut line, mut begins_line) = (text.trim_start_matches('\u{feff}'), 1, true);
    while let Some(first) = rest.chars().next() {
        if first == '\n' {
            (line, begins_line) = (line + 1, true);
        }
        if first.is_whitespace() {
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let mut token = Token {
            text: "",
            quoted: first == '"',
            line,
            begins_line,
        };
        if token.quoted {
            let end = end_of_string(&rest[1..]);
            let end = end.ok_or_else(|| format!("line {line}: a text has no closing quote"))?;
            token.text = &rest[1..=end];
            line += token.text.matches('\n').count();
            rest = &rest[end + 2..];
        } else {
            let is_sign = |letter: char| ":;,|@()[]".contains(letter);
            let ends = |letter: char| letter.is_whitespace() || letter == '"' || is_sign(letter);
            let length = if is_sign(first) {
                first.len_utf8()
            } else {
                rest.find(ends).unwrap_or(rest.len())
            };
            (token.text, rest) = rest.split_at(length);
        }
        begins_line = false;
        found.push(token);
    }
    Ok(found)
}

/// Returns where a text ends whose opening quote has been read.
fn end_of_string(text: &str) -> Option<usize> {
    let mut escaped = false;
    for (place, byte) in text.bytes().enumerate() {
        if byte == b'"' && !escaped {
            return Some(place);
        }
        escaped = byte == b'\\' && !escaped;
    }
    None
}

struct Reader<'a> {
    tokens: &'a [Token<'a>],
    at: usize,
}

impl<'a> Reader<'a> {
    fn peek(&self) -> Option<Token<'a>> {
        self.tokens.get(self.at).copied()
    }

    fn take(&mut self) -> Option<Token<'a>> {
        let token = self.peek();
        self.at += 1;
        token
    }

    fn need(&mut self, what: &str) -> Result<Token<'a>, String> {
        let last = self.tokens.last().map_or(1, |token| token.line);
        let end = || format!("line {last}: the file ends where {what} must be");
        self.take().ok_or_else(end)
    }

    /// Takes a sign if it is the next token.
    fn skip(&mut self, sign: &str) -> bool {
        let is_next = self
            .peek()
            .is_some_and(|token| token.text == sign && !token.quoted);
        self.at += usize::from(is_next);
        is_next
    }

    fn sign(&mut self, sign: &str) -> Result<(), String> {
        if self.skip(sign) {
            return Ok(());
        }
        let token = self.need(sign)?;
        Err(token.fault(&format!("stands where `{sign}` must be")))
    }

    fn string(&mut self) -> Result<&'a str, String> {
        let token = self.need("a text")?;
        let fault = || token.fault("stands where a text in quotes must be");
        token.quoted.then_some(token.text).ok_or_else(fault)
    }

    fn name(&mut self) -> Result<&'a str, String> {
        let token = self.need("a name")?;
        let fault = || token.fault("stands where a name must be");
        is_name(&token).then_some(token.text).ok_or_else(fault)
    }

    fn whole(&mut self, what: &str) -> Result<u64, String> {
        let token = self.need(what)?;
        let fault = |_| token.fault(&format!("stands where {what} must be"));
        token.text.parse().map_err(fault)
    }

    fn number(&mut self) -> Result<f64, String> {
        let token = self.need("a number")?;
        let fault = |_| token.fault("stands where a number must be");
        token.text.parse().map_err(fault)
    }

    fn rest_of_line(&mut self) {
        while self.peek().is_some_and(|token| !token.begins_line) {
            self.at += 1;
        }
    }

    fn skip_section(&mut self, section: Token<'_>) -> Result<(), String> {
        while let Some(token) = self.take() {
            if token.text == ";" && !token.quoted {
                return Ok(());
            }
            if token.begins_line && ["BO_", "SG_"].contains(&token.text) && !token.quoted {
                break;
            }
        }
        Err(section.fault("has no closing semicolon"))
    }

    /// The names after NS_ or BU_: the rest of the line, and lines of names only.
    fn names(&mut self) -> Result<(), String> {
        self.sign(":")?;
        while let Some(token) = self.peek() {
            if token.begins_line {
                let others = &self.tokens[self.at + 1..];
                let line = others.iter().take_while(|other| !other.begins_line);
                if !is_name(&token) || !line.into_iter().all(is_name) {
                    break;
                }
            }
            self.name()?;
        }
        Ok(())
    }

    fn message(&mut self) -> Result<DbcMessage, String> {
        let (id, name) = (self.whole("an identifier")?, self.name()?);
        self.sign(":")?;
        let bytes = self.whole("a number of bytes")?;
        self.name()?;
        Ok(DbcMessage {
            id,
            name: name.to_owned(),
            bytes,
            signals: Vec::new(),
        })
    }

    fn signal(&mut self) -> Result<DbcSignal, String> {
        let name = self.name()?.to_owned();
        let multiplexing = if self.skip(":") {
            Multiplexing::Plain
        } else {
            let token = self.need("`:`")?;
            self.sign(":")?;
            multiplexing(token.text).ok_or_else(|| token.fault("is no multiplexing"))?
        };
        let start_bit = self.whole("a bit")?;
        self.sign("|")?;
        let bits = self.whole("a number of bits")?;
        self.sign("@")?;
        let token = self.need("an order of bytes and a sign")?;
        let (is_intel, is_signed) = match token.text {
            "0+" => (false, false),
            "0-" => (false, true),
            "1+" => (true, false),
            "1-" => (true, true),
            _ => return Err(token.fault("stands where `0+`, `0-`, `1+` or `1-` must be")),
        };
        self.sign("(")?;
        let scale = self.number()?;
        self.sign(",")?;
        let offset = self.number()?;
        self.sign(")")?;
        self.sign("[")?;
        let least = self.number()?;
        self.sign("|")?;
        let limits = [least, self.number()?];
        self.sign("]")?;
        self.string()?;
        // Receivers, between which a comma or nothing stands.
        while self.peek().is_some_and(|token| !token.begins_line) {
            self.name()?;
            if self.skip(",") && self.peek().is_some_and(|token| token.begins_line) {
                self.name()?;
            }
        }
        Ok(DbcSignal {
            name,
            multiplexing,
            start_bit,
            bits,
            is_intel,
            is_signed,
            float: None,
            scale,
            offset,
            limits,
        })
    }
}

fn is_name(token: &Token<'_>) -> bool {
    let letter = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'_';
    let begins = |letter: &u8| !letter.is_ascii_digit();
    !token.quoted
        && token.text.bytes().all(letter)
        && token.text.as_bytes().first().is_some_and(begins)
}

fn multiplexing(text: &str) -> Option<Multiplexing> {
    if text == "M" {
        return Some(Multiplexing::Switch);
    }
    let page = text.strip_prefix('m')?;
    let number = page.strip_suffix('M').unwrap_or(page).parse().ok()?;
    Some(if page.ends_with('M') {
        Multiplexing::PagedSwitch
    } else {
        Multiplexing::Page(number)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use can_dbc::{
        ByteOrder, MessageId, MultiplexIndicator, NumericValue, SignalExtendedValueType, ValueType,
    };
    use proptest::prelude::*;

    const FILES: [&str; 3] = [
        include_str!("../../../../config/bridge/j8.dbc"),
        include_str!("../../../../config/bridge/cia402.dbc"),
        include_str!("../../tests/data/codec.dbc"),
    ];

    /// Asserts that another parser finds the same in a file.
    fn check(text: &str) {
        let (own, other) = (
            Dbc::parse(text).unwrap(),
            can_dbc::Dbc::try_from(text).unwrap(),
        );
        assert_eq!(own.messages.len(), other.messages.len());
        for (own, message) in own.messages.iter().zip(&other.messages) {
            let id = match message.id {
                MessageId::Standard(id) => u64::from(id),
                MessageId::Extended(id) => 1 << 31 | u64::from(id),
            };
            assert_eq!(
                (own.id, &own.name, own.bytes),
                (id, &message.name, message.size)
            );
            assert_eq!(own.signals.len(), message.signals.len(), "{}", own.name);
            for (own, signal) in own.signals.iter().zip(&message.signals) {
                let multiplexing = match signal.multiplexer_indicator {
                    MultiplexIndicator::Plain => Multiplexing::Plain,
                    MultiplexIndicator::Multiplexor => Multiplexing::Switch,
                    MultiplexIndicator::MultiplexedSignal(page) => Multiplexing::Page(page),
                    MultiplexIndicator::MultiplexorAndMultiplexedSignal(_) => {
                        Multiplexing::PagedSwitch
                    }
                };
                assert_eq!((&own.name, own.multiplexing), (&signal.name, multiplexing));
                assert_eq!([own.start_bit, own.bits], [signal.start_bit, signal.size]);
                assert_eq!(own.is_intel, signal.byte_order == ByteOrder::LittleEndian);
                assert_eq!(own.is_signed, signal.value_type == ValueType::Signed);
                let float = match other.extended_value_type_for_signal(message.id, &signal.name) {
                    Some(SignalExtendedValueType::IEEEfloat32Bit) => Some(32),
                    Some(SignalExtendedValueType::IEEEdouble64bit) => Some(64),
                    _ => None,
                };
                assert_eq!(own.float, float);
                let limits = [&signal.min, &signal.max].map(|value| match *value {
                    NumericValue::Uint(value) => value as f64,
                    NumericValue::Int(value) => value as f64,
                    NumericValue::Double(value) => value,
                });
                let numbers = (own.scale, own.offset, own.limits);
                assert_eq!(
                    numbers,
                    (signal.factor, signal.offset, limits),
                    "{}",
                    own.name
                );
            }
        }
        let extended = other
            .extended_multiplex
            .iter()
            .map(|mapping| match mapping.message_id {
                MessageId::Standard(id) => u64::from(id),
                MessageId::Extended(id) => 1 << 31 | u64::from(id),
            });
        assert_eq!(own.extended_multiplexing, extended.collect::<Vec<_>>());
    }

    #[test]
    fn another_parser_finds_the_same() {
        for text in FILES {
            check(text);
        }
        check(
            "VERSION \"\"\nNS_ :\n\tNS_DESC_\n\tCM_\n\tSG_MUL_VAL_\nBS_:\nBU_: A B\n\n\
             BO_ 2364540158 EEC1: 8 A\n SG_ Page M : 0|8@1+ (1,0) [0|0] \"\" B\n \
             SG_ Speed m3 : 24|16@1+ (0.125,-1.5E+2) [0|8031.875] \"rpm\" B,A\n \
             SG_ Sub m1M : 40|4@0- (1,0) [-8|7] \"\" Vector__XXX\n\nCM_ SG_ 2364540158 Speed \"of the engine;\n\
             BO_ 7 of old\";\nBA_DEF_ BO_ \"Rate\" INT 0 10;\nVAL_ 2364540158 Page 0 \"a;\" 1 \"b\" ;\n\
             SIG_VALTYPE_ 2364540158 Speed : 1;\nSG_MUL_VAL_ 2364540158 Sub Page 1-1;\n",
        );
    }

    proptest! {
        #[test]
        fn numbers_are_those_of_the_file(
            id in prop_oneof![0_u64..2048, (1_u64 << 31)..(1 << 31 | 0x1FFF_FFFF)],
            (start, bits) in (0_u64..512, 1_u64..65),
            order in "[01][+-]",
            (scale, offset, low, high) in (any::<i32>(), -1e9..1e9_f64, any::<i32>(), -1e3..1e3_f64),
        ) {
            let text = format!(
                "BU_: A\n\nBO_ {id} M: 8 A\n SG_ S : {start}|{bits}@{order} ({scale},{offset:e}) [{low}|{high}] \"\" A\n"
            );
            let dbc = Dbc::parse(&text).unwrap();
            let signal = &dbc.messages[0].signals[0];
            prop_assert_eq!([dbc.messages[0].id, signal.start_bit, signal.bits], [id, start, bits]);
            prop_assert_eq!([signal.scale, signal.offset], [f64::from(scale), offset]);
            prop_assert_eq!(signal.limits, [f64::from(low), high]);
            prop_assert_eq!([signal.is_intel, signal.is_signed], [order.starts_with('1'), order.ends_with('-')]);
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, says) in [
            ("B0_ 256 M: 8 A\n", "line 1: `B0_` is no section"),
            (
                "BU_: A\n\nBO_ 1 M: 8 A\n SG_ S : 0|8@1+ (1 0) [0|0] \"\" A\n",
                "line 4: `0` stands where `,`",
            ),
            (
                "BO_ 1 M: 8 A\n SG_ S : 0|8@2+ (1,0) [0|0] \"\" A\n",
                "line 2: `2+` stands where",
            ),
            ("BO_ 1 M: 8 A\nB0_ 2 N: 8 A\n", "line 2: `B0_`"),
            (
                "CM_ \"a\"\nBO_ 1 M: 8 A\n",
                "line 1: `CM_` has no closing semicolon",
            ),
            (
                "BU_: A\nCM_ \"a;\nBO_ 1 M: 8 A\n",
                "line 2: a text has no closing quote",
            ),
            (
                "SG_ S : 0|8@1+ (1,0) [0|0] \"\" A\n",
                "line 1: `SG_` belongs to no message",
            ),
            ("BO_ 1 M: 8", "line 1: the file ends where a name"),
        ] {
            let error = Dbc::parse(text).unwrap_err();
            assert!(error.starts_with(says), "{text}: {error}");
        }
    }
}
