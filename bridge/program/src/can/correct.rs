use anyhow::{Result, bail};
use serde_json::Value;
use sidehill::config::ConfigFile;
use sidehill_can::commissioning::Correction;

/// Returns the text of a layout with corrected scales. All else stays as it is, comments included: of all places that may
/// be meant, the one is taken that changes this value and no other.
///
/// # Errors
/// Names the key that is not written in the file, or that several share.
pub(super) fn corrected(file: &ConfigFile, corrections: &[Correction]) -> Result<String> {
    let mut text = file.text().to_owned();
    for Correction { key, to, .. } in corrections {
        let read = |text: &str| {
            let file = ConfigFile::with_text(file.path(), text.to_owned());
            file.parse::<Value>()
        };
        let mut wanted = read(&text)?;
        let written = wanted.pointer_mut(&pointer(key));
        let is_written = written.is_some();
        if let Some(value) = written {
            *value = Value::from(*to);
        }
        let candidates = text.match_indices(KEY).map(|(at, _)| {
            let from = at + KEY.len();
            let from = from + text[from..].len() - text[from..].trim_start_matches(' ').len();
            let length = text[from..].find(|letter| ",} #\r\n".contains(letter));
            let end = length.map_or(text.len(), |length| from + length);
            format!("{}{to:?}{}", &text[..from], &text[end..])
        });
        let mut right = candidates.filter(|text| read(text).is_ok_and(|value| value == wanted));
        let Some(changed) = right.next().filter(|_| is_written) else {
            bail!(
                "{}: {key}: is not written there by itself, so nothing is changed: set it to {to} by hand",
                file.name()
            );
        };
        text = changed;
    }
    Ok(text)
}

/// Key of all that is corrected.
const KEY: &str = "per_unit:";

/// Returns keys as a JSON pointer.
fn pointer(keys: &str) -> String {
    let keys = keys.replace('[', ".").replace(']', "");
    format!("/{}", keys.replace('.', "/"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn correction(key: &str, to: f64) -> Correction {
        Correction {
            key: key.to_owned(),
            from: 940.0,
            to,
        }
    }

    fn cia402(text: &str) -> ConfigFile {
        ConfigFile::with_text(Path::new("cia402.yaml"), text.to_owned())
    }

    const TEXT: &str = include_str!("../../../../config/bridge/cia402.yaml");

    #[test]
    fn one_value_changes_and_all_else_stays() {
        let corrections = [
            correction("cia402.drives[1].feedback.actual_velocity.per_unit", -940.0),
            correction("cia402.drives[0].command.target_velocity.per_unit", 98.4366),
        ];
        let text = corrected(&cia402(TEXT), &corrections).unwrap();
        let changed: Vec<_> = text
            .lines()
            .zip(TEXT.lines())
            .filter(|(new, old)| new != old)
            .map(|(new, _)| new.trim())
            .collect();
        assert_eq!(
            changed,
            [
                "target_velocity: {signal: TargetVelocity, per_unit: 98.4366} # rpm of the motor in 1 m/s",
                "actual_velocity: {signal: VelocityActual, per_unit: -940.0}",
            ]
        );
        assert_eq!(text.lines().count(), TEXT.lines().count());
    }

    #[test]
    fn a_value_that_is_shared_or_not_written_is_left_to_the_person() {
        let key = "cia402.drives[0].command.target_velocity.per_unit";
        let said = |text: &str| {
            let error = corrected(&cia402(text), &[correction(key, -940.0)]).unwrap_err();
            error.to_string()
        };
        let own = "target_velocity: {signal: TargetVelocity, per_unit: 940.0}";
        let shared = TEXT
            .replacen(own, &own.replace("{", "&v {"), 1)
            .replace(&format!("        {own}\n"), "        target_velocity: *v\n");
        assert_ne!(shared, TEXT);
        let expected = format!("cia402.yaml: {key}: is not written there by itself");
        assert!(said(&shared).starts_with(&expected), "{}", said(&shared));
        let absent = TEXT.replacen(", per_unit: 940.0}", "}", 1);
        assert!(said(&absent).starts_with(&expected), "{}", said(&absent));
    }
}
