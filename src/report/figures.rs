//! Numbers for people.

/// Returns a number with so many decimals, without a minus before zeros; a dash for what is not finite.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "\u{2013}".to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zeros) if zeros.chars().all(|c| c == '0' || c == '.') => zeros.to_owned(),
        _ => text,
    }
}

/// Returns the decimals that show two significant digits of a number, at most six.
pub(crate) fn decimals(value: f64) -> usize {
    let magnitude = value.abs().max(1e-9).log10().floor() as i32;
    usize::try_from(1 - magnitude).unwrap_or(0).min(6)
}

/// Returns a number with two significant digits, as far as three decimals show them; a dash for what is not finite.
pub(crate) fn significant(value: f64) -> String {
    fixed(value, decimals(value).min(3))
}

/// Returns a number with two significant digits, however small it is.
pub(crate) fn two_digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    fixed(value, decimals(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_have_no_sign() {
        assert_eq!(fixed(-0.0004, 3), "0.000");
        assert_eq!(fixed(-0.0, 0), "0");
        assert_eq!(fixed(-0.0006, 3), "-0.001");
        assert_eq!(significant(-1e-17), "0.000");
        assert_eq!(fixed(f64::NAN, 2), "\u{2013}");
    }

    #[test]
    fn two_digits_are_shown() {
        for (value, expected) in [
            (123.4, "123"),
            (1.234, "1.2"),
            (0.01234, "0.012"),
            (0.000_123_4, "0.00012"),
            (-2.55, "-2.5"),
            (0.0, "0"),
        ] {
            assert_eq!(two_digits(value), expected);
        }
    }
}
