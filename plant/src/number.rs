//! Texts that should be numbers.

/// Returns what is likely wrong with a text that should be a finite number, to follow a message that quotes it; nothing where
/// that is not seen.
///
/// ```
/// use sidehill_plant::number::likely_mistake;
///
/// assert_eq!(likely_mistake("12,5"), "; decimals are written with a point, thousands without a mark");
/// assert_eq!(likely_mistake("left"), "");
/// ```
pub fn likely_mistake(text: &str) -> &'static str {
    let text = text.trim();
    let digits = text.trim_start_matches(['-', '+']);
    if let Ok(number) = text.parse::<f64>() {
        match number.is_finite() {
            true => "",
            false => "; it must be finite",
        }
    } else if text.contains(',') && text.replace(['.', ','], "").parse::<f64>().is_ok() {
        "; decimals are written with a point, thousands without a mark"
    } else if matches!(text.to_lowercase().as_str(), "n/a" | "na" | "null" | "none") {
        "; what is not known is left empty in a CSV, and is the NODATA value in a grid"
    } else if text.starts_with('#') {
        "; a spreadsheet writes so what it cannot compute"
    } else if !digits.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        ""
    } else if text.contains(':') {
        "; a time is a number of seconds, with decimals, from any start"
    } else {
        "; write the number alone, without a unit, in the unit that the name says"
    }
}

#[cfg(test)]
mod tests {
    use super::likely_mistake;

    #[test]
    fn what_people_write_in_place_of_a_number_is_recognised() {
        for (texts, says) in [
            (&["0,5", "-1.234,5", "1,000.50", "3,2e-4"][..], "point"),
            (&["10:00:00.5", "2026-11-27T10:00:00Z"], "seconds"),
            (&["#DIV/0!", "#N/A"], "spreadsheet"),
            (&["N/A", " null"], "left empty"),
            (&["5.3°", "-1 m/s", ".5m", "45°30'N"], "unit"),
            (&["NaN", "inf", "1e400", "-nan"], "finite"),
        ] {
            for text in texts {
                assert!(
                    likely_mistake(text).contains(says),
                    "{text}: {}",
                    likely_mistake(text)
                );
            }
        }
        for text in ["", "forward", "-", "a,b", "-9999 "] {
            assert!(!likely_mistake(text).contains("point"), "{text}");
        }
    }
}
